//! Trains the `camera` policy, or one of the panel, on reference-camera frames of generated scenarios, and measures it.
//!
//! The teacher is the privileged [`ds_policy::driver::Driver`]. The first samples show the expert's drive and states
//! beside it (shifted, turned, faster, slower) with the way back as their label. Then, round by round, the policy drives
//! training scenarios itself and the teacher labels the states that it got into. Training seeds lie below
//! [`FIRST_HELD_OUT_SEED`], held-out seeds at or above it. Everything is a function of the settings; each round's
//! samples, and the state of training every so many steps, are files in the work folder from which a run goes on.

mod anchors;
mod augment;
mod closed_loop;
mod dataset;
mod gradient;
mod groups;
mod judge;
mod learner;
mod loss;
mod panel_loss;
mod rasters;
mod selection;
mod settings;
mod step_sample;
mod total_loss;
mod vocabulary;

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use ds_nn::safetensors::{FileError, WeightsFile};
use ds_policy::{Learned, Policy};
use ds_video::Backend;
use serde_json::json;

pub use closed_loop::{DriveResult, Driven};
pub use dataset::ScenarioSplit;
pub use loss::Displacement;
pub use settings::{PolicySettings, Round};

use dataset::Samples;
use learner::Learner;

/// Scenario seeds below this one are for training, the others are held out.
pub const FIRST_HELD_OUT_SEED: u64 = 1_000_000;

/// Says why training cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum PolicyTrainError {
    /// The settings are not TOML of the expected form.
    #[error("settings of policy training cannot be read")]
    Toml(#[from] toml::de::Error),
    /// A setting is out of range.
    #[error("setting {field:?} is {value}, {need} expected")]
    Setting {
        /// The setting.
        field: &'static str,
        /// Its value.
        value: String,
        /// What is allowed.
        need: &'static str,
    },
    /// A file cannot be read or written.
    #[error("file {path:?} cannot be {doing}")]
    Io {
        /// What was being done.
        doing: &'static str,
        /// The file.
        path: String,
        /// The system's answer.
        #[source]
        source: std::io::Error,
    },
    /// A file of samples is broken or of another version.
    #[error("samples file {path:?} {problem}")]
    Samples {
        /// The file.
        path: String,
        /// What is wrong.
        problem: String,
    },
    /// A checkpoint cannot be used.
    #[error("checkpoint or weights file cannot be used")]
    Weights(#[from] FileError),
    /// The weights in a file are not those of the network.
    #[error("checkpoint does not fit the network")]
    Fit(#[from] ds_nn::WeightsError),
    /// The network goes on from another whose weights are not there.
    #[error(
        "{student} goes on from the weights of {before}, and {path:?} is not there: `dreamstream train policy --kind {before}` trains them"
    )]
    Begin {
        /// The network.
        student: &'static str,
        /// The one before it.
        before: &'static str,
        /// The file.
        path: String,
    },
    /// A frame of a generated scenario cannot be rendered.
    #[error("a frame of scenario {name:?} cannot be rendered")]
    Frame {
        /// The scenario.
        name: String,
        /// Why.
        #[source]
        source: ds_raster::ImageError,
    },
    /// A layout image of a generated scenario cannot be drawn.
    #[error("a layout image of scenario {name:?} cannot be drawn")]
    Raster {
        /// The scenario.
        name: String,
        /// Why.
        #[source]
        source: ds_layout::LayoutError,
    },
    /// A generated scenario cannot be simulated.
    #[error("scenario {name:?} cannot be simulated")]
    Simulation {
        /// The scenario.
        name: String,
        /// Why.
        #[source]
        source: ds_sim::SimError,
    },
    /// The policy under training failed on its own scenario.
    #[error("policy failed in scenario {name:?}")]
    Policy {
        /// The scenario.
        name: String,
        /// Why.
        #[source]
        source: ds_policy::PolicyError,
    },
    /// Plans of a training sample cannot be scored.
    #[error("plans in scenario {name:?} cannot be scored")]
    Score {
        /// The scenario.
        name: String,
        /// Why.
        #[source]
        source: ds_score::ScoreError,
    },
    /// The loss is no longer a number.
    #[error("loss at step {step} is {loss}")]
    Diverged {
        /// The step.
        step: u32,
        /// The loss.
        loss: f64,
    },
}

/// The files of a training run: samples of the expert serve every student, the rest is the student's own.
#[derive(Debug, Clone)]
struct Files {
    shared: PathBuf,
    folder: PathBuf,
    weights: String,
}

impl Files {
    fn of(folder: &Path, student: Learned) -> Self {
        let shared = folder.to_owned();
        let folder = if student == Learned::Camera { shared.clone() } else { shared.join(student.name()) };
        Self { shared, folder, weights: student.file_name() }
    }

    fn new(folder: &Path, student: Learned) -> Result<Self, PolicyTrainError> {
        let files = Self::of(folder, student);
        fs::create_dir_all(&files.folder).map_err(|source| PolicyTrainError::Io {
            doing: "created",
            path: files.folder.display().to_string(),
            source,
        })?;
        Ok(files)
    }

    fn samples(&self, name: &str) -> PathBuf {
        self.shared.join(format!("{name}.samples"))
    }

