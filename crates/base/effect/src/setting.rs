//! An effect switched on: which one and with which values, checked; or a law that no effect is, by its text.

use crate::frame::Needs;
use crate::law::{Law, LawError};
use crate::parameter::{Parameter, Scale};
use crate::{Effect, Plant, find, find_frame};

/// An effect of the library with a value for each of its parameters, in reported units, or a law.
#[derive(Clone)]
pub struct Setting {
    what: What,
    values: Vec<f64>,
}

#[derive(Clone)]
enum What {
    Effect(&'static Effect),
    Law(Law),
}

/// Why an effect cannot be switched on.
#[derive(Debug, Clone, PartialEq)]
pub enum SettingError {
    /// No effect has this id.
    Unknown(String),
    /// The text of a law that is none.
    Law(LawError),
    /// A law with values beside its text.
    LawValues(String),
    /// The effect has another number of parameters.
    Count {
        /// The effect.
        id: &'static str,
        /// Values given.
        given: usize,
        /// Parameters that it has.
        need: usize,
    },
    /// The effect needs what a run does not give its frames.
    Frames {
        /// The effect.
        id: &'static str,
        /// What it needs.
        need: &'static str,
    },
    /// A value that the parameter cannot have.
    Value {
        /// The effect.
        id: &'static str,
        /// The parameter.
        parameter: &'static str,
        /// The value given.
        value: f64,
        /// What it must be.
        need: &'static str,
    },
}

impl std::fmt::Display for SettingError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unknown(id) => write!(f, "no effect is called {id:?}"),
            Self::Law(error) => error.fmt(f),
            Self::LawValues(text) => write!(f, "law {text:?} takes no values beside its text"),
            Self::Count { id, given, need } => write!(f, "effect {id} takes {need} values, not {given}"),
            Self::Frames { id, need } => write!(f, "effect {id} cannot be switched on in a run: it needs {need}"),
            Self::Value { id, parameter, value, need } => {
                write!(f, "{parameter} of effect {id} is {value}; it must be {need}")
            }
        }
    }
}

impl std::error::Error for SettingError {}

impl Setting {
    /// Checks id and values; the id of a law is its text.
    ///
    /// # Errors
    /// [`SettingError`] names the effect and what is wrong.
    pub fn new(id: &str, values: &[f64]) -> Result<Self, SettingError> {
        if Law::is_text(id) {
            let law = Law::parse(id).map_err(SettingError::Law)?;
            let alone = values.is_empty();
            return if alone { Ok(law.into()) } else { Err(SettingError::LawValues(id.to_owned())) };
        }
        let effect = find(id).ok_or_else(|| SettingError::Unknown(id.to_owned()))?;
        check_values(effect.id, effect.parameters, values)?;
        Ok(Self { what: What::Effect(effect), values: values.to_vec() })
    }

    /// Returns the id of the effect or the text of the law.
    #[must_use]
    pub fn id(&self) -> String {
        match &self.what {
            What::Effect(effect) => effect.id.to_owned(),
            What::Law(law) => law.to_string(),
        }
    }

    /// Returns the law, if it is one.
    #[must_use]
    pub fn law(&self) -> Option<&Law> {
        match &self.what {
            What::Effect(_) => None,
            What::Law(law) => Some(law),
        }
    }

    /// Returns its values, one per parameter.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Switches it on.
    pub fn apply(&self, plant: &mut Plant) {
        match &self.what {
            What::Effect(effect) => (effect.apply)(&self.values, plant),
            What::Law(law) => plant.laws.push(law.clone()),
        }
    }
}

impl From<Law> for Setting {
    fn from(law: Law) -> Self {
        Self { what: What::Law(law), values: Vec::new() }
    }
}

/// Tells whether what has this id acts on the car, others or the map, and not on frames.
#[must_use]
pub fn acts_on_the_world(id: &str) -> bool {
    find(id).is_some() || Law::is_text(id)
}

/// Checks that an effect, on the car or on frames, can be switched on in a run with these values.
///
/// # Errors
/// [`SettingError`] names the effect and what is wrong.
pub fn check(id: &str, values: &[f64]) -> Result<(), SettingError> {
    let Some(effect) = find_frame(id).filter(|_| find(id).is_none()) else {
        return Setting::new(id, values).map(|_| ());
    };
    check_values(effect.id, effect.parameters, values)?;
    let need = effect.needs.iter().find_map(|need| match need {
        Needs::Light => Some("a record of the light"),
        Needs::Boxes => Some("boxes of the layout"),
        Needs::Sequence => Some("the frames before"),
        Needs::Picture | Needs::Colour | Needs::Motion | Needs::Depth => None,
    });
    need.map_or(Ok(()), |need| Err(SettingError::Frames { id: effect.id, need }))
}

fn check_values(id: &'static str, parameters: &[Parameter], values: &[f64]) -> Result<(), SettingError> {
    if values.len() != parameters.len() {
        return Err(SettingError::Count { id, given: values.len(), need: parameters.len() });
    }
    for (parameter, &value) in parameters.iter().zip(values) {
        let (sound, need) = match parameter.scale {
            Scale::Log => (value.is_finite() && value > 0.0, "a positive factor"),
            Scale::Limit => (value > 0.0, "a positive limit"),
            Scale::Linear | Scale::Threshold | Scale::OfMass => (value.abs() <= 1e6, "a number up to a million"),
        };
        if !sound {
            return Err(SettingError::Value { id, parameter: parameter.name, value, need });
        }
    }
    Ok(())
}

impl PartialEq for Setting {
    fn eq(&self, other: &Self) -> bool {
        self.id() == other.id() && self.values == other.values
    }
}

impl std::fmt::Debug for Setting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {:?}", self.id(), self.values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_settings_are_refused_by_name() {
        let text = |id: &str, values: &[f64]| Setting::new(id, values).expect_err(id).to_string();
        assert!(text("steer_dealy", &[0.1]).contains("steer_dealy"));
        assert!(text("wind_steady", &[3.0]).contains("takes 2 values, not 1"));
        assert!(text("steer_delay", &[f64::NAN]).contains("NaN"));
        assert!(text("front_grip", &[0.0]).contains("positive factor"));
        assert!(text("steer_rate", &[-1.0]).contains("positive limit"));
        assert_eq!(check("defocus", &[1.0]), Ok(()));
        assert!(check("object_dropout", &[0.2]).expect_err("boxes").to_string().contains("boxes"));
        assert!(check("defocus", &[1.0, 2.0]).is_err());
        assert!(text("steering: 1*speed", &[]).contains("speed"));
        assert!(text("steering: 1*v", &[1.0]).contains("no values"));
        assert!(Setting::new("steering: 1*v", &[]).expect("sound").law().is_some());
        assert_eq!(Setting::new("steer_delay", &[0.1]).expect("sound").values(), [0.1]);
    }
}
