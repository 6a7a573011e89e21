//! Falling snow and rain: which share of each pixel flakes and streaks cover, drawn anew at each tick.
//!
//! Draws are keyed by a digest, a seed and the tick. Sizes follow from a distance before the camera (metres) and the focal length
//! (pixels), so that a larger picture shows the same fall.

use ds_space::{Digest, Draws, Intrinsics, Tick};

use crate::alike::Alike;
use crate::image::RgbImage;

/// Flakes in a field of view as wide and high as the focal length, where they fall heavily.
const FLAKES: f64 = 620.0;
/// Streaks of rain in the same.
const STREAKS: f64 = 300.0;

/// What falls is so many times as bright as what [`DARKER`] of the frame stay below.
const BRIGHTER: f64 = 1.07;
/// A share of a frame's values.
const DARKER: f64 = 0.9;
/// Pixels to each side of a speck that it is compared with.
const SPECK_REACH: usize = 4;
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

    /// Returns a frame covered by what falls at a tick, which is a little lighter than the lightest parts of the frame's upper half; towards
    /// the bottom, where headlights reach it, those of the lower half count for up to half of it.
    #[must_use]
    pub fn before(&self, frame: &RgbImage, tick: Tick, focal_px: f64) -> RgbImage {
        let (width, height) = (frame.width_px() as usize, frame.height_px() as usize);
        let (above, below) = frame.rgb().split_at(3 * width * (height / 2));
        let [above, below] = [above, below].map(|values| (BRIGHTER * lightest(values)).min(255.0));
        let mut covered = frame.clone();
        let pixels = covered.rgb_mut().as_chunks_mut::<3>().0;
        self.draw(tick, Sight { width, height, focal_px }, |[x, y], share| {
            let reached = (y as f64 / height as f64 - 0.25).clamp(0.0, 0.5);
            let bright = above + reached * (below - above);
            for byte in &mut pixels[y * width + x] {
                let value = f64::from(*byte);
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
                let nearer = (value + share * (bright - value)).round() as u8;
                *byte = nearer;
            }
        });
        covered
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

/// Returns a frame without what looks as if it fell before it, of which nobody knows where it fell: pixels that are brighter than most
/// around them of what the layout, a picture of the same size, shows in the same colour, become as those are. Lit windows look so too.
///
/// # Panics
///
/// Panics if the two differ in size.
#[must_use]
pub fn cleared(frame: &RgbImage, layout: &RgbImage) -> RgbImage {
    let seen = frame.rgb().as_chunks::<3>().0;
    let alike = Alike::new(frame, layout);
    let luma = |at: usize| seen[at].iter().map(|byte| u32::from(*byte)).sum::<u32>();
    let mut cleared = frame.clone();
    let mut around = Vec::with_capacity((2 * SPECK_REACH + 1).pow(2));
    for (at, pixel) in cleared.rgb_mut().as_chunks_mut::<3>().0.iter_mut().enumerate() {
        around.clear();
        around.extend(alike.around(at, SPECK_REACH));
        let middle = around.len() / 2;
        let median = *around.select_nth_unstable_by_key(middle, |near| (luma(*near), *near)).1;
        if luma(at) > luma(median) + 3 * SPECK {
            *pixel = seen[median];
        }
    }
    cleared
}

/// Returns the value that [`DARKER`] of some bytes stay below.
fn lightest(bytes: &[u8]) -> f64 {
    let mut counts = [0u32; 256];
    bytes.iter().for_each(|byte| counts[usize::from(*byte)] += 1);
    let below = DARKER * bytes.len() as f64;
    let mut seen = 0.0;
    let at = counts.iter().position(|count| {
        seen += f64::from(*count);
        seen >= below
    });
    at.unwrap_or(0) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a grey frame with a lighter sky, and what falls before it.
    fn frames(falling: Falling, density: f64, tick: u32) -> [RgbImage; 2] {
        let mut frame = RgbImage::filled(160, 96, [90; 3]);
        frame.rgb_mut()[..3 * 160 * 20].fill(220);
        let covered = Fall::new(falling, density, Digest::of(b"sky"), 3).before(&frame, Tick(tick), 130.0);
        [frame, covered]
    }

    fn covered(falling: Falling, density: f64, tick: u32) -> usize {
        let [frame, covered] = frames(falling, density, tick);
        frame.rgb().iter().zip(covered.rgb()).filter(|(a, b)| a != b).count()
    }

    #[test]
    fn more_falls_where_it_is_denser_and_nothing_where_it_is_not() {
        for falling in [Falling::Snow, Falling::Rain] {
            let [none, light, heavy] = [0.0, 0.3, 1.0].map(|density| covered(falling, density, 5));
            assert!(none == 0 && light > 0 && heavy > 2 * light, "{falling:?}: {light}, {heavy}");
            assert!(heavy < 3 * 160 * 96 / 2, "{falling:?} covers {heavy} values");
        }
    }

    #[test]
    fn what_fell_is_cleared_away_and_lines_stay() {
        let [clear, mut snowy] = frames(Falling::Snow, 0.5, 4);
        let mut layout = RgbImage::filled(160, 96, [10; 3]);
        layout.rgb_mut()[..3 * 160 * 20].fill(20);
        for row in 20..96 {
            layout.set_pixel(80, row, [30; 3]);
            snowy.set_pixel(80, row, [230; 3]);
        }
        let cleared = cleared(&snowy, &layout);
        let apart = |frame: &RgbImage| {
            frame.rgb().iter().zip(clear.rgb()).filter(|(a, b)| a.abs_diff(**b) > 12).count() - 3 * 76
        };
        assert!(20 * apart(&cleared) < apart(&snowy), "{} of {}", apart(&cleared), apart(&snowy));
        assert!((20..96).all(|row| cleared.pixel(80, row) == [230; 3]), "a line went");
    }

    #[test]
    fn it_falls_elsewhere_at_each_tick_and_the_same_way_again() {
        assert_eq!(frames(Falling::Snow, 0.8, 7), frames(Falling::Snow, 0.8, 7));
        assert_ne!(frames(Falling::Snow, 0.8, 7), frames(Falling::Snow, 0.8, 8));
    }
}
