//! The end of the page: weighting, intervals and profile in words, then each run with its settings and digests.
//!
//! Nothing here is computed: the words are those of the modules that do the computing.

use super::markup::Markup;
use crate::aggregate::{HEADLINE, INTERVALS, WEIGHTING};
use crate::report::{Report, RunHead};

/// Writes how the figures came about and what was run.
pub(crate) fn section(m: &mut Markup, report: &Report) {
    let profiles = match report.constant.get("profile") {
        Some(profile) => profile.clone(),
        None if report.headline.by.contains(&crate::dimension::Dimension::Profile) => {
            "several; drives of different profiles are never averaged together".to_owned()
        }
        None => "not named in the results".to_owned(),
    };
    m.inside("dl", &[], |m| {
        for (title, words) in [
            ("Weighting", WEIGHTING),
            ("Failed and aborted", HEADLINE),
            ("Intervals", INTERVALS),
            ("Score profile", profiles.as_str()),
            (
                "Not applicable",
                "a score that does not apply to a drive (n/a) enters no mean and is counted; it is never 1",
            ),
            ("Scale", "points of 100 on this page; 0 to 1 in the JSON, CSV and Arrow files"),
        ] {
            m.leaf("dt", &[], title);
            m.leaf("dd", &[], words);
        }
        m.leaf("dt", &[], "Seed of the draws");
        m.leaf("dd", &[], report.headline.seed);
    });
    for run in &report.runs {
        m.inside("h3", &[], |m| {
            m.text("Run ");
            m.leaf("bdi", &[], &run.name);
        });
        m.inside("dl", &[], |m| {
            for (title, words) in settings(run) {
                m.leaf("dt", &[], title);
                m.inside("dd", &[], |m| m.leaf("bdi", &[], words));
            }
        });
    }
}

fn settings(head: &RunHead) -> Vec<(String, String)> {
    let run = &head.run;
    let seeds: Vec<String> = run.seeds.iter().take(20).map(u64::to_string).collect();
    let more = run.seeds.len().saturating_sub(20);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    let mut settings = vec![
        ("version".to_owned(), format!("{}, schema {}", run.version, run.schema_version)),
        ("seeds".to_owned(), seeds.join(", ") + &more),
        ("replan period".to_owned(), format!("{} ticks", run.replan_period)),
        ("horizon".to_owned(), format!("{} s", run.horizon_secs)),
        ("history".to_owned(), format!("{} frames", run.history)),
        ("agents".to_owned(), run.agents.clone()),
        ("tracker".to_owned(), run.tracker.clone()),
        ("appearance".to_owned(), run.appearance.clone()),
        ("mode".to_owned(), run.mode.clone()),
        ("wall time".to_owned(), format!("{:.1} s", run.wall_s)),
        ("configuration".to_owned(), run.configuration_digest.clone()),
        ("video model".to_owned(), run.video_model_digest.clone()),
        ("policy model".to_owned(), run.policy_model_digest.clone()),
    ];
    settings.extend(run.compute_classes.iter().map(|(role, class)| (format!("compute class, {role}"), class.clone())));
    if run.wall_clock {
        let words =
            "the policy had the time of the wall clock: not to be compared with drives that do not depend on a machine";
        settings.push(("clock".to_owned(), words.to_owned()));
    }
    if run.insecure {
        settings.push(("security".to_owned(), "ran without TLS and tokens on more than loopback".to_owned()));
    }
    settings.retain(|(_, words)| !words.is_empty());
    settings
}
