//! Bias, coverage and shares worked out by hand.
//!
//! Pairs, families of variants and shares are chosen so that another weighting would give another number.

use super::*;
use crate::dimension::drives;
use crate::results::{Episode, Results};
use crate::sample::{drive, ended, run};

fn of(scenario: &str, set: &str, scorer: &str, score: f64) -> Episode {
    Episode { set: set.into(), scorer: scorer.into(), ..drive(scenario, "p", 0, score) }
}

fn with(episode: Episode, best_mean: f64, ticks_without_positive: u32) -> Episode {
    Episode { proposals: Some(ProposalStats { best_mean, ticks_without_positive, ticks: 10 }), ..episode }
}

fn computed(episodes: Vec<Episode>) -> Bias {
    let runs: [Results; 1] = [run("r", episodes)];
    bias(&drives(&runs), &BiasOptions::default())
}

fn near(found: Option<f64>, expected: f64) {
    assert!(found.is_some_and(|found| (found - expected).abs() < 1e-12), "{found:?}, not {expected}");
}

/// a: 0.8 − 0.5, b: 0.6 − 0.7; c has no learned drive; a failed oracle drive counts 0: 0 − 0.4.
#[test]
fn scorer_bias_is_paired() {
    let failed = Episode { set: "base".into(), scorer: "oracle".into(), ..ended("d", "p", 0, "failed") };
    let found = computed(vec![
        of("a", "base", "learned", 0.5),
        of("b", "base", "learned", 0.7),
        of("d", "base", "learned", 0.4),
        of("a", "base", "oracle", 0.8),
        of("b", "base", "oracle", 0.6),
        of("c", "base", "oracle", 1.0),
        failed,
        of("a", "base", "oracle-navsim", 0.9),
    ]);
    assert_eq!(found.scorer.len(), 2, "one row per oracle");
    let row = &found.scorer[0];
    near(row.bias.mean, (0.3 - 0.1 - 0.4) / 3.0);
    near(row.learned, 1.6 / 3.0);
    assert_eq!((row.bias.scenarios, row.unmatched, row.subject.scorer.as_str()), (3, 1, "oracle"));
    near(found.scorer[1].bias.mean, 0.4);
    assert!(found.coverage.is_empty() && found.proposals.is_empty());
}

/// cut-in has two variants (0.2, 0.4 → 0.3 against 0.8), roundabout one (0.9 against 0.6): (−0.5 + 0.3)/2.
#[test]
fn coverage_is_paired_by_the_name_of_the_base() {
    let base = [
        of("cut-in", "base", "oracle", 0.8),
        of("cut-in-wide", "base", "oracle", 0.1),
        of("roundabout", "base", "oracle", 0.6),
    ];
    let changed = [
        of("cut-in.fog", "fog", "oracle", 0.2),
        of("cut-in__rain", "fog", "oracle", 0.4),
        of("roundabout", "fog", "oracle", 0.9),
    ];
    let found = computed(base.iter().chain(&changed).cloned().collect());
    let row = &found.coverage[0];
    assert!(row.paired && found.coverage.len() == 1);
    near(row.difference, -0.1);
    near(row.base, 0.7);
    assert_eq!((row.base_scenarios, row.changed_scenarios, row.subject.set.as_str()), (2, 3, "fog"));

    let stranger = of("stranger", "fog", "oracle", 0.5);
    let found = computed(base.iter().chain(&changed).chain([&stranger]).cloned().collect());
    let row = &found.coverage[0];
    assert!(!row.paired);
    near(row.difference, (0.2 + 0.4 + 0.9 + 0.5) / 4.0 - 0.5);
    assert_eq!((row.base_scenarios, row.changed_scenarios), (3, 4));
    assert!(row.interval.is_some_and(|i| i.low < 0.0 && i.high > 0.0));
}

#[test]
fn base_names_end_at_a_mark() {
    let names = BTreeSet::from(["cut-in", "cut", "cut-in.a"]);
    for (name, expected) in [
        ("cut-in", Some("cut-in")),
        ("cut-in.fog", Some("cut-in")),
        ("cut-in.a__x", Some("cut-in.a")),
        ("cut--fog", Some("cut")),
        ("cut-inside", None),
        ("other", None),
    ] {
        assert_eq!(base_name(name, &names), expected, "{name}");
    }
}

/// a: best 0.4 and 0.6, bare 2 and 0 of 10 ticks; b: best 0, bare 10 of 10.
#[test]
fn shares_are_over_scenarios() {
    let second = Episode { seed: 1, ..of("a", "base", "learned", 0.5) };
    let found = computed(vec![
        with(of("a", "base", "learned", 0.5), 0.4, 2),
        with(second, 0.6, 0),
        with(of("b", "base", "learned", 0.5), 0.0, 10),
        of("silent", "base", "learned", 0.5),
    ]);
    let row = &found.proposals[0];
    near(row.best.mean, 0.25);
    near(row.bare_ticks.mean, (0.1 + 1.0) / 2.0);
    near(row.scenarios_with_bare_tick.mean, 1.0);
    near(row.scenarios_without_positive.mean, 0.5);
    assert_eq!(row.best.scenarios, 2);
}

#[test]
fn nothing_is_made_up() {
    assert!(computed(vec![of("a", "base", "learned", 0.5), of("a", "base", "", 0.5)]).is_empty());
}
