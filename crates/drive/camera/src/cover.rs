//! What lies on the ground and on things: snow, sand, and puddles, as changes of albedo at a place.
//!
//! Positions in metres relative to the scene's anchor; shares are 0 to 1 and follow smooth noise, so that patches stay
//! where they are from frame to frame.

use ds_space::{Vec2, Vec3};

use crate::ground::TRACKS;
use crate::noise::smooth;
use crate::surface::{Material, PixelClass, Surface};
use ds_world::{Condition, RoadSurface, Weather};

const SNOW: Vec3 = Vec3::new(0.80, 0.83, 0.88);
const SLUSH: Vec3 = Vec3::new(0.34, 0.35, 0.37);
const SAND: Vec3 = Vec3::new(0.62, 0.45, 0.22);

/// How much of each lies in a drive.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Cover {
    /// On the road.
    pub(crate) snow: f32,
    /// Beside the road and on roofs.
    pub(crate) frost: f32,
    pub(crate) sand: f32,
    pub(crate) puddles: f32,
}

impl Cover {
    /// Returns the cover of a condition whose amount is `cover`.
    pub(crate) fn of(condition: Condition, cover: f32) -> Self {
        let when = |surface: RoadSurface| if condition.surface() == surface { cover } else { 0.0 };
        let snow = when(RoadSurface::SnowCovered);
        let fresh = if condition.weather() == Weather::Snow { 0.35 } else { 0.0 };
        Self { snow, frost: snow.max(fresh), sand: when(RoadSurface::SandCovered), puddles: when(RoadSurface::Puddles) }
    }

    /// Returns the albedo of the ground under what lies on it.
    pub(crate) fn ground(&self, albedo: Vec3, surface: &Surface, p: Vec2, seed: u32) -> Vec3 {
        let mut albedo = albedo;
        let road = matches!(surface.material, Material::Asphalt | Material::Paint);
        let rut = surface.material == Material::Asphalt && surface.colour == TRACKS;
        let snow = if road { self.snow } else { self.frost };
        if snow > 0.0 {
            let drift = 0.6 * smooth(p.x / 5.0, p.y / 5.0, seed ^ 81) + 0.4 * smooth(p.x / 1.1, p.y / 1.1, seed ^ 82);
            let lies = match surface.material {
                Material::Asphalt if rut => (snow - 0.3 + 0.9 * (drift - 0.5)).clamp(0.0, 0.5),
                Material::Asphalt => (1.25 * snow - 0.12 + 1.2 * (drift - 0.5)).clamp(0.0, 0.96),
                Material::Paint => (0.8 * snow - 0.2 + 1.2 * (drift - 0.5)).clamp(0.0, 0.75),
                _ => (1.5 * snow + 0.8 * (drift - 0.5)).clamp(0.0, 0.97),
            };
            let white = if rut { SLUSH } else { SNOW * (0.9 + 0.2 * drift) };
            albedo += (white - albedo) * lies;
        }
        if self.sand > 0.0 {
            let ripple = smooth((p.x + 0.4 * p.y) / 3.4, (p.y - 0.4 * p.x) / 9.0, seed ^ 83);
            let grain = smooth(p.x / 0.7, p.y / 0.7, seed ^ 84);
            let lies = match surface.material {
                Material::Asphalt if rut => (0.7 * self.sand + 0.8 * (ripple - 0.5)).clamp(0.05, 0.7),
                Material::Asphalt => (1.2 * self.sand + 1.1 * (ripple - 0.5)).clamp(0.1, 0.95),
                Material::Paint => (0.7 * self.sand + 1.0 * (ripple - 0.5)).clamp(0.0, 0.7),
                _ => (0.85 + 0.2 * self.sand + 0.3 * (ripple - 0.5)).clamp(0.0, 0.97),
            };
            albedo += (SAND * (0.86 + 0.28 * grain) - albedo) * lies;
        }
        albedo
    }

    /// Returns how much of a place of the road is a puddle.
    pub(crate) fn puddle(&self, p: Vec2, seed: u32) -> f32 {
        if self.puddles <= 0.0 {
            return 0.0;
        }
        let low = 0.65 * smooth(p.x / 3.4, p.y / 3.4, seed ^ 85) + 0.35 * smooth(p.x / 0.9, p.y / 0.9, seed ^ 86);
        ((low - 0.66 + 0.24 * self.puddles) * 10.0).clamp(0.0, 1.0)
    }

    /// Returns the albedo of a thing whose face has an upward share `up` of its normal.
    pub(crate) fn thing(&self, albedo: Vec3, surface: &Surface, up: f32) -> Vec3 {
        let movable = matches!(surface.class, PixelClass::Vehicle | PixelClass::Person);
        let lies = if movable { 0.45 } else { 1.0 };
        let mut albedo = albedo;
        if self.frost > 0.0 {
            let lies = lies * ((up - 0.25) * 2.2).clamp(0.0, 1.0) * (1.3 * self.frost).min(0.95);
            albedo += (SNOW - albedo) * lies;
        }
        if self.sand > 0.0 {
            let lies = lies * (0.12 + 0.4 * up.max(0.0)) * self.sand;
            albedo += (SAND - albedo) * lies;
        }
        albedo
    }
}
