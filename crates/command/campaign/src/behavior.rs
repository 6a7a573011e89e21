//! `build behavior` and its `check`: a base set → variants in which an adversary meets the logged ego and an expert does not.
//!
//! A set has at most one variant of each base scenario, of the class that is rarest over all variants found; further ones are
//! the set NAME-extended. Scenarios and solutions lie beside the manifest: `check` lets the expert drive each again.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use ds_adverse::{MotionModel, Options, Refusal, Variant, adversary_digest, solved_again};
use ds_benchmark::manifest::SUFFIX;
use ds_benchmark::quality::{Figure, Severity};
use ds_benchmark::{Entry, Kind, Manifest, Quality, Recipe, file, source};
use ds_process::terminal::{answer, bar};
use ds_scenario::store;
use ds_space::{DigestWriter, Tick};
use ds_world::{CrashClass, Scene};
use rayon::prelude::*;

use crate::adverse::SolutionPart;
use crate::cli::BehaviorArgs;
use crate::cli::adverse::Arm;
use crate::quality::{self, Searched};
use crate::{Ended, describe};

/// How solutions end.
const SOLUTION: &str = ".solution.json";

/// Runs `build behavior`.
///
/// # Errors
/// If the set is no base set, a scenario is not to be had, none has a variant, or another set is there.
pub(crate) fn build(args: &BehaviorArgs) -> Result<Ended> {
    let base = Manifest::load(&args.base)?;
    ensure!(base.kind == Kind::Base, "{} is of kind {:?}, not base", args.base.display(), base.kind);
    let name = args.name.clone().unwrap_or_else(|| format!("{}-behavior", base.name));
    let bases: Vec<&Entry> = base.entries.iter().step_by(args.every as usize).collect();
    let recipe = Recipe {
        command: command(args, &base.name, &name),
        source: source::FILES.to_owned(),
        settings_digest: settings(args, &base.digest),
        program: env!("CARGO_PKG_VERSION").to_owned(),
        seed: args.seed,
        candidates: bases.len() as u64,
        rejected: BTreeMap::new(),
    };
    let more = format!("{name}-extended");
    // Before the search, which takes long, and again when it is known what is in the sets.
    let paths = [Manifest::place(&args.out, &name, &recipe)?, Manifest::place(&args.out, &more, &recipe)?];
    let found = searched(args, &bases)?;
    let mut counts: BTreeMap<CrashClass, usize> = BTreeMap::new();
    let built = found.iter().filter_map(|(_, built)| built.as_ref().ok());
    let classes = built.flat_map(|built| &built.variants).map(|variant| variant.class);
    classes.for_each(|class| *counts.entry(class).or_default() += 1);
    let (mut entries, mut further, mut variants) = (Vec::new(), Vec::new(), Vec::new());
    let mut rejected: BTreeMap<String, u64> = BTreeMap::new();
    for (entry, (_, built)) in bases.iter().zip(&found) {
        let all = built.as_ref().map_or(&[][..], |built| &built.variants);
        let first = all.iter().min_by_key(|variant| (counts[&variant.class], variant.class));
        if let Some(reason) = none(built) {
            *rejected.entry(reason.to_owned()).or_default() += 1;
        }
        for variant in all {
            let named = named(args, &name, entry, variant)?;
            if first.is_some_and(|first| first.class == variant.class) { &mut entries } else { &mut further }
                .push(named);
            variants.push(variant);
        }
    }
    ensure!(!entries.is_empty(), "none of {} scenarios has a variant: {rejected:?}", bases.len());
    let figures = quality::figures(&found, &entries);
    let extended = Recipe { candidates: further.len() as u64, ..recipe.clone() };
    let severities = quality::severities(&found);
    let set = Manifest::new(&name, Kind::Behavior, Recipe { rejected, ..recipe }, entries);
    let extended = (!further.is_empty()).then(|| Manifest::new(&more, Kind::Behavior, extended, further));
    let sets = [(Some(set), figures), (extended, Vec::new())];
    for ((set, _), path) in sets.iter().zip(&paths) {
        set.as_ref().map_or(Ok(()), |set| set.savable(path))?;
    }
    for variant in variants {
        write(args, &name, variant)?;
    }
    for ((set, figures), path) in sets.into_iter().zip(&paths) {
        set.map_or(Ok(()), |set| saved(path, set, figures, &severities))?;
    }
    Ok(Ended::Complete)
}

/// Writes the manifest of a set and what the search came to, and tells of it.
fn saved(path: &Path, set: Manifest, figures: Vec<Figure>, severities: &BTreeMap<String, Severity>) -> Result<()> {
    set.save(path)?;
    describe(&set);
    answer(&format!("set: {}", path.display()));
    let severity = |entry: &Entry| Some((entry.name.clone(), *severities.get(&entry.name)?));
    let variants = set.entries.iter().filter_map(severity).collect();
    Quality { set: set.name, digest: set.digest, figures, variants }.save(path.parent().unwrap_or(Path::new(".")))?;
    Ok(())
}

/// Returns what makes the same set again.
fn command(args: &BehaviorArgs, base: &str, name: &str) -> String {
    let (seed, mode, every) = (args.seed, args.arm.mode(args.mode).name(), args.every);
    let arm = if args.arm == Arm::Own { String::new() } else { format!(" --arm {}", args.arm.name()) };
    format!(
        "dreamstream benchmark build behavior {base}{SUFFIX} --name {name} --seed {seed} --mode {mode} --every {every}{arm}"
    )
}

