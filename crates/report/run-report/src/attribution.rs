//! What each of several swapped components takes from a score: Shapley shares of a full factorial, with intervals.
//!
//! Cell `c` of a factorial over `n` components is the run in which component `k` is the real world's where bit `k` of
//! `c` is set, and the nominal one's where it is not. The share of a component is its mean contribution over all orders
//! in which components could be swapped (Shapley 1953); shares sum to the whole difference, scenario by scenario and
//! therefore in every resample.

use std::collections::BTreeSet;

use ds_space::Draws;
use ds_stats::{mean, shapley};
use serde::Serialize;

use crate::bootstrap::{self, Interval};
use crate::results::{Episode, Results};

/// The most components of a factorial.
pub const MOST_COMPONENTS: usize = 6;

/// What one component takes from the score when it becomes the real world's.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Share {
    /// The component.
    pub component: String,
    /// Mean over scenarios.
    pub value: f64,
    /// 95 % interval over scenarios.
    pub interval: Option<Interval>,
}

/// The component whose share is largest in size, and whether these scenarios tell it from the next.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Lead {
    /// The component with the largest share.
    pub component: String,
    /// The component that comes next.
    pub next: String,
    /// Whether the 95 % interval of the difference in size, paired by scenario, lies above zero.
    pub apart: bool,
    /// About how many scenarios would tell them apart, by how intervals shrink with their number; nothing where the two
    /// are equal or already apart.
    pub scenarios_needed: Option<u64>,
}

/// What the components take in one scenario.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InScenario {
    /// The scenario.
    pub scenario: String,
    /// One share per component; they sum to the scenario's difference.
    pub shares: Vec<f64>,
}

/// A score's difference between the real and the nominal world, split.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Attribution {
    /// The metric.
    pub metric: String,
    /// Mean in the nominal world.
    pub nominal: f64,
    /// Mean in the real world.
    pub real: f64,
    /// Real minus nominal; the sum of all shares.
    pub total: f64,
    /// 95 % interval of the total.
    pub interval: Option<Interval>,
    /// One share per component.
    pub shares: Vec<Share>,
    /// Which share is the largest; nothing with fewer than two components or two scenarios.
    pub lead: Option<Lead>,
    /// Scenarios with a value in every cell.
    pub scenarios: usize,
    /// The split of each of them.
    pub each: Vec<InScenario>,
}

/// Splits the difference of a metric; `cells[c][s]` is its value in cell `c` for scenario `s`. Scenarios that lack a
/// value in any cell are left out. Nothing if none is left or the cells are not 2^n.
#[must_use]
pub fn attribute(
    metric: &str,
    components: &[&str],
    scenarios: &[&str],
    cells: &[Vec<Option<f64>>],
    seed: u64,
) -> Option<Attribution> {
    if components.len() > MOST_COMPONENTS || cells.len() != 1 << components.len() {
        return None;
    }
    let values = |s: usize| cells.iter().map(|cell| *cell.get(s)?).collect::<Option<Vec<f64>>>();
    let complete = scenarios.iter().enumerate().filter_map(|(s, name)| Some((*name, values(s)?)));
    let (named, complete): (Vec<&str>, Vec<Vec<f64>>) = complete.unzip();
    let per_scenario: Vec<Vec<f64>> = complete.iter().map(|values| shapley(values)).collect();
    let totals: Vec<f64> = per_scenario.iter().map(|shares| shares.iter().sum()).collect();
    let draws = bootstrap::draws(seed);
    let column = |k: usize| -> Vec<f64> { per_scenario.iter().map(|shares| shares[k]).collect() };
    let shares = components.iter().enumerate().map(|(k, component)| {
        let interval = bootstrap::mean_interval(&column(k), &draws);
        Some(Share { component: (*component).to_owned(), value: mean(column(k))?, interval })
    });
    let shares: Vec<Share> = shares.collect::<Option<_>>()?;
    Some(Attribution {
        metric: metric.to_owned(),
        nominal: mean(complete.iter().map(|values| values[0]))?,
        real: mean(complete.iter().map(|values| values[values.len() - 1]))?,
        total: mean(totals.iter().copied())?,
        interval: bootstrap::mean_interval(&totals, &draws),
        lead: lead(&shares, &column, &draws),
        shares,
        scenarios: complete.len(),
        each: named
            .into_iter()
            .zip(per_scenario)
            .map(|(scenario, shares)| InScenario { scenario: scenario.to_owned(), shares })
            .collect(),
    })
}

