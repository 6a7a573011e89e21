//! `gap`: diagnoses the gap between reference logs and their nominal simulators, and scores such diagnoses.

pub(crate) mod attribute;
pub(crate) mod close;
pub(crate) mod explain;
pub(crate) mod logs;
mod pairs;
pub(crate) mod scenes;
mod stamps;
pub(crate) mod watch;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use ds_diagnosis::score::score_folder;
use ds_diagnosis::{Diagnosis, Verdict};
use ds_dynamics::{Options, diagnose, evaluate};
use ds_effect::Channel;
use ds_vehicle_logs::Mapping;
use indicatif::ProgressBar;
use rayon::prelude::*;

use crate::cli::{ApplyArgs, DiagnoseArgs, EvaluateArgs, GapCommand, GapImportArgs, GapScoreArgs};
use crate::command::{answer, bar, complain};
use crate::world::{self, EffectLine, RunConfig};

const FILE: &str = "diagnosis.json";
const PAGE: &str = "report.html";

/// Runs the command.
///
/// # Errors
/// If a case is refused or a file cannot be read or written.
pub(crate) fn run(command: &GapCommand, log: &str) -> Result<()> {
    match command {
        GapCommand::Import(args) => import(args),
        GapCommand::Explain(args) => explain::run(args),
        GapCommand::Apply(args) => apply(args),
        GapCommand::Close(args) => crate::runtime()?.block_on(close::run(args, log)),
        GapCommand::Attribute(args) => crate::runtime()?.block_on(attribute::run(args, log)),
        GapCommand::Watch(args) => crate::runtime()?.block_on(watch::run(args)),
        GapCommand::Isolability { channels } => isolability(channels),
        GapCommand::Effects => {
            list_effects();
            Ok(())
        }
        GapCommand::Unseal { answer: path } => {
            answer(toml::to_string(&world::unseal(path)?).context("the answer as TOML")?.trim_end());
            Ok(())
        }
        GapCommand::Diagnose(args) => diagnose_all(args),
        GapCommand::Evaluate(args) => evaluate_one(args),
        GapCommand::Score(args) => score(args),
    }
}

/// Returns the case folders among some paths: those with a `meta.json`, and those in folders without one.
fn cases(paths: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for path in paths {
        if path.join("meta.json").exists() {
            found.push(path.clone());
            continue;
        }
        let entries = std::fs::read_dir(path).with_context(|| format!("read {}", path.display()))?;
        let mut inner: Vec<PathBuf> =
            entries.flatten().map(|entry| entry.path()).filter(|inner| inner.join("meta.json").exists()).collect();
        ensure!(!inner.is_empty(), "{} is no case and holds none: a case has a meta.json", path.display());
        inner.sort();
        found.extend(inner);
    }
    Ok(found)
}

/// Makes tables of vehicle logs, in the folder of the answer, and pairs of their frames with those of a nominal run;
/// other cases stay as they are.
fn tables(case: &Path, nominal: Option<&Path>, out: &Path) -> Result<Vec<PathBuf>> {
    if !logs::are_logs(case) {
        return Ok(vec![case.to_path_buf()]);
    }
    // The logs of a run lie in RUN/real: the case is called after the run.
    let run = if name(case) == "real" { case.canonicalize()?.parent().map(Path::to_path_buf) } else { None };
    let folder = out.join("cases").join(name(&run.unwrap_or_else(|| case.to_path_buf())));
    logs::case(case, &[], &folder)?;
    let Some(nominal) = nominal else { return Ok(vec![folder]) };
    let frames = folder.with_file_name(format!("{}-frames", name(&folder)));
    let frames = pairs::write(case, &nominal.join("real"), &frames)?;
    Ok(std::iter::once(folder).chain(frames).collect())
}

/// Returns the corrected simulator of a diagnosis as a run's configuration.
pub(crate) fn corrected(diagnosis: &Diagnosis) -> RunConfig {
    let line = |effect: &ds_diagnosis::schema::CorrectedEffect| EffectLine {
        id: effect.id.clone(),
        values: effect.values.clone(),
    };
    RunConfig { effects: diagnosis.corrected_model.effects.iter().map(line).collect() }
}

