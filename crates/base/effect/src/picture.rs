//! A plain picture of floats and the operations that effects on frames share: samples, light, blurs, warps.
//!
//! Values are encoded grey levels 0 to 255, rows from the top, channels interleaved. Linear light is (encoded / 255)^2.2.

/// Exponent between encoded values and linear light.
pub const ENCODING: f32 = 2.2;

/// A picture; every value may be any number, [`Picture::clip`] brings it back to what a file can hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 1 (grey) or 3 (red, green, blue).
    pub channels: usize,
    /// `height * width * channels` encoded values.
    pub data: Vec<f32>,
}

/// Returns linear light (white is 1) of an encoded value.
#[must_use]
#[inline]
pub fn light_of(encoded: f32) -> f32 {
    power(encoded.max(0.0) * (1.0 / 255.0), ENCODING)
}

/// Returns the encoded value of linear light.
#[must_use]
#[inline]
pub fn encoded_of(light: f32) -> f32 {
    255.0 * power(light.max(0.0), 1.0 / ENCODING)
}

/// Returns `x` to the power `y` for `x` from 0 to 1e30, within 3e-6 of the value, the same on every machine and several
/// times as fast as the system's.
#[must_use]
#[inline]
pub fn power(x: f32, y: f32) -> f32 {
    // x = m 2^e with m within a factor of the square root of two of 1
    const ROOT: u32 = 0x3f35_04f3;
    const ROUND: f32 = 12_582_912.0;
    let bits = x.max(1e-30).to_bits();
    let e = (bits.wrapping_sub(ROOT) as i32) >> 23;
    let f = f32::from_bits(bits.wrapping_sub((e << 23) as u32)) - 1.0;
    let s = f / (2.0 + f);
    let z = s * s;
    let ln = 2.0 * s * (1.0 + z * (1.0 / 3.0 + z * (0.2 + z * (1.0 / 7.0 + z * (1.0 / 9.0)))));
    let t = (y * (ln * std::f32::consts::LOG2_E + e as f32)).clamp(-126.0, 126.0);
    let k = (t + ROUND) - ROUND;
    let r = (t - k) * std::f32::consts::LN_2;
    let near = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0))))));
    near * f32::from_bits(((k as i32 + 127) << 23) as u32)
}

impl Picture {
    /// Makes a picture of one value.
    #[must_use]
    pub fn filled(width: usize, height: usize, channels: usize, value: f32) -> Self {
        Self { width, height, channels, data: vec![value; width * height * channels] }
    }

    /// Limits every value to 0 to 255.
    pub fn clip(&mut self) {
        for value in &mut self.data {
            *value = value.clamp(0.0, 255.0);
        }
    }

    /// Returns the value of a pixel; places outside repeat the border.
    #[must_use]
    pub fn at(&self, x: isize, y: isize, channel: usize) -> f32 {
        let x = x.clamp(0, self.width as isize - 1) as usize;
        let y = y.clamp(0, self.height as isize - 1) as usize;
        self.data[(y * self.width + x) * self.channels + channel]
    }

    /// Returns the brightness, 0.299 R + 0.587 G + 0.114 B, as a grey picture.
    #[must_use]
    pub fn grey(&self) -> Self {
        if self.channels == 1 {
            return self.clone();
        }
        let data = self.data.chunks_exact(3).map(|p| 0.299 * p[0] + 0.587 * p[1] + 0.114 * p[2]).collect();
        Self { width: self.width, height: self.height, channels: 1, data }
    }

    /// Edits every pixel in linear light; the closure gets column, row and the channels.
    pub fn edit_light(&mut self, mut edit: impl FnMut(usize, usize, &mut [f32])) {
        let (width, channels) = (self.width, self.channels);
        let mut light = [0.0f32; 3];
        for (k, pixel) in self.data.chunks_exact_mut(channels).enumerate() {
            for (l, v) in light.iter_mut().zip(&*pixel) {
                *l = light_of(*v);
            }
            edit(k % width, k / width, &mut light[..channels]);
            for (v, l) in pixel.iter_mut().zip(light) {
                *v = encoded_of(l).min(255.0);
            }
        }
    }

