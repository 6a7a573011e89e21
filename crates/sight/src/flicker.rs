//! Brightness that changes from frame to frame: a field of ln gain (linear light) for each frame, bilinear on 3 x 3 knots.

use ds_effect::picture::{ENCODING, Picture};
use nalgebra::{SMatrix, SVector};

/// ln gain of light at the knots of one frame, rows from the top.
pub type Knots = [f64; 9];

/// The gain of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field(pub Knots);

impl Field {
    /// Scales light by the field.
    pub fn apply(&self, picture: &mut Picture) {
        let (width, height) = (picture.width, picture.height);
        picture.scale_light(|x, y| {
            let shares = shares(x, y, width, height);
            shares.iter().map(|(k, s)| self.0[*k] * s).sum::<f64>().exp() as f32
        });
    }

    /// Measures the field that turns the rendered into the real frame, with a prior of `sd` (ln) at each knot.
    #[must_use]
    pub fn measured(rendered: &Picture, real: &Picture, sd: f64) -> Self {
        let (p, q) = (rendered.grey(), real.grey());
        let mut m = SMatrix::<f64, 9, 9>::identity() / (sd * sd);
        let mut v = SVector::<f64, 9>::zeros();
        for y in 0..p.height {
            for x in 0..p.width {
                let k = y * p.width + x;
                let (a, b) = (f64::from(p.data[k]), f64::from(q.data[k]));
                if a < 12.0 || b > 250.0 || a > 250.0 {
                    continue;
                }
                let ratio = f64::from(ENCODING) * (b.max(1.0) / a).ln();
                // a small pixel counts by its error: about 3 % of light plus two levels
                let error = 0.03 + f64::from(ENCODING) * 2.0 / a;
                let weight = 0.1 / (error * error + ratio * ratio * 0.1);
                let shares = shares(x, y, p.width, p.height);
                for (i, s) in shares {
                    for (j, t) in shares {
                        m[(i, j)] += weight * s * t;
                    }
                    v[i] += weight * s * ratio;
                }
            }
        }
        let knots = m.cholesky().map_or(SVector::zeros(), |c| c.solve(&v));
        Self(std::array::from_fn(|k| knots[k]))
    }
}

/// Returns the four knots around a pixel and their shares.
fn shares(x: usize, y: usize, width: usize, height: usize) -> [(usize, f64); 4] {
    let (u, v) = (2.0 * (x as f64 + 0.5) / width as f64, 2.0 * (y as f64 + 0.5) / height as f64);
    let (i, j) = ((u as usize).min(1), (v as usize).min(1));
    let (a, b) = (u - i as f64, v - j as f64);
    let k = 3 * j + i;
    [(k, (1.0 - a) * (1.0 - b)), (k + 1, a * (1.0 - b)), (k + 3, (1.0 - a) * b), (k + 4, a * b)]
}
