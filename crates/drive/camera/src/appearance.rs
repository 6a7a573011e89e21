//! What a drive looks like: sun, clouds, haze, wetness, night and the palette, as plain numbers and as words.
//!
//! Angles in radians, world frame (azimuth counter-clockwise from east); shares are 0 to 1. An appearance with a
//! [`Condition`] takes the colours of its light from it; one without is ruled by the numbers alone.

use ds_space::Draws;

use ds_world::{Condition, ConditionError, Lighting, RoadSurface, Weather};

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
    /// How densely rain or snow falls: 0 none, 1 heavily. Only in a [`Condition`] of such weather.
    pub fall: f64,
    /// How much of the ground lies under snow, sand or puddles. Only in a [`Condition`] of such a surface.
    pub cover: f64,
    /// Lighting, weather and road surface; without one the numbers above mean a plain day or night.
    pub condition: Option<Condition>,
}

/// The name is not one of an appearance.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "appearance {name:?} is neither \"day\", \"seed-N\" nor a condition such as \"snow\", \"rain-night\" or \"lighting=night,weather=rain,surface=puddles\", with \"-N\" or \",seed=N\" behind it for another draw"
)]
pub struct UnknownAppearance {
    /// The name.
    pub name: String,
    /// Why it is no condition.
    #[source]
    pub source: ConditionError,
}

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
        fall: 0.0,
        cover: 0.0,
        condition: None,
    };

    /// Returns the appearance of a name: `day`, `seed-N` as drawn by [`Appearance::from_seed`], or a condition, such as
    /// `snow`, `rain-night`, `rain-night-7` (draw 7 of it) or `lighting=night,weather=rain,surface=puddles,seed=7`.
    ///
    /// # Errors
    /// [`UnknownAppearance`] for any other name.
    pub fn named(name: &str) -> Result<Self, UnknownAppearance> {
        Ok(match Name::parse(name)? {
            Name::Day => Self::DAY,
            Name::Seed(seed) => Self::from_seed(seed),
            Name::Condition(condition, seed) => Self::condition(condition, seed),
        })
    }

    /// Returns the short form of a name, of letters, digits, `-` and `_` alone: `night-rain-puddles-7`.
    ///
    /// # Errors
    /// [`UnknownAppearance`] if the name is none.
    pub fn short_name(name: &str) -> Result<String, UnknownAppearance> {
        Ok(match Name::parse(name)? {
            Name::Day | Name::Seed(_) => name.to_owned(),
            Name::Condition(condition, 0) => condition.to_string(),
            Name::Condition(condition, seed) => format!("{condition}-{seed}"),
        })
    }

    /// Draws an appearance of a condition: sun, clouds, density of fog, rain and snow vary within its bounds.
    #[must_use]
    pub fn condition(condition: Condition, seed: u64) -> Self {
        let draws = Draws::from_seed(seed, "condition");
        let range = |index: u64, (low, high): (f64, f64)| draws.range(index, low, high);
        let elevation = match condition.lighting() {
            Lighting::Day => (0.65, 1.25),
            Lighting::Sunrise | Lighting::Sunset => (0.13, 0.2),
            Lighting::GoldenHour => (0.22, 0.38),
            Lighting::Twilight | Lighting::BlueHour | Lighting::Night => (0.13, 0.3),
        };
        let (cloud, haze, fall) = match condition.weather() {
            Weather::Clear => ((0.0, 0.35), (0.03, 0.12), (0.0, 0.0)),
            Weather::Overcast => ((0.88, 1.0), (0.06, 0.18), (0.0, 0.0)),
            Weather::Snow => ((0.9, 1.0), (0.5, 0.66), (0.55, 1.0)),
            Weather::Rain => ((0.9, 1.0), (0.32, 0.46), (0.55, 1.0)),
            Weather::Fog => ((0.75, 1.0), (0.86, 1.0), (0.0, 0.0)),
        };
        let (wetness, cover) = match condition.surface() {
            RoadSurface::Dry => ((0.0, 0.0), (0.0, 0.0)),
            RoadSurface::SnowCovered => ((0.0, 0.0), (0.6, 0.9)),
            RoadSurface::SandCovered => ((0.0, 0.0), (0.55, 0.9)),
            RoadSurface::Puddles => ((0.45, 0.7), (0.4, 0.9)),
        };
        let night = match condition.lighting() {
            Lighting::Night => 1.0,
            Lighting::BlueHour | Lighting::Twilight => 0.55,
            _ => 0.0,
        };
        Self {
            sun_azimuth_rad: range(0, (0.0, std::f64::consts::TAU)),
            sun_elevation_rad: range(1, elevation),
            cloud: range(2, cloud),
            haze: range(3, haze),
            wetness: range(4, wetness),
            night,
            palette_seed: draws.u64(5),
            fall: range(6, fall),
            cover: range(7, cover),
            condition: Some(condition),
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
            fall: 0.0,
            cover: 0.0,
            condition: None,
        }
    }

    /// Describes the appearance in words, for the prompt of a video model.
    #[must_use]
    pub fn prompt(&self) -> String {
        if let Some(condition) = self.condition {
            return condition.words();
        }
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
        words.push_str(if self.wetness > 0.3 { ", wet road" } else { ", dry road" });
        words
    }
}

