//! Sky and sun of this world: single scattering by air and dust along the line of sight, a closed cloud cover by the
//! CIE overcast law, exposure by the light there is, and a filmic tone curve.
//!
//! Optical depths of a clear zenith: air (0.046, 0.108, 0.265), dust from the weather. Air mass after Kasten and Young.
//! Light is linear; 1 is about the white of paper in full sun before exposure.

use ds_space::{DVec2, Draws, Vec2, Vec3};
use ds_world::{Condition, Lighting, Weather};

use crate::cells::around;

const AIR: Vec3 = Vec3::new(0.046, 0.108, 0.265);

/// All light of a scene.
#[derive(Debug, Clone)]
pub(crate) struct Light {
    /// Towards the sun (or where it went down).
    pub(crate) sun_direction: Vec3,
    /// Its direct light; none below the horizon or behind clouds.
    pub(crate) sun: Vec3,
    /// From above and from below.
    pub(crate) dome: Vec3,
    pub(crate) floor: Vec3,
    pub(crate) exposure: f32,
    /// Own lamps, 0 to 1.
    pub(crate) lamps: f32,
    /// Share of light lost per metre of air.
    pub(crate) fog_per_m: f32,
    pub(crate) fog: Vec3,
    dust: f32,
    cover: f32,
    /// Brightness of the sky relative to full day.
    level: f32,
    cast: Vec3,
    seed: u32,
}

#[expect(clippy::cast_possible_truncation, reason = "light is reckoned in single precision")]
fn single(value: f64) -> f32 {
    value as f32
}

fn air_mass(sine: f32) -> f32 {
    let degrees = sine.clamp(0.0, 1.0).asin().to_degrees();
    1.0 / (sine.max(0.0) + 0.505_72 * (degrees + 6.079_95).powf(-1.636_4))
}

fn exp(v: Vec3) -> Vec3 {
    Vec3::new(v.x.exp(), v.y.exp(), v.z.exp())
}

impl Light {
    pub(crate) fn new(condition: Condition, draws: &Draws, seed: u32) -> Self {
        let range = |index: u64, low: f64, high: f64| draws.range(index, low, high);
        let (elevation, level, cast, lamps) = match condition.lighting() {
            Lighting::Day => (range(0, 0.6, 1.2), 1.0, Vec3::ONE, 0.0f32),
            Lighting::Sunrise => (range(0, 0.10, 0.17), 0.5, Vec3::new(1.10, 0.92, 1.04), 0.3),
            Lighting::Sunset => (range(0, 0.08, 0.14), 0.45, Vec3::new(1.35, 0.85, 0.62), 0.3),
            Lighting::GoldenHour => (range(0, 0.2, 0.34), 0.8, Vec3::new(1.2, 1.0, 0.68), 0.0),
            Lighting::Twilight => (0.03, 0.11, Vec3::new(1.15, 0.78, 1.15), 0.7),
            Lighting::BlueHour => (0.02, 0.10, Vec3::new(0.42, 0.78, 1.75), 0.7),
            Lighting::Night => (0.02, 0.012, Vec3::new(0.9, 0.95, 1.15), 1.0),
        };
        let (dust, cover, visibility_m) = match condition.weather() {
            Weather::Clear => (range(1, 0.04, 0.12), range(2, 0.0, 0.3), 8_000.0),
            Weather::Overcast => (0.2, 1.0, 3_000.0),
            Weather::Snow => (0.2, 1.0, range(3, 150.0, 260.0)),
            Weather::Rain => (0.25, 1.0, range(3, 300.0, 600.0)),
            Weather::Fog => (0.3, 1.0, range(3, 45.0, 90.0)),
        };
        let dust = dust * if condition.lighting() == Lighting::Sunset { 3.0 } else { 1.0 };
        let around = DVec2::from_angle(range(4, 0.0, std::f64::consts::TAU));
        let (up, flat) = elevation.sin_cos();
        let direction = Vec3::new(single(around.x * flat), single(around.y * flat), single(up));
        let below = matches!(condition.lighting(), Lighting::Twilight | Lighting::BlueHour | Lighting::Night);
        let (dust, cover) = (single(dust), single(cover));
        let through = exp(-(AIR + Vec3::splat(dust)) * air_mass(direction.z).min(9.0));
        let sun = if below { Vec3::ZERO } else { through * 2.6 * (1.0 - cover).powi(2) };
        let mut light = Self {
            sun_direction: direction,
            sun,
            dome: Vec3::ZERO,
            floor: Vec3::ZERO,
            exposure: 1.0,
            lamps: lamps.max(if visibility_m < 700.0 { 0.25 } else { 0.0 }),
            fog_per_m: single(3.0 / visibility_m),
            fog: Vec3::ZERO,
            dust,
            cover,
            level,
            cast,
            seed,
        };
        light.gather();
        light
    }

