//! Fleets: cases of vehicle logs, grouped by what their descriptions name.

use std::path::PathBuf;

use ds_diagnosis::{CaseError, Diagnosis};
use ds_dynamics::Options;
pub use ds_dynamics::fleet::{Fleet, steps};
use ds_dynamics::healthy::{Healthy, Progress};

use crate::baseline::healthy;
use crate::error::CasesError;

/// What a member of a fleet is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum By {
    /// A vehicle.
    Vehicle,
    /// A day of drives.
    Day,
}

impl By {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Vehicle, Self::Day];

    /// Finds what a field of `meta.json` names.
    #[must_use]
    pub fn from_field(field: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|by| by.field() == field)
    }

    /// Returns the field of `meta.json` that names it.
    #[must_use]
    pub fn field(self) -> &'static str {
        match self {
            Self::Vehicle => "vehicle",
            Self::Day => "day",
        }
    }

    fn of(self, log: &Healthy) -> Result<String, CasesError> {
        let meta = &log.case.meta;
        let name = match self {
            Self::Vehicle => &meta.vehicle,
            Self::Day => &meta.day,
        };
        name.clone().ok_or_else(|| CaseError::NoMember { case: log.name.clone(), by: self.field() }.into())
    }
}

/// Reads the cases of a fleet; folders of cases are opened.
///
/// # Errors
/// If a case cannot be read or holds no logs of a vehicle.
pub fn read(paths: &[PathBuf]) -> Result<Vec<Healthy>, CasesError> {
    healthy(paths, None)
}

/// Diagnoses a fleet; `progress` is told [`steps`] times.
///
/// # Errors
/// If a case names no member, or there are too few.
pub fn diagnose(
    logs: Vec<Healthy>,
    by: By,
    quick: bool,
    progress: Progress<'_>,
) -> Result<(Fleet, Vec<Diagnosis>), CasesError> {
    let of: Vec<String> = logs.iter().map(|log| by.of(log)).collect::<Result<_, _>>()?;
    let options = Options { quick, without: Vec::new() };
    Ok(ds_dynamics::fleet::fleet(logs, by.field(), &of, &options, progress)?)
}