    /// Scales linear light by a factor of the place; cheaper than [`Picture::edit_light`].
    pub fn scale_light(&mut self, mut factor: impl FnMut(usize, usize) -> f32) {
        let (width, channels) = (self.width, self.channels);
        for (k, pixel) in self.data.chunks_exact_mut(channels).enumerate() {
            let gain = power(factor(k % width, k / width).max(0.0), 1.0 / ENCODING);
            for value in pixel {
                *value = (*value * gain).min(255.0);
            }
        }
    }

    /// Averages `factor` x `factor` pixels into one; what does not fill a block is left out.
    #[must_use]
    pub fn shrunk(&self, factor: usize) -> Self {
        let (width, height, c) = (self.width / factor, self.height / factor, self.channels);
        let mut data = vec![0.0; width * height * c];
        for y in 0..height * factor {
            let row = &self.data[y * self.width * c..(y + 1) * self.width * c];
            let out = &mut data[(y / factor) * width * c..(y / factor + 1) * width * c];
            for x in 0..width * factor {
                for k in 0..c {
                    out[x / factor * c + k] += row[x * c + k];
                }
            }
        }
        let scale = 1.0 / (factor * factor) as f32;
        data.iter_mut().for_each(|v| *v *= scale);
        Self { width, height, channels: c, data }
    }

    /// Resamples: the result at a pixel is the picture at `place(x, y)`, by cubic convolution (Keys 1981, a = -1/2).
    #[must_use]
    pub fn warped(&self, mut place: impl FnMut(usize, usize) -> [f32; 2]) -> Self {
        let c = self.channels;
        let (width, height) = (self.width as i32, self.height as i32);
        let mut data = Vec::with_capacity(self.data.len());
        for y in 0..self.height {
            for x in 0..self.width {
                let [u, v] = place(x, y).map(|p| p.clamp(-1e6, 1e6));
                let (fu, fv) = (below(u), below(v));
                let (wx, wy) = (cubic(u - fu as f32), cubic(v - fv as f32));
                let (ix, iy) = (fu - 1, fv - 1);
                let inside = ix >= 0 && iy >= 0 && ix + 4 <= width && iy + 4 <= height;
                let start = if inside { (iy as usize * self.width + ix as usize) * c } else { 0 };
                for k in 0..c {
                    let mut sum = 0.0;
                    for (j, wy) in wy.iter().enumerate() {
                        let line = if inside {
                            let at = start + j * self.width * c + k;
                            let row = &self.data[at..=at + 3 * c];
                            wx[0] * row[0] + wx[1] * row[c] + wx[2] * row[2 * c] + wx[3] * row[3 * c]
                        } else {
                            let row = |i: usize| self.at(ix as isize + i as isize, iy as isize + j as isize, k);
                            wx[0] * row(0) + wx[1] * row(1) + wx[2] * row(2) + wx[3] * row(3)
                        };
                        sum += wy * line;
                    }
                    data.push(sum);
                }
            }
        }
        Self { width: self.width, height: self.height, channels: c, data }
    }

    /// Resamples as [`Picture::warped`] with one offset for every pixel, axis by axis.
    #[must_use]
    pub fn shifted(&self, by: [f32; 2]) -> Self {
        self.slipped(by[0], true).slipped(by[1], false)
    }

