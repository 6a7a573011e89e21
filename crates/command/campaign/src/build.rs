//! `build` and `check`: sets of scenarios from the generator or from imported logs, filtered by drives.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use ds_benchmark::filter::left_out;
use ds_benchmark::manifest::SUFFIX;
use ds_benchmark::{Entry, Judged, Keep, Kind, Manifest, Recipe, Record, Review, Sheet, record, source};
use ds_launch::fleet_plan::workers;
use ds_launch::{Networks, scenarios};
use ds_process::terminal::{answer, bar};
use ds_scenario::Family;
use ds_space::DigestWriter;
use rayon::prelude::*;

use crate::cli::{BaseArgs, BuildCommand, CellArgs};
use crate::{Ended, ask, behavior, describe, drive};

/// The policy that solves a scenario without looking.
const BLIND: &str = "constant-velocity";

/// Runs `build`.
///
/// # Errors
/// If a scenario is refused, nothing stays, or another set is there.
pub(crate) fn run(command: &BuildCommand) -> Result<Ended> {
    match command {
        BuildCommand::Base(args) => base(args),
        BuildCommand::Behavior(args) => behavior::build(args),
        BuildCommand::Weather { base, name, every, out } => weather(base, name.as_deref(), *every, out),
    }
}

fn base(args: &BaseArgs) -> Result<Ended> {
    let town = args.scenarios.is_empty();
    let name = args.name.clone().unwrap_or_else(|| if town { "town" } else { "logs" }.to_owned());
    let mut recipe = Recipe {
        command: command(args, &name),
        source: if town { source::TOWN } else { source::FILES }.to_owned(),
        settings_digest: settings(args),
        program: env!("CARGO_PKG_VERSION").to_owned(),
        seed: if town { args.seed } else { 0 },
        ..Recipe::default()
    };
    let manifest = Manifest::place(&args.out, &name, &recipe)?;
    let entries = if town { generated(args, &mut recipe)? } else { imported(args, &mut recipe)? };
    ensure!(
        !entries.is_empty(),
        "no scenario can be driven after the hand-over at tick {}: {:?}",
        source::HAND_OVER,
        recipe.rejected
    );
    let all = Manifest::new(&name, Kind::Base, recipe, entries);
    let set = if args.unfiltered { Some(all) } else { filtered(args, all)? };
    let Some(set) = set else { return Ok(Ended::Interrupted) };
    ensure!(!set.entries.is_empty(), "none of {} candidates stays: {:?}", set.recipe.candidates, set.recipe.rejected);
    set.save(&manifest)?;
    describe(&set);
    answer(&format!("set: {}", manifest.display()));
    Ok(Ended::Complete)
}

/// Returns what makes the same set again.
fn command(args: &BaseArgs, name: &str) -> String {
    let filter = if args.unfiltered { "--unfiltered".to_owned() } else { format!("--expert {}", args.expert) };
    let town = format!("--candidates {} --seed {}", args.candidates, args.seed);
    let what = if args.scenarios.is_empty() { town } else { "SCENARIOS".to_owned() };
    format!("dreamstream benchmark build base {what} --name {name} {filter}")
}

fn settings(args: &BaseArgs) -> String {
    let mut writer = DigestWriter::new();
    writer.bool(args.scenarios.is_empty()).u32(args.candidates).u64(args.seed).bool(args.unfiltered).text(&args.expert);
    writer.u32(source::HAND_OVER).u32(source::SCORED).finish().to_string()
}

fn generated(args: &BaseArgs, recipe: &mut Recipe) -> Result<Vec<Entry>> {
    let bar = bar(u64::from(args.candidates), "scenarios");
    let families = Family::ALL.len() as u64;
    let entries = (0..u64::from(args.candidates))
        .into_par_iter()
        .map(|index| {
            let family = Family::ALL[(index % families) as usize];
            let scene = ds_scenario::generate(family, args.seed + index / families);
            bar.inc(1);
            Entry::of(&scene, None).context("a generated scenario")
        })
        .collect::<Result<Vec<_>>>()?;
    bar.finish_and_clear();
    recipe.candidates = u64::from(args.candidates);
    Ok(entries)
}

fn imported(args: &BaseArgs, recipe: &mut Recipe) -> Result<Vec<Entry>> {
    let files = scenarios::files(&args.scenarios)?;
    let folder = std::path::absolute(&args.out).context("--out")?;
    let named: Option<Vec<String>> = args.names.as_deref().map(names).transpose()?;
    let (mut entries, mut found) = (Vec::new(), Vec::new());
    for file in &files {
        let (scene, _warnings) = ds_scenario::load(file)?;
        if let Some(named) = &named {
            if !named.contains(&scene.name) {
                continue;
            }
            found.push(scene.name.clone());
        }
        recipe.candidates += 1;
        let file = std::path::absolute(file).with_context(|| format!("path of {}", file.display()))?;
        let file = file.strip_prefix(&folder).map(Path::to_path_buf).unwrap_or(file);
        match Entry::of(&scene, Some(file)) {
            Ok(entry) => entries.push(entry),
            Err(unfit) => *recipe.rejected.entry(unfit.name().to_owned()).or_default() += 1,
        }
    }
    let missing: Vec<&String> = named.iter().flatten().filter(|name| !found.contains(name)).collect();
    if let Some(first) = missing.first() {
        bail!("{} of the names are no scenarios there, the first is {first:?}", missing.len());
    }
    Ok(entries)
}

fn names(file: &Path) -> Result<Vec<String>> {
    let text = std::fs::read_to_string(file).with_context(|| format!("read {}", file.display()))?;
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    let names: Vec<String> = lines.map(str::to_owned).collect();
    ensure!(!names.is_empty(), "--names: {} names nothing", file.display());
    Ok(names)
}

