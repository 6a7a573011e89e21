//! Baselines of healthy drives: learned from case folders, or read from a file.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use ds_dynamics::baseline::Baseline;
pub use ds_dynamics::healthy::steps;
use ds_dynamics::healthy::{Healthy, Progress};

use crate::case::{Case, folders, names};
use crate::error::CasesError;

/// Reads healthy cases of vehicle logs; folders of cases are opened.
///
/// # Errors
/// If a case cannot be read or holds no logs of a vehicle.
pub fn healthy(paths: &[PathBuf]) -> Result<Vec<Healthy>, CasesError> {
    let cases = folders(paths)?;
    let of = |(path, name): (&PathBuf, String)| match Case::read(path)? {
        Case::Vehicle(case, _) => Ok(Healthy { name, case: *case }),
        Case::Frames(_) | Case::Traffic(_) => Err(CasesError::NoVehicle { path: path.clone() }),
    };
    cases.iter().zip(names(&cases)).map(of).collect()
}

/// Learns a baseline from healthy cases; `progress` is told [`steps`] times.
///
/// # Errors
/// If there is nothing to learn from.
pub fn learn(healthy: &[Healthy], progress: Progress<'_>) -> Result<Baseline, CasesError> {
    Ok(ds_dynamics::healthy::learn(healthy, progress)?)
}

/// Reads a baseline from its file, or learns one from a folder of healthy cases.
///
/// # Errors
/// If it is neither.
pub fn open(path: &Path) -> Result<Arc<Baseline>, CasesError> {
    let baseline = if path.is_dir() { learn(&healthy(&[path.to_path_buf()])?, &|| ())? } else { Baseline::read(path)? };
    Ok(Arc::new(baseline))
}