/// Splits every metric that the drives of a factorial have, seeds averaged within a scenario; `cells[c]` are the results
/// of cell `c`.
#[must_use]
pub fn split(components: &[&str], cells: &[Results]) -> Vec<Attribution> {
    let scenarios: BTreeSet<&str> = cells.iter().flat_map(|cell| &cell.episodes).map(|e| e.scenario.as_str()).collect();
    let terms: BTreeSet<&str> =
        cells.iter().flat_map(|cell| &cell.episodes).flat_map(|e| e.sub_scores.keys()).map(String::as_str).collect();
    let named: Vec<&str> = scenarios.iter().copied().collect();
    let whole = ["driving_score", "route_completion"];
    let split = |metric: &str| {
        let column = |cell: &Results| scenarios.iter().map(|scenario| of_scenario(cell, scenario, metric)).collect();
        attribute(metric, components, &named, &cells.iter().map(column).collect::<Vec<_>>(), 0)
    };
    whole.into_iter().chain(terms).filter_map(split).collect()
}

/// The mean of a metric over the seeds of a scenario.
fn of_scenario(cell: &Results, scenario: &str, metric: &str) -> Option<f64> {
    let of = |episode: &Episode| match metric {
        "driving_score" => episode.driving_score,
        "route_completion" => episode.route_completion,
        term => episode.sub_scores.get(term).copied().flatten(),
    };
    mean(cell.episodes.iter().filter(|e| e.scenario == scenario).filter_map(of))
}

/// Finds the largest share and tells it from the next; `column` gives a component's share of each scenario.
fn lead(shares: &[Share], column: &dyn Fn(usize) -> Vec<f64>, draws: &Draws) -> Option<Lead> {
    let mut order: Vec<usize> = (0..shares.len()).collect();
    order.sort_by(|&a, &b| shares[b].value.abs().total_cmp(&shares[a].value.abs()));
    let &[first, next, ..] = order.as_slice() else { return None };
    let size = |k: usize| column(k).into_iter().map(move |value| value * shares[k].value.signum());
    let differences: Vec<f64> = size(first).zip(size(next)).map(|(first, next)| first - next).collect();
    let interval = bootstrap::mean_interval(&differences, draws)?;
    let (apart, mean) = (interval.low > 0.0, mean(differences.iter().copied())?);
    let shrink = (mean - interval.low) / mean;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a rounded count above zero")]
    let needed = (differences.len() as f64 * shrink * shrink).ceil() as u64;
    Some(Lead {
        component: shares[first].component.clone(),
        next: shares[next].component.clone(),
        apart,
        scenarios_needed: (!apart && mean > 0.0).then_some(needed.max(differences.len() as u64 + 1)),
    })
}

