//! Displacement of a frame on a coarse grid: geometry effects vary slowly over the picture, so that they are evaluated
//! every few pixels and interpolated linearly in between. Units px of the picture that is warped.

use ds_effect::FrameChain;
use ds_effect::frame::FrameContext;
use ds_effect::picture::Picture;

/// Distance of nodes, px.
const STEP: usize = 8;

/// Where in the source each node of a grid looks, as an offset.
#[derive(Debug, Clone)]
pub struct Grid {
    columns: usize,
    nodes: Vec<[f32; 2]>,
    shift: Option<[f32; 2]>,
}

impl Grid {
    /// Evaluates the warps of a chain and adds a shift.
    #[must_use]
    pub fn new(chain: &FrameChain, context: &FrameContext<'_>, shift: [f64; 2]) -> Self {
        let [width, height] = context.size;
        let (columns, rows) = (width / STEP + 2, height / STEP + 2);
        if !chain.warps() {
            return Self { columns, nodes: Vec::new(), shift: Some(shift.map(|s| s as f32)) };
        }
        let mut nodes = Vec::with_capacity(columns * rows);
        for j in 0..rows {
            for i in 0..columns {
                let at = [(i * STEP) as f64, (j * STEP) as f64];
                let from = chain.source_of(context, at);
                nodes.push([(from[0] - at[0] + shift[0]) as f32, (from[1] - at[1] + shift[1]) as f32]);
            }
        }
        Self { columns, nodes, shift: None }
    }

    /// Returns the offset at a pixel.
    #[must_use]
    pub fn at(&self, x: usize, y: usize) -> [f32; 2] {
        if let Some(shift) = self.shift {
            return shift;
        }
        let (i, j) = (x / STEP, y / STEP);
        let (a, b) = ((x % STEP) as f32 / STEP as f32, (y % STEP) as f32 / STEP as f32);
        let k = j * self.columns + i;
        let (n, m) = (&self.nodes[k..k + 2], &self.nodes[k + self.columns..k + self.columns + 2]);
        std::array::from_fn(|d| {
            (1.0 - b) * ((1.0 - a) * n[0][d] + a * n[1][d]) + b * ((1.0 - a) * m[0][d] + a * m[1][d])
        })
    }

    /// Resamples a picture.
    #[must_use]
    pub fn apply(&self, picture: &Picture) -> Picture {
        if let Some(shift) = self.shift {
            return picture.shifted(shift);
        }
        picture.warped(|x, y| {
            let d = self.at(x, y);
            [x as f32 + d[0], y as f32 + d[1]]
        })
    }
}
