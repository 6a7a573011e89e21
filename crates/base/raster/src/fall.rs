//! Falling snow and rain: which share of each pixel flakes and streaks cover, drawn anew at each tick.
//!
//! Draws are keyed by a digest, a seed and the tick. Sizes follow from a distance before the camera (metres) and the focal length
//! (pixels), so that a larger picture shows the same fall.

use ds_space::{Digest, Draws, Intrinsics, Tick};

use crate::image::RgbImage;

/// Flakes in a field of view as wide and high as the focal length, where they fall heavily.
const FLAKES: f64 = 620.0;
/// Streaks of rain in the same.
const STREAKS: f64 = 300.0;

/// Pixels to each side of a speck that it is compared with.
const SPECK_REACH: usize = 3;
/// By how much a speck is brighter, of 255.
const SPECK: u32 = 12;

/// What falls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Falling {
    /// Flakes of snow.
    Snow,
    /// Streaks of rain.
    Rain,
}

/// How it falls, in one scene.
#[derive(Debug, Clone, Copy)]
pub struct Fall {
    falling: Falling,
    density: f64,
    key: Digest,
    seed: u64,
    /// Sideways metres a metre of falling.
    slant: f64,
}

/// The size of a picture and its focal length, in pixels.
#[derive(Debug, Clone, Copy)]
pub struct Sight {
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal length.
    pub focal_px: f64,
}

impl Sight {
    /// Returns the sight of a lens.
    #[must_use]
    pub fn of(lens: &Intrinsics) -> Self {
        Self { width: lens.width_px as usize, height: lens.height_px as usize, focal_px: lens.fx_px }
    }
}

/// What covers the pixels of a picture one after another: is told column, row and share, 0 to 1.
struct Cover<'a> {
    sight: Sight,
    tell: &'a mut dyn FnMut([usize; 2], f64),
}

impl Fall {
    /// Returns a fall of a density, 0 none to 1 heavy.
    #[must_use]
    pub fn new(falling: Falling, density: f64, key: Digest, seed: u64) -> Self {
        let slant = Draws::new(&key, "wind", &[seed]).range(0, -0.28, 0.28);
        Self { falling, density: density.clamp(0.0, 1.0), key, seed, slant }
    }

    /// Draws what falls at a tick: tells column, row and the share that is covered, 0 to 1, piece by piece; a pixel may be told of more
    /// than once.
    pub fn draw(&self, tick: Tick, sight: Sight, mut tell: impl FnMut([usize; 2], f64)) {
        let mut cover = Cover { sight, tell: &mut tell };
        let draws = Draws::new(&self.key, "fall", &[self.seed, u64::from(tick.0)]);
        let Sight { width, height, focal_px } = sight;
        // As many in the field of view of every size of picture.
        let (wide, high) = (width as f64 / focal_px, height as f64 / focal_px);
        let per_area = self.density * if self.falling == Falling::Snow { FLAKES } else { STREAKS };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded below")]
        let count = (per_area * wide * high).clamp(0.0, 4_000.0) as u64;
        for i in 0..count {
            let u = |k: u64| draws.uniform(4 * i + k);
            let (x, y) = (u(0) * width as f64, (1.2 * u(1) - 0.2) * height as f64);
            let distance_m = 1.0 + 9.0 * u(2);
            if self.falling == Falling::Snow {
                cover.flake(x, y, focal_px * 0.018 / distance_m * (0.7 + 0.6 * u(3)));
            } else {
                let length = focal_px * 0.42 / distance_m * (0.7 + 0.6 * u(3));
                cover.streak([x, y], length.max(2.0), self.slant, 0.16 + 0.34 / distance_m.sqrt() * self.density);
            }
        }
    }

    /// Returns the share of each pixel that is covered at a tick, 255 for all of it, rows top to bottom.
    #[must_use]
    pub fn shares(&self, tick: Tick, sight: Sight) -> Vec<u8> {
        let mut free = vec![1.0; sight.width * sight.height];
        self.draw(tick, sight, |[x, y], share| free[y * sight.width + x] *= 1.0 - share);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
        let shares = free.into_iter().map(|free: f64| (255.0 * (1.0 - free)).round() as u8).collect();
        shares
    }
}

