//! What a report is grouped by, and what it repeats.
//!
//! No drive may be lost between the results and any of the tables.

use super::*;
use crate::results::Episode;
use crate::sample::{self, drive, ended, run};

#[test]
fn the_headline_is_split_by_what_varies() {
    let check = |runs: &[Results], expected: &[Dimension]| {
        let report = Report::new(runs, Vec::new(), &ReportOptions::default());
        assert_eq!(report.headline.by, expected);
    };
    let plain = run("r", vec![drive("a", "p", 0, 0.5), drive("b", "p", 0, 0.5)]);
    check(std::slice::from_ref(&plain), &[Dimension::Policy]);
    check(&[plain.clone(), plain], &[Dimension::Run, Dimension::Policy]);
    check(&sample::runs(), &[Dimension::Policy, Dimension::Set, Dimension::Scorer, Dimension::Profile]);
}

#[test]
fn every_drive_is_somewhere() {
    let report = sample::report();
    let episodes: usize = sample::runs().iter().map(|run| run.episodes.len()).sum();
    for aggregate in [Some(&report.headline), Some(&report.scenarios), report.categories.as_ref()] {
        let groups = &aggregate.expect("the sample has several families").groups;
        assert_eq!(groups.iter().map(|group| group.counts.episodes).sum::<usize>(), episodes);
    }
    assert_eq!(report.counts.failed + report.counts.aborted, report.unfinished.len());
}

#[test]
fn scenarios_of_several_sets_stay_apart() {
    let of = |set: &str| Episode { set: set.into(), ..drive("a", "p", 0, 0.5) };
    let report = Report::new(
        &[run("r", vec![of("base"), of("fog"), ended("b", "p", 0, "running")])],
        Vec::new(),
        &ReportOptions::default(),
    );
    assert_eq!((report.counts.scenarios, report.scenarios.groups.len()), (3, 3));
    assert_eq!((report.counts.aborted, report.unfinished[0].status.as_str()), (1, "running"));
    assert_eq!(report.constant.get("policy").map(String::as_str), Some("p"));
}
