//! Drives on fleets of several sizes → one table: frames per second, efficiency, and what an iteration costs outside
//! generation. Efficiency is frames/s per worker over that of the first row. All rows are of one kind, real or simulated.
//!
//! Digests are compared between all drives that must be equal, within a row and across rows.

use std::collections::BTreeMap;

use ds_stats::sorted_quantile;

use crate::report::Report;
use crate::table::{Table, Value};

/// What efficiency is to reach.
pub const EFFICIENT: f64 = 0.95;

/// A drive that completed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Completed {
    /// What it drove: drives of one name must be equal.
    pub name: String,
    /// Digests of its worlds, layouts and frames.
    pub digests: [String; 3],
}

/// What was measured with one count of workers.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Row {
    /// Video workers.
    pub workers: u32,
    /// Devices that they held a lease of.
    pub devices: usize,
    /// Episodes asked for.
    pub episodes: usize,
    /// Ticks driven, each with a frame of every camera.
    pub ticks: u64,
    /// From submission to the last end, in seconds.
    pub wall_secs: f64,
    /// Processor time of orchestrator and simulator, in seconds; nothing where the system does not tell.
    pub processor_secs: [Option<f64>; 2],
    /// Durable writes to the ledger.
    pub ledger_commits: u64,
    /// What each iteration took outside the video model, in seconds.
    pub overhead_secs: Vec<f64>,
    /// What the video model worked in all, in seconds.
    pub generation_secs: f64,
    /// Workers that were killed.
    pub killed: usize,
    /// The drives that completed.
    pub completed: Vec<Completed>,
}

impl Row {
    fn rate(&self) -> f64 {
        self.ticks as f64 / self.wall_secs.max(1e-9)
    }

    /// Returns a quantile of the iterations' overhead, in milliseconds.
    fn overhead_ms(&self, share: f64) -> Option<f64> {
        let mut sorted = self.overhead_secs.clone();
        sorted.sort_by(f64::total_cmp);
        sorted_quantile(&sorted, share).map(|secs| 1e3 * secs)
    }

    /// Returns what the video model works in an iteration, in milliseconds.
    fn generation_ms(&self) -> Option<f64> {
        let iterations = self.overhead_secs.len();
        (iterations > 0).then(|| 1e3 * self.generation_secs / iterations as f64)
    }
}

/// A measurement.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Scaling {
    /// What simulated workers wait for each chunk, in seconds; nothing where workers generate.
    pub simulated_secs: Option<f64>,
    /// Processors of the machine.
    pub cores: u32,
    /// What else was chosen, in words: name and value.
    pub facts: Vec<(&'static str, String)>,
    /// Rows that were asked for and are not there.
    pub missing: usize,
    /// One row for each count of workers, in the order in which they were driven.
    pub rows: Vec<Row>,
}

impl Scaling {
    /// Returns of each row how many of its drives differ from the first drive of their name.
    #[must_use]
    pub fn different(&self) -> Vec<usize> {
        let mut first: BTreeMap<&str, &[String; 3]> = BTreeMap::new();
        let mut counts = Vec::with_capacity(self.rows.len());
        for row in &self.rows {
            let mut count = 0;
            for Completed { name, digests } in &row.completed {
                count += usize::from(*first.entry(name).or_insert(digests) != digests);
            }
            counts.push(count);
        }
        counts
    }

    /// Says whether every row is there, every drive completed, and equal drives are equal.
    #[must_use]
    pub fn sound(&self) -> bool {
        let whole = self.rows.iter().all(|row| row.completed.len() == row.episodes);
        self.missing == 0 && whole && self.different().iter().all(|count| *count == 0)
    }

    /// Returns the efficiency of a row, 1 for the first.
    fn efficiency(&self, row: &Row) -> Option<f64> {
        let each = |row: &Row| row.rate() / f64::from(row.workers.max(1));
        self.rows.first().filter(|first| each(first) > 0.0).map(|first| each(row) / each(first))
    }

    /// Returns the report.
    #[must_use]
    pub fn report(&self) -> Report {
        let (title, workers) = match self.simulated_secs {
            Some(secs) => ("Scaling with simulated workers", format!("simulated: each waits {secs} s for a chunk")),
            None => ("Scaling", "real: each generates".to_owned()),
        };
        let mut facts = vec![("workers", workers), ("processors", self.cores.to_string())];
        facts.extend(self.facts.iter().cloned());
        facts.push(("efficiency", self.bar()));
        Report {
            title: title.to_owned(),
            warnings: self.warnings(),
            facts,
            complete: self.sound(),
            tables: vec![self.table()],
            plots: BTreeMap::new(),
        }
    }

    /// Says up to which count of workers efficiency holds, and at which it does not.
    fn bar(&self) -> String {
        let below = |row: &&Row| self.efficiency(row).is_some_and(|efficiency| efficiency < EFFICIENT);
        if self.rows.len() < 2 {
            return "not told by fewer than two rows".to_owned();
        }
        let most = self.rows.iter().map(|row| row.workers).max().unwrap_or_default();
        match self.rows.iter().filter(below).map(|row| row.workers).min() {
            Some(count) => format!("below {EFFICIENT} from {count} workers on"),
            None => format!("{EFFICIENT} or above up to {most} workers"),
        }
    }

    fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.simulated_secs.is_some() {
            warnings.push(
                "Simulated: nothing was generated. These rows tell what the fleet around the workers serves, nothing \
                 about a device."
                    .to_owned(),
            );
        } else if self.rows.iter().any(|row| row.workers > self.cores && row.devices == 0) {
            let cores = self.cores;
            warnings.push(format!(
                "Rows of more than {cores} workers share {cores} processors: their efficiency tells nothing of devices."
            ));
        }
        if self.missing > 0 {
            warnings.push(format!("Incomplete: {} rows were not driven.", self.missing));
        }
        for (row, different) in self.rows.iter().zip(self.different()) {
            let lost = row.episodes - row.completed.len();
            if lost + different > 0 {
                let workers = row.workers;
                warnings.push(format!(
                    "{workers} workers: {lost} drives did not complete, {different} differ from others."
                ));
            }
        }
        warnings
    }

    fn table(&self) -> Table {
        let rows = self.rows.iter().zip(self.different()).map(|(row, different)| {
            let share = |secs: Option<f64>| Value::Score(secs.map(|secs| secs / row.wall_secs.max(1e-9)));
            let [orchestrator, simulator] = row.processor_secs;
            let (overhead, generation) = (row.overhead_ms(0.5), row.generation_ms());
            let of_generation = overhead.zip(generation).filter(|(_, all)| *all > 0.0).map(|(part, all)| part / all);
            vec![
                Value::Count(row.workers.into()),
                Value::count(row.devices),
                Value::count(row.episodes),
                Value::Number(Some(row.rate())),
                Value::Score(self.efficiency(row)),
                share(orchestrator),
                share(simulator),
                Value::Number(Some(row.ledger_commits as f64 / row.wall_secs.max(1e-9))),
                Value::Number(overhead),
                Value::Number(row.overhead_ms(0.99)),
                Value::Number(generation),
                Value::Score(of_generation),
                Value::count(row.killed),
                Value::count(row.episodes - row.completed.len()),
                Value::count(different),
            ]
        });
        let columns = vec![
            "workers",
            "devices",
            "episodes",
            "frames/s",
            "efficiency %",
            "orchestrator %",
            "simulator %",
            "commits/s",
            "overhead ms",
            "overhead p99 ms",
            "generation ms",
            "overhead %",
            "killed",
            "lost",
            "different",
        ];
        let note = "Frames/s: ticks driven over the time from submission to the last end. Efficiency: frames/s per worker, \
                    of the first row's. Orchestrator, simulator: processor time of the process, of one processor. Commits: \
                    durable writes to the ledger. Overhead: what an iteration after the first takes outside the video \
                    model, median and 99th percentile; its share is of what the video model takes on average. Killed: \
                    workers that were killed and replaced. Lost: drives that did not complete. Different: drives whose \
                    worlds, layouts or frames are not those of an equal drive."
            .to_owned();
        Table { id: "scaling", title: "Scaling", note, columns, rows: rows.collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(workers: u32, ticks: u64) -> Row {
        let drive = |index: usize| Completed {
            name: format!("drive-{}", index % 2),
            digests: [0, 1, 2].map(|k| k.to_string()),
        };
        Row {
            workers,
            episodes: 4,
            ticks,
            wall_secs: 10.0,
            processor_secs: [Some(1.0), None],
            ledger_commits: 50,
            overhead_secs: (1..=100).map(|k| f64::from(k) * 1e-3).collect(),
            generation_secs: 50.0,
            completed: (0..4).map(drive).collect(),
            ..Row::default()
        }
    }

    #[test]
    fn efficiency_is_per_worker_and_against_the_first_row() {
        let rows = vec![row(1, 100), row(2, 196), row(4, 360)];
        let scaling = Scaling { simulated_secs: Some(0.5), cores: 2, rows, ..Scaling::default() };
        assert!(scaling.sound());
        let report = scaling.report();
        let told: Vec<Vec<String>> =
            report.tables[0].rows.iter().map(|row| row.iter().map(Value::told).collect()).collect();
        assert_eq!(told[0][..9], ["1", "0", "4", "10.0", "100.0", "10.0", "n/a", "5.0", "50.5"]);
        assert_eq!(told[1][4], "98.0");
        assert_eq!(told[2][3..5], ["36.0", "90.0"]);
        assert_eq!(told[2][9..], ["99.0", "500.0", "10.1", "0", "0", "0"]);
        assert!(
            report.facts.contains(&("efficiency", "below 0.95 from 4 workers on".to_owned())),
            "{:?}",
            report.facts
        );
        assert!(report.title.contains("simulated") && report.warnings.len() == 1, "{:?}", report.warnings);
    }

    #[test]
    fn one_row_says_nothing_of_efficiency() {
        let scaling = Scaling { rows: vec![row(1, 100)], ..Scaling::default() };
        assert!(scaling.report().facts.contains(&("efficiency", "not told by fewer than two rows".to_owned())));
    }

    #[test]
    fn a_lost_or_different_drive_is_told() {
        let mut rows = vec![row(1, 100), row(4, 400)];
        rows[1].completed[3].digests[0] = "other".to_owned();
        rows[1].completed.remove(0);
        let scaling = Scaling { cores: 2, rows, ..Scaling::default() };
        assert_eq!(scaling.different(), [0, 1]);
        assert!(!scaling.sound() && !scaling.report().complete);
        let warnings = scaling.report().warnings.join("\n");
        assert!(warnings.contains("4 workers: 1 drives did not complete, 1 differ"), "{warnings}");
        assert!(warnings.contains("more than 2 workers share 2 processors"), "{warnings}");
        assert!(!Scaling { missing: 1, rows: vec![row(1, 100)], ..Scaling::default() }.sound());
    }
}
