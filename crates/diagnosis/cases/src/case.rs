//! A case of any kind and the diagnoser that takes it.

use std::ops::RangeInclusive;
use std::path::Path;
use std::sync::Arc;

use ds_diagnosis::discovery::EXTRAPOLATED;
use ds_diagnosis::meta::Kind;
use ds_diagnosis::schema::Shrink;
use ds_diagnosis::{Diagnosis, Verdict};
use ds_dynamics::baseline::Baseline;
use ds_frames::{Nuisance, Streams};
use ds_record::vehicle_log::Planned;
use ds_simulator::Explored;

use crate::attended::{Panel, attended};
use crate::error::CasesError;
use crate::folder::name;
use crate::logs;
use crate::stamps;

/// A case, read and checked.
pub enum Case {
    /// Logs of a vehicle, and when its policy answered.
    Vehicle(Box<ds_dynamics::case::Case>, Vec<Planned>),
    /// Streams of frames.
    Frames(Box<Streams>),
    /// Recorded traffic.
    Traffic(Box<ds_traffic::Case>),
}

/// How to diagnose.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Logs of a vehicle: fast pass and single fits only.
    pub quick: bool,
    /// Effects that are left out of the library, to see what is said without them.
    pub without: Vec<String>,
    /// Logs of a vehicle: what healthy drives of it say.
    pub baseline: Option<Arc<Baseline>>,
    /// Logs of a vehicle: the command that serves the nominal simulator; `{case}` in it is the case's folder.
    pub simulator: Option<String>,
    /// Frames: what the generator does without any effect.
    pub nuisance: Option<Nuisance>,
    /// Frames: policies that look at them.
    pub panel: Panel,
    /// Logs of a vehicle: look for a law whatever the verdict; without, where it is unknown and the diagnosis is no quick one.
    pub discover: bool,
}

/// On what a diagnosis is measured anew; all of the case without.
#[derive(Debug, Clone, Default)]
pub struct Unseen {
    /// Drives or recordings.
    pub drives: Vec<usize>,
    /// Frames.
    pub frames: Option<RangeInclusive<u64>>,
    /// Frames: policies that look at them.
    pub panel: Panel,
}

impl Case {
    /// Reads a case folder, or the folder of the vehicle logs of a run.
    ///
    /// # Errors
    /// If a file is unreadable or makes no sense.
    pub fn read(folder: &Path) -> Result<Self, CasesError> {
        if logs::are_logs(folder) {
            let (case, plans) = logs::read(folder, &name(folder))?;
            return Ok(Self::Vehicle(Box::new(case), plans));
        }
        Ok(match Kind::of(folder) {
            Kind::Traffic => Self::Traffic(Box::new(ds_traffic::Case::read(folder)?)),
            Kind::Frames => Self::Frames(Box::new(Streams::read(folder)?)),
            Kind::Vehicle => Self::Vehicle(Box::new(ds_dynamics::case::Case::read(folder)?), stamps::read(folder)?),
        })
    }

    /// Returns how many drives or recordings it has; none of frames.
    #[must_use]
    pub fn drives(&self) -> Option<usize> {
        match self {
            Self::Vehicle(case, _) => Some(case.drives.len()),
            Self::Traffic(case) => Some(case.recordings.len()),
            Self::Frames(_) => None,
        }
    }

    /// Returns the case to be diagnosed against a baseline, which speaks of logs of a vehicle alone.
    ///
    /// # Errors
    /// If the baseline is of another vehicle or other channels.
    pub fn against(self, baseline: Option<&Arc<Baseline>>) -> Result<Self, CasesError> {
        Ok(match (self, baseline) {
            (Self::Vehicle(case, plans), Some(baseline)) => {
                Self::Vehicle(Box::new(case.against(baseline.clone())?), plans)
            }
            (other, _) => other,
        })
    }
}

