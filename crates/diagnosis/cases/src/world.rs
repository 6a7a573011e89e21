//! The world of a run beyond the nominal one: effects from flags, files and corrected models.

use std::path::{Path, PathBuf};

use ds_diagnosis::Diagnosis;
use ds_effect::{Insertion, Law, Port, find};
use ds_wire::control as pb;
use serde::{Deserialize, Serialize};

use crate::error::{CasesError, at};

/// The effect that moves the steering's zero point.
const ZERO_POINT: &str = "steer_offset";
/// A thousandth of the smallest step of a steering sensor, in radians.
pub const HAIR_RAD: f64 = 1e-6;

/// What a configuration file of a run may say.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RunConfig {
    /// Effects that the world has beyond the nominal one.
    pub effects: Vec<EffectLine>,
    /// Laws that no effect of the library is, by their text.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub laws: Vec<String>,
    /// The ordinary mismatch that was fitted beside them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub nuisance: Vec<EffectLine>,
}

/// One effect with its values, one per parameter, in reported units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectLine {
    /// Its id.
    pub id: String,
    /// Its values.
    pub values: Vec<f64>,
}

impl EffectLine {
    /// Reads `id=value` or `id=value,value`.
    fn parse(text: &str) -> Result<Self, CasesError> {
        let refused = || CasesError::Flag { text: text.to_owned() };
        let (id, values) = text.split_once('=').ok_or_else(refused)?;
        let number = |value: &str| value.trim().parse::<f64>().map_err(|_| refused());
        Ok(Self { id: id.trim().to_owned(), values: values.split(',').map(number).collect::<Result<_, _>>()? })
    }
}

impl RunConfig {
    /// Returns the effects and laws of a file, if any, and of flags, checked.
    ///
    /// # Errors
    /// If the file is no configuration, or an effect or a law is refused.
    pub fn gather(file: Option<&PathBuf>, flags: &[String], laws: &[String]) -> Result<Self, CasesError> {
        let mut config = file.map(|path| read(path)).transpose()?.unwrap_or_default();
        for flag in flags {
            config.effects.push(EffectLine::parse(flag)?);
        }
        config.laws.extend_from_slice(laws);
        for text in &config.laws {
            let law = Law::parse(text).map_err(|error| CasesError::Law(error.to_string()))?;
            if law.port() == Port::Follower {
                return Err(CasesError::Law("a law at \"follower\" acts in diagnoses alone, not in a run".to_owned()));
            }
        }
        for line in config.lines() {
            ds_effect::check(&line.id, &line.values).map_err(|error| CasesError::Effect(error.to_string()))?;
        }
        Ok(config)
    }

    /// Returns the corrected simulators of some diagnoses, such as that of a car and that of its camera, as one, with the
    /// ordinary mismatch that was measured with their effects. An effect takes the place of mismatch of its name, which
    /// counts once.
    ///
    /// # Errors
    /// If an effect has no finite value.
    pub fn corrected(diagnoses: &[Diagnosis]) -> Result<Self, CasesError> {
        let mut config = Self::default();
        for diagnosis in diagnoses {
            for (id, values) in diagnosis.corrected_model.added() {
                if values.iter().any(|value| !value.is_finite()) {
                    return Err(CasesError::NoValue { id, case: diagnosis.case.clone() });
                }
                config.effects.push(EffectLine { id, values });
            }
            config.laws.extend(diagnosis.corrected_model.laws.clone());
        }
        for (id, values) in diagnoses.iter().flat_map(|diagnosis| diagnosis.corrected_model.mismatch()) {
            if config.lines().all(|line| line.id != id) {
                config.nuisance.push(EffectLine { id, values });
            }
        }
        Ok(config)
    }

    /// Returns the same world but for a zero point of the steering that lies a [`HAIR_RAD`] beside: no log could tell, yet drives
    /// of a policy that sees frames may part, and how far says what chance makes of two runs.
    #[must_use]
    pub fn hair_apart(&self) -> Self {
        let mut config = self.clone();
        let lines = config.nuisance.iter_mut().chain(&mut config.effects);
        match lines.filter(|line| line.id == ZERO_POINT).find_map(|line| line.values.first_mut()) {
            Some(value) => *value += HAIR_RAD,
            None => config.effects.push(EffectLine { id: ZERO_POINT.to_owned(), values: vec![HAIR_RAD] }),
        }
        config
    }

    /// Returns all that is switched on, the ordinary mismatch first.
    pub fn lines(&self) -> impl Iterator<Item = &EffectLine> {
        self.nuisance.iter().chain(&self.effects)
    }

    /// Writes a configuration file that says after which case it was corrected, and remarks.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, case: &str, remarks: &[String], path: &Path) -> Result<(), CasesError> {
        let remarks: String =
            remarks.iter().map(|remark| format!("# {}\n", remark.replace(char::is_control, " "))).collect();
        let text = format!("# The simulator corrected by the diagnosis of {case:?}.\n{remarks}{}", self.to_toml());
        std::fs::write(path, text).map_err(at(path))
    }

    /// Returns the text of a configuration file.
    ///
    /// # Panics
    /// Never: tables of numbers are TOML.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("tables of numbers are TOML")
    }

    /// Returns the effects as a run's settings carry them.
    #[must_use]
    pub fn switched(&self) -> Vec<pb::SwitchedEffect> {
        let switched = |line: &EffectLine| pb::SwitchedEffect { id: line.id.clone(), values: line.values.clone() };
        let law = |text: &String| pb::SwitchedEffect { id: text.clone(), values: Vec::new() };
        self.lines().map(switched).chain(self.laws.iter().map(law)).collect()
    }
}

