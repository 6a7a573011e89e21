//! A z-buffered scanline rasteriser for triangles, bit-reproducible on one instruction set.
//!
//! Every pixel holds the value (a colour, a surface) of the nearest triangle that covers its centre. Two ways to
//! draw: `paint` covers whatever is there and leaves depth alone (ground layers, in painter's order), `fill` tests
//! and writes depth. Depth is kept as 1/z (1/m), which is linear on the screen; 0 is infinitely far. A pixel belongs
//! to a triangle if its centre lies inside; of two triangles that share an edge exactly one takes a pixel on it.

use crate::image::{ImageError, MAX_SIDE_PX};

/// A projected vertex: pixel coordinates from the top left corner, and 1/z in 1/m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScreenPoint {
    /// To the right, in pixels.
    pub x_px: f64,
    /// Downwards, in pixels.
    pub y_px: f64,
    /// The inverse of the depth along the optical axis, in 1/m; greater is nearer.
    pub inverse_depth: f64,
}

/// A buffer of pixel values with depth.
#[derive(Debug, Clone)]
pub struct DepthRaster<P> {
    width: usize,
    height: usize,
    values: Vec<P>,
    inverse_depths: Vec<f32>,
}

impl<P: Copy> DepthRaster<P> {
    /// Makes a buffer that holds `background` everywhere, infinitely far.
    ///
    /// # Errors
    /// If a side is 0 or over [`MAX_SIDE_PX`].
    pub fn new(width_px: u32, height_px: u32, background: P) -> Result<Self, ImageError> {
        if width_px == 0 || height_px == 0 || width_px > MAX_SIDE_PX || height_px > MAX_SIDE_PX {
            return Err(ImageError::Side { width_px, height_px });
        }
        let (width, height) = (width_px as usize, height_px as usize);
        let count = width * height;
        Ok(Self { width, height, values: vec![background; count], inverse_depths: vec![0.0; count] })
    }

    /// Returns the width, in pixels.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the height, in pixels.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Sets every pixel to the value given for its column and row, infinitely far.
    pub fn clear_with(&mut self, mut background: impl FnMut(usize, usize) -> P) {
        self.inverse_depths.fill(0.0);
        for (y, row) in self.values.chunks_exact_mut(self.width).enumerate() {
            for (x, value) in row.iter_mut().enumerate() {
                *value = background(x, y);
            }
        }
    }

    /// Returns the values, rows top to bottom.
    #[must_use]
    pub fn values(&self) -> &[P] {
        &self.values
    }

    /// Returns the inverse depths in 1/m, rows top to bottom; 0 where nothing was filled.
    #[must_use]
    pub fn inverse_depths(&self) -> &[f32] {
        &self.inverse_depths
    }

    /// Covers a triangle without looking at depth and without changing it.
    pub fn paint(&mut self, corners: &[ScreenPoint; 3], value: P) {
        let (width, values) = (self.width, &mut self.values);
        scan(self.width, self.height, corners, |y, from, to| values[y * width + from..y * width + to].fill(value));
    }

    /// Covers those pixels of a triangle that are nearer than what was filled before.
    pub fn fill(&mut self, corners: &[ScreenPoint; 3], value: P) {
        let Some(plane) = Plane::through(corners) else { return };
        let (width, values, depths) = (self.width, &mut self.values, &mut self.inverse_depths);
        scan(self.width, self.height, corners, |y, from, to| {
            let span = y * width + from..y * width + to;
            let mut inverse_depth = plane.at(from as f64 + 0.5, y as f64 + 0.5);
            for (pixel, depth) in values[span.clone()].iter_mut().zip(&mut depths[span]) {
                #[expect(clippy::cast_possible_truncation, reason = "depth is kept in single precision")]
                let here = inverse_depth.clamp(plane.least, plane.greatest) as f32;
                if here > *depth {
                    *depth = here;
                    *pixel = value;
                }
                inverse_depth += plane.per_x;
            }
        });
    }
}

/// 1/z as a linear function of the pixel, and its bounds on the triangle.
struct Plane {
    per_x: f64,
    per_y: f64,
    constant: f64,
    least: f64,
    greatest: f64,
}

impl Plane {
    fn through([a, b, c]: &[ScreenPoint; 3]) -> Option<Self> {
        let (bx, by, bw) = (b.x_px - a.x_px, b.y_px - a.y_px, b.inverse_depth - a.inverse_depth);
        let (cx, cy, cw) = (c.x_px - a.x_px, c.y_px - a.y_px, c.inverse_depth - a.inverse_depth);
        let area = bx * cy - by * cx;
        if area.abs() <= 1e-9 || area.is_nan() {
            return None;
        }
        let per_x = (bw * cy - cw * by) / area;
        let per_y = (cw * bx - bw * cx) / area;
        Some(Self {
            per_x,
            per_y,
            constant: a.inverse_depth - per_x * a.x_px - per_y * a.y_px,
            least: a.inverse_depth.min(b.inverse_depth).min(c.inverse_depth),
            greatest: a.inverse_depth.max(b.inverse_depth).max(c.inverse_depth),
        })
    }