    fn slipped(&self, by: f32, across: bool) -> Self {
        let whole = below(by.clamp(-1e6, 1e6));
        let weights = cubic(by - whole as f32);
        let (c, width, height) = (self.channels, self.width as isize, self.height as isize);
        let mut data = vec![0.0f32; self.data.len()];
        let line = self.width * c;
        for (tap, weight) in (0isize..).zip(weights) {
            let step = whole as isize - 1 + tap;
            for y in 0..height {
                let from = if across { y } else { (y + step).clamp(0, height - 1) } as usize * line;
                let (row, out) = (&self.data[from..from + line], &mut data[y as usize * line..][..line]);
                if !across {
                    out.iter_mut().zip(row).for_each(|(o, v)| *o += weight * v);
                    continue;
                }
                let (start, end) = ((-step).clamp(0, width) as usize, (width - step).clamp(0, width) as usize);
                if start < end {
                    let shift = (start as isize + step) as usize * c;
                    out[start * c..end * c].iter_mut().zip(&row[shift..]).for_each(|(o, v)| *o += weight * v);
                }
                for (x, edge) in
                    (0..start.min(self.width)).map(|x| (x, 0)).chain((end..self.width).map(|x| (x, line - c)))
                {
                    for k in 0..c {
                        out[x * c + k] += weight * row[edge + k];
                    }
                }
            }
        }
        Self { data, ..*self }
    }

    /// Averages linear light over taps (offset in px, weight) that the closure lists for each pixel.
    #[must_use]
    pub fn spread(&self, mut taps: impl FnMut(usize, usize, &mut Vec<([f32; 2], f32)>)) -> Self {
        let light: Vec<f32> = self.data.iter().map(|v| light_of(*v)).collect();
        let light = Self { data: light, ..self.clone() };
        let (mut list, mut out) = (Vec::new(), self.clone());
        for (k, pixel) in out.data.chunks_exact_mut(self.channels).enumerate() {
            let (x, y) = (k % self.width, k / self.width);
            list.clear();
            taps(x, y, &mut list);
            let total: f32 = list.iter().map(|(_, weight)| weight).sum();
            for (channel, value) in pixel.iter_mut().enumerate() {
                let sum: f32 = list.iter().map(|(by, weight)| weight * light.between(x, y, *by, channel)).sum();
                *value = encoded_of(sum / total);
            }
        }
        out
    }

    /// Averages linear light over taps (whole-pixel offset, weight) that are the same for every pixel.
    #[must_use]
    pub fn convolved(&self, taps: &[([isize; 2], f32)]) -> Self {
        let (c, width) = (self.channels, self.width as isize);
        let light: Vec<f32> = self.data.iter().map(|v| light_of(*v)).collect();
        let total: f32 = taps.iter().map(|(_, weight)| weight).sum();
        let mut sums = vec![0.0f32; light.len()];
        for ([dx, dy], weight) in taps {
            let weight = weight / total;
            for y in 0..self.height {
                let from = (y as isize + dy).clamp(0, self.height as isize - 1) as usize * self.width * c;
                let row = &light[from..from + self.width * c];
                let out = &mut sums[y * self.width * c..(y + 1) * self.width * c];
                let (start, end) = ((-dx).clamp(0, width) as usize, (width - dx).clamp(0, width) as usize);
                if start < end {
                    let shift = (start as isize + dx) as usize * c;
                    for (o, l) in out[start * c..end * c].iter_mut().zip(&row[shift..]) {
                        *o += weight * l;
                    }
                }
                for (x, edge) in (0..start).map(|x| (x, 0)).chain((end..self.width).map(|x| (x, self.width - 1))) {
                    for k in 0..c {
                        out[x * c + k] += weight * row[edge * c + k];
                    }
                }
            }
        }
        sums.iter_mut().for_each(|v| *v = encoded_of(*v));
        Self { data: sums, ..*self }
    }

    /// Returns the value at an offset from a pixel, linear in between.
    fn between(&self, x: usize, y: usize, by: [f32; 2], channel: usize) -> f32 {
        let (u, v) = (x as f32 + by[0], y as f32 + by[1]);
        let (i, j) = (below(u) as isize, below(v) as isize);
        let (a, b) = (u - i as f32, v - j as f32);
        if a == 0.0 && b == 0.0 {
            return self.at(i, j, channel);
        }
        let row = |j: isize| (1.0 - a) * self.at(i, j, channel) + a * self.at(i + 1, j, channel);
        (1.0 - b) * row(j) + b * row(j + 1)
    }

    /// Averages over a box of `2 radius + 1` pixels a side, borders repeated.
    #[must_use]
    pub fn boxed(&self, radius: usize) -> Self {
        let across = self.slid(radius, true);
        across.slid(radius, false)
    }

