//! What fixed places of the picture lose: real = clear rendered + (1 - clear) veil, block by block over all frames.

use ds_effect::picture::Picture;

/// Columns and rows of the map.
pub const SIZE: [usize; 2] = [52, 16];

/// A fixed map over the picture.
#[derive(Debug, Clone)]
pub struct Map {
    /// Gain of encoded values at each block, rows from the top.
    pub gain: Vec<f32>,
    /// Offset of encoded values, levels.
    pub offset: Vec<f32>,
}

impl Map {
    /// Measures the map from small pictures of all frames; a block that gains nothing stays clear.
    #[must_use]
    pub fn measured(rendered: &[Picture], real: &[Picture]) -> Self {
        let [columns, rows] = SIZE;
        let mut sums = vec![[0.0f64; 6]; columns * rows];
        for (p, q) in rendered.iter().zip(real) {
            let (p, q) = (p.grey(), q.grey());
            for y in 0..p.height {
                for x in 0..p.width {
                    let block = (y * rows / p.height) * columns + x * columns / p.width;
                    let (a, b) = (f64::from(p.data[y * p.width + x]), f64::from(q.data[y * p.width + x]));
                    if a > 251.0 && b > 251.0 {
                        continue;
                    }
                    let s = &mut sums[block];
                    for (s, v) in s.iter_mut().zip([1.0, a, b, a * a, a * b, b * b]) {
                        *s += v;
                    }
                }
            }
        }
        let mut map = Self { gain: vec![1.0; sums.len()], offset: vec![0.0; sums.len()] };
        for (k, [n, a, b, aa, ab, _]) in sums.into_iter().enumerate() {
            if n < 4.0 {
                continue;
            }
            let (mean_a, mean_b) = (a / n, b / n);
            let (var, cov) = (aa / n - mean_a * mean_a, ab / n - mean_a * mean_b);
            // a prior of 10 levels keeps the gain at one where the block never changes
            let gain = ((cov + 25.0) / (var + 25.0)).clamp(0.0, 1.1);
            map.gain[k] = gain as f32;
            map.offset[k] = (mean_b - gain * mean_a) as f32;
        }
        map
    }

    /// Applies the map, smooth between the middles of its blocks.
    pub fn apply(&self, picture: &mut Picture) {
        let [columns, rows] = SIZE;
        let (width, height, channels) = (picture.width, picture.height, picture.channels);
        for y in 0..height {
            let v = ((y as f32 + 0.5) * rows as f32 / height as f32 - 0.5).clamp(0.0, rows as f32 - 1.001);
            for x in 0..width {
                let u = ((x as f32 + 0.5) * columns as f32 / width as f32 - 0.5).clamp(0.0, columns as f32 - 1.001);
                let (i, j) = (u as usize, v as usize);
                let (a, b) = (u - i as f32, v - j as f32);
                let mix = |m: &[f32]| {
                    let k = j * columns + i;
                    (1.0 - b) * ((1.0 - a) * m[k] + a * m[k + 1])
                        + b * ((1.0 - a) * m[k + columns] + a * m[k + columns + 1])
                };
                let (gain, offset) = (mix(&self.gain), mix(&self.offset));
                for value in &mut picture.data[(y * width + x) * channels..(y * width + x + 1) * channels] {
                    *value = (*value * gain + offset).clamp(0.0, 255.0);
                }
            }
        }
    }
}
