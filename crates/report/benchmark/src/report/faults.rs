//! What went wrong on the way: cells, attempts, sessions, workers, and the wall time that came to nothing.

use std::collections::BTreeMap;

use ds_run_report::results::Outcome as Ending;

use crate::faults::Faults;
use crate::results::{Drive, Results};
use crate::table::{Table, Value};

/// Returns the faults as one table: how often, and what share of cells or of wall time.
pub(super) fn faults(results: &Results) -> Table {
    let all: Vec<&Drive> = results.drives().collect();
    let (cells, faults, sessions) = (results.cells, &results.faults, &results.sessions);
    let ended = |ending| all.iter().filter(|drive| drive.ending == ending).count();
    let of_cells = |count: usize| (count, (cells > 0).then(|| count as f64 / cells as f64));
    let alone = |count: usize| (count, None);
    let time = |millis: u64| ((millis as f64 / 1000.0).round() as usize, faults.share(millis));
    let mut rows = vec![
        ("cells".to_owned(), alone(cells)),
        ("completed".to_owned(), of_cells(ended(Ending::Completed))),
        ("failed by the policy".to_owned(), of_cells(ended(Ending::Failed))),
        ("aborted and not driven since".to_owned(), of_cells(ended(Ending::Aborted))),
        ("never driven".to_owned(), of_cells(cells.saturating_sub(all.len()))),
        ("attempts".to_owned(), alone(all.iter().map(|drive| drive.attempts as usize).sum())),
        (
            "attempts beyond the first".to_owned(),
            alone(all.iter().map(|drive| drive.attempts.saturating_sub(1) as usize).sum()),
        ),
        ("aborts before the drive that counts".to_owned(), alone(all.iter().map(|drive| drive.round as usize).sum())),
    ];
    rows.extend(lost(faults));
    rows.extend([
        ("orders sent again".to_owned(), alone(faults.orders_repeated as usize)),
        ("seconds stalled".to_owned(), time(faults.stalled_millis)),
        ("seconds of wall time in drives".to_owned(), time(faults.wall_millis)),
        ("seconds of it lost to aborted drives".to_owned(), time(faults.lost_millis)),
        (
            "records told more than once, equal".to_owned(),
            alone(results.repeated + results.merged.as_ref().map_or(0, |m| m.repeated)),
        ),
        ("sessions".to_owned(), alone(sessions.begun)),
        ("sessions that were killed".to_owned(), alone(sessions.killed)),
        ("sessions that a signal ended".to_owned(), alone(sessions.interrupted)),
        ("sessions that found a torn last line".to_owned(), alone(sessions.torn)),
        (
            "torn last lines".to_owned(),
            alone(usize::from(results.torn.is_some()) + results.merged.as_ref().map_or(0, |m| m.torn.len())),
        ),
    ]);
    let mut reasons: BTreeMap<&str, usize> = BTreeMap::new();
    for drive in all.iter().filter(|drive| drive.ending != Ending::Completed) {
        *reasons.entry(&drive.reason).or_default() += 1;
    }
    rows.extend(reasons.into_iter().map(|(reason, count)| (format!("reason: {reason}"), alone(count))));
    let row = |(what, (count, share)): (String, (usize, Option<f64>))| {
        vec![Value::Text(what), Value::count(count), Value::Score(share)]
    };
    let note = "What went wrong on the way; none of it changes a result. Share: of the cells, or of the wall time in all drives. A drive \
                stalls in iterations after its first that take over 5 s beside the video model's own work, as when a worker is lost and \
                its lease has to run out; workers are those lost in the attempts that count. Records of older programs tell neither, \
                nor orders that were sent again because no answer came."
        .to_owned();
    let columns = vec!["what", "count", "share %"];
    Table { id: "faults", title: "Faults", note, columns, rows: rows.into_iter().map(row).collect() }
}

/// Returns workers that were lost and drives that were aborted, of each kind and in all.
fn lost(faults: &Faults) -> Vec<(String, (usize, Option<f64>))> {
    let mut rows = Vec::new();
    for (what, of_each, counts) in [
        ("workers lost", "workers lost, role", &faults.workers),
        ("aborted drives", "aborted drives, reason", &faults.aborted),
    ] {
        rows.push((what.to_owned(), (counts.values().sum::<u64>() as usize, None)));
        rows.extend(counts.iter().map(|(name, count)| (format!("{of_each} {name}"), (*count as usize, None))));
    }
    rows
}
