//! What went wrong on the way to results, summed up over the records of one or several folders. None of it changes a result.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::record::Record;

/// What was lost. Times are in milliseconds of wall time, over all episodes at a time.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Faults {
    /// Drives that were aborted, by reason; of one that was aborted twice both.
    pub aborted: BTreeMap<String, u64>,
    /// Workers that were lost, by role.
    pub workers: BTreeMap<String, u64>,
    /// Orders that were sent again, as no answer came.
    #[serde(default)]
    pub orders_repeated: u64,
    /// In which drives stood.
    pub stalled_millis: u64,
    /// Of drives that were aborted, so that nothing came of it.
    pub lost_millis: u64,
    /// Of all drives.
    pub wall_millis: u64,
}

impl Faults {
    /// Adds what a record says; a reason ends at its first colon, where details begin.
    pub fn take(&mut self, record: &Record) {
        let wall_millis = (record.episode.wall_s.max(0.0) * 1000.0).round() as u64;
        self.wall_millis += wall_millis;
        self.stalled_millis += record.lost.stalled_millis;
        self.orders_repeated += record.lost.orders_repeated;
        for (role, count) in &record.lost.workers {
            *self.workers.entry(role.clone()).or_default() += u64::from(*count);
        }
        if !record.ended() {
            let reason = record.episode.reason.split(':').next().unwrap_or_default().trim();
            let reason = if reason.is_empty() { "no reason told" } else { reason };
            *self.aborted.entry(reason.to_owned()).or_default() += 1;
            self.lost_millis += wall_millis;
        }
    }

    /// Adds what was lost on the way to other results.
    #[must_use]
    pub fn with(mut self, other: Self) -> Self {
        for (all, more) in [(&mut self.aborted, other.aborted), (&mut self.workers, other.workers)] {
            for (name, count) in more {
                *all.entry(name).or_default() += count;
            }
        }
        self.stalled_millis += other.stalled_millis;
        self.orders_repeated += other.orders_repeated;
        self.lost_millis += other.lost_millis;
        self.wall_millis += other.wall_millis;
        self
    }

    /// Returns a time as a share of the wall time of all drives; nothing where nothing was driven.
    #[must_use]
    pub fn share(&self, millis: u64) -> Option<f64> {
        (self.wall_millis > 0).then(|| millis as f64 / self.wall_millis as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Cell;
    use crate::record::Losses;
    use crate::record::tests::driven;

    #[test]
    fn what_was_lost_adds_up_over_drives_and_folders() {
        let drive = |status: &str, reason: &str, wall_s: f64, lost: Losses| {
            let mut record = driven(Cell::default(), status, 0.5);
            (record.episode.wall_s, record.episode.reason) = (wall_s, reason.to_owned());
            Record { lost, ..record }
        };
        let lost = Losses { workers: [("video".to_owned(), 2)].into(), orders_repeated: 4, stalled_millis: 7_500 };
        let mut faults = Faults::default();
        faults.take(&drive("completed", "", 30.0, lost));
        faults.take(&drive("aborted", "no_instance: video for 60 s", 9.0, Losses::default()));
        faults.take(&drive("aborted", "", 1.0, Losses::default()));
        let twice = faults.clone().with(faults.clone());
        assert_eq!((twice.workers["video"], twice.aborted["no_instance"], twice.aborted["no reason told"]), (4, 2, 2));
        assert_eq!(twice.orders_repeated, 8);
        assert_eq!((twice.stalled_millis, twice.lost_millis, twice.wall_millis), (15_000, 20_000, 80_000));
        assert_eq!((faults.share(faults.lost_millis), Faults::default().share(0)), (Some(0.25), None));
    }
}
