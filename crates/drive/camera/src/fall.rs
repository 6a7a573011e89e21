//! Falling snow and rain: flakes and streaks over the finished light of a picture, drawn anew at each tick.
//!
//! Draws are keyed by the scene, the palette and the tick. Sizes follow from a distance before the camera (metres) and
//! the focal length (pixels), so that a larger picture shows the same fall.

use ds_space::{Digest, Draws, Tick, Vec3};

use ds_world::Weather;

/// What falls.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fall {
    snow: bool,
    density: f64,
    key: Digest,
    palette_seed: u64,
    /// Sideways metres a metre of falling.
    slant: f64,
}

/// A picture of light being covered.
pub(crate) struct Canvas<'a> {
    pub(crate) light: &'a mut [Vec3],
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Focal length, in pixels.
    pub(crate) focal_px: f64,
    /// Light that falls on what falls.
    pub(crate) bright: Vec3,
    /// Strength of the headlights.
    pub(crate) headlight: f32,
}

impl Canvas<'_> {
    /// Covers a share of a pixel.
    fn cover(&mut self, x: i64, y: i64, share: f64) {
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
        if x >= self.width || y >= self.height {
            return;
        }
        // Headlights reach what falls below the middle of the picture.
        let below = (y as f32 / self.height as f32 - 0.25).clamp(0.0, 0.5);
        let light = self.bright + Vec3::new(0.42, 0.40, 0.35) * (self.headlight * below);
        let pixel = &mut self.light[y * self.width + x];
        #[expect(clippy::cast_possible_truncation, reason = "light is reckoned in single precision")]
        let share = share.clamp(0.0, 1.0) as f32;
        *pixel += (light - *pixel) * share;
    }

    fn flake(&mut self, x: f64, y: f64, radius: f64) {
        #[expect(clippy::cast_possible_truncation, reason = "float casts saturate")]
        let (low_x, low_y, reach) = (x.floor() as i64, y.floor() as i64, (radius + 0.5).ceil() as i64);
        for row in low_y - reach..=low_y + reach {
            for column in low_x - reach..=low_x + reach {
                let away = (column as f64 + 0.5 - x).hypot(row as f64 + 0.5 - y);
                let share = (radius + 0.5 - away).clamp(0.0, 1.0) * (2.0 * radius).min(1.0);
                if share > 0.0 {
                    self.cover(column, row, 0.85 * share);
                }
            }
        }
    }

    fn streak(&mut self, x: f64, y: f64, length: f64, slant: f64, share: f64) {
        #[expect(clippy::cast_possible_truncation, reason = "float casts saturate")]
        let (from, to) = (y.floor() as i64, (y + length).ceil() as i64);
        for row in from..to {
            let at = x + (row as f64 + 0.5 - y) * slant - 0.5;
            let left = at.floor();
            #[expect(clippy::cast_possible_truncation, reason = "float casts saturate")]
            let column = left as i64;
            self.cover(column, row, share * (1.0 - (at - left)));
            self.cover(column + 1, row, share * (at - left));
        }
    }
}

impl Fall {
    /// Returns the fall of a weather and density, if it is one in which something falls.
    pub(crate) fn new(weather: Weather, density: f64, key: Digest, palette_seed: u64) -> Option<Self> {
        let snow = match weather {
            Weather::Snow => true,
            Weather::Rain => false,
            _ => return None,
        };
        let slant = Draws::new(&key, "wind", &[palette_seed]).range(0, -0.28, 0.28);
        Some(Self { snow, density: density.clamp(0.0, 1.0), key, palette_seed, slant })
    }

    /// Draws what falls at a tick.
    pub(crate) fn draw(&self, tick: Tick, canvas: &mut Canvas<'_>) {
        let draws = Draws::new(&self.key, "fall", &[self.palette_seed, u64::from(tick.0)]);
        // As many in the field of view of every size of picture.
        let (wide, high) = (canvas.width as f64 / canvas.focal_px, canvas.height as f64 / canvas.focal_px);
        let per_area = self.density * if self.snow { 620.0 } else { 300.0 };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded below")]
        let count = (per_area * wide * high).clamp(0.0, 4_000.0) as u64;
        for i in 0..count {
            let u = |k: u64| draws.uniform(4 * i + k);
            let (x, y) = (u(0) * canvas.width as f64, (1.2 * u(1) - 0.2) * canvas.height as f64);
            let distance_m = 1.0 + 9.0 * u(2);
            if self.snow {
                canvas.flake(x, y, canvas.focal_px * 0.018 / distance_m * (0.7 + 0.6 * u(3)));
            } else {
                let length = canvas.focal_px * 0.42 / distance_m * (0.7 + 0.6 * u(3));
                canvas.streak(x, y, length.max(2.0), self.slant, 0.16 + 0.34 / distance_m.sqrt() * self.density);
            }
        }
    }
}