impl Attribution {
    /// Says in one sentence what takes how much, in points of 100, the largest first.
    #[must_use]
    pub fn sentence(&self) -> String {
        let points = |value: f64| 100.0 * value;
        let mut shares: Vec<&Share> = self.shares.iter().collect();
        shares.sort_by(|a, b| b.value.abs().total_cmp(&a.value.abs()));
        let parts: Vec<String> = shares
            .iter()
            .map(|share| {
                let range = share
                    .interval
                    .map_or(String::new(), |range| format!(" [{:.1}, {:.1}]", points(range.low), points(range.high)));
                format!("{} {:.1}{range}", share.component, points(share.value))
            })
            .collect();
        let lead = self.lead.as_ref().map_or(String::new(), |lead| {
            let (first, next) = (&lead.component, &lead.next);
            match (lead.apart, lead.scenarios_needed) {
                (true, _) => format!("; {first} is the largest"),
                (false, Some(needed)) => {
                    format!("; {first} and {next} are not apart, about {needed} scenarios may tell")
                }
                (false, None) => format!("; {first} and {next} are alike"),
            }
        });
        format!("of {:.1} points of {}: {}{lead}", points(self.total), self.metric, parts.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scenario_sums_and_incomplete_ones_are_left_out() {
        let cell = |set: usize| (0..6).map(|s| Some(0.9 - 0.1 * set as f64 + 0.01 * (s * set * set) as f64)).collect();
        let mut cells: Vec<Vec<Option<f64>>> = (0..4).map(cell).collect();
        cells[2][5] = None;
        let names = ["a", "b", "c", "d", "e", "f"];
        let split = attribute("driving_score", &["frames", "dynamics"], &names, &cells, 1).expect("an attribution");
        let sum: f64 = split.shares.iter().map(|share| share.value).sum();
        assert!((sum - split.total).abs() < 1e-12 && (split.real - split.nominal - split.total).abs() < 1e-12);
        assert_eq!(split.scenarios, 5);
        assert!(split.each.iter().map(|one| one.scenario.as_str()).eq(["a", "b", "c", "d", "e"]), "{:?}", split.each);
        assert!(split.shares.iter().all(|share| {
            share.interval.is_some_and(|range| range.low <= share.value && share.value <= range.high)
        }));
        assert!(split.sentence().starts_with("of "), "{}", split.sentence());
        let lead = split.lead.as_ref().expect("two components");
        assert!(lead.component == "dynamics" && lead.apart && lead.scenarios_needed.is_none(), "{lead:?}");
        assert!(attribute("x", &["frames"], &names, &cells, 1).is_none());
    }

    #[test]
    fn terms_come_from_seeds_alike() {
        let episode = |scenario: &str, score: f64| Episode {
            scenario: scenario.to_owned(),
            driving_score: Some(score),
            sub_scores: [("comfort".to_owned(), Some(score))].into(),
            ..Episode::default()
        };
        let cell = |shift: f64| Results {
            episodes: vec![episode("a", 0.8 - shift), episode("a", 0.6 - shift), episode("b", 0.4)],
            run: crate::Run::default(),
        };
        let split = split(&["dynamics"], &[cell(0.0), cell(0.2)]);
        let names: Vec<&str> = split.iter().map(|one| one.metric.as_str()).collect();
        assert_eq!(names, ["driving_score", "comfort"]);
        assert!((split[0].total + 0.1).abs() < 1e-12 && split[0].scenarios == 2, "{:?}", split[0]);
    }

    #[test]
    fn shares_that_scatter_more_than_they_differ_are_not_apart() {
        // Each component costs everything in one scenario of four and nothing in the others; frames a little more.
        let hurt = |s: usize, k: usize| if s % 4 == 2 * k { 0.5 + 0.02 * (1 - k) as f64 } else { 0.0 };
        let cell = |set: usize| {
            let cost = move |s: usize| (0..2).filter(|k| set >> k & 1 == 1).map(|k| hurt(s, k)).sum::<f64>();
            (0..24).map(|s| Some(1.0 - cost(s))).collect()
        };
        let cells: Vec<Vec<Option<f64>>> = (0..4).map(cell).collect();
        let names: Vec<String> = (0..24).map(|s| s.to_string()).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let split = attribute("driving_score", &["frames", "dynamics"], &names, &cells, 1).expect("an attribution");
        let lead = split.lead.as_ref().expect("two components");
        assert!(lead.component == "frames" && !lead.apart, "{lead:?}");
        assert!(lead.scenarios_needed.is_some_and(|needed| needed > 1000), "{lead:?}");
        assert!(split.sentence().contains("not apart"), "{}", split.sentence());
    }
}
