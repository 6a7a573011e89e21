//! `gap attribute`: which component of the real world costs a policy how much of its score.
//!
//! The same policies, scenarios and seeds drive a full factorial of swaps: frames, dynamics, agents and transport, each
//! the nominal or the real world's. A component without a difference between the two is not swapped.

use anyhow::{Context, Result, ensure};
use ds_cases::world::{Component, components};
use ds_cases::{EffectLine, RunConfig};
use ds_diagnosis::json;
use ds_diagnosis_page::Attributed;
use ds_launch::{RunPlan, run};
use ds_process::terminal::{answer, bar};
use ds_run_report::RESULTS;
use ds_run_report::attribution::split;
use ds_run_report::{Attribution, Results};
use serde::Serialize;

use crate::cli::AttributeArgs;
use crate::put;

/// The split of every metric for one policy.
#[derive(Debug, Serialize)]
struct PolicyReport {
    policy: String,
    sentence: String,
    metrics: Vec<Attribution>,
}

impl PolicyReport {
    fn attributed(&self) -> Attributed<'_> {
        Attributed { policy: &self.policy, sentence: &self.sentence, metrics: &self.metrics }
    }
}

/// Runs the command.
///
/// # Errors
/// If the configuration is refused, nothing differs between the worlds, or a drive fails.
pub(crate) async fn run(args: &AttributeArgs, log: &str) -> Result<()> {
    let config = RunConfig::gather(Some(&args.config), &[], &[])?;
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
    json::write(&reports, &args.out.join("attribution.json"))?;
    put(&args.out.join("attribution.html"), &page(args, &components, &reports))?;
    for report in &reports {
        answer(&format!("{}: {}", report.policy, report.sentence));
    }
    answer(&format!("written to {}", args.out.join("attribution.html").display()));
    Ok(())
}

/// Writes values as people read them.
fn joined(values: &[f64]) -> String {
    values
        .iter()
        .map(|value| format!("{value:.3e}").parse().map_or_else(|_| value.to_string(), |v: f64| v.to_string()))
        .collect::<Vec<_>>()
        .join(",")
}

fn page(args: &AttributeArgs, components: &[Component], reports: &[PolicyReport]) -> String {
    let effects = |component: &Component| {
        let named = component.effects.iter().map(|effect| format!("{}={}", effect.id, joined(&effect.values)));
        let all: Vec<String> = named.chain(component.laws.iter().cloned()).collect();
        let frames = component.name == Component::FRAMES && args.real_frames != args.nominal_frames;
        let swapped = frames.then(|| format!("{} for {}", args.real_frames.name(), args.nominal_frames.name()));
        format!("{}: {}", component.name, swapped.into_iter().chain(all).collect::<Vec<_>>().join(", "))
    };
    let asked = [
        ("real world", args.config.display().to_string()),
        ("its parts", components.iter().map(effects).collect::<Vec<_>>().join("; ")),
        ("scenarios", args.scenarios.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")),
        ("seeds", args.seed.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")),
        (
            "duration",
            if args.duration > 0.0 { format!("{} s", args.duration) } else { "the whole scenario".to_owned() },
        ),
    ];
    let policies: Vec<Attributed<'_>> = reports.iter().map(PolicyReport::attributed).collect();
    ds_diagnosis_page::attribution(&policies, &asked)
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
    RunConfig { effects, laws, ..RunConfig::default() }.write(&format!("cell {cell:04b}"), &[], &file)?;
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
