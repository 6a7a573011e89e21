//! What a correction of the simulator closes: quantities of drives in the nominal and in the corrected simulator, each
//! against the real world.

use std::collections::BTreeMap;

use ds_stats::mean;
use serde::Serialize;

use crate::bootstrap::{self, Interval, mean_interval};
use crate::results::{Episode, Results};

/// A quantity of held-out drives in the nominal and in the corrected simulator, against the real world.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Closing {
    /// `route_deviation` in metres, `driving_score`, `route_completion`.
    pub metric: String,
    /// Mean over drives of the absolute difference to the real drive, nominal simulator.
    pub before: f64,
    /// The same of the corrected simulator.
    pub after: f64,
    /// Mean over drives of the absolute difference between two corrected simulators that differ by nothing that could be
    /// measured: no correction can be told to come closer than this.
    pub chance: f64,
    /// 1 - after / before; 0 where nothing was to be closed.
    pub share_closed: f64,
    /// 95 % interval over drives of before minus after.
    pub gain: Option<Interval>,
    /// Number of drives.
    pub drives: usize,
    /// Each of them.
    pub each: Vec<Drive>,
}

/// One drive's absolute difference to the real drive.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Drive {
    /// Its scenario.
    pub scenario: String,
    /// Nominal simulator.
    pub before: f64,
    /// Corrected simulator.
    pub after: f64,
    /// The corrected simulator against one that differs by nothing that could be measured.
    pub chance: f64,
}

/// Absolute differences to the real drives before and after, by metric.
#[derive(Debug, Clone, Default)]
pub struct Columns(BTreeMap<&'static str, Vec<Drive>>);

impl Columns {
    /// Adds the differences of one drive: before, after, and by chance.
    pub fn add(&mut self, metric: &'static str, scenario: &str, [before, after, chance]: [f64; 3]) {
        self.0.entry(metric).or_default().push(Drive { scenario: scenario.to_owned(), before, after, chance });
    }

    /// Adds the differences of a scenario's scores, where all runs have them; the last is the corrected one a hair apart.
    pub fn add_scores(&mut self, scenario: &str, real: &Results, [nominal, corrected, apart]: [&Results; 3]) {
        type Field = fn(&Episode) -> Option<f64>;
        let scores: [(&'static str, Field); 2] =
            [("driving_score", |e| e.driving_score), ("route_completion", |e| e.route_completion)];
        for (metric, field) in scores {
            let of = |results: &Results| results.episodes.iter().find(|e| e.scenario == scenario).and_then(field);
            if let (Some(truth), Some(before), Some(after), Some(apart)) =
                (of(real), of(nominal), of(corrected), of(apart))
            {
                let pairs = [(before, truth), (after, truth), (apart, after)];
                self.add(metric, scenario, pairs.map(|(one, other)| (one - other).abs()));
            }
        }
    }
}

/// Returns what was closed, metric by metric.
#[must_use]
pub fn closings(columns: Columns) -> Vec<Closing> {
    let closing = |(metric, each): (&str, Vec<Drive>)| {
        let before = mean(each.iter().map(|drive| drive.before)).unwrap_or_default();
        let after = mean(each.iter().map(|drive| drive.after)).unwrap_or_default();
        let chance = mean(each.iter().map(|drive| drive.chance)).unwrap_or_default();
        let gains: Vec<f64> = each.iter().map(|drive| drive.before - drive.after).collect();
        Closing {
            metric: metric.to_owned(),
            before,
            after,
            chance,
            share_closed: if before > 0.0 { 1.0 - after / before } else { 0.0 },
            gain: mean_interval(&gains, &bootstrap::draws(0)),
            drives: each.len(),
            each,
        }
    };
    columns.0.into_iter().map(closing).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_half_as_far_off_is_half_closed() {
        let run = |score: f64| Results {
            run: crate::Run::default(),
            episodes: vec![Episode { scenario: "a".to_owned(), driving_score: Some(score), ..Episode::default() }],
        };
        let mut columns = Columns::default();
        columns.add("route_deviation", "a", [2.0, 1.0, 0.1]);
        columns.add("route_deviation", "b", [4.0, 2.0, 0.3]);
        columns.add_scores("a", &run(0.8), [&run(0.4), &run(0.9), &run(0.85)]);
        columns.add_scores("b", &run(0.8), [&run(0.4), &run(0.9), &run(0.85)]);
        let found = closings(columns);
        let of = |metric: &str| found.iter().find(|one| one.metric == metric).expect("a metric");
        assert!((of("route_deviation").share_closed - 0.5).abs() < 1e-12 && of("route_deviation").drives == 2);
        assert!(
            (of("route_deviation").chance - 0.2).abs() < 1e-12 && (of("driving_score").chance - 0.05).abs() < 1e-12
        );
        assert!((of("driving_score").share_closed - 0.75).abs() < 1e-12 && of("driving_score").drives == 1);
        assert_eq!(found.len(), 2);
    }
}
