//! Brightness that changes from frame to frame: a field of ln gain (linear light) for each frame, bilinear on
//! 9 x 5 knots.

use ds_effect::picture::{ENCODING, Picture};
use nalgebra::{DMatrix, DVector};

/// Columns and rows of knots.
const KNOTS: [usize; 2] = [9, 5];
/// Number of knots.
pub const COUNT: usize = KNOTS[0] * KNOTS[1];

/// ln gain of light at the knots of one frame, rows from the top.
pub type Knots = [f64; COUNT];

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
        let mut m = DMatrix::<f64>::identity(COUNT, COUNT) / (sd * sd);
        let mut v = DVector::<f64>::zeros(COUNT);
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
        let knots = m.cholesky().map_or(DVector::zeros(COUNT), |c| c.solve(&v));
        Self(std::array::from_fn(|k| knots[k]))
    }
}

/// Returns the four knots around a pixel and their shares.
fn shares(x: usize, y: usize, width: usize, height: usize) -> [(usize, f64); 4] {
    let (u, v) = ((x as f64 + 0.5) / width as f64, (y as f64 + 0.5) / height as f64);
    let (u, v) = (u * (KNOTS[0] - 1) as f64, v * (KNOTS[1] - 1) as f64);
    let (i, j) = ((u as usize).min(KNOTS[0] - 2), (v as usize).min(KNOTS[1] - 2));
    let (a, b) = (u - i as f64, v - j as f64);
    let k = KNOTS[0] * j + i;
    [(k, (1.0 - a) * (1.0 - b)), (k + 1, a * (1.0 - b)), (k + KNOTS[0], (1.0 - a) * b), (k + KNOTS[0] + 1, a * b)]
}

/// What fields look like over time.
#[derive(Debug, Clone, Copy)]
pub struct Pattern {
    /// Spread from frame to frame, ln.
    pub sd: f64,
    /// Share of energy that is the same in all frames.
    pub fixed: f64,
    /// Correlation of a frame with the next one, after the mean is taken out.
    pub lasting: f64,
}

/// Describes fields over time.
#[must_use]
pub fn pattern(fields: &[Field]) -> Pattern {
    let n = fields.len() as f64;
    let mean: Knots = std::array::from_fn(|k| fields.iter().map(|f| f.0[k]).sum::<f64>() / n);
    let product = |a: &Field, b: &Field| (0..COUNT).map(|k| (a.0[k] - mean[k]) * (b.0[k] - mean[k])).sum::<f64>();
    let moving: f64 = fields.iter().map(|f| product(f, f)).sum();
    let next: f64 = fields.windows(2).map(|w| product(&w[0], &w[1])).sum();
    let fixed = n * mean.iter().map(|m| m * m).sum::<f64>();
    Pattern {
        sd: (moving / ((n - 1.0).max(1.0) * COUNT as f64)).sqrt(),
        fixed: fixed / (fixed + moving).max(1e-12),
        lasting: next / moving.max(1e-12),
    }
}
