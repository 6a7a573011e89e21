//! What fixed places of the picture lose: real = clear rendered + (1 - clear) veil, block by block over all frames.

use ds_effect::picture::Picture;

/// Columns and rows of the map.
pub const SIZE: [usize; 2] = [52, 16];

/// Gain below which a place counts as dirty.
const LOSSY: f32 = 0.88;

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
        let seen: Vec<bool> = sums.iter().map(|s| s[0] >= 4.0).collect();
        for (k, [n, a, b, aa, ab, _]) in sums.into_iter().enumerate() {
            if !seen[k] {
                continue;
            }
            let (mean_a, mean_b) = (a / n, b / n);
            let (var, cov) = (aa / n - mean_a * mean_a, ab / n - mean_a * mean_b);
            // a prior of 10 levels keeps the gain at one where the block never changes
            let gain = ((cov + 25.0) / (var + 25.0)).clamp(0.0, 1.1);
            map.gain[k] = gain as f32;
            map.offset[k] = (mean_b - gain * mean_a) as f32;
        }
        map.bridge(&seen);
        map
    }

    /// Gives blocks that no pixel fell into, as in pictures narrower than the map, what lies beside them in their row.
    fn bridge(&mut self, seen: &[bool]) {
        for k in (0..seen.len()).filter(|k| !seen[*k]) {
            let row = k - k % SIZE[0];
            let left = (row..k).rev().find(|j| seen[*j]);
            let right = (k..row + SIZE[0]).find(|j| seen[*j]);
            for values in [&mut self.gain, &mut self.offset] {
                let mean = match (left, right) {
                    (Some(a), Some(b)) => 0.5 * (values[a] + values[b]),
                    (Some(a), None) | (None, Some(a)) => values[a],
                    (None, None) => continue,
                };
                values[k] = mean;
            }
        }
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

/// What a map looks like.
#[derive(Debug, Clone, Copy)]
pub struct Spots {
    /// Connected places that lose something.
    pub count: usize,
    /// Share of the picture that they cover.
    pub area: f64,
    /// Largest loss of gain.
    pub opacity: f64,
    /// What is seen where the lens is dirty, levels.
    pub veil: f64,
}

impl Map {
    /// Leaves everything clear that is not in or beside a place that loses something.
    pub fn keep_spots(&mut self) {
        let [columns, rows] = SIZE;
        let lossy: Vec<bool> = self.gain.iter().map(|g| *g < LOSSY).collect();
        for k in 0..lossy.len() {
            let (x, y) = (k % columns, k / columns);
            let near = |v: usize, most: usize| v.saturating_sub(1)..(v + 2).min(most);
            if !near(y, rows).any(|j| near(x, columns).any(|i| lossy[j * columns + i])) {
                (self.gain[k], self.offset[k]) = (1.0, 0.0);
            }
        }
    }

    /// Finds the connected places whose gain is clearly below one.
    #[must_use]
    pub fn spots(&self) -> Spots {
        let [columns, rows] = SIZE;
        let mut seen = vec![false; columns * rows];
        let lossy = |k: usize| self.gain[k] < LOSSY;
        let (mut count, mut covered, mut opacity, mut veil) = (0, 0usize, 0.0f32, 0.0f32);
        for first in 0..seen.len() {
            if seen[first] || !lossy(first) {
                continue;
            }
            let (mut stack, mut size) = (vec![first], 0usize);
            seen[first] = true;
            while let Some(k) = stack.pop() {
                size += 1;
                covered += 1;
                opacity = opacity.max(1.0 - self.gain[k]);
                veil += self.offset[k] / (1.0 - self.gain[k]);
                let (x, y) = (k % columns, k / columns);
                let sides = [(x > 0, k.wrapping_sub(1)), (x + 1 < columns, k + 1)];
                let ends = [(y > 0, k.wrapping_sub(columns)), (y + 1 < rows, k + columns)];
                for (_, next) in sides.into_iter().chain(ends).filter(|(inside, _)| *inside) {
                    if !seen[next] && lossy(next) {
                        seen[next] = true;
                        stack.push(next);
                    }
                }
            }
            count += usize::from(size >= 2);
        }
        Spots {
            count,
            area: covered as f64 / seen.len() as f64,
            opacity: f64::from(opacity),
            veil: f64::from(veil / covered.max(1) as f32),
        }
    }
}

impl Map {
    /// Returns the places that are not clear as (place, gain, offset) one after the other.
    #[must_use]
    pub fn listed(&self) -> Vec<f64> {
        (0..self.gain.len())
            .filter(|k| self.gain[*k] < 1.0 || self.offset[*k] != 0.0)
            .flat_map(|k| [k as f64, f64::from(self.gain[k]), f64::from(self.offset[k])])
            .collect()
    }

    /// Makes a map of such a list; what lies outside of the map is left out.
    #[must_use]
    pub fn from_list(list: &[f64]) -> Self {
        let count = SIZE[0] * SIZE[1];
        let mut map = Self { gain: vec![1.0; count], offset: vec![0.0; count] };
        for place in list.chunks_exact(3) {
            let k = place[0].max(0.0) as usize;
            if k < count {
                (map.gain[k], map.offset[k]) = (place[1] as f32, place[2] as f32);
            }
        }
        map
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_narrower_than_the_map_leave_no_clear_stripes() {
        let (width, height) = (40, 24);
        let picture = |frame: usize, share: f32| Picture {
            width,
            height,
            channels: 1,
            data: (0..width * height).map(|k| share * (40.0 + ((k * 7 + frame * 31) % 150) as f32)).collect(),
        };
        let clear: Vec<Picture> = (0..20).map(|frame| picture(frame, 1.0)).collect();
        let dirty: Vec<Picture> = (0..20).map(|frame| picture(frame, 0.5)).collect();
        let map = Map::measured(&clear, &dirty);
        assert!(map.gain.iter().all(|gain| (gain - 0.5).abs() < 0.1), "{:?}", map.gain);
    }
}
