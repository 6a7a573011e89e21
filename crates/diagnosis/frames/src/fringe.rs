//! Displacement between the colours of the real frame: red and blue against green, as a shift and a growth from the
//! middle. No effect of the library moves one colour alone. Units px at half the width.

use ds_effect::FrameChain;
use ds_effect::picture::Picture;
use nalgebra::{Matrix3, Vector3};

use crate::blocks::blocks;
use crate::geometry::moves;
use crate::scene::{Model, Scene};
use crate::settings;
use crate::warp::Grid;

/// Returns how far the colours lie apart beyond what the placed simulated frames have; 0 for grey streams.
#[must_use]
pub fn apart(scene: &Scene<'_>, model: &Model) -> f64 {
    if scene.small[0].0.channels != 3 {
        return 0.0;
    }
    let chain = FrameChain::new(&model.effects.iter().filter(|(e, _)| moves(e)).cloned().collect::<Vec<_>>());
    let mut fits = [Fit::default(), Fit::default(), Fit::default()];
    for k in scene.full.iter().filter(|k| **k >= model.blind) {
        let frame = scene.frames[*k];
        let context = scene.case.context(frame, 1, scene.case.depth_m.as_deref());
        let source = &scene.frames[k.saturating_sub(model.ages[*k])].sim;
        let placed = Grid::new(&chain, &context, model.shifts[*k]).apply(source);
        for (channel, fit) in fits.iter_mut().enumerate() {
            fit.add(&plane(&placed, channel), &plane(&frame.real, channel));
        }
    }
    let [red, green, blue] = fits.map(|f| f.solved());
    let half = scene.case.size[0] as f64 / 2.0;
    let far = |a: Vector3<f64>| {
        let d = a - green;
        (d[2] * half).abs().max(d[0].hypot(d[1]))
    };
    far(red).max(far(blue))
}

fn plane(picture: &Picture, channel: usize) -> Picture {
    let data = picture.data.iter().skip(channel).step_by(3).copied().collect();
    Picture { channels: 1, data, ..*picture }
}

/// Shift and growth of one channel.
#[derive(Default)]
struct Fit {
    m: Matrix3<f64>,
    v: Vector3<f64>,
}

impl Fit {
    fn add(&mut self, rendered: &Picture, real: &Picture) {
        let middle = [rendered.width as f64 / 2.0, rendered.height as f64 / 2.0];
        for b in blocks(rendered, real, settings::BLOCK_PX) {
            let [x, y] = [0, 1].map(|d| b.at[d] - middle[d]);
            // displacement = shift + growth (x, y)
            let [xx, xy, yy] = b.info;
            // one sharp block must not decide alone
            let trust = 1.0 / (1.0 + 0.02 * (xx + yy));
            let columns = [[1.0, 0.0], [0.0, 1.0], [x, y]];
            for i in 0..3 {
                let weighted = [columns[i][0] * xx + columns[i][1] * xy, columns[i][0] * xy + columns[i][1] * yy];
                for (j, column) in columns.iter().enumerate() {
                    self.m[(i, j)] += trust * (weighted[0] * column[0] + weighted[1] * column[1]);
                }
                self.v[i] += trust * (columns[i][0] * b.pull[0] + columns[i][1] * b.pull[1]);
            }
        }
    }

    fn solved(&self) -> Vector3<f64> {
        let mut m = self.m;
        for (k, prior) in [25.0, 25.0, 1e4].into_iter().enumerate() {
            m[(k, k)] += prior;
        }
        m.cholesky().map_or_else(Vector3::zeros, |c| c.solve(&self.v))
    }
}