/// Lets expert and constant velocity drive all candidates and keeps what tells policies apart; nothing after a signal.
fn filtered(args: &BaseArgs, all: Manifest) -> Result<Option<Manifest>> {
    let folder = args.out.join(format!("{}.filter", all.name));
    // Not called as sets are: `*.set.json` names what was built.
    let candidates = args.out.join(format!("{}.candidates.json", all.name));
    all.save(&candidates)?;
    let what = CellArgs {
        manifests: vec![candidates],
        policies: vec![BLIND.to_owned(), args.expert.clone()],
        observations: vec![ds_topic::ObservationSource::Layout],
        agents: vec![ds_world::AgentMode::IdmAll],
        scorers: vec![ds_topic::ProposalScorer::Learned],
        seeds: vec![0],
        selection: Vec::new(),
        replan: 5,
        horizon: 80,
        history: 1,
        tracker: ds_world::TrackerKind::Lqr,
        networks: Networks::default(),
    };
    let (mut sheet, sets) = ask::sheet(&what)?;
    sheet.place.keep = Keep::None;
    sheet.place.workers = workers(args.workers, usize::MAX);
    let now = drive::Now { again: Some("the same command"), ..drive::Now::default() };
    let ended = if folder.join(ds_benchmark::sheet::FILE).exists() {
        drive::resume(&folder, None, args.workers, &now)?
    } else {
        drive::begin(&folder, &sheet, &sets, &now)?
    };
    if ended == Ended::Interrupted {
        return Ok(None);
    }
    let judged = judged(&folder, &sheet)?;
    let mut recipe = all.recipe.clone();
    let mut stays = Vec::new();
    for entry in all.entries {
        let of = |policy: &str| judged.get(&(entry.scenario.clone(), policy.to_owned()));
        match left_out(of(&args.expert), of(BLIND), entry.hand_over) {
            None => stays.push(entry),
            Some(reason) => *recipe.rejected.entry(reason.name().to_owned()).or_default() += 1,
        }
    }
    Ok(Some(Manifest::new(&all.name, Kind::Base, recipe, stays)))
}

/// Returns what is said of each drive, by scenario and policy.
fn judged(folder: &Path, sheet: &Sheet) -> Result<BTreeMap<(String, String), Judged>> {
    let (there, _) = Sheet::load(folder)?;
    ensure!(
        there.digest() == sheet.digest(),
        "{} holds drives of other candidates or of another version: remove it, or give another --out or --name",
        folder.display()
    );
    let mut judged = BTreeMap::new();
    record::read(folder, |_, Record { cell, judged: said, .. }| {
        if let Some(said) = said {
            judged.insert((cell.scenario, cell.policy.name), said);
        }
    })?;
    Ok(judged)
}

fn weather(base: &Path, name: Option<&str>, every: u32, out: &Path) -> Result<Ended> {
    let set = Manifest::load(base)?;
    ensure!(set.kind == Kind::Base, "{} is of kind {:?}, not base", base.display(), set.kind);
    let name = name.map_or_else(|| format!("{}-weather", set.name), str::to_owned);
    let folder = base.parent().unwrap_or(Path::new("."));
    let place = |file: &PathBuf| std::path::absolute(folder.join(file)).context("path of a scenario");
    let mut entries = Vec::new();
    for entry in set.entries.iter().step_by(every as usize) {
        let file = entry.file.as_ref().map(place).transpose()?;
        entries.extend(Entry { file, ..entry.clone() }.under_conditions());
    }
    let recipe = Recipe {
        command: format!("dreamstream benchmark build weather {}{SUFFIX} --every {every}", set.name),
        settings_digest: set.digest.clone(),
        program: env!("CARGO_PKG_VERSION").to_owned(),
        candidates: entries.len() as u64,
        rejected: BTreeMap::new(),
        ..set.recipe
    };
    let path = Manifest::place(out, &name, &recipe)?;
    let set = Manifest::new(&name, Kind::Weather, recipe, entries);
    set.save(&path)?;
    describe(&set);
    answer(&format!("set: {}", path.display()));
    Ok(Ended::Complete)
}

/// Runs `check`.
///
/// # Errors
/// The first entry whose scenario is not to be had or is another one, or whose solution does not come out again.
pub(crate) fn check(manifests: &[PathBuf]) -> Result<Ended> {
    let (sets, folders) = ask::manifests(manifests)?;
    for (set, folder) in sets.iter().zip(folders) {
        let mut distinct: BTreeMap<&str, &Entry> = BTreeMap::new();
        distinct.extend(set.entries.iter().map(|entry| (entry.scenario.as_str(), entry)));
        let bar = bar(distinct.len() as u64, "scenarios");
        let entries: Vec<&Entry> = distinct.into_values().collect();
        entries.into_par_iter().try_for_each(|entry| {
            bar.inc(1);
            let scene = entry.scene(&folder)?;
            if set.kind == Kind::Behavior { behavior::check(entry, scene, &folder) } else { Ok(()) }
        })?;
        bar.finish_and_clear();
        describe(set);
        answer("  every scenario is the one that is meant");
        if set.kind == Kind::Behavior {
            let unsolved = set.entries.iter().filter(|entry| entry.solution_digest.is_none()).count();
            let but = if unsolved == 0 {
                String::new()
            } else {
                format!("; {unsolved} entries have none: an arm for comparison")
            };
            answer(&format!("  every solution was driven again, to the bit{but}"));
            answer(&format!("  {}", Review::beside(&folder, set)?.told(set)));
        }
    }
    Ok(Ended::Complete)
}