/// A name, taken apart.
enum Name {
    Day,
    Seed(u64),
    Condition(Condition, u64),
}

impl Name {
    fn parse(name: &str) -> Result<Self, UnknownAppearance> {
        if name == "day" {
            return Ok(Self::Day);
        }
        if let Some(seed) = name.strip_prefix("seed-").and_then(|digits| digits.parse().ok()) {
            return Ok(Self::Seed(seed));
        }
        let separator = if name.contains('=') { ",seed=" } else { "-" };
        let with_seed = name.rsplit_once(separator).and_then(|(rest, digits)| Some((rest, digits.parse().ok()?)));
        let (rest, seed) = with_seed.unwrap_or((name, 0));
        let condition = rest.parse().map_err(|source| UnknownAppearance { name: name.to_owned(), source })?;
        Ok(Self::Condition(condition, seed))
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
    fn names_of_conditions_are_read_and_shortened() {
        let check = |name: &str, expected: &str| {
            let found = Appearance::short_name(name).unwrap_or_else(|error| error.to_string());
            assert_eq!(found, expected, "{name}");
            assert_eq!(Appearance::named(name).is_ok(), Appearance::named(&found).is_ok());
            if let (Ok(a), Ok(b)) = (Appearance::named(name), Appearance::named(&found)) {
                assert_eq!(a, b, "{name}");
            }
        };
        check("day", "day");
        check("seed-12", "seed-12");
        check("snow", "day-snow-snow_covered");
        check("rain-night-7", "night-rain-puddles-7");
        check("lighting=night,weather=rain,surface=puddles,seed=7", "night-rain-puddles-7");
        let error = Appearance::named("bright").expect_err("no such look");
        assert!(error.to_string().contains("rain-night"), "{error}");
        assert!(std::error::Error::source(&error).is_some_and(|source| source.to_string().contains("golden_hour")));
    }

    #[test]
    fn draws_of_a_condition_differ_and_keep_to_it() {
        for condition in Condition::all() {
            let (a, b) = (Appearance::condition(condition, 1), Appearance::condition(condition, 2));
            assert_ne!(a, b);
            assert_eq!((a.condition, a.prompt()), (b.condition, b.prompt()));
            assert_eq!(a.fall > 0.0, matches!(condition.weather(), Weather::Snow | Weather::Rain));
            assert_eq!(a.cover > 0.0, condition.surface() != RoadSurface::Dry);
        }
    }

    #[test]
    fn words_name_what_is_seen() {
        let dry = Appearance::named("day-clear-dry").expect("a condition");
        assert_eq!(Appearance::DAY.prompt(), dry.prompt());
        let rainy = Appearance { night: 1.0, wetness: 1.0, cloud: 0.9, haze: 0.5, ..Appearance::DAY };
        assert_eq!(rainy.prompt(), "driving at night, headlights on, overcast sky, haze, wet road");
    }
}
