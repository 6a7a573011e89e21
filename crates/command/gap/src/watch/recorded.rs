//! Recorded cases watched for alarms against a baseline: when, in which channels, and what a diagnosis says of the first.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use ds_cases::Case;
use ds_cases::CasesError;
use ds_cases::folder::{folders, names};
use ds_diagnosis::{Diagnosis, json};
use ds_dynamics::Options;
use ds_dynamics::baseline::Baseline;
use ds_dynamics::watch::detector::STEPS_AN_HOUR;
use ds_dynamics::watch::{Alarm, Watch};
use ds_process::service::UsageError;
use ds_process::terminal::{answer, bar};
use serde::Serialize;

use crate::cli::WatchArgs;

/// What a watch of recorded cases says.
#[derive(Debug, Serialize)]
struct Report {
    schema_version: u32,
    cases: Vec<String>,
    alarms_per_hour: f64,
    /// Evidence at which there is an alarm.
    threshold: f64,
    hours: f64,
    windows: usize,
    /// Windows that tell nothing, because the car did what none of the healthy drives did.
    windows_strange: usize,
    alarms: Vec<Alarm>,
    #[serde(skip_serializing_if = "Option::is_none")]
    diagnosed: Option<Diagnosed>,
}

/// The diagnosis of the first alarm's log.
#[derive(Debug, Serialize)]
struct Diagnosed {
    /// Stamp from which on the alarm's drive was looked at, s, with the drives after it.
    from_secs: f64,
    diagnosis: Diagnosis,
}

/// Tells whether the arguments name case folders.
pub(crate) fn are_cases(args: &WatchArgs) -> bool {
    args.watched.iter().any(|given| Path::new(given).is_dir())
}

/// Runs the command.
///
/// # Errors
/// If there is no baseline, a case is refused, or the file cannot be written.
pub(crate) fn run(args: &WatchArgs) -> Result<()> {
    let usage = |why: String| anyhow::Error::from(UsageError(why));
    let path = args.baseline.as_deref();
    let path =
        path.ok_or_else(|| usage("recorded cases are watched against healthy ones: --baseline FILE".to_owned()))?;
    let (rate, baseline) = (args.alarms_per_hour, baseline(args, path)?);
    let paths: Vec<PathBuf> = args.watched.iter().map(PathBuf::from).collect();
    let cases = folders(&paths)?;
    let mut watch = Watch::new(baseline, rate)?;
    let bar = bar(cases.len() as u64, "cases");
    let (mut alarms, mut diagnosed): (Vec<Alarm>, Option<Diagnosed>) = (Vec::new(), None);
    let names = names(&cases);
    for (path, name) in cases.iter().zip(&names) {
        let Case::Vehicle(case, _) = Case::read(path)? else {
            return Err(CasesError::NoVehicle { path: path.clone() }.into());
        };
        let found = watch.log(name, &case).with_context(|| name.clone())?;
        bar.suspend(|| found.iter().for_each(|alarm| answer(&line(alarm))));
        if let (Some(first), true, false) = (found.first(), alarms.is_empty(), args.alarms_only) {
            let options = Options { quick: args.quick, ..Options::default() };
            let (diagnosis, from_secs) = watch.diagnose(&case, first, &options)?;
            diagnosed = Some(Diagnosed { from_secs, diagnosis });
        }
        alarms.extend(found);
        bar.inc(1);
    }
    bar.finish_and_clear();
    strange(&watch).iter().for_each(|said| answer(said));
    ensure!(watch.windows > 0, "no window could be judged: drives too short, or tyres at their limit throughout");
    let (hours, threshold) = (watch.hours(), watch.threshold());
    answer(&format!("{} alarms in {hours:.2} h; {rate} false ones an hour are allowed", alarms.len()));
    if let Some(Diagnosed { from_secs, diagnosis }) = &diagnosed {
        answer(&format!("the log of the first from {from_secs:.1} s on:"));
        answer(&ds_diagnosis_page::text(diagnosis));
    }
    let report = Report {
        schema_version: 1,
        cases: names,
        alarms_per_hour: rate,
        threshold,
        hours,
        windows: watch.windows,
        windows_strange: watch.strange,
        alarms,
        diagnosed,
    };
    args.out.as_deref().map_or(Ok(()), |path| Ok(json::write(&report, path)?))
}

/// Says how much of the driving told nothing because no healthy drive was like it.
pub(super) fn strange(watch: &Watch) -> Option<String> {
    let (strange, all) = (watch.strange, watch.strange + watch.windows);
    (strange > 0).then(|| {
        format!("{strange} of {all} windows tell nothing: the car did what none of the healthy drives did; record such ones for the baseline")
    })
}

/// Reads the baseline of a watch, whose rate of alarms must be one.
pub(super) fn baseline(args: &WatchArgs, path: &Path) -> Result<Arc<Baseline>> {
    let rate = args.alarms_per_hour;
    if !(rate > 0.0 && rate < STEPS_AN_HOUR) {
        return Err(UsageError(format!("--alarms-per-hour {rate} is not above 0 and below {STEPS_AN_HOUR}")).into());
    }
    Ok(ds_cases::baseline::open(path, None)?)
}

/// Returns an alarm in words.
pub(super) fn line(alarm: &Alarm) -> String {
    let Alarm { case, file, secs, since_secs, hours, .. } = alarm;
    let channels: Vec<&str> = alarm.channels.iter().map(|(name, _)| name.as_str()).collect();
    let channels = channels.join(", ");
    format!("alarm at {secs:.1} s of {file}, {case} (after {hours:.3} h): {channels}; since about {since_secs:.1} s")
}
