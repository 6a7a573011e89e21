//! What falls before the reference camera, and its light.

use ds_raster::{Fall, Falling, Sight};
use ds_space::{Digest, Tick, Vec3};
use ds_world::Weather;

use crate::appearance::Appearance;

impl Appearance {
    /// Returns what falls in a scene of this appearance, if it is one in which something falls.
    #[must_use]
    pub fn falling(&self, scene: Digest) -> Option<Fall> {
        let falling = match self.condition?.weather() {
            Weather::Snow => Falling::Snow,
            Weather::Rain => Falling::Rain,
            Weather::Clear | Weather::Overcast | Weather::Fog => return None,
        };
        Some(Fall::new(falling, self.fall, scene, self.palette_seed))
    }
}

/// A picture of light being covered.
pub(crate) struct Canvas<'a> {
    pub(crate) light: &'a mut [Vec3],
    pub(crate) sight: Sight,
    /// Light that falls on what falls.
    pub(crate) bright: Vec3,
    /// Strength of the headlights.
    pub(crate) headlight: f32,
}

impl Canvas<'_> {
    /// Covers the picture by what falls at a tick.
    pub(crate) fn cover(&mut self, fall: &Fall, tick: Tick) {
        let Sight { width, height, .. } = self.sight;
        fall.draw(tick, self.sight, |[x, y], share| {
            // Headlights reach what falls below the middle of the picture.
            let below = (y as f32 / height as f32 - 0.25).clamp(0.0, 0.5);
            let light = self.bright + Vec3::new(0.42, 0.40, 0.35) * (self.headlight * below);
            let pixel = &mut self.light[y * width + x];
            #[expect(clippy::cast_possible_truncation, reason = "light is reckoned in single precision")]
            let share = share as f32;
            *pixel += (light - *pixel) * share;
        });
    }
}
