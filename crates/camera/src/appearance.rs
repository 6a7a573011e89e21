//! What a drive looks like: sun, clouds, haze, wetness, night and the palette, as plain numbers and as words.
//!
//! Angles in radians, world frame (azimuth counter-clockwise from east); shares are 0 to 1.

use ds_space::Draws;

/// Light, weather and palette of a drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Appearance {
    /// Direction towards the sun in the ground plane.
    pub sun_azimuth_rad: f64,
    /// Height of the sun above the horizon; drawn as at least 0.12.
    pub sun_elevation_rad: f64,
    /// Cloud cover: 0 clear, 1 overcast without shadows.
    pub cloud: f64,
    /// Haze: 0 clear, 1 about 80 m of visibility.
    pub haze: f64,
    /// Wetness of the road: 0 dry, 1 mirroring the sky.
    pub wetness: f64,
    /// Darkness: 0 day, 1 night with headlights.
    pub night: f64,
    /// Chooses colours of vehicles, people and houses.
    pub palette_seed: u64,
}

/// The name is not one of an appearance.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("appearance {0:?} is neither \"day\" nor \"seed-N\"")]
pub struct UnknownAppearance(pub String);

impl Appearance {
    /// A clear day.
    pub const DAY: Self = Self {
        sun_azimuth_rad: 0.9,
        sun_elevation_rad: 0.85,
        cloud: 0.25,
        haze: 0.08,
        wetness: 0.0,
        night: 0.0,
        palette_seed: 0,
    };

    /// Returns the appearance of a name: `day`, or `seed-N` as drawn by [`Appearance::from_seed`].
    ///
    /// # Errors
    /// [`UnknownAppearance`] for any other name.
    pub fn named(name: &str) -> Result<Self, UnknownAppearance> {
        let seed = name.strip_prefix("seed-").and_then(|digits| digits.parse().ok());
        match (name, seed) {
            ("day", _) => Ok(Self::DAY),
            (_, Some(seed)) => Ok(Self::from_seed(seed)),
            _ => Err(UnknownAppearance(name.to_owned())),
        }
    }

    /// Draws an appearance: mostly day, sometimes overcast, hazy, wet or night.
    #[must_use]
    pub fn from_seed(seed: u64) -> Self {
        let draws = Draws::from_seed(seed, "appearance");
        let now_and_then = |index: u64, share: f64, low: f64, high: f64| {
            if draws.uniform(index) < share { draws.range(index + 1, low, high) } else { 0.0 }
        };
        let night = now_and_then(0, 0.15, 0.75, 1.0);
        let wetness = now_and_then(2, 0.2, 0.4, 1.0);
        let cloud = if wetness > 0.0 { draws.range(4, 0.7, 1.0) } else { draws.uniform(4).powi(2) };
        Self {
            sun_azimuth_rad: draws.range(5, 0.0, std::f64::consts::TAU),
            sun_elevation_rad: draws.range(6, 0.3, 1.25),
            cloud,
            haze: 0.05 + now_and_then(7, 0.25, 0.15, 0.6),
            wetness,
            night,
            palette_seed: draws.u64(9),
        }
    }

    /// Describes the appearance in words, for the prompt of a video model.
    #[must_use]
    pub fn prompt(&self) -> String {
        let time = match (self.night, self.sun_elevation_rad) {
            (night, _) if night > 0.5 => "at night, headlights on",
            (_, elevation) if elevation < 0.45 => "under a low sun with long shadows",
            _ => "by day",
        };
        let sky = match self.cloud {
            cloud if cloud > 0.7 => "overcast",
            cloud if cloud > 0.3 => "cloudy",
            _ => "clear",
        };
        let mut words = format!("driving {time}, {sky} sky");
        if self.haze > 0.2 {
            words.push_str(", haze");
        }
        if self.wetness > 0.3 {
            words.push_str(", wet road");
        }
        words
    }
}

impl Default for Appearance {
    fn default() -> Self {
        Self::DAY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawn_appearances_stay_in_their_bounds_and_differ() {
        let mut words = std::collections::BTreeSet::new();
        for seed in 0..200 {
            let a = Appearance::from_seed(seed);
            for share in [a.cloud, a.haze, a.wetness, a.night] {
                assert!((0.0..=1.0).contains(&share), "seed {seed}: {a:?}");
            }
            assert_eq!(a, Appearance::from_seed(seed));
            words.insert(a.prompt());
        }
        assert!(words.len() > 8, "{words:?}");
    }

    #[test]
    fn words_name_what_is_seen() {
        assert_eq!(Appearance::DAY.prompt(), "driving by day, clear sky");
        let rainy = Appearance { night: 1.0, wetness: 1.0, cloud: 0.9, haze: 0.5, ..Appearance::DAY };
        assert_eq!(rainy.prompt(), "driving at night, headlights on, overcast sky, haze, wet road");
    }
}