/// Diagnoses a case.
///
/// # Errors
/// If traffic shows nobody for long enough, or frames cannot be compared.
pub fn diagnose(case: &Case, options: &Options) -> Result<Diagnosis, CasesError> {
    let without = || options.without.clone();
    Ok(match case {
        Case::Traffic(case) => ds_traffic::diagnose(case, &ds_traffic::Options { without: without() })?,
        Case::Frames(case) => {
            let nuisance = options.nuisance.clone();
            let mut diagnosis = case.diagnose(&ds_frames::Options { without: without(), nuisance })?;
            let told = attended(case, &diagnosis, None, &options.panel)?;
            diagnosis.how_far.extend(told.shrinks);
            diagnosis.attended = told.attended;
            diagnosis.warnings.extend(told.unknown);
            diagnosis
        }
        Case::Vehicle(case, plans) => {
            let own = ds_dynamics::Options { quick: options.quick, without: without() };
            let mut diagnosis = ds_dynamics::diagnose(case, &own);
            if options.discover || (diagnosis.verdict == Verdict::Unknown && !options.quick) {
                ds_discover::discover(case, &mut diagnosis, &own.without);
            }
            diagnosis.join(stamps::diagnose(&diagnosis.case, plans));
            diagnosis
        }
    })
}

/// Diagnoses logs of a vehicle with a command as the nominal simulator, see `docs/simulators.md`; laws are looked for where
/// that was asked.
///
/// # Errors
/// If the case is another one, or the simulator cannot be used.
pub fn diagnose_by(case: Case, command: &str, options: &Options) -> Result<Diagnosis, CasesError> {
    let Case::Vehicle(case, plans) = case else { return Err(CasesError::SimulatorWithoutVehicle) };
    let own = ds_dynamics::Options { quick: options.quick, without: options.without.clone() };
    let (case, explored) = Explored::new(*case, command, options.baseline.clone(), &own)?;
    let able = explored.able(&own);
    let mut diagnosis = ds_dynamics::diagnose(&case, &able);
    if options.discover {
        ds_discover::discover(&case, &mut diagnosis, &able.without);
    }
    explored.tell(&mut diagnosis);
    diagnosis.join(stamps::diagnose(&diagnosis.case, &plans));
    Ok(diagnosis)
}

/// Returns the command of a simulator for a case: `{case}` in it is the case's folder.
#[must_use]
pub fn served(command: &str, case: &Path) -> String {
    command.replace("{case}", &case.to_string_lossy())
}

/// Measures how far a diagnosis shrinks the gap on data that it never saw, without any refit.
///
/// # Errors
/// If traffic shows nobody for long enough, or frames cannot be compared.
pub fn evaluate(diagnosis: &Diagnosis, case: &Case, unseen: Unseen) -> Result<Vec<Shrink>, CasesError> {
    Ok(match case {
        Case::Traffic(case) => ds_traffic::evaluate(diagnosis, case, &unseen.drives)?,
        Case::Frames(case) => {
            let wanted = |n: u64| unseen.frames.as_ref().is_none_or(|frames| frames.contains(&n));
            let mut shrinks = case.evaluate(diagnosis, unseen.frames.clone())?;
            shrinks.extend(attended(case, diagnosis, Some(&wanted), &unseen.panel)?.shrinks);
            shrinks
        }
        Case::Vehicle(case, _) => ds_dynamics::evaluate(diagnosis, case, &unseen.drives),
    })
}

/// Warns where laws of a diagnosis are measured beyond the ranges on which they were found.
#[must_use]
pub fn beyond(diagnosis: &Diagnosis, case: &Case, drives: &[usize]) -> Option<String> {
    let Case::Vehicle(case, _) = case else { return None };
    let all: Vec<usize> = (0..case.drives.len()).filter(|d| drives.is_empty() || drives.contains(d)).collect();
    let laws = diagnosis.corrected_model.obeyed();
    let shares = laws.iter().filter_map(|law| ds_discover::extrapolated_share(case, law, &all));
    let share = shares.max_by(f64::total_cmp)?;
    (share > EXTRAPOLATED).then(|| {
        format!("{:.0} % of the samples lie beyond the ranges on which the law was found: there it counts as at their ends, a table as 0", 100.0 * share)
    })
}

/// Measures the same on logs of a vehicle by a command as the nominal simulator; also returns what went wrong with some of its
/// runs.
///
/// # Errors
/// If the case is another one, or the simulator cannot be used.
pub fn evaluate_by(
    diagnosis: &Diagnosis,
    case: Case,
    command: &str,
    drives: &[usize],
) -> Result<(Vec<Shrink>, Vec<String>), CasesError> {
    let Case::Vehicle(case, _) = case else { return Err(CasesError::SimulatorWithoutVehicle) };
    Ok(ds_simulator::evaluate(diagnosis, *case, command, drives)?)
}
