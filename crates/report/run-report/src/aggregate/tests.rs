//! Means worked out by hand.
//!
//! Each case is small enough to be checked in the head; the arithmetic stands beside it.

use super::*;
use crate::dimension::drives;
use crate::results::Episode;
use crate::sample::{drive, ended, run};

fn close(found: Option<f64>, expected: f64) {
    assert!(found.is_some_and(|found| (found - expected).abs() < 1e-12), "{found:?}, not {expected}");
}

fn only<'a>(aggregate: &'a Aggregate, key: &[&str]) -> &'a Group {
    aggregate.groups.iter().find(|group| group.key == key).expect("the group")
}

/// a: seeds 0.2 and 0.4 → 0.3; b: 0.8 → mean 0.55 (0.4667 if every drive weighed the same).
#[test]
fn a_scenario_with_many_seeds_weighs_no_more() {
    let runs = [run("r", vec![drive("a", "p", 0, 0.2), drive("a", "p", 1, 0.4), drive("b", "p", 0, 0.8)])];
    let found = aggregate(&drives(&runs), &[Dimension::Policy], 0);
    let score = only(&found, &["p"]).metric("driving_score").expect("it is always there");
    close(score.headline.mean, 0.55);
    assert_eq!(score.headline.scenarios, 2);
    assert_eq!(score.headline, score.finished);
}

/// a: 0.6 and a failed seed → 0.3 in the headline, 0.6 finished; b failed → 0, none; c aborted → in neither.
#[test]
fn failed_drives_count_zero_and_aborted_ones_are_counted() {
    let runs = [run(
        "r",
        vec![
            drive("a", "p", 0, 0.6),
            ended("a", "p", 1, "failed"),
            ended("b", "p", 0, "failed"),
            ended("c", "p", 0, "aborted"),
        ],
    )];
    let found = aggregate(&drives(&runs), &[Dimension::Policy], 0);
    let group = only(&found, &["p"]);
    assert_eq!(group.counts, Counts { scenarios: 3, episodes: 4, completed: 1, failed: 2, aborted: 1 });
    let score = group.metric("driving_score").expect("it is always there");
    close(score.headline.mean, 0.15);
    close(score.finished.mean, 0.6);
    assert_eq!((score.headline.scenarios, score.finished.scenarios), (2, 1));
    assert_eq!((score.finished.interval, score.not_applicable), (None, 0));
    assert!(score.headline.interval.is_some_and(|i| i.low.abs() < 1e-12 && (i.high - 0.3).abs() < 1e-12));
}

#[test]
fn a_score_of_a_failed_drive_is_not_used() {
    let failed = Episode { status: "failed".into(), ..drive("a", "p", 0, 0.9) };
    let runs = [run("r", vec![failed])];
    let found = aggregate(&drives(&runs), &[], 0);
    let score = found.groups[0].metric("driving_score").expect("it is always there");
    assert_eq!((score.headline.mean, score.finished.mean), (Some(0.0), None));
}

/// Lights apply to a only: the failed drives of a and c are 0 in collisions, that of b (no lights) not in lights, and
/// c, which nobody completed, is 0 only in what applies to all scenarios.
#[test]
fn failed_drives_count_zero_in_what_applies() {
    let with = |scenario, light| Episode {
        sub_scores: BTreeMap::from([("nc".to_owned(), Some(1.0)), ("tlc".to_owned(), light)]),
        ..drive(scenario, "good", 0, 0.5)
    };
    let mut episodes = vec![with("a", Some(1.0)), with("b", None)];
    episodes.extend(["a", "b", "c"].map(|scenario| ended(scenario, "bad", 0, "failed")));
    let runs = [run("r", episodes)];
    let found = aggregate(&drives(&runs), &[Dimension::Policy], 0);
    let bad = |name| only(&found, &["bad"]).metric(name).expect("it is there").headline;
    assert_eq!((bad("sub_scores.nc").mean, bad("sub_scores.nc").scenarios), (Some(0.0), 3));
    assert_eq!((bad("sub_scores.tlc").mean, bad("sub_scores.tlc").scenarios), (Some(0.0), 1));
    assert_eq!((bad("driving_score").mean, bad("driving_score").scenarios), (Some(0.0), 3));
}

