//! What is left in flat places: white noise by brightness, and signs that it is not white (streaks).
//!
//! Variances in levels² of encoded values; only pixels whose neighbourhood in the rendered frame is flat are looked at.

use ds_effect::picture::Picture;

use crate::scene::{Model, Scene};
use crate::settings;

/// Largest step to a neighbour in a flat place, levels.
const FLAT: f32 = 3.0;

/// Noise that a model adds to that of every case.
#[derive(Debug, Clone, Copy, Default)]
pub struct Grain {
    /// Variance everywhere.
    pub read: f64,
    /// Variance added at white; in proportion below.
    pub shot: f64,
}

impl Grain {
    /// Returns the noise of a model.
    #[must_use]
    pub fn of_model(model: &Model) -> Self {
        let noise = model.values("sensor_noise").map_or([0.0; 2], |v| [v[0] * v[0], v[1] * v[1]]);
        // streaks of a given count and strength, a tenth of the height long, as mean energy
        let rain = model.values("rain_streaks").map_or(0.0, |v| v[2]);
        Self { read: noise[0] + rain, shot: noise[1] }
    }

    /// Returns the variance at an encoded brightness.
    #[must_use]
    pub fn variance(&self, light: f64) -> f64 {
        self.read + self.shot * light / 255.0
    }
}

/// What the residual of flat places looks like.
#[derive(Debug, Clone, Copy, Default)]
pub struct Texture {
    /// Variance at black, levels².
    pub read: f64,
    /// Variance added at white, levels².
    pub shot: f64,
    /// Correlation with the pixel below.
    pub down: f64,
    /// Correlation with the pixel to the right.
    pub across: f64,
    /// Third moment over the 3/2 power of the second.
    pub skew: f64,
    /// Fourth moment over the square of the second, minus 3.
    pub peak: f64,
    /// Robust variance (squared median size) of the worst brightness, levels².
    pub middle: f64,
    /// Pixels looked at.
    pub count: f64,
}

/// Looks at the flat places of full pictures.
#[must_use]
pub fn texture(scene: &Scene<'_>, full: &[Picture]) -> Texture {
    const BINS: usize = 8;
    let mut bins = [[0.0f64; 3]; BINS];
    let mut sizes = [[0u32; 64]; BINS];
    let (mut s2, mut s3, mut s4, mut down, mut across, mut n) = (0.0f64, 0.0, 0.0, 0.0, 0.0, 0.0);
    for (at, k) in scene.full.iter().enumerate() {
        let (p, q) = (&full[at], &scene.grey[*k].1);
        let w = p.width;
        let mut r = Picture { data: q.data.iter().zip(&p.data).map(|(q, p)| q - p).collect(), ..p.clone() };
        let smooth = r.boxed(3);
        r.data.iter_mut().zip(&smooth.data).for_each(|(r, s)| *r -= s);
        for y in 2..p.height - 3 {
            for x in 2..w - 3 {
                let k = y * w + x;
                let v = p.data[k];
                let flat = [k - 2, k + 2, k - 2 * w, k + 2 * w, k - 1, k + 1, k - w, k + w]
                    .iter()
                    .all(|i| (p.data[*i] - v).abs() < FLAT);
                if !flat || !(6.0..246.0).contains(&v) {
                    continue;
                }
                let e = f64::from(r.data[k]);
                let bin = &mut bins[(v as usize * BINS / 256).min(BINS - 1)];
                sizes[(v as usize * BINS / 256).min(BINS - 1)][((e.abs() * 4.0) as usize).min(63)] += 1;
                bin[0] += 1.0;
                bin[1] += e * e;
                bin[2] += f64::from(v);
                n += 1.0;
                s2 += e * e;
                s3 += e * e * e;
                s4 += e * e * e * e;
                down += e * f64::from(r.data[k + w]);
                across += e * f64::from(r.data[k + 1]);
            }
        }
    }
    if n < 50.0 {
        return Texture { read: settings::LEAST_NOISE, ..Texture::default() };
    }
    let (read, shot) = line(&bins);
    let v = s2 / n;
    Texture {
        read,
        shot,
        down: down / s2,
        across: across / s2,
        skew: s3 / n / v.powf(1.5),
        peak: s4 / n / (v * v) - 3.0,
        middle: sizes.iter().map(robust_variance).fold(0.0, f64::max),
        count: n,
    }
}

/// Returns the variance of a normal distribution with the median size of a histogram in quarter levels.
fn robust_variance(sizes: &[u32; 64]) -> f64 {
    let total: u32 = sizes.iter().sum();
    if total < 300 {
        return 0.0;
    }
    let mut below = 0;
    let median = sizes.iter().position(|n| {
        below += n;
        2 * below >= total
    });
    (1.4826 * (median.unwrap_or(0) as f64 + 0.5) * 0.25).powi(2)
}

/// Fits variance = read + shot brightness / 255 to bins of (count, squares, brightness); neither below zero.
fn line(bins: &[[f64; 3]]) -> (f64, f64) {
    let (mut sw, mut sx, mut sy, mut sxx, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for [n, squares, light] in bins.iter().filter(|b| b[0] > 30.0) {
        let (x, y, w) = (light / n / 255.0, squares / n, n.sqrt());
        sw += w;
        sx += w * x;
        sy += w * y;
        sxx += w * x * x;
        sxy += w * x * y;
    }
    let det = sw * sxx - sx * sx;
    let (mut shot, mean) = (if det > 1e-6 * sw * sw { (sw * sxy - sx * sy) / det } else { 0.0 }, sx / sw.max(1e-9));
    shot = shot.max(0.0);
    let read = sy / sw.max(1e-9) - shot * mean;
    if read < 0.0 { (0.0, sxy / sxx.max(1e-9)) } else { (read, shot) }
}
