//! Made-up results for the tests of the writers: two runs, three sets, hostile names, failed and aborted drives.
//!
//! The names try to leave every format that they are written into; scores are draws, so nothing depends on them.

use std::collections::BTreeMap;

use ds_space::Draws;

use crate::compare::{Pairing, compare};
use crate::report::{Report, ReportOptions};
use crate::results::{Episode, ProposalStats, Results, Run};

/// A name that tries to leave every format it is written into.
pub(crate) const HOSTILE: &str =
    "=cmd|'</script><script>alert(\"1\")</script>,\u{202e}&amp;\n--><img src=//x onerror=y>`*[z](w)";

/// Returns a completed drive with every total at `score`.
pub(crate) fn drive(scenario: &str, policy: &str, seed: u64, score: f64) -> Episode {
    Episode {
        scenario: scenario.to_owned(),
        policy: policy.to_owned(),
        seed,
        observation: "reference".to_owned(),
        status: "completed".to_owned(),
        ticks: 80,
        driving_score: Some(score),
        route_completion: Some(score),
        mean_score: Some(score),
        ..Episode::default()
    }
}

/// Returns a drive that ended otherwise.
pub(crate) fn ended(scenario: &str, policy: &str, seed: u64, status: &str) -> Episode {
    Episode {
        status: status.to_owned(),
        reason: "plan refused: field \"poses[3].x_m\" is NaN".to_owned(),
        driving_score: None,
        route_completion: None,
        mean_score: None,
        ..drive(scenario, policy, seed, 0.0)
    }
}

/// Returns a run of these drives.
pub(crate) fn run(id: &str, episodes: Vec<Episode>) -> Results {
    let run = Run { id: id.to_owned(), version: "0.1.0".to_owned(), appearance: "day".to_owned(), ..Run::default() };
    Results { run, episodes }
}

fn scored(scenario: &str, set: &str, scorer: &str, index: u64) -> Episode {
    let draws = Draws::from_seed(index, scorer);
    let score = draws.range(0, 0.3, 0.9);
    let lost = BTreeMap::from([("nc".to_owned(), 0.6 * (1.0 - score)), ("ec".to_owned(), 0.4 * (1.0 - score))]);
    Episode {
        set: set.to_owned(),
        category: scenario.split('.').next().unwrap_or_default().to_owned(),
        appearance: "day".to_owned(),
        scorer: scorer.to_owned(),
        score_profile: "bridgesim".to_owned(),
        score_version: "1".to_owned(),
        sub_scores: BTreeMap::from([("nc".to_owned(), Some(score)), ("tlc".to_owned(), None)]),
        first_violations: BTreeMap::from([("nc".to_owned(), 41), ("ec".to_owned(), 3 + 40 * (index as u32 % 2))]),
        lost,
        proposals: Some(ProposalStats { best_mean: score, ticks_without_positive: index as u32 % 3, ticks: 16 }),
        ..drive(scenario, "lattice", index % 2, score)
    }
}

/// Returns a run with the learned and one with the oracle scorer.
pub(crate) fn runs() -> Vec<Results> {
    let names = ["cut-in", "free-curve", "roundabout", "lead-braking", "unprotected-left", "parked-narrowing"];
    let run_of = |scorer: &str, offset: u64| {
        let mut episodes = Vec::new();
        for (index, name) in (offset..).zip(names) {
            episodes.push(scored(name, "base", scorer, index));
            episodes.push(scored(&format!("{name}.fog"), "appearance", scorer, index + 20));
        }
        episodes.push(Episode { driving_score: Some(0.01), ..scored(HOSTILE, "behavior", scorer, 4) });
        let other =
            |status| Episode { set: "base".into(), scorer: scorer.into(), ..ended("cut-in", "other", 0, status) };
        episodes.push(Episode { appearance: "day".into(), ..other("failed") });
        episodes.push(Episode { seed: 1, appearance: "day".into(), reason: HOSTILE.into(), ..other("aborted") });
        run(&format!("run-{scorer}"), episodes)
    };
    let mut runs = vec![run_of("learned", 0), run_of("oracle", 100)];
    runs[1].episodes.push(scored("only-here", "base", "oracle", 7));
    runs
}

/// Returns the report of both, with their comparison.
pub(crate) fn report() -> Report {
    let runs = runs();
    let comparison = compare(&runs[0], &runs[1], &Pairing::default(), 1);
    Report::new(&runs, vec![comparison], &ReportOptions { title: HOSTILE.to_owned(), ..ReportOptions::default() })
}