impl Cover<'_> {
    fn pixel(&mut self, x: i64, y: i64, share: f64) {
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
        if x < self.sight.width && y < self.sight.height {
            (self.tell)([x, y], share.clamp(0.0, 1.0));
        }
    }

    fn flake(&mut self, x: f64, y: f64, radius: f64) {
        #[expect(clippy::cast_possible_truncation, reason = "float casts saturate")]
        let (low_x, low_y, reach) = (x.floor() as i64, y.floor() as i64, (radius + 0.5).ceil() as i64);
        for row in low_y - reach..=low_y + reach {
            for column in low_x - reach..=low_x + reach {
                let away = (column as f64 + 0.5 - x).hypot(row as f64 + 0.5 - y);
                let share = (radius + 0.5 - away).clamp(0.0, 1.0) * (2.0 * radius).min(1.0);
                if share > 0.0 {
                    self.pixel(column, row, 0.85 * share);
                }
            }
        }
    }

    fn streak(&mut self, [x, y]: [f64; 2], length: f64, slant: f64, share: f64) {
        #[expect(clippy::cast_possible_truncation, reason = "float casts saturate")]
        let (from, to) = (y.floor() as i64, (y + length).ceil() as i64);
        for row in from..to {
            let at = x + (row as f64 + 0.5 - y) * slant - 0.5;
            let left = at.floor();
            #[expect(clippy::cast_possible_truncation, reason = "float casts saturate")]
            let column = left as i64;
            self.pixel(column, row, share * (1.0 - (at - left)));
            self.pixel(column + 1, row, share * (at - left));
        }
    }
}

/// Returns what looks as if it fell before a frame of which nobody knows it: 255 where a pixel is brighter than most around it, else 0.
/// Lines on the road and lit windows look so too.
#[must_use]
pub fn specks(frame: &RgbImage) -> Vec<u8> {
    let (width, height) = (frame.width_px() as usize, frame.height_px() as usize);
    let luma: Vec<u32> =
        frame.rgb().chunks_exact(3).map(|pixel| pixel.iter().map(|byte| u32::from(*byte)).sum()).collect();
    let mut around = Vec::with_capacity((2 * SPECK_REACH + 1).pow(2));
    let mut speck = |x: usize, y: usize| {
        around.clear();
        for row in y.saturating_sub(SPECK_REACH)..(y + SPECK_REACH + 1).min(height) {
            let columns = x.saturating_sub(SPECK_REACH)..(x + SPECK_REACH + 1).min(width);
            around.extend_from_slice(&luma[row * width..][columns]);
        }
        let middle = around.len() / 2;
        let median = *around.select_nth_unstable(middle).1;
        if luma[y * width + x] > median + 3 * SPECK { 255 } else { 0 }
    };
    (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| speck(x, y)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIGHT: Sight = Sight { width: 160, height: 96, focal_px: 130.0 };

    fn covered(falling: Falling, density: f64, tick: u32) -> f64 {
        let fall = Fall::new(falling, density, Digest::of(b"sky"), 3);
        let shares = fall.shares(Tick(tick), SIGHT);
        shares.iter().map(|share| f64::from(*share) / 255.0).sum::<f64>() / shares.len() as f64
    }

    #[test]
    fn more_falls_where_it_is_denser_and_nothing_where_it_is_not() {
        for falling in [Falling::Snow, Falling::Rain] {
            let [none, light, heavy] = [0.0, 0.3, 1.0].map(|density| covered(falling, density, 5));
            assert!(none == 0.0 && light > 0.0 && heavy > 2.0 * light, "{falling:?}: {light}, {heavy}");
            assert!(heavy < 0.5, "{falling:?} hides {heavy} of the picture");
        }
    }

    #[test]
    fn flakes_stand_out_of_a_frame() {
        let fall = Fall::new(Falling::Snow, 0.5, Digest::of(b"sky"), 3);
        let mut frame = RgbImage::filled(SIGHT.width as u32, SIGHT.height as u32, [90; 3]);
        fall.draw(Tick(4), SIGHT, |[x, y], share| {
            let pixel = &mut frame.rgb_mut()[3 * (y * SIGHT.width + x)..][..3];
            pixel.iter_mut().for_each(|byte| *byte += (share * f64::from(230 - *byte)) as u8);
        });
        let (specks, shares) = (specks(&frame), fall.shares(Tick(4), SIGHT));
        let found = shares.iter().zip(&specks).filter(|(share, speck)| **share > 40 && **speck > 0).count();
        let covered = shares.iter().filter(|share| **share > 40).count();
        assert!(10 * found > 9 * covered, "{found} of {covered}");
        assert!(specks.iter().zip(&shares).all(|(speck, share)| *speck == 0 || *share > 0));
    }

    #[test]
    fn it_falls_elsewhere_at_each_tick_and_the_same_way_again() {
        let fall = Fall::new(Falling::Snow, 0.8, Digest::of(b"sky"), 3);
        assert_eq!(fall.shares(Tick(7), SIGHT), fall.shares(Tick(7), SIGHT));
        assert_ne!(fall.shares(Tick(7), SIGHT), fall.shares(Tick(8), SIGHT));
    }
}
