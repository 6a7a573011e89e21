//! `gap attribute`: which component of the real world costs a policy how much of its score.
//!
//! The same policies, scenarios and seeds drive a full factorial of swaps: frames, dynamics, agents and transport, each
//! the nominal or the real world's. A component without a difference between the two is not swapped.

use anyhow::{Context, Result, ensure};
use ds_cases::world::{Component, components};
use ds_cases::{EffectLine, RunConfig};
use ds_diagnosis::json;
use ds_run_report::attribution::split;
use ds_run_report::{Attribution, Results};
use serde::Serialize;

use crate::cli::{AttributeArgs, RunPlan};
use crate::command::report::RESULTS;
use crate::command::{answer, bar, run};

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
    let config = RunConfig::gather(Some(&args.config), (&[], &[]))?;
    let components = components(&config, args.real_frames != args.nominal_frames);
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
        let metrics = split(&names, &results);
        let score = metrics.iter().find(|split| split.metric == "driving_score");
        let sentence = score.map_or("no scenario has a driving score in every cell".to_owned(), Attribution::sentence);
        reports.push(PolicyReport { policy: policy.clone(), sentence, metrics });
    }
    bar.finish_and_clear();
    let path = args.out.join("attribution.json");
    json::write(&reports, &path)?;
    for report in &reports {
        answer(&format!("{}: {}", report.policy, report.sentence));
    }
    answer(&format!("written to {}", path.display()));
    Ok(())
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
    let real = inside.iter().any(|component| component.name == Component::FRAMES);
    let effects: Vec<EffectLine> = inside.iter().flat_map(|component| component.effects.clone()).collect();
    let laws: Vec<String> = inside.iter().flat_map(|component| component.laws.clone()).collect();
    let file = out.join("world.toml");
    RunConfig { effects, laws, ..RunConfig::default() }.write(&format!("cell {cell:04b}"), &file)?;
    let plan = RunPlan {
        scenarios: args.scenarios.clone(),
        policy: policy.to_owned(),
        observation: if real { args.real_frames } else { args.nominal_frames },
        duration: args.duration,
        seed: args.seed.clone(),
        no_pictures: true,
        config: Some(file),
        out,
        ..RunPlan::default()
    };
    run::drive_all(&plan, log).await
}
