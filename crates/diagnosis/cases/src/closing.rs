//! Before and after: how far the drives of a nominal and of a corrected simulator are from the real ones.

use std::path::Path;

use ds_record::vehicle_log;
use ds_run_report::Results;
use ds_run_report::closing::{Closing, Columns, closings};
use ds_world::Reading;

use crate::error::CasesError;
use crate::logs;

/// A run with its vehicle logs: its folder, and its results.
pub struct LoggedRun<'a> {
    /// The folder; logs lie in `real`.
    pub folder: &'a Path,
    /// Its results.
    pub results: &'a Results,
}

/// Compares drives of a nominal and of a corrected simulator with the real ones, and those of the corrected one with those of
/// one a hair apart ([`crate::RunConfig::hair_apart`]).
///
/// # Errors
/// If a vehicle log cannot be read.
pub fn closed(
    drives: &[String],
    real: &LoggedRun<'_>,
    [nominal, corrected, apart]: [&LoggedRun<'_>; 3],
) -> Result<Vec<Closing>, CasesError> {
    let mut columns = Columns::default();
    for name in drives {
        let readings = |run: &LoggedRun<'_>| {
            Ok::<_, CasesError>(vehicle_log::read(&logs::file(&run.folder.join("real"), name))?.readings)
        };
        let truth = readings(real)?;
        let (before, after, other) = (readings(nominal)?, readings(corrected)?, readings(apart)?);
        let pairs = [(&truth, &before), (&truth, &after), (&after, &other)];
        columns.add("route_deviation", name, pairs.map(|(one, other)| deviation(one, other)));
        columns.add_scores(name, real.results, [nominal.results, corrected.results, apart.results]);
    }
    Ok(closings(columns))
}

/// Root mean square distance between two drives at equal stamps, metres.
fn deviation(truth: &[Reading], other: &[Reading]) -> f64 {
    let squares = truth.iter().zip(other).map(|(a, b)| (a.x_m - b.x_m).powi(2) + (a.y_m - b.y_m).powi(2));
    ds_stats::mean(squares).unwrap_or_default().sqrt()
}