    fn driven(&self, round: u64) -> PathBuf {
        self.folder.join(format!("round{round}.samples"))
    }

    fn checkpoint(&self) -> PathBuf {
        self.folder.join("checkpoint.safetensors")
    }

    fn weights(&self) -> PathBuf {
        self.folder.join(&self.weights)
    }

    /// Appends a line of JSON to the log and hands it to the listener.
    fn log(&self, line: &serde_json::Value, listener: &mut dyn FnMut(&str)) -> Result<(), PolicyTrainError> {
        let path = self.folder.join("log.jsonl");
        let text = line.to_string();
        let mut open = OpenOptions::new();
        let written = open.create(true).append(true).open(&path).and_then(|mut file| writeln!(file, "{text}"));
        written.map_err(|source| PolicyTrainError::Io {
            doing: "written",
            path: path.display().to_string(),
            source,
        })?;
        listener(&text);
        Ok(())
    }
}

/// Trains to the end of the settings' rounds, from the last checkpoint in `folder` if there is one, and returns the
/// path of the weights; `backend` is ready, `listener` is shown each line of the log. `shipped` are the weights of the network that the student
/// goes on from ([`Learned::begins_with`]) where none were trained in `folder`.
///
/// # Errors
/// [`PolicyTrainError`] says what is wrong.
pub fn run(
    student: Learned,
    settings: &PolicySettings,
    backend: Backend,
    [folder, shipped]: [&Path; 2],
    listener: &mut dyn FnMut(&str),
) -> Result<PathBuf, PolicyTrainError> {
    settings.check()?;
    let files = Files::new(folder, student)?;
    let begun = student.begins_with().map(|before| Files::of(folder, before).weights()).filter(|file| file.exists());
    let begun = begun.unwrap_or_else(|| shipped.to_owned());
    let held_out =
        Samples::held(&files.samples("held-out"), || dataset::beside_the_expert(settings, ScenarioSplit::HeldOut))?;
    let mut samples =
        Samples::held(&files.samples("expert"), || dataset::beside_the_expert(settings, ScenarioSplit::Training))?;
    files.log(&json!({"samples": samples.len(), "held_out": held_out.len()}), listener)?;
    let mut learner = Learner::resume(student, settings, &samples, &files.checkpoint(), &begun)?;
    let mut end = 0;
    for (index, round) in (0u64..).zip(&settings.rounds) {
        if round.scenarios > 0 {
            let driven = Samples::held(&files.driven(index), || {
                let average = learner.average();
                let policy = || Ok(student.policy(average)?);
                closed_loop::samples_of(settings, index, round.scenarios, &backend.team(), policy)
            })?;
            samples.append(driven);
            files.log(&json!({"round": index, "samples": samples.len()}), listener)?;
        }
        end += round.steps;
        while learner.steps() < end {
            let (step, loss) = (learner.steps(), learner.step(settings, &samples)?);
            if step % settings.log_every == 0 {
                files.log(&json!({"step": step, "loss": loss}), listener)?;
            }
            if learner.steps() % settings.save_every == 0 || learner.steps() == end {
                learner.save(&files.checkpoint())?;
                write_weights(student, settings, &learner, &files.weights())?;
                let mut policy = student.policy(learner.average())?;
                files.log(&open_loop_line(learner.steps(), &mut *policy, &held_out)?, listener)?;
            }
        }
    }
    Ok(files.weights())
}

fn open_loop_line(
    step: u32,
    policy: &mut dyn Policy,
    held_out: &Samples,
) -> Result<serde_json::Value, PolicyTrainError> {
    let found = loss::displacement(policy, held_out)?;
    Ok(json!({
        "step": step,
        "held_out_ade_m": found.policy_m,
        "held_out_best_of_modes_m": found.best_mode_m,
        "constant_velocity_ade_m": found.constant_velocity_m,
        "held_out_lateral_m": found.lateral_m,
        "constant_velocity_lateral_m": found.constant_velocity_lateral_m,
    }))
}

fn write_weights(
    student: Learned,
    settings: &PolicySettings,
    learner: &Learner,
    path: &Path,
) -> Result<(), PolicyTrainError> {
    let metadata = [
        ("steps".to_owned(), learner.steps().to_string()),
        ("model".to_owned(), format!("{} policy 1", student.name())),
        ("settings".to_owned(), settings.digest().to_string()),
        ("licence".to_owned(), "Apache-2.0".to_owned()),
    ];
    let file = WeightsFile { weights: learner.average().clone(), metadata: metadata.into() };
    match student {
        Learned::Camera => file.write(path)?,
        Learned::Panel(_) => file.write_half(path)?,
    }
    Ok(())
}

/// Drives held-out scenarios in closed loop with the weights of a file, with constant velocity, and with frames of
/// another scenario; `listener` is shown one line of JSON per drive and one with the means.
///
/// # Errors
/// [`PolicyTrainError`] says what is wrong.
pub fn evaluate(
    student: Learned,
    settings: &PolicySettings,
    weights: &Path,
    listener: &mut dyn FnMut(&str),
) -> Result<Vec<DriveResult>, PolicyTrainError> {
    settings.check()?;
    let weights = WeightsFile::read(weights)?.weights;
    closed_loop::evaluate(student, settings, &weights, listener)
}

#[cfg(test)]
mod tests;
