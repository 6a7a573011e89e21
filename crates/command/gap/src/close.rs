//! `gap close`: diagnose → apply → drive again → before and after, on scenarios that the fit never saw.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use ds_cases::closing::{LoggedRun, closed};
use ds_cases::{Case, Options, RunConfig, logs};
use ds_diagnosis::{Diagnosis, json};
use ds_launch::{RunPlan, run, scenarios};
use ds_process::terminal::answer;
use ds_run_report::RESULTS;
use ds_run_report::Results;
use ds_run_report::closing::Closing;
use serde::Serialize;

use crate::cli::CloseArgs;
use crate::{PAGE, put, tell};

#[derive(Debug, Serialize)]
struct Report {
    #[serde(with = "ds_diagnosis::verdict")]
    verdict: ds_diagnosis::Verdict,
    chosen: Vec<String>,
    /// Share of `position_2s` that the fit promises, and what held-out logs show.
    predicted_share: Option<f64>,
    realised_share: Option<f64>,
    closed_loop: Vec<Closing>,
}

impl Report {
    fn new(diagnosis: &Diagnosis, closed_loop: Vec<Closing>) -> Self {
        let realised = diagnosis.how_far.iter().find(|shrink| shrink.metric == "position_2s");
        Self {
            verdict: diagnosis.verdict,
            chosen: diagnosis.chosen.clone(),
            predicted_share: diagnosis.predicted_share,
            realised_share: realised.and_then(|shrink| shrink.share_explained),
            closed_loop,
        }
    }
}

/// Runs the command.
///
/// # Errors
/// If logs are missing or refused, or a drive fails.
pub(crate) async fn run(args: &CloseArgs, log: &str) -> Result<()> {
    let real = args.real.join("real");
    let files = scenarios::files(&args.scenarios)?;
    let names = files.iter().map(|file| Ok(ds_scenario::load(file)?.0.name)).collect::<Result<Vec<_>>>()?;
    let logged = logs::drives(&real)?;
    let held: Vec<String> = names.iter().filter(|name| logged.contains(name)).cloned().collect();
    ensure!(!held.is_empty(), "{} has no log of the scenarios to drive again", real.display());
    ensure!(held.len() < logged.len(), "every log of {} is held out: none is left to fit", real.display());
    let case = args.out.join("case");
    logs::case(&real, &held, &case)?;
    let options = Options { quick: args.quick, ..Options::default() };
    let diagnosis = ds_cases::diagnose(&Case::read(&case)?, &options)?;
    diagnosis.write(&args.out)?;
    tell("diagnosis", &diagnosis);
    let config = args.out.join("corrected.toml");
    let corrected = RunConfig::corrected(std::slice::from_ref(&diagnosis))?;
    corrected.write(&diagnosis.case, &ds_diagnosis_page::values(&diagnosis), &config)?;
    let plan = |name: &str, config: Option<PathBuf>| RunPlan {
        scenarios: args.scenarios.clone(),
        policy: args.policy.clone(),
        observation: args.observation,
        duration: args.duration,
        vehicle_log: true,
        no_pictures: true,
        out: args.out.join(name),
        config,
        ..RunPlan::default()
    };
    let hair = args.out.join("hair_apart.toml");
    corrected.hair_apart().write(&diagnosis.case, &[], &hair)?;
    let runs = [plan("nominal", None), plan("corrected", Some(config)), plan("hair-apart", Some(hair))];
    let real = Results::load(&args.real.join(RESULTS))?;
    let mut driven = Vec::new();
    for plan in &runs {
        driven.push(run::drive_all(plan, log).await?);
    }
    let real = LoggedRun { folder: &args.real, results: &real };
    let [before, after, apart] = [0, 1, 2].map(|k| LoggedRun { folder: &runs[k].out, results: &driven[k] });
    let report = Report::new(&diagnosis, closed(&held, &real, [&before, &after, &apart])?);
    json::write(&report, &args.out.join("close.json"))?;
    let asked = [
        ("real drives", args.real.display().to_string()),
        ("kept from the fit", held.join(", ")),
        (
            "fitted",
            format!("{} drives, {} effort", logged.len() - held.len(), if args.quick { "quick" } else { "full" }),
        ),
        ("policy", format!("{} on {} frames", args.policy, args.observation.name())),
        ("corrected simulator", "corrected.toml".to_owned()),
    ];
    put(&args.out.join(PAGE), &ds_diagnosis_page::page(&diagnosis, Some(&case)))?;
    put(&args.out.join("close.html"), &ds_diagnosis_page::closing(&diagnosis, &report.closed_loop, &asked, PAGE))?;
    for closing in &report.closed_loop {
        let gain = closing.gain.map_or(String::new(), |gain| format!(", gain {:.3} to {:.3}", gain.low, gain.high));
        answer(&format!(
            "{:16} off by {:.3} → {:.3}: {:.0} % closed over {} drives{gain}; by chance {:.3}",
            closing.metric,
            closing.before,
            closing.after,
            100.0 * closing.share_closed,
            closing.drives,
            closing.chance
        ));
    }
    answer(&format!("written to {}", args.out.join("close.html").display()));
    Ok(())
}
