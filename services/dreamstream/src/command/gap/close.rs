//! `gap close`: diagnose → apply → drive again → before and after, on scenarios that the fit never saw.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use ds_diagnosis::Diagnosis;
use ds_dynamics::{Options, diagnose};
use ds_record::vehicle_log;
use ds_run_report::bootstrap::{self, mean_interval};
use ds_run_report::{Interval, Results};
use ds_stats::mean;
use ds_world::Reading;
use serde::Serialize;

use super::{corrected, logs, save, stamps, tell, write_config};
use crate::cli::{Cli, CloseArgs, Command, RunArgs};
use crate::command::report::RESULTS;
use crate::command::{answer, run, scenario};

/// A quantity of held-out drives in the nominal and in the corrected simulator, against the real world.
#[derive(Debug, Clone, Serialize)]
struct Closing {
    /// `route_deviation` in metres, `driving_score`, `route_completion`.
    metric: String,
    /// Mean over drives of the absolute difference to the real drive.
    before: f64,
    after: f64,
    /// 1 - after / before; 0 where nothing was to be closed.
    share_closed: f64,
    /// 95 % interval over drives of before minus after.
    gain: Option<Interval>,
    drives: usize,
}

#[derive(Debug, Serialize)]
struct Report {
    verdict: ds_diagnosis::Verdict,
    chosen: Vec<String>,
    /// Share of `position_2s` that the fit promises, and what held-out logs show.
    predicted_share: f64,
    realised_share: Option<f64>,
    closed_loop: Vec<Closing>,
}

/// Runs the command.
///
/// # Errors
/// If logs are missing or refused, or a drive fails.
pub(crate) async fn run(args: &CloseArgs, log: &str) -> Result<()> {
    let real = args.real.join("real");
    let files = scenario::files(&args.scenarios)?;
    let names = files.iter().map(|file| Ok(ds_scenario::load(file)?.0.name)).collect::<Result<Vec<_>>>()?;
    let logged = logs::drives(&real)?;
    let held: Vec<String> = names.iter().filter(|name| logged.contains(name)).cloned().collect();
    ensure!(!held.is_empty(), "{} has no log of the scenarios to drive again", real.display());
    ensure!(held.len() < logged.len(), "every log of {} is held out: none is left to fit", real.display());
    let case = args.out.join("case");
    logs::case(&real, &held, &case)?;
    let mut diagnosis = diagnose(&case, &Options { quick: args.quick, without: Vec::new() })?;
    stamps::add(&case, &mut diagnosis)?;
    save(&args.out, &diagnosis)?;
    tell("diagnosis", &diagnosis);
    let config = args.out.join("corrected.toml");
    write_config(&corrected(&diagnosis), &diagnosis.case, &config)?;
    let nominal = drive(args, "nominal", None, log).await?;
    let mended = drive(args, "corrected", Some(&config), log).await?;
    let results = Results::load(&args.real.join(RESULTS))?;
    let report = report(args, &held, &diagnosis, [&results, &nominal, &mended])?;
    let path = args.out.join("close.json");
    std::fs::write(&path, serde_json::to_string_pretty(&report)? + "\n")
        .with_context(|| format!("write {}", path.display()))?;
    for closing in &report.closed_loop {
        let gain = closing.gain.map_or(String::new(), |gain| format!(", gain {:.3} to {:.3}", gain.low, gain.high));
        answer(&format!(
            "{:16} off by {:.3} → {:.3}: {:.0} % closed over {} drives{gain}",
            closing.metric,
            closing.before,
            closing.after,
            100.0 * closing.share_closed,
            closing.drives
        ));
    }
    answer(&format!("written to {}", args.out.display()));
    Ok(())
}

async fn drive(args: &CloseArgs, name: &str, config: Option<&Path>, log: &str) -> Result<Results> {
    let out = args.out.join(name);
    let mut words: Vec<OsString> = ["dreamstream", "run"].map(OsString::from).to_vec();
    words.extend(args.scenarios.iter().map(OsString::from));
    let flags = ["--policy", &args.policy, "--observation", &args.observation, "--vehicle-log", "--no-pictures"];
    words.extend(flags.map(OsString::from));
    words.extend(["--duration".into(), args.duration.to_string().into(), "--out".into(), out.into()]);
    if let Some(config) = config {
        words.extend(["--config".into(), config.into()]);
    }
    run::drive_all(&run_args(words)?, log).await
}

/// Reads the arguments of a run.
pub(crate) fn run_args(words: Vec<OsString>) -> Result<RunArgs> {
    match Cli::try_parse_from(words)?.command {
        Command::Run(args) => Ok(args),
        _ => unreachable!("the words begin with `run`"),
    }
}

fn report(
    args: &CloseArgs,
    held: &[String],
    diagnosis: &Diagnosis,
    [real, nominal, mended]: [&Results; 3],
) -> Result<Report> {
    let mut columns: BTreeMap<&str, Vec<(f64, f64)>> = BTreeMap::new();
    for name in held {
        let log = |folder: &Path| vehicle_log::read(&folder.join("real").join(format!("{name}.mcap")));
        let truth = log(&args.real)?;
        let [before, after] = ["nominal", "corrected"].map(|run| log(&args.out.join(run)));
        let (before, after) =
            (deviation(&truth.readings, &before?.readings), deviation(&truth.readings, &after?.readings));
        columns.entry("route_deviation").or_default().push((before, after));
        type Field = fn(&ds_run_report::Episode) -> Option<f64>;
        let scores: [(&str, Field); 2] =
            [("driving_score", |e| e.driving_score), ("route_completion", |e| e.route_completion)];
        for (metric, field) in scores {
            let of = |results: &Results| results.episodes.iter().find(|e| &e.scenario == name).and_then(field);
            if let (Some(truth), Some(before), Some(after)) = (of(real), of(nominal), of(mended)) {
                columns.entry(metric).or_default().push(((before - truth).abs(), (after - truth).abs()));
            }
        }
    }
    let closing = |(metric, pairs): (&str, Vec<(f64, f64)>)| {
        let before = mean(pairs.iter().map(|pair| pair.0)).unwrap_or_default();
        let after = mean(pairs.iter().map(|pair| pair.1)).unwrap_or_default();
        let gains: Vec<f64> = pairs.iter().map(|(before, after)| before - after).collect();
        Closing {
            metric: metric.to_owned(),
            before,
            after,
            share_closed: if before > 0.0 { 1.0 - after / before } else { 0.0 },
            gain: mean_interval(&gains, &bootstrap::draws(0)),
            drives: pairs.len(),
        }
    };
    let realised = diagnosis.how_far.iter().find(|shrink| shrink.metric == "position_2s");
    Ok(Report {
        verdict: diagnosis.verdict,
        chosen: diagnosis.chosen.clone(),
        predicted_share: diagnosis.predicted_share,
        realised_share: realised.map(|shrink| shrink.share_explained),
        closed_loop: columns.into_iter().map(closing).collect(),
    })
}

/// Root mean square distance between two drives at equal stamps, metres.
fn deviation(truth: &[Reading], other: &[Reading]) -> f64 {
    let squares = truth.iter().zip(other).map(|(a, b)| (a.x_m - b.x_m).powi(2) + (a.y_m - b.y_m).powi(2));
    mean(squares).unwrap_or_default().sqrt()
}