fn apply(args: &ApplyArgs) -> Result<()> {
    let diagnoses = args.diagnoses.iter().map(|path| read(path)).collect::<Result<Vec<_>>>()?;
    let config = RunConfig { effects: diagnoses.iter().flat_map(|diagnosis| corrected(diagnosis).effects).collect() };
    let cases: Vec<&str> = diagnoses.iter().map(|diagnosis| diagnosis.case.as_str()).collect();
    if let Some(line) = config.effects.iter().find(|line| line.values.iter().any(|value| !value.is_finite())) {
        bail!("{} has no value in {}: diagnose once more", line.id, cases.join(", "));
    }
    let named = |line: &EffectLine| format!("{} = {:?}", line.id, line.values);
    let named: Vec<String> = config.effects.iter().map(named).collect();
    write_config(&config, &cases.join(", "), &args.out)?;
    answer(&if named.is_empty() {
        "no effect: the nominal simulator stays as it is".to_owned()
    } else {
        named.join("\n")
    });
    answer(&format!("dreamstream run SCENARIOS --config {}", args.out.display()));
    Ok(())
}

/// Writes a run's configuration.
pub(crate) fn write_config(config: &RunConfig, case: &str, path: &Path) -> Result<()> {
    let text = toml::to_string(config).context("the configuration as TOML")?;
    let text = format!("# The simulator corrected by the diagnosis of {case:?}.\n{text}");
    std::fs::write(path, text).with_context(|| format!("write {}", path.display()))
}

