//! Sun, sky and haze of an appearance, in linear light.

use ds_space::{DVec2, Vec3};

use crate::appearance::Appearance;
use crate::cover::Cover;
use crate::{look, noise};
use ds_world::{Condition, Weather};

/// The light of a scene.
#[derive(Debug, Clone)]
pub(crate) struct Light {
    /// Towards the sun.
    pub(crate) sun_direction: Vec3,
    pub(crate) sun: Vec3,
    pub(crate) ambient: Vec3,
    pub(crate) headlight: f32,
    pub(crate) wetness: f32,
    pub(crate) night: f32,
    zenith: Vec3,
    horizon: Vec3,
    cloud: f32,
    haze_per_m: f32,
    seed: u32,
    /// Added near the horizon on the sun's side.
    afterglow: Vec3,
    /// How much of the sky the air hides.
    veil: f32,
    /// What lies on the ground; none without a condition.
    pub(crate) cover: Option<Cover>,
}

fn mix(a: Vec3, b: Vec3, share: f32) -> Vec3 {
    a + (b - a) * share
}

#[expect(clippy::cast_possible_truncation, reason = "light is reckoned in single precision")]
fn single(value: f64) -> f32 {
    value as f32
}

impl Light {
    pub(crate) fn new(appearance: &Appearance, seed: u32) -> Self {
        let plain = Self::plain(appearance, seed);
        match appearance.condition {
            Some(condition) => plain.in_condition(condition, appearance),
            None => plain,
        }
    }

    /// Takes the colours of a condition; the sun's place, clouds, haze and wetness stay as the numbers say.
    fn in_condition(self, condition: Condition, appearance: &Appearance) -> Self {
        let look = look::of(condition.lighting(), condition.weather(), self.cloud);
        let veil = match condition.weather() {
            Weather::Fog => 0.96,
            Weather::Snow => 0.6,
            Weather::Rain => 0.4,
            Weather::Clear | Weather::Overcast => 0.0,
        };
        Self {
            sun: look.sun,
            ambient: look.ambient,
            headlight: look.headlight,
            zenith: look.zenith,
            horizon: look.horizon,
            afterglow: look.afterglow,
            veil,
            cover: Some(Cover::of(condition, single(appearance.cover.clamp(0.0, 1.0)))),
            ..self
        }
    }

    /// Returns what the numbers alone say.
    fn plain(appearance: &Appearance, seed: u32) -> Self {
        let elevation = appearance.sun_elevation_rad.clamp(0.12, 1.5);
        let (up, flat) = elevation.sin_cos();
        let around = DVec2::from_angle(appearance.sun_azimuth_rad) * flat;
        let share = |value: f64| single(value.clamp(0.0, 1.0));
        let (cloud, night) = (share(appearance.cloud), share(appearance.night));
        let low = (1.0 - single(elevation) / 0.6).clamp(0.0, 1.0);
        let day = 1.0 - night;
        let warm = mix(Vec3::new(1.0, 0.95, 0.86), Vec3::new(1.0, 0.62, 0.34), low);
        let dark = |clear: Vec3, black: Vec3| mix(clear, black, night);
        let zenith = mix(Vec3::new(0.11, 0.26, 0.58), Vec3::new(0.46, 0.48, 0.52), cloud);
        let horizon = mix(
            mix(Vec3::new(0.56, 0.69, 0.84), Vec3::new(0.82, 0.62, 0.45), 0.7 * low),
            Vec3::new(0.64, 0.66, 0.68),
            cloud,
        );
        Self {
            sun_direction: Vec3::new(single(around.x), single(around.y), single(up)),
            sun: warm * (1.35 * day * (1.0 - 0.92 * cloud)),
            ambient: dark(
                mix(Vec3::new(0.40, 0.47, 0.58), Vec3::new(0.74, 0.76, 0.79), cloud),
                Vec3::new(0.035, 0.038, 0.05),
            ),
            headlight: night,
            wetness: share(appearance.wetness),
            night,
            zenith: dark(zenith, Vec3::new(0.004, 0.005, 0.012)),
            horizon: dark(horizon, Vec3::new(0.030, 0.029, 0.034)),
            cloud,
            haze_per_m: 0.0006
                + 0.03 * share(appearance.haze) * share(appearance.haze)
                + 0.004 * share(appearance.haze),
            seed,
            afterglow: Vec3::ZERO,
            veil: 0.0,
            cover: None,
        }
    }

