//! The three axes of a drive's look: lighting, weather and road surface, their names and their words.
//!
//! Not every combination makes sense: rain leaves puddles, and it does not snow on sand. [`Condition::all`] lists those
//! that do. The words are fixed and differ between all values, since prompts are embedded as bags of words.

use std::fmt;
use std::str::FromStr;

/// Declares one axis: values with their names in files and their words in prompts.
macro_rules! axis {
    ($(#[$doc:meta])* $axis:ident { $($(#[$value_doc:meta])* $value:ident = $name:literal, $words:literal;)* }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum $axis {
            $($(#[$value_doc])* $value,)*
        }

        impl $axis {
            /// All values of the axis.
            pub const ALL: &[Self] = &[$(Self::$value,)*];

            /// Returns the name in files and on the command line.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self { $(Self::$value => $name,)* }
            }

            /// Returns the words of a prompt.
            #[must_use]
            pub fn words(self) -> &'static str {
                match self { $(Self::$value => $words,)* }
            }

            /// Returns the value of a name.
            #[must_use]
            pub fn named(name: &str) -> Option<Self> {
                Self::ALL.iter().copied().find(|value| value.name() == name)
            }
        }
    };
}

axis! {
    /// Time of day.
    Lighting {
        /// The sun stands high.
        Day = "day", "by day";
        /// A low, rosy sun.
        Sunrise = "sunrise", "at sunrise";
        /// A low, red sun.
        Sunset = "sunset", "at sunset";
        /// After sunset, a purple sky.
        Twilight = "twilight", "at twilight";
        /// A low, golden sun.
        GoldenHour = "golden_hour", "in the golden hour, warm light";
        /// Before sunrise, a deep blue sky.
        BlueHour = "blue_hour", "in the blue hour, dim light";
        /// Dark, with headlights.
        Night = "night", "at night, headlights on";
    }
}

axis! {
    /// What falls from or hangs in the air.
    Weather {
        /// Few clouds.
        Clear = "clear", "clear sky";
        /// A closed cloud cover.
        Overcast = "overcast", "overcast sky";
        /// Falling snow.
        Snow = "snow", "snowfall, flakes in the air";
        /// Falling rain.
        Rain = "rain", "rain, streaks in the air";
        /// Thick fog.
        Fog = "fog", "dense fog";
    }
}

axis! {
    /// What lies on the road and beside it.
    RoadSurface {
        /// Nothing.
        Dry = "dry", "dry road";
        /// Snow, with darker wheel tracks.
        SnowCovered = "snow_covered", "snow covered road";
        /// Drifts of sand.
        SandCovered = "sand_covered", "sand covered road";
        /// Wet, with puddles that mirror the sky.
        Puddles = "puddles", "wet road with puddles";
    }
}

/// One look of a drive, as a value on each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Condition {
    lighting: Lighting,
    weather: Weather,
    surface: RoadSurface,
}

/// A name or combination that is no condition.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ConditionError {
    /// A word is none of any axis.
    #[error(
        "{word:?} is none of lighting ({}), weather ({}) or surface ({})",
        names(Lighting::ALL, Lighting::name),
        names(Weather::ALL, Weather::name),
        names(RoadSurface::ALL, RoadSurface::name)
    )]
    Word {
        /// The word.
        word: String,
    },
    /// Two values of one axis are given.
    #[error("two values of one axis are given, the second is {word:?}")]
    Twice {
        /// The second word.
        word: String,
    },
    /// The combination makes no sense.
    #[error("{weather} on a {surface} road makes no sense: {reason}")]
    Senseless {
        /// The weather.
        weather: &'static str,
        /// The surface.
        surface: &'static str,
        /// Why.
        reason: &'static str,
    },
}

fn names<T: Copy>(all: &[T], name: fn(T) -> &'static str) -> String {
    all.iter().map(|value| name(*value)).collect::<Vec<_>>().join(", ")
}

impl Condition {
    /// Ordinary daylight: clear and dry.
    pub const DAY: Self = Self { lighting: Lighting::Day, weather: Weather::Clear, surface: RoadSurface::Dry };

    /// Combines three values.
    ///
    /// # Errors
    /// [`ConditionError::Senseless`] where weather and surface exclude each other.
    pub fn new(lighting: Lighting, weather: Weather, surface: RoadSurface) -> Result<Self, ConditionError> {
        let reason = match (weather, surface) {
            (Weather::Rain, RoadSurface::Puddles) => None,
            (Weather::Rain, _) => Some("rain leaves puddles"),
            (Weather::Snow, RoadSurface::SandCovered | RoadSurface::Puddles) => {
                Some("it snows on dry roads or on snow")
            }
            _ => None,
        };
        match reason {
            Some(reason) => Err(ConditionError::Senseless { weather: weather.name(), surface: surface.name(), reason }),
            None => Ok(Self { lighting, weather, surface }),
        }
    }