fn read(path: &Path) -> Result<Diagnosis> {
    let text = std::fs::read_to_string(path).with_context(|| format!("read {}", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{} is no diagnosis", path.display()))
}

fn isolability(named: &[String]) -> Result<()> {
    let known = |name: &String| {
        let all = || Channel::ALL.map(Channel::name).join(", ");
        let found = Channel::ALL.into_iter().find(|channel| channel.name() == name);
        found.with_context(|| format!("no channel is called {name:?}; there are {}", all()))
    };
    let channels =
        if named.is_empty() { Channel::ALL.to_vec() } else { named.iter().map(known).collect::<Result<_>>()? };
    for group in ds_dynamics::isolability(&channels) {
        answer(&group.join(" = "));
    }
    Ok(())
}

fn list_effects() {
    for effect in ds_effect::library() {
        let parameters: Vec<String> = effect.parameters.iter().map(|p| format!("{} [{}]", p.name, p.unit)).collect();
        let channels: Vec<&str> = effect.channels.iter().map(|channel| channel.name()).collect();
        let note = if effect.suspect { "" } else { "; fitted, never accused" };
        answer(&format!(
            "{:18} {:28} {:?}; {}{note}",
            effect.id,
            parameters.join(", "),
            effect.insertion,
            channels.join(" ")
        ));
    }
    for effect in ds_effect::frame_library() {
        let parameters: Vec<String> = effect.parameters.iter().map(|p| format!("{} [{}]", p.name, p.unit)).collect();
        let absent = effect.neutral();
        let run = if ds_effect::check(effect.id, &absent).is_ok() { "" } else { "; in frame streams only" };
        answer(&format!("{:18} {:28} {:?}; camera{run}", effect.id, parameters.join(", "), effect.insertion));
    }
}

fn name(case: &Path) -> String {
    case.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_else(|| "case".to_owned())
}

/// How logs and frames are diagnosed.
struct Ways {
    logs: Options,
    frames: ds_frames::Options,
}

/// Returns the name under which each case is written: its folder's, after that of the folder above where two are alike.
fn names(cases: &[PathBuf]) -> Vec<String> {
    let shared = |case: &Path| cases.iter().filter(|other| name(other) == name(case)).count() > 1;
    let long = |case: &Path| match case.canonicalize().ok().as_deref().and_then(Path::parent) {
        Some(above) => format!("{}-{}", name(above), name(case)),
        None => name(case),
    };
    cases.iter().map(|case| if shared(case) { long(case) } else { name(case) }).collect()
}

fn diagnose_all(args: &DiagnoseArgs) -> Result<()> {
    let mut cases = Vec::new();
    for case in self::cases(&args.cases)? {
        let made = tables(&case, args.nominal.as_deref(), &args.out)?;
        let traffic = args.out.join("cases").join(format!("{}-traffic", name(made.first().unwrap_or(&case))));
        let seen = logs::are_logs(&case) && !args.scenes.is_empty() && scenes::case(&case, &args.scenes, &traffic)?;
        cases.extend(made);
        cases.extend(seen.then_some(traffic));
    }
    let nuisance = args.nuisance.as_deref().map(ds_frames::Nuisance::learn).transpose()?;
    let options = Ways {
        logs: Options { quick: args.quick, without: Vec::new() },
        frames: ds_frames::Options { without: Vec::new(), nuisance },
    };
    let bar = bar(cases.len() as u64, "cases");
    bar.tick();
    let names = names(&cases);
    let one = |(case, name): (&PathBuf, &String)| written(&args.out.join(name), (case, args.no_pages), &options, &bar);
    let results: Vec<Result<Diagnosis>> = cases.par_iter().zip(&names).map(one).collect();
    bar.finish_and_clear();
    let mut made = Vec::new();
    let mut refused = 0;
    for (name, result) in names.iter().zip(results) {
        match result {
            Ok(diagnosis) => {
                answer(&ds_diagnosis_page::text(&diagnosis));
                made.push((format!("{name}/{PAGE}"), diagnosis));
            }
            Err(error) => {
                refused += 1;
                complain(&error.context(name.clone()));
            }
        }
    }
    if !args.no_pages && !made.is_empty() {
        put(&args.out.join("index.html"), &ds_diagnosis_page::index(&made))?;
    }
    answer(&format!("written to {}", args.out.display()));
    ensure!(refused == 0, "{refused} of {} cases were refused", cases.len());
    Ok(())
}

/// Diagnoses a case and writes its diagnosis and page.
fn written(folder: &Path, (case, bare): (&Path, bool), options: &Ways, bar: &ProgressBar) -> Result<Diagnosis> {
    let diagnosis = one(case, options, bar)?;
    save(folder, &diagnosis)?;
    explain::note_case(folder, case)?;
    if !bare {
        let material = Some(case).filter(|case| !ds_traffic::is_traffic_case(case));
        put(&folder.join(PAGE), &ds_diagnosis_page::page(&diagnosis, material))?;
    }
    Ok(diagnosis)
}

fn put(path: &Path, text: &str) -> Result<()> {
    std::fs::write(path, text).with_context(|| format!("write {}", path.display()))
}

fn import(args: &GapImportArgs) -> Result<()> {
    let mapping = Mapping::read(&args.mapping)?;
    let found = mapping.check(&args.logs)?;
    found.iter().for_each(|finding| answer(&finding.to_string()));
    answer(&format!("{} findings", found.len()));
    let Some(out) = &args.out else { return Ok(()) };
    for (number, drive) in mapping.case(&args.logs, out)?.iter().enumerate() {
        let (file, start, secs) = (&drive.file, drive.start_secs, drive.secs());
        answer(&format!("drive {number}: {file} from {start:.1} s, {secs:.1} s long"));
    }
    answer(&format!("dreamstream gap diagnose {}", out.display()));
    Ok(())
}

/// Diagnoses a log of a vehicle, recorded traffic or a pair of frame streams, whichever the case is.
fn one(case: &Path, options: &Ways, bar: &ProgressBar) -> Result<Diagnosis> {
    let began = Instant::now();
    let diagnosis = if ds_traffic::is_traffic_case(case) {
        let options = ds_traffic::Options { without: options.logs.without.clone() };
        ds_traffic::diagnose(case, &options).map_err(anyhow::Error::new)
    } else if ds_frames::is_frame_case(case) {
        ds_frames::diagnose(case, &options.frames).map_err(anyhow::Error::new)
    } else {
        diagnose(case, &options.logs).map_err(anyhow::Error::new).and_then(|mut diagnosis| {
            stamps::add(case, &mut diagnosis)?;
            Ok(diagnosis)
        })
    };
    bar.inc(1);
    diagnosis.map(|diagnosis| Diagnosis { secs: began.elapsed().as_secs_f64(), ..diagnosis })
}

fn save(folder: &Path, diagnosis: &Diagnosis) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("create {}", folder.display()))?;
    let path = folder.join(FILE);
    let text = serde_json::to_string_pretty(diagnosis).context("diagnosis as JSON")?;
    std::fs::write(&path, text + "\n").with_context(|| format!("write {}", path.display()))
}