    fn slid(&self, radius: usize, across: bool) -> Self {
        let c = self.channels;
        let (lines, length) = if across { (self.height, self.width) } else { (self.width, self.height) };
        let (line_step, step) = if across { (self.width * c, c) } else { (c, self.width * c) };
        let mut data = vec![0.0; self.data.len()];
        let scale = 1.0 / (2 * radius + 1) as f32;
        let r = radius as isize;
        for line in 0..lines {
            for k in 0..c {
                let base = line * line_step + k;
                let value = |i: isize| self.data[base + i.clamp(0, length as isize - 1) as usize * step];
                let mut sum: f32 = (-r..=r).map(value).sum();
                for i in 0..length {
                    data[base + i * step] = sum * scale;
                    sum += value(i as isize + r + 1) - value(i as isize - r);
                }
            }
        }
        Self { width: self.width, height: self.height, channels: c, data }
    }
}

/// Returns the largest whole number that is not above a value.
fn below(v: f32) -> i32 {
    let whole = v as i32;
    whole - i32::from(whole as f32 > v)
}

/// Returns the four weights of cubic convolution at fraction `t` behind the second sample.
fn cubic(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-0.5 * t3 + t2 - 0.5 * t, 1.5 * t3 - 2.5 * t2 + 1.0, -1.5 * t3 + 2.0 * t2 + 0.5 * t, 0.5 * t3 - 0.5 * t2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_whole_step_is_exact_and_half_a_step_keeps_a_ramp() {
        let data = (0..80).map(|k| (k % 10) as f32 * 3.0).collect();
        let ramp = Picture { width: 10, height: 8, channels: 1, data };
        let moved = ramp.warped(|x, y| [x as f32 + 0.5, y as f32]);
        assert!((moved.at(4, 4, 0) - 13.5).abs() < 1e-4);
        assert_eq!(ramp.warped(|x, y| [x as f32 + 1.0, y as f32]).at(3, 2, 0), ramp.at(4, 2, 0));
    }

    #[test]
    fn one_offset_for_all_is_the_same_by_axis() {
        let data = (0..240).map(|k| ((k * 37) % 101) as f32).collect();
        let picture = Picture { width: 10, height: 8, channels: 3, data };
        for by in [[0.3f32, -1.6], [-4.2, 0.0], [12.5, 9.1]] {
            let warped = picture.warped(|x, y| [x as f32 + by[0], y as f32 + by[1]]);
            let shifted = picture.shifted(by);
            assert!(warped.data.iter().zip(&shifted.data).all(|(a, b)| (a - b).abs() < 1e-3), "{by:?}");
        }
    }

    #[test]
    fn powers_are_those_of_the_system() {
        for k in 1..2000 {
            let x = 0.000_7 * k as f32;
            for y in [ENCODING, 1.0 / ENCODING, 3.5] {
                assert!((power(x, y) / x.powf(y) - 1.0).abs() < 3e-6, "{x}^{y}: {} {}", power(x, y), x.powf(y));
            }
        }
        assert!(power(1.0, ENCODING).to_bits() == 1f32.to_bits() && power(0.0, ENCODING) < 1e-30);
    }

    #[test]
    fn kernels_wider_than_the_picture_repeat_its_border() {
        let narrow = Picture { width: 2, height: 1, channels: 1, data: vec![40.0, 80.0] };
        let far = narrow.convolved(&[([5, 0], 1.0)]);
        assert!(far.data.iter().all(|v| (v - 80.0).abs() < 1e-3), "{:?}", far.data);
        let back = narrow.convolved(&[([-5, 3], 1.0)]);
        assert!(back.data.iter().all(|v| (v - 40.0).abs() < 1e-3), "{:?}", back.data);
    }

    #[test]
    fn boxes_keep_the_mean_of_a_constant() {
        let flat = Picture::filled(9, 7, 3, 40.0);
        assert!(flat.boxed(2).data.iter().all(|v| (v - 40.0).abs() < 1e-3));
    }
}
