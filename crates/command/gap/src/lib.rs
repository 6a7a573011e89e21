//! `gap`: diagnoses the gap between reference logs and their nominal simulators, and scores such diagnoses.

mod attribute;
pub mod cli;
mod close;
mod explain;
mod next;
mod watch;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use ds_cases::attended::Panel;
use ds_cases::case::{Case, Options, Unseen, beyond, diagnose_by, evaluate_by, served};
use ds_cases::folder::{folders, name, names};
use ds_cases::localised::localisation;
use ds_cases::pairs::Paired;
use ds_cases::{CasesError, RunConfig, finished, logs, pairs, scenes, seal};
use ds_diagnosis::meta::{Kind, VehicleMeta};
use ds_diagnosis::score::score_folder;
use ds_diagnosis::score::skill::{Reliability, Skill};
use ds_diagnosis::{Diagnosis, json};
use ds_effect::{Channel, Parameter};
use ds_launch::scenarios;
use ds_process::terminal::{answer, bar, complain};
use ds_space::Digest;
use ds_vehicle_logs::{Mapping, Suggestion};
use indicatif::ProgressBar;
use rayon::prelude::*;

use cli::{
    ApplyArgs, BaselineArgs, DiagnoseArgs, EvaluateArgs, FleetArgs, GapCommand, GapImportArgs, GapScoreArgs, PanelArgs,
};

const PAGE: &str = "report.html";

/// Runs the command.
///
/// # Errors
/// If a case is refused or a file cannot be read or written.
pub fn run(command: &GapCommand, log: &str) -> Result<()> {
    match command {
        GapCommand::Import(args) => import(args),
        GapCommand::Explain(args) => explain::run(args),
        GapCommand::Apply(args) => apply(args),
        GapCommand::Close(args) => ds_launch::runtime()?.block_on(close::run(args, log)),
        GapCommand::Attribute(args) => ds_launch::runtime()?.block_on(attribute::run(args, log)),
        GapCommand::Watch(args) if watch::recorded::are_cases(args) => watch::recorded::run(args),
        GapCommand::Watch(args) => ds_launch::runtime()?.block_on(watch::run(args)),
        GapCommand::Isolability { channels } => isolability(channels),
        GapCommand::Serve { case, ports_only } => {
            let served = ds_simulator::Served::new(&VehicleMeta::read(case)?.nominal, !ports_only);
            Ok(ds_simulator::serve(served, std::io::stdin().lock(), std::io::stdout().lock())?)
        }
        GapCommand::Effects => {
            list_effects();
            Ok(())
        }
        GapCommand::Unseal { answer: path } => {
            answer(seal::unseal(path)?.to_toml().trim_end());
            Ok(())
        }
        GapCommand::Baseline(args) => learn(args),
        GapCommand::Fleet(args) => fleet(args),
        GapCommand::Diagnose(args) => diagnose_all(args, false),
        GapCommand::Discover(args) => diagnose_all(args, true),
        GapCommand::Next(args) => next::run(args),
        GapCommand::Evaluate(args) => evaluate_one(args),
        GapCommand::Score(args) => score(args),
    }
}

/// Makes tables of vehicle logs, in the folder of the answer, and pairs of their frames with those of a nominal run;
/// other cases stay as they are.
fn tables(case: &Path, nominal: Option<&Path>, out: &Path) -> Result<Vec<PathBuf>> {
    if !logs::are_logs(case) {
        return Ok(vec![case.to_path_buf()]);
    }
    let folder = out.join("cases").join(name(case));
    logs::case(case, &[], &folder)?;
    let Some(nominal) = nominal else { return Ok(vec![folder]) };
    let frames = folder.with_file_name(format!("{}-frames", name(&folder)));
    let paired = pairs::write(case, &nominal.join("real"), &frames)?;
    match paired {
        Paired::Case => {}
        Paired::TooFew => {
            answer(&format!("{}: too few frames at the same states to compare pictures", case.display()));
        }
        Paired::Alike(count) => answer(&format!("{}: {count} camera frames are as the nominal ones", case.display())),
    }
    Ok(std::iter::once(folder).chain((paired == Paired::Case).then_some(frames)).collect())
}

