//! What the case folder adds to a diagnosis: the gap along its held-out drives, or example tiles of its frames.
//!
//! A folder with `sim/` and `real/` is a case of frames, any other one of logs. A folder that cannot be read adds
//! nothing but a note that says why.

use std::path::Path;

use ds_diagnosis::meta::Nominal;
use ds_diagnosis::schema::Diagnosis;
use ds_dynamics::case::Case;
use ds_dynamics::traces::{Traces, traces};

use super::frames::{self, Strip};

/// Most drives that are drawn.
const DRIVES: usize = 2;

/// What a case adds.
#[derive(Default)]
pub(crate) struct Material {
    /// The nominal vehicle.
    pub(crate) nominal: Option<Nominal>,
    /// Number of drives.
    pub(crate) drives: Option<usize>,
    /// Names of the recorded channels.
    pub(crate) recorded: Option<Vec<String>>,
    /// The gap along the held-out drives; along the last one if none was kept.
    pub(crate) traces: Vec<Traces>,
    /// Example tiles.
    pub(crate) strip: Option<Strip>,
    /// Why there is nothing.
    pub(crate) note: Option<String>,
}

/// Reads what a case folder adds.
pub(crate) fn of(diagnosis: &Diagnosis, folder: &Path) -> Material {
    if folder.join("sim").is_dir() && folder.join("real").is_dir() {
        return Material { strip: frames::strip(diagnosis, folder), ..Material::default() };
    }
    match Case::read(folder) {
        Err(error) => Material { note: Some(error.to_string()), ..Material::default() },
        Ok(case) => {
            let (fit, held) = case.meta.split();
            let drawn: Vec<usize> = if held.is_empty() { fit.last().copied().into_iter().collect() } else { held };
            let along = |drive: usize| traces(&case, &diagnosis.corrected_model, drive);
            let traces: Vec<Traces> =
                drawn.into_iter().take(DRIVES).map(along).filter(|t| !t.series.is_empty()).collect();
            let names = traces.iter().flat_map(|t| &t.series).map(|series| series.name.clone()).collect();
            Material {
                nominal: Some(case.meta.nominal.clone()),
                drives: Some(case.drives.len()),
                recorded: (!traces.is_empty()).then_some(names),
                traces,
                ..Material::default()
            }
        }
    }
}