    fn at(&self, x_px: f64, y_px: f64) -> f64 {
        self.constant + self.per_x * x_px + self.per_y * y_px
    }
}

/// Calls `row(y, from, to)` with the pixels `from..to` of each row whose centres lie inside the triangle.
fn scan(width: usize, height: usize, corners: &[ScreenPoint; 3], mut row: impl FnMut(usize, usize, usize)) {
    let mut sorted = *corners;
    sorted.sort_by(|a, b| a.y_px.total_cmp(&b.y_px).then(a.x_px.total_cmp(&b.x_px)));
    let [top, middle, bottom] = sorted;
    for y in first_centre(top.y_px, height)..first_centre(bottom.y_px, height) {
        let centre_y = y as f64 + 0.5;
        let long = crossing(&top, &bottom, centre_y);
        let short = if centre_y < middle.y_px {
            crossing(&top, &middle, centre_y)
        } else {
            crossing(&middle, &bottom, centre_y)
        };
        let (from, to) = (first_centre(long.min(short), width), first_centre(long.max(short), width));
        if from < to {
            row(y, from, to);
        }
    }
}

/// Returns the first pixel, up to `limit`, whose centre is not before `edge_px`.
fn first_centre(edge_px: f64, limit: usize) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "float casts saturate")]
    let first = (edge_px - 0.5).ceil().max(0.0) as usize;
    first.min(limit)
}

/// Returns where an edge crosses a row; both triangles of a shared edge compute the same number.
fn crossing(upper: &ScreenPoint, lower: &ScreenPoint, y_px: f64) -> f64 {
    upper.x_px + (y_px - upper.y_px) * ((lower.x_px - upper.x_px) / (lower.y_px - upper.y_px))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(x_px: f64, y_px: f64, depth_m: f64) -> ScreenPoint {
        ScreenPoint { x_px, y_px, inverse_depth: 1.0 / depth_m }
    }

    fn raster() -> DepthRaster<u8> {
        DepthRaster::new(32, 24, 0).expect("the size fits")
    }

    #[test]
    fn the_nearer_triangle_wins_in_either_order() {
        let near = [at(0.0, 0.0, 5.0), at(32.0, 0.0, 5.0), at(0.0, 24.0, 5.0)];
        let far = [at(0.0, 0.0, 9.0), at(32.0, 0.0, 9.0), at(32.0, 24.0, 9.0)];
        let mut first = raster();
        first.fill(&near, 1);
        first.fill(&far, 2);
        let mut second = raster();
        second.fill(&far, 2);
        second.fill(&near, 1);
        assert_eq!(first.values(), second.values());
        assert_eq!((first.values()[0], first.values()[31 + 12 * 32]), (1, 2));
    }

    #[test]
    fn depth_between_corners_is_that_of_the_plane() {
        // The plane z = 10 + u·5 with u = x/z: 1/z is linear on the screen.
        let mut r = raster();
        r.fill(&[at(0.0, 0.0, 10.0), at(32.0, 0.0, 20.0), at(0.0, 24.0, 10.0)], 1);
        let middle = f64::from(r.inverse_depths()[15]);
        let expected = 0.1 + (15.5 / 32.0) * (0.05 - 0.1);
        assert!((middle - expected).abs() < 1e-6, "{middle} is not {expected}");
    }

    #[test]
    fn what_is_not_a_triangle_draws_nothing() {
        for bad in [f64::NAN, f64::INFINITY] {
            let mut r = raster();
            r.fill(&[at(bad, 1.0, 5.0), at(bad, 9.0, 5.0), at(3.0, bad, 5.0)], 1);
            assert!(r.values().iter().all(|v| *v == 0), "{bad} was drawn");
        }
    }

    proptest! {
        #[test]
        fn a_fan_covers_every_pixel_of_a_rectangle_exactly_once(x in 1.0..31.0, y in 1.0..23.0) {
            let corners = [at(0.0, 0.0, 1.0), at(32.0, 0.0, 1.0), at(32.0, 24.0, 1.0), at(0.0, 24.0, 1.0)];
            let mut counts = [0u8; 32 * 24];
            for i in 0..4 {
                scan(32, 24, &[corners[i], corners[(i + 1) % 4], at(x, y, 1.0)], |row, from, to| {
                    counts[row * 32 + from..row * 32 + to].iter_mut().for_each(|c| *c += 1);
                });
            }
            prop_assert!(counts.iter().all(|c| *c == 1));
        }
    }
}
