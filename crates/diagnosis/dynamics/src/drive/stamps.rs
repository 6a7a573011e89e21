//! The stamps of a log: they must grow without a long hole; what else is odd about them is said.

use ds_diagnosis::CaseError;
use ds_diagnosis::table::{STEP_SECS, Table};
use ds_diagnosis::unevenness::{gaps, scatter};

/// Shortest drive that can be diagnosed, s.
const SHORTEST_SECS: f64 = 6.0;
/// Fewest rows.
const FEWEST: usize = 60;
/// Longest hole in the stamps that is bridged, s.
const LONGEST_HOLE_SECS: f64 = 1.0;
/// Longest log, s.
const LONGEST_SECS: usize = 14_400;

/// Returns the stamps of a table, s.
///
/// # Errors
/// If they do not grow, have a long hole, or are too few or too many.
pub(super) fn stamps(table: &Table) -> Result<Vec<f64>, CaseError> {
    let file = || table.file().to_owned();
    if table.rows() == 0 {
        return Err(CaseError::TooShort { samples: 0, secs: 0.0, file: file() });
    }
    let t = table.required("t")?.to_vec();
    for (row, pair) in t.windows(2).enumerate() {
        let (before, t) = (pair[0], pair[1]);
        if t.is_nan() || before.is_nan() || t <= before {
            return Err(CaseError::TimeGoesBack { row: row + 2, t, before, file: file() });
        }
        if t - before > LONGEST_HOLE_SECS {
            return Err(CaseError::TimeGap { secs: t - before, t: before, file: file() });
        }
    }
    let secs = t[t.len() - 1] - t[0];
    shorter(secs, table)?;
    if secs < SHORTEST_SECS || t.len() < FEWEST {
        return Err(CaseError::TooShort { samples: t.len(), secs, file: file() });
    }
    Ok(t)
}

/// Checks that the columns of a table with its stamps, s, have no long hole; those without any value count as absent.
///
/// # Errors
/// If one has.
pub(super) fn whole(table: &Table, t: &[f64], columns: &[&str]) -> Result<(), CaseError> {
    for name in columns {
        let Some(column) = table.column(name) else { continue };
        let known = t.iter().zip(column).filter(|(_, value)| value.is_finite()).map(|(t, _)| *t);
        let mut known: Vec<f64> = known.collect();
        if known.is_empty() {
            continue;
        }
        known.insert(0, t[0]);
        known.push(t[t.len() - 1]);
        if let Some(pair) = known.windows(2).find(|pair| pair[1] - pair[0] > LONGEST_HOLE_SECS) {
            let (column, file) = ((*name).to_owned(), table.file().to_owned());
            return Err(CaseError::ColumnGap { column, secs: pair[1] - pair[0], t: pair[0], file });
        }
    }
    Ok(())
}

/// Checks the length of a log, s.
///
/// # Errors
/// If it is longer than the longest.
pub(super) fn shorter(secs: f64, table: &Table) -> Result<(), CaseError> {
    if secs > LONGEST_SECS as f64 {
        return Err(CaseError::TooLarge { what: "seconds", limit: LONGEST_SECS, file: table.file().to_owned() });
    }
    Ok(())
}

/// Says what is odd about stamps of so many rows a second but could be used.
pub(super) fn oddities(t: &[f64], rate_hz: f64) -> Vec<String> {
    let usual = 1.0 / rate_hz;
    let bridged = gaps(t, usual, STEP_SECS).map(|gaps| {
        let (longest, after) = (gaps.longest_secs, gaps.after_secs);
        format!("gaps in the stamps, {} in all, are bridged by straight lines: {longest:.3} s at most, the first after {after:.3} s", gaps.count)
    });
    let uneven = scatter(t, usual)
        .map(|[low, high]| format!("steps between stamps scatter from {low:.4} to {high:.4} s about {usual:.4} s"));
    bridged.into_iter().chain(uneven).collect()
}