fn apply(args: &ApplyArgs) -> Result<()> {
    let diagnoses: Vec<Diagnosis> = args.diagnoses.iter().map(|path| json::read(path)).collect::<Result<_, _>>()?;
    let mut config = RunConfig::corrected(&diagnoses)?;
    if args.effects_only {
        config.nuisance.clear();
    }
    let cases: Vec<&str> = diagnoses.iter().map(|diagnosis| diagnosis.case.as_str()).collect();
    let values: Vec<String> = diagnoses.iter().flat_map(ds_diagnosis_page::values).collect();
    config.write(&cases.join(", "), &values, &args.out)?;
    if config.effects.is_empty() && config.laws.is_empty() {
        answer("no effect is added");
    }
    config.laws.iter().for_each(|law| answer(law));
    config.effects.iter().for_each(|line| answer(&format!("{} = {:?}", line.id, line.values)));
    values.iter().for_each(|value| answer(value));
    if !config.nuisance.is_empty() {
        answer(&format!("and the ordinary mismatch that was measured with it, {} entries", config.nuisance.len()));
    }
    answer(&format!("dreamstream run SCENARIOS --config {}", args.out.display()));
    Ok(())
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
    let parameters =
        |all: &[Parameter]| all.iter().map(|p| format!("{} [{}]", p.name, p.unit)).collect::<Vec<_>>().join(", ");
    for effect in ds_effect::library() {
        let channels: Vec<&str> = effect.channels.iter().map(|channel| channel.name()).collect();
        let (names, channels) = (parameters(effect.parameters), channels.join(" "));
        let note = if effect.suspect { "" } else { "; fitted, never accused" };
        answer(&format!("{:18} {names:28} {:?}; {channels}{note}", effect.id, effect.insertion));
    }
    for effect in ds_effect::frame_library() {
        let run = if ds_effect::check(effect.id, &effect.neutral()).is_ok() { "" } else { "; in frame streams only" };
        answer(&format!("{:18} {:28} {:?}; camera{run}", effect.id, parameters(effect.parameters), effect.insertion));
    }
}