/// A part of the world that can be the nominal or the real one's.
#[derive(Debug, Clone, PartialEq)]
pub struct Component {
    /// Its name.
    pub name: &'static str,
    /// Effects that it brings.
    pub effects: Vec<EffectLine>,
    /// Laws that it brings.
    pub laws: Vec<String>,
}

impl Component {
    /// The component that is what makes the frames, and what acts on them.
    pub const FRAMES: &'static str = "frames";
}

/// Sorts the real world's differences by the service that makes them; `frames_differ` says whether something else makes
/// its frames. A component without a difference is left out.
#[must_use]
pub fn components(config: &RunConfig, frames_differ: bool) -> Vec<Component> {
    let of = |wanted: &[Insertion]| -> Vec<EffectLine> {
        let inside = |line: &&EffectLine| find(&line.id).is_some_and(|effect| wanted.contains(&effect.insertion));
        config.lines().filter(inside).cloned().collect()
    };
    let dynamics = [Insertion::CommandPath, Insertion::Actuator, Insertion::Vehicle, Insertion::Road];
    let senses = |text: &&String| Law::parse(text).is_ok_and(|law| matches!(law.port(), Port::Sensor(_)));
    let (sensors, moves): (Vec<&String>, Vec<&String>) = config.laws.iter().partition(senses);
    let named = |laws: Vec<&String>| laws.into_iter().cloned().collect();
    let all = [
        Component { name: "dynamics", effects: of(&dynamics), laws: named(moves) },
        Component { name: "agents", effects: of(&[Insertion::Agent, Insertion::Map]), laws: Vec::new() },
        Component {
            name: "latency and sensors",
            effects: of(&[Insertion::Clock, Insertion::Sensor]),
            laws: named(sensors),
        },
    ];
    // What the car's own library does not know acts on finished frames.
    let on_frames: Vec<EffectLine> = config.lines().filter(|line| find(&line.id).is_none()).cloned().collect();
    let differ = frames_differ || !on_frames.is_empty();
    let frames = differ.then_some(Component { name: Component::FRAMES, effects: on_frames, laws: Vec::new() });
    let differs = |component: &Component| !(component.effects.is_empty() && component.laws.is_empty());
    frames.into_iter().chain(all.into_iter().filter(differs)).collect()
}

fn read(path: &Path) -> Result<RunConfig, CasesError> {
    let text = std::fs::read_to_string(path).map_err(at(path))?;
    toml::from_str(&text).map_err(|source| CasesError::Config { path: path.to_path_buf(), source: Box::new(source) })
}

#[cfg(test)]
mod tests {

    use ds_diagnosis::schema::CorrectedEffect;

    use super::*;

    #[test]
    fn corrections_carry_their_mismatch_and_are_read_back() {
        let diagnosis = |effect: (&str, f64), nuisance: &[(&str, f64)]| {
            let mut found = Diagnosis::blank("case");
            let (id, value) = (effect.0.to_owned(), effect.1);
            found.corrected_model.effects = vec![CorrectedEffect { id, value, values: vec![value] }];
            found.corrected_model.nuisance = nuisance.iter().map(|(id, value)| ((*id).to_owned(), *value)).collect();
            found
        };
        let car = diagnosis(("steer_delay", 0.1), &[("payload", 12.0), ("shift_x_px", 3.0)]);
        let traffic = diagnosis(("tr_delay", 0.3), &[("steer_delay", 0.01), ("payload", 15.0), ("tr_headway", 1.02)]);
        let both = RunConfig::corrected(&[car, traffic]).expect("values");
        let lines: Vec<(&str, f64)> = both.lines().map(|line| (line.id.as_str(), line.values[0])).collect();
        assert_eq!(lines, [("payload", 12.0), ("tr_headway", 1.02), ("steer_delay", 0.1), ("tr_delay", 0.3)]);
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("corrected.toml");
        both.write("case", &["two\nlines".to_owned()], &path).expect("written");
        let read = RunConfig::gather(Some(&path), &[], &[]).expect("sound");
        assert_eq!((read.switched().len(), read), (4, both));
    }

    #[test]
    fn flags_are_read_and_refused() {
        let flags = |text: &str| RunConfig::gather(None, &[text.to_owned()], &[]);
        assert_eq!(flags("steer_delay=0.1").expect("sound").effects[0].values, [0.1]);
        assert_eq!(flags("wind_steady=3,-2").expect("sound").effects[0].values, [3.0, -2.0]);
        for bad in ["steer_delay", "steer_delay=x", "wind_steady=3", "nothing=1"] {
            assert!(flags(bad).is_err(), "{bad} was accepted");
        }
        let laws = |text: &str| RunConfig::gather(None, &[], &[text.to_owned()]);
        let config = laws("steering: 0.2*delta*v[5;30]").expect("sound");
        assert_eq!(config.switched()[0].id, "steering: 0.2*delta*v[5;30]");
        assert_eq!(components(&config, false)[0].name, "dynamics");
        assert_eq!(components(&laws("sensor.v: 0.1*v").expect("sound"), false)[0].name, "latency and sensors");
        for bad in ["steering", "steering: delta", "wheel: 1*v", "follower: 1*gap"] {
            assert!(laws(bad).is_err(), "{bad} was accepted");
        }
    }
}