fn settings(args: &BehaviorArgs, base: &str) -> String {
    let mut writer = DigestWriter::new();
    writer.text(base).u64(args.seed).text(args.arm.mode(args.mode).name()).u32(args.every).u32(source::HAND_OVER);
    if args.arm != Arm::Own {
        writer.text(args.arm.name());
    }
    writer.finish().to_string()
}

/// Searches the variants of each entry and returns them with their scenes, in their order whatever the number of threads.
fn searched(args: &BehaviorArgs, bases: &[&Entry]) -> Result<Vec<(Scene, Searched)>> {
    let folder = args.base.parent().unwrap_or(Path::new("."));
    let model = MotionModel::town();
    let options = Options {
        hand_over: Tick(source::HAND_OVER),
        seed: args.seed,
        mode: args.arm.mode(args.mode),
        ..Options::default()
    };
    let bar = bar(bases.len() as u64, "scenarios");
    let search = |entry: &&Entry| -> Result<(Scene, Searched)> {
        let scene = entry.scene(folder)?;
        let built = args.arm.search(&scene, &model, &options);
        bar.inc(1);
        Ok((scene, built))
    };
    let found = bases.par_iter().map(search).collect::<Result<_>>()?;
    bar.finish_and_clear();
    Ok(found)
}

/// Returns why a scenario has no variant; nothing if it has one.
fn none(built: &Searched) -> Option<&'static str> {
    match built {
        Ok(built) if !built.variants.is_empty() => None,
        Ok(_) => Some("no_valid_candidate"),
        Err(Refusal::Standing { .. }) => Some("ego_stands"),
        Err(Refusal::Short { .. }) => Some("too_short"),
        Err(Refusal::TimeStep { .. }) => Some("time_step"),
    }
}

/// Returns where the scenario of a variant lies, from the folder of the manifest.
fn file_of(set: &str, variant: &Variant) -> PathBuf {
    Path::new(set).join(format!("{}{}", variant.scene.name, store::SUFFIX))
}

/// Writes scenario and solution of a variant.
fn write(args: &BehaviorArgs, set: &str, variant: &Variant) -> Result<()> {
    let path = args.out.join(file_of(set, variant));
    ds_scenario::save(&variant.scene, &path)?;
    if let Some(solution) = &variant.solution {
        file::write_json(&SolutionPart::of(solution), &solution_file(&path))?;
    }
    Ok(())
}

/// Returns the entry of a variant.
fn named(args: &BehaviorArgs, set: &str, base: &Entry, variant: &Variant) -> Result<Entry> {
    let scene = &variant.scene;
    ensure!(variant.solution.is_some() || args.arm != Arm::Own, "{:?}: a variant without a solution", scene.name);
    Ok(Entry {
        name: scene.name.clone(),
        file: Some(file_of(set, variant)),
        scenario: scene.name.clone(),
        scenario_digest: scene.digest.to_string(),
        base: Some(base.name.clone()),
        category: variant.class.name().to_owned(),
        adversary_digest: adversary_digest(scene).map(|digest| digest.to_string()),
        solution_digest: variant.solution.as_ref().map(|solution| solution.digest().to_string()),
        ..base.clone()
    })
}

/// Returns where the solution of a scenario file lies.
fn solution_file(scenario: &Path) -> PathBuf {
    let name = scenario.file_name().unwrap_or_default().to_string_lossy();
    scenario.with_file_name(format!("{}{SOLUTION}", name.strip_suffix(store::SUFFIX).unwrap_or(&name)))
}

/// Compares the adversary of an entry with the manifest and lets the expert drive its solution again; an entry without one, as
/// the arm `advbmt-default` has them, is only compared.
///
/// # Errors
/// If the scenario has another adversary or none, or the drive is not the one that is stored.
pub(crate) fn check(entry: &Entry, scene: Scene, folder: &Path) -> Result<()> {
    let (name, class) = (&entry.name, &entry.category);
    let found = adversary_digest(&scene).map(|digest| digest.to_string());
    ensure!(
        found.is_some() && found == entry.adversary_digest,
        "entry {name:?}: field \"adversary_digest\" is {:?}, the scenario's is {found:?}",
        entry.adversary_digest
    );
    let is = scene.adversary.as_ref().map(|adversary| adversary.class.name());
    ensure!(is == Some(class), "entry {name:?}: field \"category\" is {class:?}, the adversary's class is {is:?}");
    let Some(said) = entry.solution_digest.as_deref() else { return Ok(()) };
    let path = Manifest::file_of(folder, entry).with_context(|| format!("entry {name:?} names no file"))?;
    let path = solution_file(&path);
    let stored: SolutionPart = file::read_json(&path)?;
    let last = Tick(entry.last);
    let driven = solved_again(&Arc::new(scene), Tick(stored.from_tick), last)
        .with_context(|| format!("entry {name:?}: the expert does not survive it: {}", path.display()))?;
    let digest = driven.digest().to_string();
    ensure!(
        stored.tells(&driven) && digest == said,
        "entry {name:?}: the solution driven again has digest {digest}, the manifest says {said}: {}",
        path.display()
    );
    Ok(())
}