/// Prints what was found in one line, for answers with more to say.
fn tell(when: &str, diagnosis: &Diagnosis) {
    let found: Vec<String> = diagnosis
        .effects
        .iter()
        .filter(|finding| diagnosis.chosen.contains(&finding.id))
        .map(|finding| format!("{} {:.4} {}", finding.id, finding.value, finding.unit))
        .collect();
    let found = if found.is_empty() { String::new() } else { format!(": {}", found.join(", ")) };
    let verdict = match diagnosis.verdict {
        Verdict::None => "nothing beyond what every vehicle has",
        Verdict::Single => "one effect",
        Verdict::Multiple => "several effects",
        Verdict::Unknown => "something that the library does not contain",
    };
    answer(&format!("{when}: {verdict}{found} (none {:.2}, unknown {:.2})", diagnosis.p_none, diagnosis.p_unknown));
}

/// Reads `first-last`.
fn frames(text: &str) -> Result<std::ops::RangeInclusive<u64>> {
    let ends = text.split_once('-').and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    let (first, last) = ends.filter(|(a, b)| a <= b).with_context(|| format!("--frames {text:?} is not FIRST-LAST"))?;
    Ok(first..=last)
}

fn evaluate_one(args: &EvaluateArgs) -> Result<()> {
    let diagnosis = read(&args.diagnosis)?;
    // Tables of vehicle logs are made beside the diagnosis.
    let beside = args.diagnosis.parent().unwrap_or(Path::new(".")).join("unseen");
    let case = tables(&args.case, None, &beside)?.pop().unwrap_or_else(|| args.case.clone());
    let shrinks = if ds_traffic::is_traffic_case(&case) {
        ds_traffic::evaluate(&diagnosis, &case, &args.drives)?
    } else if ds_frames::is_frame_case(&case) {
        ds_frames::evaluate(&diagnosis, &case, args.frames.as_deref().map(frames).transpose()?)?
    } else {
        evaluate(&diagnosis, &case, &args.drives)?
    };
    let text = serde_json::to_string_pretty(&shrinks).context("shrink as JSON")?;
    match &args.out {
        Some(path) => std::fs::write(path, text + "\n").with_context(|| format!("write {}", path.display()))?,
        None => answer(&text),
    }
    Ok(())
}

fn score(args: &GapScoreArgs) -> Result<()> {
    let labels = args.labels.clone().unwrap_or_else(|| args.diagnoses.join("labels.json"));
    let scores = score_folder(&args.diagnoses, &labels)?;
    for (name, share) in &scores.shares {
        let text = share.as_ref().map_or("no such case".to_owned(), |share| {
            let [low, high] = share.interval90;
            format!("{} of {} = {:.2} [{low:.2}, {high:.2}]", share.hits, share.of, share.value)
        });
        answer(&format!("{name:36} {text}"));
    }
    answer(&format!(
        "Brier {:.3}, calibration error {:.3}, median relative error {:.3}, median |predicted − realised share| {:.3}",
        scores.brier, scores.calibration_error, scores.relative_error, scores.share_error
    ));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_of_one_name_are_kept_apart() {
        let root = tempfile::tempdir().expect("a folder");
        let cases = ["car/case_01", "camera/case_01", "car/case_02"].map(|case| root.path().join(case));
        cases.iter().for_each(|case| std::fs::create_dir_all(case).expect("a folder"));
        assert_eq!(names(&cases), ["car-case_01", "camera-case_01", "case_02"]);
    }
}