    /// Combines what is said of each axis: what is not said is day, clear (overcast on snow and puddles) and the surface that the weather leaves.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of(
        lighting: Option<Lighting>,
        weather: Option<Weather>,
        surface: Option<RoadSurface>,
    ) -> Result<Self, ConditionError> {
        let weather = weather.unwrap_or(match surface {
            Some(RoadSurface::SnowCovered | RoadSurface::Puddles) => Weather::Overcast,
            _ => Weather::Clear,
        });
        let surface = surface.unwrap_or(match weather {
            Weather::Snow => RoadSurface::SnowCovered,
            Weather::Rain => RoadSurface::Puddles,
            Weather::Clear | Weather::Overcast | Weather::Fog => RoadSurface::Dry,
        });
        Self::new(lighting.unwrap_or(Lighting::Day), weather, surface)
    }

    /// Returns all conditions that make sense, in the order of the axes.
    pub fn all() -> impl Iterator<Item = Self> {
        let weathers = |lighting| Weather::ALL.iter().map(move |weather| (lighting, *weather));
        let pairs = Lighting::ALL.iter().flat_map(move |lighting| weathers(*lighting));
        pairs.flat_map(|(lighting, weather)| {
            RoadSurface::ALL.iter().filter_map(move |surface| Self::new(lighting, weather, *surface).ok())
        })
    }

    /// Returns the time of day.
    #[must_use]
    pub fn lighting(self) -> Lighting {
        self.lighting
    }

    /// Returns the weather.
    #[must_use]
    pub fn weather(self) -> Weather {
        self.weather
    }

    /// Returns what lies on the road.
    #[must_use]
    pub fn surface(self) -> RoadSurface {
        self.surface
    }

    /// Describes the condition for a prompt; the sky is not named where precipitation or fog hides it.
    #[must_use]
    pub fn words(self) -> String {
        format!("driving {}, {}, {}", self.lighting.words(), self.weather.words(), self.surface.words())
    }
}

impl fmt::Display for Condition {
    /// Writes the short name, such as `night-rain-puddles`, which parses back.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-{}-{}", self.lighting.name(), self.weather.name(), self.surface.name())
    }
}

/// What is said of a condition so far.
#[derive(Default)]
struct Said {
    lighting: Option<Lighting>,
    weather: Option<Weather>,
    surface: Option<RoadSurface>,
}

impl Said {
    fn word(&mut self, axis: Option<&str>, word: &str) -> Result<(), ConditionError> {
        let is = |name: &str| axis.is_none_or(|axis| axis == name);
        let fresh = if let Some(value) = Lighting::named(word).filter(|_| is("lighting")) {
            self.lighting.replace(value).is_none()
        } else if let Some(value) = Weather::named(word).filter(|_| is("weather")) {
            self.weather.replace(value).is_none()
        } else if let Some(value) = RoadSurface::named(word).filter(|_| is("surface")) {
            self.surface.replace(value).is_none()
        } else {
            return Err(ConditionError::Word { word: word.to_owned() });
        };
        if fresh { Ok(()) } else { Err(ConditionError::Twice { word: word.to_owned() }) }
    }
}

impl FromStr for Condition {
    type Err = ConditionError;

    /// Reads `snow`, `rain-night` or `lighting=night,weather=rain,surface=puddles`: any of the axes in any order.
    ///
    /// What is not said is as [`Condition::of`] has it.
    fn from_str(text: &str) -> Result<Self, ConditionError> {
        let mut said = Said::default();
        if text.contains('=') {
            for part in text.split(',') {
                let (axis, word) = part.split_once('=').unwrap_or(("", part));
                said.word(Some(axis.trim()), word.trim())?;
            }
        } else {
            let joined = text.replace("golden-hour", "golden_hour").replace("blue-hour", "blue_hour");
            let joined = joined.replace("snow-covered", "snow_covered").replace("sand-covered", "sand_covered");
            for word in joined.split('-') {
                said.word(None, if word == "sand" { "sand_covered" } else { word })?;
            }
        }
        Self::of(said.lighting, said.weather, said.surface)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn all_conditions_have_names_that_parse_back_and_words_of_their_own() {
        let all: Vec<Condition> = Condition::all().collect();
        assert_eq!(all.len(), 7 * 15);
        let mut bags = BTreeSet::new();
        for condition in &all {
            assert_eq!(condition.to_string().parse(), Ok(*condition));
            let words = condition.words();
            let bag: BTreeSet<String> =
                words.split(|c: char| !c.is_alphanumeric()).filter(|w| !w.is_empty()).map(str::to_owned).collect();
            assert!(bags.insert(bag), "{words:?} has the words of another condition");
        }
    }

    #[test]
    fn names_are_read_in_every_form() {
        let check = |text: &str, expected: &str| {
            let found = text.parse::<Condition>().map_or_else(|error| error.to_string(), |found| found.to_string());
            assert!(found.contains(expected), "{text:?} gives {found:?}, not {expected:?}");
        };
        check("snow", "day-snow-snow_covered");
        check("rain-night", "night-rain-puddles");
        check("golden-hour-fog", "golden_hour-fog-dry");
        check("sand", "day-clear-sand_covered");
        check("lighting=night,weather=rain,surface=puddles", "night-rain-puddles");
        check("surface=snow_covered", "day-overcast-snow_covered");
        check("weather=night", "\"night\" is none of");
        check("hail", "\"hail\" is none of lighting (day, sunrise");
        check("rain-snow", "two values");
        check("rain-dry", "rain leaves puddles");
        check("snow-sand", "makes no sense");
    }
}
