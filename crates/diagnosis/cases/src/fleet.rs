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
    /// A version of the software that drives.
    Software,
}

impl By {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Vehicle, Self::Day, Self::Software];

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
            Self::Software => "software",
        }
    }

    fn of(self, log: &Healthy) -> Result<String, CasesError> {
        let meta = &log.case.meta;
        let name = match self {
            Self::Vehicle => &meta.vehicle,
            Self::Day => &meta.day,
            Self::Software => &meta.software,
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

#[cfg(test)]
mod tests {
    use ds_dynamics::case::Case;

    use super::*;

    #[test]
    fn a_member_is_named_by_the_field_of_what_it_is() {
        let folder = tempfile::tempdir().expect("a folder");
        ds_dynamics::synthetic::write_case(folder.path(), 1, &|_| ()).expect("the case can be written");
        let mut log = Healthy { name: "log".to_owned(), case: Case::read(folder.path()).expect("a case") };
        let named = |name: &str| Some(name.to_owned());
        let meta = &mut log.case.meta;
        (meta.vehicle, meta.day, meta.software) = (named("van"), named("monday"), named("4.2.1"));
        for (field, name) in [("vehicle", "van"), ("day", "monday"), ("software", "4.2.1")] {
            let by = By::from_field(field).expect("a kind of member");
            assert_eq!((by.field(), by.of(&log).expect("it is named").as_str()), (field, name));
        }
        log.case.meta.software = None;
        let refused = By::Software.of(&log).expect_err("it is not named").to_string();
        assert!(refused.contains("of which software it is"), "{refused}");
    }
}