    /// Sums the sky up into what falls on faces, the colour of fog, and the exposure.
    fn gather(&mut self) {
        let mut dome = Vec3::ZERO;
        for i in 0..24u8 {
            let turn = f32::from(i) * 2.399_963;
            let up = ((f32::from(i) + 0.5) / 24.0).sqrt();
            let flat = (1.0 - up * up).sqrt();
            dome += self.air(Vec3::new(turn.cos() * flat, turn.sin() * flat, up)) / 24.0;
        }
        self.dome = dome * 1.15 + Vec3::splat(0.004);
        self.floor = (self.dome + self.sun * self.sun_direction.z) * 0.18;
        let ring: Vec3 = (0..8u8)
            .map(|i| {
                let turn = f32::from(i) * std::f32::consts::FRAC_PI_4;
                self.air(Vec3::new(turn.cos(), turn.sin(), 0.12).normalize())
            })
            .sum();
        self.fog = ring / 8.0 + Vec3::splat(0.03 * self.lamps * (1.0 - self.level));
        let bright = (self.dome + self.sun * (0.6 * self.sun_direction.z.max(0.2))).dot(Vec3::new(0.3, 0.5, 0.2));
        // The eye opens in the dark, but not all the way.
        self.exposure = 0.78 / (bright + 0.02).powf(0.62);
    }

    /// Returns the light of the sky without clouds' edges, sun's disc and stars.
    fn air(&self, direction: Vec3) -> Vec3 {
        let height = direction.z.clamp(0.0, 1.0);
        let depth = AIR + Vec3::splat(self.dust);
        let cosine = direction.dot(self.sun_direction);
        let g = 0.72f32;
        let by_dust = (1.0 - g * g) / (1.0 + g * g - 2.0 * g * cosine).powf(1.5) * 0.12;
        let by_air = 0.75 * (1.0 + cosine * cosine);
        let share = (AIR * by_air + Vec3::splat(self.dust * by_dust)) / depth;
        let view = Vec3::ONE - exp(-depth * air_mass(height).min(14.0));
        let sunlight = exp(-(AIR * 0.9 + Vec3::splat(0.4 * self.dust)) * air_mass(self.sun_direction.z).min(9.0));
        let clear = share * view * sunlight.max(Vec3::splat(0.02)) * 1.7 * self.cast;
        let clear = if self.level < 0.2 {
            // Below the horizon the light is what the upper air still gets, strongest on the sun's side.
            let side = 0.35 + 0.65 * (0.5 + 0.5 * cosine).powi(2);
            self.cast * ((0.25 + 0.75 * (1.0 - height).powi(3)) * side)
        } else {
            clear
        };
        let closed = self.cast * Vec3::new(0.80, 0.82, 0.84) * ((1.0 + 2.0 * height) / 3.0);
        clear.lerp(closed, self.cover) * self.level
    }

    /// Returns what is seen of the sky in a direction.
    pub(crate) fn seen(&self, direction: Vec3) -> Vec3 {
        let mut light = self.air(direction);
        if direction.z > 0.03 && self.cover < 0.95 {
            let p = Vec2::new(direction.x, direction.y) / (direction.z + 0.2);
            let puff = around(p * 1.1, self.seed ^ 0x33);
            let edge = around(p * 3.1, self.seed ^ 0x34).nearest;
            let thick = ((0.15 + 0.9 * self.cover - puff.nearest + 0.25 * (0.5 - edge)) * 3.0).clamp(0.0, 1.0);
            let white = (self.dome * 1.1 + self.sun * 0.25) * Vec3::splat(0.9);
            light = light.lerp(white, 0.85 * thick);
        }
        if self.level < 0.02 && self.cover < 0.9 && direction.z > 0.1 {
            let star = around(Vec2::new(direction.x, direction.y) / (0.3 + direction.z) * 40.0, self.seed);
            if star.nearest < 0.05 && star.tone > 0.7 {
                light += Vec3::splat(0.08);
            }
        }
        let disc = ((direction.dot(self.sun_direction) - 0.9993) * 4_000.0).clamp(0.0, 1.0);
        light += self.sun * (3.0 * disc);
        // Towards the horizon the sky drowns in fog.
        let lost = 1.0 - (-self.fog_per_m * 160.0 / (direction.z.max(0.0) + 0.06)).exp();
        light.lerp(self.fog, lost * (self.fog_per_m * 300.0).min(1.0))
    }

    /// Veils a light over a distance.
    pub(crate) fn through_air(&self, light: Vec3, distance_m: f32) -> Vec3 {
        self.fog + (light - self.fog) * (-self.fog_per_m * distance_m).exp()
    }

    /// Returns the sRGB bytes of a light: exposure, a filmic curve (Narkowicz' fit), the standard's transfer function.
    pub(crate) fn print(&self, light: Vec3) -> [u8; 3] {
        let channel = |x: f32| {
            let x = (x * self.exposure).max(0.0) * 0.72;
            let x = (x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)).clamp(0.0, 1.0);
            let x = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within a byte")]
            let byte = (x * 255.0 + 0.5) as u8;
            byte
        };
        [channel(light.x), channel(light.y), channel(light.z)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_brighter_than_dusks_and_dusks_than_nights_and_the_sky_is_blue_by_day() {
        let light = |name: &str| Light::new(name.parse().expect("a condition"), &Draws::from_seed(1, "sky"), 1);
        let grey = |v: Vec3| v.dot(Vec3::new(0.3, 0.5, 0.2));
        let levels: Vec<f32> =
            ["day", "sunset", "twilight", "night"].iter().map(|name| grey(light(name).dome)).collect();
        assert!(levels.windows(2).all(|pair| pair[0] > pair[1]), "{levels:?}");
        let up = light("day").seen(Vec3::new(0.1, 0.2, 0.97).normalize());
        assert!(up.z > 1.3 * up.x, "the zenith is {up:?}");
        for name in ["fog", "night-fog", "snow", "sunrise"] {
            let light = light(name);
            assert!(light.exposure.is_finite() && light.fog.is_finite() && light.dome.min_element() >= 0.0);
        }
    }
}
