//! Patterns of conditions, such as `weather=fog,lighting=night` or `any`: what a recipe selects and holds out.

use std::fmt;
use std::str::FromStr;

use ds_camera::{Condition, Lighting, RoadSurface, Weather};

/// Values that a condition must have; what is not named may be anything.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Pattern {
    /// The time of day.
    pub lighting: Option<Lighting>,
    /// The weather.
    pub weather: Option<Weather>,
    /// What lies on the road.
    pub surface: Option<RoadSurface>,
}

impl Pattern {
    /// Says whether a condition has all named values.
    #[must_use]
    pub fn holds(&self, condition: Condition) -> bool {
        self.lighting.is_none_or(|value| value == condition.lighting())
            && self.weather.is_none_or(|value| value == condition.weather())
            && self.surface.is_none_or(|value| value == condition.surface())
    }
}

impl FromStr for Pattern {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut pattern = Self::default();
        if text == "any" {
            return Ok(pattern);
        }
        for part in text.split(',') {
            let (axis, value) = part.split_once('=').unwrap_or((part, ""));
            let (axis, value) = (axis.trim(), value.trim());
            let known = match axis {
                "lighting" => set(&mut pattern.lighting, Lighting::ALL, Lighting::name, value),
                "weather" => set(&mut pattern.weather, Weather::ALL, Weather::name, value),
                "surface" => set(&mut pattern.surface, RoadSurface::ALL, RoadSurface::name, value),
                _ => Err("lighting, weather, surface".to_owned()),
            };
            known.map_err(|choices| {
                format!("pattern {text:?}: {part:?} is none of `any` or axis=value pairs; choose from {choices}")
            })?;
        }
        Ok(pattern)
    }
}

fn set<T: Copy>(slot: &mut Option<T>, all: &[T], name: fn(T) -> &'static str, value: &str) -> Result<(), String> {
    match all.iter().find(|candidate| name(**candidate) == value) {
        Some(found) if slot.is_none() => {
            *slot = Some(*found);
            Ok(())
        }
        Some(_) => Err("one value an axis".to_owned()),
        None => Err(all.iter().map(|value| name(*value)).collect::<Vec<_>>().join(", ")),
    }
}

impl fmt::Display for Pattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts = [
            self.lighting.map(|value| format!("lighting={}", value.name())),
            self.weather.map(|value| format!("weather={}", value.name())),
            self.surface.map(|value| format!("surface={}", value.name())),
        ];
        let parts: Vec<String> = parts.into_iter().flatten().collect();
        f.write_str(if parts.is_empty() { "any" } else { "" })?;
        f.write_str(&parts.join(","))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_select_by_the_named_axes() {
        let check = |text: &str, expected: usize| {
            let pattern: Pattern = text.parse().expect("a pattern");
            assert_eq!(pattern.to_string().parse(), Ok(pattern));
            assert_eq!(Condition::all().filter(|condition| pattern.holds(*condition)).count(), expected, "{text}");
        };
        check("any", 105);
        check("lighting=day", 15);
        check("weather=fog, lighting=night", 4);
        check("surface=dry,weather=clear,lighting=day", 1);
        check("weather=rain,surface=dry", 0);
        for bad in ["", "fog", "weather=hail", "weather=fog,weather=rain", "wind=calm"] {
            assert!(bad.parse::<Pattern>().is_err(), "{bad:?}");
        }
    }
}
