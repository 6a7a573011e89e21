//! Baselines of healthy drives: learned from case folders, or read from a file.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use ds_dynamics::baseline::Baseline;
pub use ds_dynamics::healthy::steps;
use ds_dynamics::healthy::{Healthy, Progress};
use rayon::prelude::*;

use crate::case::{Case, served};
use crate::error::CasesError;
use crate::folder::{folders, names};

/// Reads healthy cases of vehicle logs, driven by a command in the place of the built-in car if there is one; folders of cases
/// are opened.
///
/// # Errors
/// If a case cannot be read or holds no logs of a vehicle, or the simulator cannot be used.
pub fn healthy(paths: &[PathBuf], simulator: Option<&str>) -> Result<Vec<Healthy>, CasesError> {
    let cases = folders(paths)?;
    let of = |(path, name): (&PathBuf, String)| match (Case::read(path)?, simulator) {
        (Case::Vehicle(case, _), None) => Ok(Healthy { name, case: *case }),
        (Case::Vehicle(case, _), Some(command)) => {
            Ok(Healthy { name, case: ds_simulator::healthy(*case, &served(command, path))? })
        }
        (Case::Frames(_) | Case::Traffic(_), _) => Err(CasesError::NoVehicle { path: path.clone() }),
    };
    let named: Vec<_> = cases.iter().zip(names(&cases)).collect();
    named.into_par_iter().map(of).collect()
}

/// Learns a baseline from healthy cases; `progress` is told [`steps`] times.
///
/// # Errors
/// If there is nothing to learn from.
pub fn learn(healthy: &[Healthy], progress: Progress<'_>) -> Result<Baseline, CasesError> {
    Ok(ds_dynamics::healthy::learn(healthy, progress)?)
}

/// Reads a baseline from its file, or learns one from a folder of healthy cases, by a command if there is one.
///
/// # Errors
/// If it is neither.
pub fn open(path: &Path, simulator: Option<&str>) -> Result<Arc<Baseline>, CasesError> {
    let learned = || learn(&healthy(&[path.to_path_buf()], simulator)?, &|| ());
    let baseline = if path.is_dir() { learned()? } else { Baseline::read(path)? };
    Ok(Arc::new(baseline))
}
