//! What studies ask their questions of: features of every network, and their distances with resamples.

use ds_fidelity::{Features, Unit, mean_of};
use ds_space::Digest;

use super::config::StudyConfig;
use super::frames::Take;
use super::outcome::Table;

/// Distances are stated in hundredths of the variance.
pub(super) const HUNDREDTHS: f64 = 100.0;

/// Features of one network on the real set and on each source.
pub(super) struct Sets {
    pub(super) name: String,
    pub(super) control: bool,
    pub(super) digest: Digest,
    pub(super) real: Features,
    pub(super) others: Vec<Features>,
    pub(super) placed: Option<(Features, Vec<Features>)>,
    /// The variance, or the features' own of a network that was given.
    pub(super) unit: Unit,
}

/// One network's distances: the table, the draws of each source, |φ - φ̃|²/Tr Σ by source, scenario and frame; all × 100
/// but the last, and those of networks that were given.
pub(super) struct Measured {
    pub(super) name: String,
    pub(super) table: Table,
    pub(super) drawn: Vec<Vec<f64>>,
    pub(super) pairs: Vec<Vec<Vec<f64>>>,
}

impl Measured {
    /// Returns the distance of a source, × 100.
    pub(super) fn value(&self, config: &StudyConfig, at: usize) -> f64 {
        self.table.sources[config.sources[at].name()].fd.value
    }
}

/// What a study asks its questions of.
pub(super) struct Found<'a> {
    pub(super) config: &'a StudyConfig,
    pub(super) takes: &'a [Take],
    /// By network: the panel with its controls, then the look network's and those that were given.
    pub(super) sets: Vec<Sets>,
    pub(super) measured: Vec<Measured>,
    /// PDMS by policy, source (the real set first) and scenario: one a frame. Empty where no plans were made.
    pub(super) pdms: Vec<Vec<Vec<Vec<f64>>>>,
    /// Networks that are policies, controls included.
    pub(super) policies: usize,
}

impl Found<'_> {
    /// Returns the places of the policies that make FDπ.
    pub(super) fn panel(&self) -> Vec<usize> {
        (0..self.policies).filter(|at| !self.measured[*at].table.control).collect()
    }

    /// Returns FDπ of a source, × 100, with its resamples.
    pub(super) fn fd_pi(&self, at: usize) -> (f64, Vec<f64>) {
        fd_pi(&self.measured[..self.policies], self.config.sources[at].name(), at)
    }
}

/// Returns FDπ of the source of a name and a place, × 100, over the policies that are no control, with its resamples.
pub(super) fn fd_pi(policies: &[Measured], name: &str, at: usize) -> (f64, Vec<f64>) {
    let panel: Vec<&Measured> = policies.iter().filter(|measured| !measured.table.control).collect();
    let value = panel.iter().map(|measured| measured.table.sources[name].fd.value).sum::<f64>() / panel.len() as f64;
    let drawn: Vec<&[f64]> = panel.iter().map(|measured| measured.drawn[at].as_slice()).collect();
    (value, mean_of(&drawn))
}
