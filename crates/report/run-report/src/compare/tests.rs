//! Differences and conclusions worked out by hand.
//!
//! Pairs that lack a side, a value or an end must be counted, never averaged.

use super::*;
use crate::results::Episode;
use crate::sample::{drive, ended, run};

fn compared(a: Vec<Episode>, b: Vec<Episode>) -> Comparison {
    compare(&run("old", a), &run("new", b), &Pairing::default(), 0)
}

fn score(comparison: &Comparison) -> &Difference {
    let group = comparison.groups.first().expect("a group");
    group.metrics.iter().find(|metric| metric.metric == "driving_score").expect("it is always there")
}

fn near(found: Option<f64>, expected: f64) {
    assert!(found.is_some_and(|found| (found - expected).abs() < 1e-12), "{found:?}, not {expected}");
}

fn numbered(scores: &[f64]) -> Vec<Episode> {
    scores.iter().enumerate().map(|(i, score)| drive(&format!("s{i:02}"), "p", 0, *score)).collect()
}

/// a: (0.5, 0.7) against (0.6, 1.0): +0.2 in the mean of its seeds; b: 0.4 against 0.3: −0.1; so +0.05.
#[test]
fn seeds_are_averaged_within_a_scenario() {
    let old = vec![drive("a", "p", 0, 0.5), drive("a", "p", 1, 0.7), drive("b", "p", 0, 0.4)];
    let new = vec![drive("a", "p", 0, 0.6), drive("a", "p", 1, 1.0), drive("b", "p", 0, 0.3)];
    let found = compared(old, new);
    let score = score(&found);
    near(score.difference, 0.05);
    near(score.a, 0.5);
    near(score.b, 0.55);
    assert_eq!((score.scenarios, score.verdict, score.p), (2, Verdict::TooFewScenarios, None));
    assert_eq!((found.groups[0].pairs, found.groups[0].scenarios), (3, 2));
}

/// With all of one sign p = 2/2ⁿ: 2/512 for 9 scenarios, three times that after Holm's correction over three metrics.
#[test]
fn conclusions_follow_the_corrected_p_value() {
    let check = |scenarios: usize, p: Option<f64>, verdict: Verdict| {
        let old = numbered(&vec![0.5; scenarios]);
        let new = numbered(&(0..scenarios).map(|i| 0.6 + 0.01 * i as f64).collect::<Vec<_>>());
        let found = compared(old, new);
        let score = score(&found);
        assert_eq!(score.verdict, verdict, "{scenarios} scenarios: {score:?}");
        assert_eq!(score.p.map(|p| (p * 4096.0).round()), p.map(|p| (p * 4096.0).round()));
    };
    check(4, None, Verdict::TooFewScenarios);
    check(5, Some(2.0 / 32.0), Verdict::OutOfReach);
    check(6, Some(2.0 / 64.0), Verdict::OutOfReach);
    check(9, Some(2.0 / 512.0), Verdict::Significant);
    let same = compared(numbered(&[0.5; 9]), numbered(&[0.5; 9]));
    assert_eq!((score(&same).verdict, score(&same).p_holm), (Verdict::NotSignificant, Some(1.0)));
}

#[test]
fn failed_is_zero_and_aborted_is_left_out() {
    let old = vec![drive("a", "p", 0, 0.5), drive("b", "p", 0, 0.5), drive("c", "p", 0, 0.5)];
    let silent = Episode { driving_score: None, ..drive("c", "p", 0, 0.5) };
    let new = vec![ended("a", "p", 0, "failed"), ended("b", "p", 0, "aborted"), silent];
    let found = compared(old, new);
    let score = score(&found);
    near(score.difference, -0.5);
    assert_eq!((score.scenarios, score.aborted_pairs, score.not_applicable_pairs), (1, 1, 1));
}

#[test]
fn what_has_no_partner_is_listed() {
    let old = vec![drive("a", "p", 0, 0.5), drive("a", "p", 1, 0.5), drive("gone", "p", 0, 0.5)];
    let new = vec![drive("a", "p", 0, 0.5), drive("added", "p", 0, 0.5), drive("added", "p", 1, 0.5)];
    let found = compared(old, new);
    let entry = |run, scenario: &str, episodes, partly| Unmatched {
        run,
        set: String::new(),
        scenario: scenario.to_owned(),
        episodes,
        partly,
    };
    assert_eq!(
        found.unmatched,
        [entry("a", "a", 1, true), entry("a", "gone", 1, false), entry("b", "added", 2, false)]
    );
    assert_eq!(found.groups[0].pairs, 1);
}

#[test]
fn policies_are_paired_by_name_by_rename_or_as_the_only_ones() {
    let both = |score: f64| vec![drive("a", "p", 0, score), drive("a", "q", 0, score + 0.1)];
    assert_eq!(compared(both(0.1), both(0.2)).groups[0].pairs, 2);

    let alone = compared(vec![drive("a", "p", 0, 0.5)], vec![drive("a", "q", 0, 0.7)]);
    near(score(&alone).difference, 0.2);
    assert!(alone.notes[0].contains("policy \"p\" of the first run is compared with \"q\""), "{:?}", alone.notes);

    let renames = BTreeMap::from([("p".to_owned(), "q".to_owned())]);
    let pairing = Pairing { renames: BTreeMap::from([(Dimension::Policy, renames)]), ..Pairing::default() };
    let found = compare(&run("old", both(0.1)), &run("new", vec![drive("a", "q", 0, 0.4)]), &pairing, 0);
    // p and q of the first run both meet q of the second: their mean 0.15 is compared with 0.4.
    near(score(&found).difference, 0.25);
}

#[test]
fn appearances_are_paired() {
    let at = |appearance: &str, score| Episode { appearance: appearance.into(), ..drive("a", "p", 0, score) };
    let found = compared(vec![at("day", 0.5), at("fog", 0.3)], vec![at("fog", 0.4), at("day", 0.9)]);
    near(score(&found).difference, (0.4 + 0.1) / 2.0);
    assert_eq!(found.groups[0].pairs, 2);
}

#[test]
fn groups_and_profiles_are_told() {
    let with = |profile: &str, policy| Episode { score_profile: profile.into(), ..drive("a", policy, 0, 0.5) };
    let pairing = Pairing { by: vec![Dimension::Policy], ..Pairing::default() };
    let old = run("same", vec![with("bridgesim", "p"), with("bridgesim", "q")]);
    let new = run("same", vec![with("strict", "p"), with("strict", "q")]);
    let found = compare(&old, &new, &pairing, 0);
    assert_eq!((found.a.as_str(), found.b.as_str()), ("same", "same #2"));
    assert_eq!(found.groups.iter().map(|group| group.key[0].as_str()).collect::<Vec<_>>(), ["p", "q"]);
    assert!(found.notes.iter().any(|note| note.contains("score profiles differ")), "{:?}", found.notes);
}
