//! `gap attribute`: which component of the real world costs a policy how much of its score.
//!
//! The same policies, scenarios and seeds drive a full factorial of swaps: frames, dynamics, agents and transport, each
//! the nominal or the real world's. A component without a difference between the two is not swapped.

use std::collections::BTreeSet;
use std::ffi::OsString;

use anyhow::{Context, Result, ensure};
use ds_effect::{Insertion, find};
use ds_run_report::{Attribution, Episode, Results, attribute};
use serde::Serialize;

use super::close::run_args;
use super::write_config;
use crate::cli::AttributeArgs;
use crate::command::report::RESULTS;
use crate::command::{answer, bar, run};
use crate::world::{EffectLine, RunConfig};

/// A part of the world that can be the nominal or the real one's.
#[derive(Debug, Clone)]
struct Component {
    name: &'static str,
    /// Effects that it brings.
    effects: Vec<EffectLine>,
}

/// The split of every metric for one policy.
#[derive(Debug, Serialize)]
struct PolicyReport {
    policy: String,
    sentence: String,
    metrics: Vec<Attribution>,
}

/// Runs the command.
///
/// # Errors
/// If the configuration is refused, nothing differs between the worlds, or a drive fails.
pub(crate) async fn run(args: &AttributeArgs, log: &str) -> Result<()> {
    let config = RunConfig::gather(Some(&args.config), &[])?;
    let components = components(args, &config);
    ensure!(
        !components.is_empty(),
        "the two worlds do not differ: no effect in {}, same frames",
        args.config.display()
    );
    let names: Vec<&str> = components.iter().map(|component| component.name).collect();
    let cells = 1 << components.len();
    let bar = bar(cells * args.policy.len() as u64, "cells");
    let mut reports = Vec::new();
    for policy in &args.policy {
        let mut results = Vec::new();
        for cell in 0..cells {
            results.push(drive(args, policy, &components, cell, log).await?);
            bar.inc(1);
        }
        let metrics = metrics(&names, &results);
        let score = metrics.iter().find(|split| split.metric == "driving_score");
        let sentence = score.map_or("no scenario has a driving score in every cell".to_owned(), Attribution::sentence);
        reports.push(PolicyReport { policy: policy.clone(), sentence, metrics });
    }
    bar.finish_and_clear();
    let path = args.out.join("attribution.json");
    std::fs::write(&path, serde_json::to_string_pretty(&reports)? + "\n")
        .with_context(|| format!("write {}", path.display()))?;
    for report in &reports {
        answer(&format!("{}: {}", report.policy, report.sentence));
    }
    answer(&format!("written to {}", path.display()));
    Ok(())
}

/// Sorts the real world's differences by the service that makes them.
fn components(args: &AttributeArgs, config: &RunConfig) -> Vec<Component> {
    let of = |wanted: &[Insertion]| -> Vec<EffectLine> {
        let inside = |line: &&EffectLine| find(&line.id).is_some_and(|effect| wanted.contains(&effect.insertion));
        config.effects.iter().filter(inside).cloned().collect()
    };
    let dynamics = [Insertion::CommandPath, Insertion::Actuator, Insertion::Vehicle, Insertion::Road];
    let all = [
        Component { name: "dynamics", effects: of(&dynamics) },
        Component { name: "agents", effects: of(&[Insertion::Agent, Insertion::Map]) },
        Component { name: "latency and sensors", effects: of(&[Insertion::Clock, Insertion::Sensor]) },
    ];
    // What the car's own library does not know acts on finished frames.
    let on_frames: Vec<EffectLine> = config.effects.iter().filter(|line| find(&line.id).is_none()).cloned().collect();
    let differ = args.real_frames != args.nominal_frames || !on_frames.is_empty();
    let frames = differ.then_some(Component { name: "frames", effects: on_frames });
    frames.into_iter().chain(all.into_iter().filter(|component| !component.effects.is_empty())).collect()
}

async fn drive(args: &AttributeArgs, policy: &str, components: &[Component], cell: u64, log: &str) -> Result<Results> {
    let swapped = |index: usize| cell & (1 << index) != 0;
    let inside: Vec<&Component> = components.iter().enumerate().filter(|(i, _)| swapped(*i)).map(|(_, c)| c).collect();
    let out = args.out.join(policy).join(format!("{cell:04b}"));
    let finished = out.join(RESULTS);
    if args.resume && finished.exists() {
        return Ok(Results::load(&finished)?);
    }
    std::fs::create_dir_all(&out).with_context(|| format!("create {}", out.display()))?;
    let frames = if inside.iter().any(|c| c.name == "frames") { &args.real_frames } else { &args.nominal_frames };
    let config = RunConfig { effects: inside.iter().flat_map(|component| component.effects.clone()).collect() };
    let file = out.join("world.toml");
    write_config(&config, &format!("cell {cell:04b}"), &file)?;
    let mut words: Vec<OsString> = ["dreamstream", "run"].map(OsString::from).to_vec();
    words.extend(args.scenarios.iter().map(OsString::from));
    words.extend(["--policy", policy, "--observation", frames, "--no-pictures", "--duration"].map(OsString::from));
    words.extend([args.duration.to_string().into(), "--config".into(), file.into(), "--out".into(), out.into()]);
    for seed in &args.seed {
        words.extend(["--seed".into(), seed.to_string().into()]);
    }
    run::drive_all(&run_args(words)?, log).await
}

/// Splits every metric that the drives have.
fn metrics(names: &[&str], cells: &[Results]) -> Vec<Attribution> {
    let scenarios: BTreeSet<&str> = cells.iter().flat_map(|cell| &cell.episodes).map(|e| e.scenario.as_str()).collect();
    let terms: BTreeSet<&str> =
        cells.iter().flat_map(|cell| &cell.episodes).flat_map(|e| e.sub_scores.keys()).map(String::as_str).collect();
    let whole = ["driving_score", "route_completion"];
    let split = |metric: &str| {
        let column = |cell: &Results| scenarios.iter().map(|scenario| of_scenario(cell, scenario, metric)).collect();
        attribute(metric, names, &cells.iter().map(column).collect::<Vec<_>>(), 0)
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
    ds_stats::mean(cell.episodes.iter().filter(|e| e.scenario == scenario).filter_map(of))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn terms_come_from_seeds_alike() {
        let episode = |scenario: &str, score: f64| Episode {
            scenario: scenario.to_owned(),
            driving_score: Some(score),
            sub_scores: BTreeMap::from([("comfort".to_owned(), Some(score))]),
            ..Episode::default()
        };
        let cell = |shift: f64| Results {
            episodes: vec![episode("a", 0.8 - shift), episode("a", 0.6 - shift), episode("b", 0.4)],
            run: ds_run_report::Run::default(),
        };
        let split = metrics(&["dynamics"], &[cell(0.0), cell(0.2)]);
        let names: Vec<&str> = split.iter().map(|one| one.metric.as_str()).collect();
        assert_eq!(names, ["driving_score", "comfort"]);
        assert!((split[0].total + 0.1).abs() < 1e-12 && split[0].scenarios == 2, "{:?}", split[0]);
    }
}