fn diagnose_all(args: &DiagnoseArgs, discover: bool) -> Result<()> {
    let known = |id: &&String| ds_effect::find(id).is_some() || ds_effect::find_frame(id).is_some();
    if let Some(id) = args.without.iter().find(|id| !known(id)) {
        bail!("--without {id:?} names no effect of the library, see gap effects");
    }
    let mut cases = Vec::new();
    let driven = scenarios::files(&args.scenes)?;
    for case in folders(&args.cases)? {
        let made = tables(&case, args.nominal.as_deref(), &args.out)?;
        let traffic = args.out.join("cases").join(format!("{}-traffic", name(made.first().unwrap_or(&case))));
        let seen = logs::are_logs(&case) && !driven.is_empty() && scenes::case(&case, &driven, &traffic)?;
        cases.extend(made);
        cases.extend(seen.then_some(traffic));
    }
    // pictures and traffic of the same drives have no simulator of the car
    let unserved = args.simulator.is_some() && cases.iter().all(|case| Kind::of(case) != Kind::Vehicle);
    ensure!(!unserved, CasesError::SimulatorWithoutVehicle);
    let open = |path: &Path| ds_cases::baseline::open(path, args.simulator.as_deref());
    let baseline = args.baseline.as_deref().map(open).transpose()?;
    let nuisance = args.nuisance.as_deref().map(ds_frames::Nuisance::learn).transpose()?;
    let simulator = args.simulator.clone();
    let without = args.without.clone();
    let panel = Panel { effect_free: args.nuisance.clone(), ..panel(&args.panel) };
    let unseen = !panel.policies.is_empty() && cases.iter().all(|case| Kind::of(case) != Kind::Frames);
    ensure!(!unseen, "--policy looks at streams of frames; none of these cases has any");
    let options = Options { quick: args.quick, without, baseline, simulator, nuisance, panel, discover };
    let bar = bar(cases.len() as u64, "cases");
    bar.tick();
    let names = names(&cases);
    let program = Digest::of(&std::fs::read(std::env::current_exe()?).context("read this program")?);
    let one = |(case, name): (&PathBuf, &String)| {
        let (folder, inputs) = (args.out.join(name), finished::inputs(case, &options, &program)?);
        if let Some(kept) = args.resume.then(|| finished::finished(&folder, &inputs)).flatten() {
            bar.inc(1);
            return Ok(kept);
        }
        let made = written(&folder, case, args.no_pages, &options, &bar)?;
        finished::note_inputs(&folder, &inputs)?;
        Ok(made)
    };
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

fn panel(args: &PanelArgs) -> Panel {
    Panel { policies: args.policy.clone(), weights: args.policy_weights.clone(), effect_free: None }
}

/// Diagnoses a case and writes its diagnosis and page.
fn written(folder: &Path, case: &Path, bare: bool, options: &Options, bar: &ProgressBar) -> Result<Diagnosis> {
    let diagnosis = one(case, options, bar)?;
    diagnosis.write(folder)?;
    finished::note_case(folder, case)?;
    if !bare {
        let material = Some(case).filter(|case| Kind::of(case) != Kind::Traffic);
        put(&folder.join(PAGE), &ds_diagnosis_page::page(&diagnosis, material))?;
    }
    Ok(diagnosis)
}

fn put(path: &Path, text: &str) -> Result<()> {
    std::fs::write(path, text).with_context(|| format!("write {}", path.display()))
}

/// Learns a baseline and says what can be told with it.
fn learn(args: &BaselineArgs) -> Result<()> {
    let healthy = ds_cases::baseline::healthy(&args.healthy, args.simulator.as_deref())?;
    let bar = bar(ds_cases::baseline::steps(&healthy), "steps");
    let baseline = ds_cases::baseline::learn(&healthy, &|| bar.inc(1))?;
    bar.finish_and_clear();
    baseline.write(&args.out)?;
    answer(&ds_diagnosis_page::baseline(&baseline));
    answer(&format!("dreamstream gap diagnose CASES --baseline {}", args.out.display()));
    Ok(())
}

/// Diagnoses a fleet, member by member against the others.
fn fleet(args: &FleetArgs) -> Result<()> {
    let paths = folders(&args.cases)?;
    let logs = ds_cases::fleet::read(&args.cases)?;
    let bar = bar(ds_cases::fleet::steps(logs.len()), "steps");
    bar.tick();
    let (fleet, diagnoses) = ds_cases::fleet::diagnose(logs, args.by, args.quick, &|| bar.inc(1))?;
    bar.finish_and_clear();
    for (path, diagnosis) in paths.iter().zip(&diagnoses) {
        let folder = args.out.join(&diagnosis.case);
        diagnosis.write(&folder)?;
        finished::note_case(&folder, path)?;
        put(&folder.join(PAGE), &ds_diagnosis_page::page(diagnosis, Some(path)))?;
    }
    json::write(&fleet, &args.out.join("fleet.json"))?;
    put(&args.out.join("fleet.html"), &ds_diagnosis_page::fleet(&fleet, &diagnoses))?;
    answer(&ds_diagnosis_page::fleet_text(&fleet));
    answer(&format!("written to {}", args.out.display()));
    Ok(())
}

fn import(args: &GapImportArgs) -> Result<()> {
    if let Some(log) = &args.suggest {
        return suggest(log, args.out.as_deref());
    }
    let path = args.mapping.as_deref().context("a mapping, or --suggest LOG")?;
    let mapping = Mapping::read(path)?;
    let folder = |path: &Path| path.parent().unwrap_or(Path::new(".")).to_path_buf();
    match args.logs.as_slice() {
        [] => import_one(&mapping, &folder(path), args.out.as_deref()),
        [logs] if logs.is_dir() => import_one(&mapping, logs, args.out.as_deref()),
        logs => logs.iter().enumerate().try_for_each(|(place, log)| {
            let twin = logs[..place].iter().find(|other| other.file_stem() == log.file_stem());
            if let Some(twin) = twin {
                bail!("{} and {} would be one case", twin.display(), log.display());
            }
            let mapping = mapping.for_log(log);
            let out = args.out.as_ref().map(|out| out.join(&mapping.log.name));
            import_one(&mapping, &folder(log), out.as_deref()).with_context(|| format!("{}", log.display()))
        }),
    }
}

/// Checks the logs of a mapping in a folder and makes a case of them.
fn import_one(mapping: &Mapping, logs: &Path, out: Option<&Path>) -> Result<()> {
    let found = mapping.check(logs)?;
    found.iter().for_each(|finding| answer(&finding.to_string()));
    answer(&format!("{} findings", found.len()));
    let Some(out) = out else { return Ok(()) };
    let imported = mapping.case(logs, out)?;
    for (number, drive) in imported.drives.iter().enumerate() {
        let (file, start, secs) = (&drive.file, drive.start_secs, drive.secs());
        answer(&format!("drive {number}: {file} from {start:.1} s, {secs:.1} s long"));
    }
    if imported.offered > imported.drives.len() {
        let kept = imported.drives.len();
        answer(&format!("{kept} of {} drives kept, as many of each kind of driving as there are", imported.offered));
    }
    answer(&format!("dreamstream gap diagnose {}", out.display()));
    Ok(())
}

/// Proposes a mapping and says what is left to decide and what to do next.
fn suggest(log: &Path, out: Option<&Path>) -> Result<()> {
    let Suggestion { text, undecided } = ds_vehicle_logs::suggest(log)?;
    let Some(out) = out else {
        answer(text.trim_end());
        return Ok(());
    };
    put(out, &text)?;
    undecided.iter().for_each(|sentence| answer(&format!("not decided: {sentence}")));
    let folder = log.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    answer(&format!("dreamstream gap import {} {} -o CASE", out.display(), folder.display()));
    Ok(())
}

/// Reads a case and diagnoses it.
fn one(case: &Path, options: &Options, bar: &ProgressBar) -> Result<Diagnosis> {
    let began = Instant::now();
    let diagnosis = Case::read(case).and_then(|read| match &options.simulator {
        Some(command) if matches!(read, Case::Vehicle(..)) => diagnose_by(read, &served(command, case), options),
        _ => ds_cases::diagnose(&read.against(options.baseline.as_ref())?, options),
    });
    bar.inc(1);
    Ok(Diagnosis { secs: began.elapsed().as_secs_f64(), ..diagnosis? })
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
    let verdict = diagnosis.verdict.words();
    answer(&format!("{when}: {verdict}{found} (none {:.2}, unknown {:.2})", diagnosis.p_none, diagnosis.p_unknown));
}

/// Reads `first-last`.
fn frames(text: &str) -> Result<std::ops::RangeInclusive<u64>> {
    let ends = text.split_once('-').and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    let (first, last) = ends.filter(|(a, b)| a <= b).with_context(|| format!("--frames {text:?} is not FIRST-LAST"))?;
    Ok(first..=last)
}

fn evaluate_one(args: &EvaluateArgs) -> Result<()> {
    let diagnosis: Diagnosis = json::read(&args.diagnosis)?;
    // Tables of vehicle logs are made beside the diagnosis.
    let beside = args.diagnosis.parent().unwrap_or(Path::new(".")).join("unseen");
    let case = tables(&args.case, None, &beside)?.pop().unwrap_or_else(|| args.case.clone());
    let frames = args.frames.as_deref().map(frames).transpose()?;
    let (drives, read) = (args.drives.clone(), Case::read(&case)?);
    let absent = |count| drives.iter().find(|drive| **drive >= count).map(|drive| (drive, count));
    if let Some((drive, count)) = read.drives().and_then(absent) {
        bail!("--drives {drive} is not there: {} has {count} of them, counted from 0", case.display());
    }
    if let Some(warning) = beyond(&diagnosis, &read, &drives) {
        complain(&anyhow::anyhow!(warning));
    }
    let shrinks = match &args.simulator {
        Some(command) => {
            let (shrinks, warnings) = evaluate_by(&diagnosis, read, &served(command, &case), &drives)?;
            warnings.into_iter().for_each(|warning| complain(&anyhow::anyhow!(warning)));
            shrinks
        }
        None => {
            let panel = panel(&args.panel);
            let unseen = !panel.policies.is_empty() && !matches!(read, Case::Frames(_));
            ensure!(!unseen, "--policy looks at streams of frames; {} has none", case.display());
            ds_cases::evaluate(&diagnosis, &read, Unseen { drives, frames, panel })?
        }
    };
    match &args.out {
        Some(path) => json::write(&shrinks, path)?,
        None => answer(&serde_json::to_string_pretty(&shrinks).context("shrink as JSON")?),
    }
    Ok(())
}

fn score(args: &GapScoreArgs) -> Result<()> {
    let labels = args.labels.clone().unwrap_or_else(|| args.diagnoses.join("labels.json"));
    let scores = score_folder(&args.diagnoses, &labels, &args.others)?;
    for (name, share) in &scores.shares {
        let text = share.as_ref().map_or("no such case".to_owned(), ToString::to_string);
        answer(&format!("{name:36} {text}"));
    }
    if !scores.absent.is_empty() {
        answer(&format!(
            "{} cases have no diagnosis and count as wrong: {}",
            scores.absent.len(),
            scores.absent.join(", ")
        ));
    }
    answer(&format!(
        "Brier {:.3}, calibration error {:.3}, median relative error {:.3}, median |predicted − realised share| {:.3}",
        scores.brier, scores.calibration_error, scores.relative_error, scores.share_error
    ));
    if let Some(Skill { brier, constant, skill, .. }) = scores.skill {
        let beside =
            constant.zip(skill).map_or("; --others LABELS says beside which constant".to_owned(), |(b, skill)| {
                format!(", of the constant {b:.3}: skill {skill:.2}")
            });
        answer(&format!("Brier over all answers {brier:.3}{beside}"));
    }
    let row = |row: &Reliability| format!("{:.2} stated {:.2} right ({})", row.stated, row.right, row.cases);
    answer(&format!("reliability: {}", scores.reliability.iter().map(row).collect::<Vec<_>>().join(", ")));
    let path = args.diagnoses.join("scores.json");
    json::write(&scores, &path)?;
    answer(&format!("written to {}", path.display()));
    args.twins.as_deref().map_or(Ok(()), |world| localise(&args.diagnoses, &labels, world))
}

/// Prints how well diagnoses tell where the gap lies.
fn localise(diagnoses: &Path, labels: &Path, world: &Path) -> Result<()> {
    let found = localisation(diagnoses, labels, world)?;
    ensure!(!found.cases.is_empty(), "{} has no twin of a diagnosed case (without/CASE)", world.display());
    for (name, share) in [
        ("located: overlap of a half or more", &found.located),
        ("named cells in which nothing shows", &found.wrong),
        ("cells that show an effect, named", &found.found),
    ] {
        answer(&format!("{name:36} {share}"));
    }
    if let Some(overlap) = found.median_overlap {
        answer(&format!("median overlap {overlap:.2}"));
    }
    if !found.left_out.is_empty() {
        answer(&format!("without a diagnosis or comparable twin, not counted: {}", found.left_out.join(", ")));
    }
    let path = diagnoses.join("localisation.json");
    json::write(&found, &path)?;
    answer(&format!("written to {}", path.display()));
    Ok(())
}