#[test]
fn what_does_not_apply_is_counted_and_is_not_one() {
    let silent = Episode { driving_score: None, route_completion: None, ..drive("a", "p", 0, 0.5) };
    let runs = [run("r", vec![silent, drive("b", "p", 0, 0.4)])];
    let found = aggregate(&drives(&runs), &[], 0);
    let score = found.groups[0].metric("driving_score").expect("it is always there");
    close(score.headline.mean, 0.4);
    assert_eq!((score.not_applicable, score.headline.scenarios), (1, 1));
    close(found.groups[0].metric("mean_score").expect("it is there").headline.mean, 0.45);
}

#[test]
fn any_dimensions_make_groups() {
    let with = |scenario, policy, set: &str, score| Episode { set: set.into(), ..drive(scenario, policy, 0, score) };
    let runs = [
        run("r", vec![with("a", "p", "base", 0.2), with("a", "q", "base", 0.4), with("a", "p", "fog", 0.6)]),
        run("r", vec![with("a", "p", "base", 0.8)]),
    ];
    let all = drives(&runs);
    let check = |by: &[Dimension], expected: &[(&[&str], f64)]| {
        let found = aggregate(&all, by, 0);
        assert_eq!(found.groups.len(), expected.len(), "{by:?}");
        for (key, mean) in expected {
            close(only(&found, key).metric("driving_score").expect("it is there").headline.mean, *mean);
        }
    };
    check(&[], &[(&[], (1.4 / 3.0 + 0.6) / 2.0)]);
    check(&[Dimension::Policy, Dimension::Set], &[(&["p", "base"], 0.5), (&["p", "fog"], 0.6), (&["q", "base"], 0.4)]);
    check(&[Dimension::Run], &[(&["r"], (0.3 + 0.6) / 2.0), (&["r #2"], 0.8)]);
    check(&[Dimension::Scenario, Dimension::Category], &[(&["a", ""], (1.4 / 3.0 + 0.6) / 2.0)]);
}

#[test]
fn score_profiles_are_never_mixed() {
    let with = |scenario, profile: &str| Episode { score_profile: profile.into(), ..drive(scenario, "p", 0, 0.5) };
    let runs = [run("r", vec![with("a", "bridgesim"), with("b", "strict")])];
    let found = aggregate(&drives(&runs), &[Dimension::Policy], 0);
    assert_eq!(found.by, [Dimension::Policy, Dimension::Profile]);
    assert_eq!(found.groups.len(), 2);
}

/// Two scenarios: one kept 0.7 and lost 0.2 to nc and 0.1 to ec; the other failed.
#[test]
fn losses_add_up_to_one() {
    let lossy =
        Episode { lost: BTreeMap::from([("nc".to_owned(), 0.2), ("ec".to_owned(), 0.06)]), ..drive("a", "p", 0, 0.7) };
    let runs = [run("r", vec![lossy, ended("b", "p", 0, "failed"), ended("c", "p", 0, "aborted")])];
    let lost = aggregate(&drives(&runs), &[], 0).groups[0].lost.clone().expect("a drive tells");
    close(Some(lost.kept), 0.35);
    close(Some(lost.by_term["nc"]), 0.1);
    close(Some(lost.to_failures), 0.5);
    close(Some(lost.unexplained), 0.02);
    assert_eq!(lost.scenarios, 2);
    let silent = [run("r", vec![drive("a", "p", 0, 0.7)])];
    assert_eq!(aggregate(&drives(&silent), &[], 0).groups[0].lost, None);
}

#[test]
fn the_order_of_episodes_does_not_matter() {
    let mut episodes: Vec<Episode> =
        (0..20u64).map(|i| drive(&format!("s{}", i % 7), "p", i, 1.0 / (1.0 + i as f64))).collect();
    let forward = aggregate(&drives(&[run("r", episodes.clone())]), &[Dimension::Policy], 4);
    episodes.reverse();
    assert_eq!(forward, aggregate(&drives(&[run("r", episodes)]), &[Dimension::Policy], 4));
}