    /// Says whether the sun is strong enough to cast shadows.
    pub(crate) fn casts_shadows(&self) -> bool {
        self.sun.max_element() > 0.12
    }

    /// Says whether vehicles drive with their lamps on.
    pub(crate) fn lamps_on(&self) -> bool {
        self.night > 0.3 || self.wetness > 0.3 || (self.cover.is_some() && self.headlight > 0.1)
    }

    /// Returns how a shadow on the ground moves per metre of height.
    pub(crate) fn shadow_per_m(&self) -> DVec2 {
        let d = self.sun_direction.as_dvec3();
        -d.truncate() / d.z
    }

    /// Returns the light that comes from a direction (unit vector) of the sky.
    pub(crate) fn sky(&self, direction: Vec3) -> Vec3 {
        let height = direction.z.clamp(0.0, 1.0);
        let toward = (1.0 - height).powi(5);
        let mut light = mix(self.zenith, self.horizon, toward);
        if height > 0.015 {
            let (x, y) = (direction.x / (height + 0.12), direction.y / (height + 0.12));
            let n =
                0.6 * noise::smooth(1.6 * x, 1.6 * y, self.seed) + 0.4 * noise::smooth(4.3 * x, 4.3 * y, self.seed ^ 1);
            let cover = ((n - 0.72 + 0.5 * self.cloud) * 4.0).clamp(0.0, 1.0) * (height * 8.0).min(1.0);
            let cloud = mix(self.horizon, self.ambient, 0.35) * (1.0 + 0.25 * (1.0 - self.cloud));
            light = mix(light, cloud, 0.75 * cover);
        }
        let glow = direction.dot(self.sun_direction).max(0.0);
        let light = light + self.sun * (0.25 * glow.powi(16) + 2.0 * glow.powi(1024));
        if self.cover.is_none() {
            return light;
        }
        let flat = direction.truncate().normalize_or_zero().dot(self.sun_direction.truncate().normalize_or_zero());
        let lit = light + self.afterglow * ((0.25 + 0.75 * flat.max(0.0).powi(2)) * (1.0 - height).powi(4));
        mix(lit, self.horizon, self.veil * (1.0 - 0.35 * height))
    }

    /// Returns the skyline at the horizon: far hills and woods, or `None` above them.
    pub(crate) fn skyline(&self, direction: Vec3) -> Option<Vec3> {
        let (x, y) = (direction.x, direction.y);
        let ridge = 0.012
            + 0.045 * noise::smooth(3.1 * x + 9.0, 3.1 * y, self.seed ^ 2)
            + 0.016 * noise::smooth(17.0 * x, 17.0 * y, self.seed ^ 3);
        let wood = Vec3::new(0.10, 0.14, 0.11) * (self.ambient + 0.4 * self.sun);
        let far_m = if self.cover.is_some() { 250.0 } else { 40.0 };
        let hidden = 0.4 * (1.0 - (-far_m * self.haze_per_m).exp());
        (direction.z < ridge).then(|| mix(wood, self.horizon, 0.55 + hidden.max(0.45 * self.veil)))
    }

    /// Veils a light seen over a distance.
    pub(crate) fn hazed(&self, light: Vec3, distance_m: f32) -> Vec3 {
        mix(light, self.horizon, 1.0 - (-self.haze_per_m * distance_m).exp())
    }
}
