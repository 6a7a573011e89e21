//! How experiments fare: single-effect cases that a short log leaves ambiguous, driven on by designed runs and by the library in
//! its fixed order.
//!
//! `experiments --seed SEED --cases COUNT [--most DRAWN] [--pairs]`: draws effects and ordinary mismatch of the built-in car, keeps
//! cases whose likeliest explanation is below 0.7, prints a line for each and the figures. `--pairs` draws larger effects and keeps cases
//! in which it is open which effect acts, not whether one does: the ordinary mismatch alone is below 0.1.
#![allow(clippy::print_stdout, reason = "the table is this command's answer")]

use ds_diagnosis::meta::VehicleMeta;
use ds_dynamics::case::Case;
use ds_dynamics::motion::BuiltIn;
use ds_dynamics::space::{Part, Space};
use ds_dynamics::{Options, diagnose_leaving, synthetic};
use ds_effect::{Plant, Scale};
use ds_experiment::{ENOUGH, Envelope, LIBRARY, MOST_RUNS, Settings, World, drive, join, run};
use ds_space::Draws;
use rayon::prelude::*;

/// Length of the log that is there beforehand, s.
const LOG_SECS: f64 = 9.0;
/// Probability below which a case is ambiguous.
const AMBIGUOUS: f64 = 0.7;

/// Probability of the ordinary mismatch alone above which it is open whether any effect acts.
const NONE: f64 = 0.1;
/// Sizes that are drawn, of the whole range of an effect.
const SIZES: (f64, f64) = (0.08, 0.4);
/// The same where which effect acts is to be open.
const LARGE: (f64, f64) = (0.15, 0.7);

/// One case that was driven on.
struct Driven {
    standing: bool,
    /// Runs until the likeliest was sure, whether it was the truth, and whether it was sure.
    designed: (usize, bool, bool),
    early: bool,
    library: (usize, bool, bool),
    runs: usize,
    violations: usize,
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let after = |flag: &str, or: u64| {
        let found = arguments.iter().position(|a| a == flag).and_then(|k| arguments.get(k + 1));
        found.and_then(|text| text.parse().ok()).unwrap_or(or)
    };
    let pairs = arguments.iter().any(|a| a == "--pairs");
    let (seed, cases, most) = (after("--seed", 1), after("--cases", 10) as usize, after("--most", 400));
    let mut found: Vec<Driven> = Vec::new();
    let mut drawn = 0;
    while found.len() < cases && drawn < most {
        let next = drawn..(drawn + 8).min(most);
        drawn = next.end;
        found.extend(next.into_par_iter().filter_map(|k| one(seed * 1000 + k, pairs)).collect::<Vec<_>>());
    }
    found.truncate(cases);
    let share = |of: usize, all: usize| format!("{of} of {all} = {:.2}", of as f64 / all.max(1) as f64);
    let known: Vec<&Driven> = found.iter().filter(|d| d.standing).collect();
    let early = |of: &[&Driven]| of.iter().filter(|d| d.early).count();
    let all: Vec<&Driven> = found.iter().collect();
    println!("{drawn} drawn, {} ambiguous, truth among the hypotheses in {}", found.len(), known.len());
    println!("right and {ENOUGH} within 2 runs: {}", share(early(&all), found.len()));
    println!("the same where the truth was among the hypotheses: {}", share(early(&known), known.len()));
    let fewer =
        |d: &&Driven| d.designed.1 && d.designed.2 && (!d.library.1 || !d.library.2 || d.designed.0 < d.library.0);
    let worse =
        |d: &&Driven| d.library.1 && d.library.2 && (!d.designed.1 || !d.designed.2 || d.library.0 < d.designed.0);
    println!("fewer runs than the library's order: {}", share(all.iter().filter(|d| fewer(d)).count(), found.len()));
    println!("more runs: {}", share(all.iter().filter(|d| worse(d)).count(), found.len()));
    let (runs, violations) =
        (all.iter().map(|d| d.runs).sum::<usize>(), all.iter().map(|d| d.violations).sum::<usize>());
    println!("runs that left the envelope: {}", share(violations, runs));
}

/// Draws a case and drives it on if it is ambiguous.
fn one(seed: u64, pairs: bool) -> Option<Driven> {
    let draws = Draws::from_seed(seed, "experiments");
    let space = Space::new(Part::Ego, &synthetic::nominal(), &[]);
    let suspects: Vec<usize> = (0..space.effects.len()).filter(|e| space.suspects(*e)).collect();
    let effect = suspects[draws.below(0, suspects.len() as u64) as usize];
    let mut vector = space.usual();
    for (k, coordinate) in space.coordinates.iter().enumerate() {
        if let Some(nuisance) = coordinate.nuisance {
            vector[k] += nuisance.sd * draws.normal(100 + k as u64);
        }
    }
    let k = space.of(effect)[0];
    let parameter = space.coordinates[k].parameter;
    let (low, high) = parameter.slab;
    let (least, most) = if pairs { LARGE } else { SIZES };
    let size = draws.range(1, least, most);
    let both = low < parameter.neutral && parameter.scale != Scale::Limit && parameter.neutral.is_finite();
    let side = if both && draws.uniform(2) < 0.5 { low } else { high };
    vector[k] = if parameter.neutral.is_finite() {
        parameter.neutral + size * (side - parameter.neutral)
    } else {
        low + (1.0 - size) * (high - low)
    };
    let truth = space.effects[effect].id.to_owned();
    let folder = tempfile::tempdir().expect("a folder");
    let world = || -> Plant { space.plant(&vector) };
    synthetic::write_case(folder.path(), seed, &|plant| *plant = world()).expect("the case can be written");
    let whole = Case::read(folder.path()).expect("the case can be read");
    let log = (draws.below(3, 4)) as usize;
    let start = whole.drives[log].start_secs + draws.range(4, 0.0, 24.0);
    let part = whole.drives[log].between(start, start + LOG_SECS);
    let entry = whole.meta.drives[log].clone();
    let meta = VehicleMeta { drives: vec![entry], suggested_split: None, ..whole.meta.clone() };
    let case = Case::new(meta, vec![part]).expect("a case");
    let options = Options { quick: true, ..Options::default() };
    let (_, standings) = diagnose_leaving(&case, &options);
    let before = standings[0].probability;
    let none = standings.iter().find(|s| s.effects.is_empty()).map_or(0.0, |s| s.probability);
    if before >= AMBIGUOUS || (pairs && none > NONE) {
        return None;
    }
    let standing = standings.iter().take(5).any(|s| s.effects == [truth.clone()] && s.probability >= 0.01);
    let settings = Settings { seed, envelope: Envelope::default(), quick: true, ..Settings::default() };
    let plant = world();
    let real = World { motion: &BuiltIn, plant: &plant };
    let is_truth = |effects: &[String]| effects == [truth.clone()];
    let mut line = format!("{seed} {truth} before {before:.2} {:?}", standings[0].effects);
    // What cannot be driven is wrong, like what is driven for nothing.
    let made = run(&case, &real, &settings, &|_| ());
    let (runs, refused, ended) = match made {
        Ok((next, ..)) => (next.runs, next.refused, next.ended.unwrap_or_default()),
        Err(error) => (Vec::new(), Vec::new(), error.to_string()),
    };
    for r in &refused {
        line += &format!("\n    run {} ({}) refused: {}", r.run, r.from, r.why);
    }
    for r in &runs {
        line += &format!("\n    run {} ({}, {:.2} nat): {:?} {:.3}", r.run, r.from, r.nats, r.effects, r.probability);
    }
    let sure = |effects: &[String], p: f64| (is_truth(effects), p >= ENOUGH);
    let last = runs.last().map_or((false, false), |r| sure(&r.effects, r.probability));
    let early = runs.iter().any(|r| r.run <= 2 && sure(&r.effects, r.probability) == (true, true));
    let designed = (runs.len() + refused.len(), last.0, last.1);
    line += &format!("\n    ended: {ended}");
    let library = by_library(&case, &real, &settings, &options, &is_truth);
    line += &format!("\n    library: {} runs, right {}, sure {}", library.0, library.1, library.2);
    println!("{line}");
    let violations = runs.iter().filter(|r| r.left_envelope).count();
    Some(Driven { standing, designed, early, library, runs: runs.len(), violations })
}

/// Drives the library in its order until one hypothesis is sure.
fn by_library(
    case: &Case,
    world: &World<'_>,
    settings: &Settings,
    options: &Options,
    is_truth: &dyn Fn(&[String]) -> bool,
) -> (usize, bool, bool) {
    let mut grown = case.clone();
    let mut found = (false, false);
    for (number, (_, design)) in (1..).zip(LIBRARY).take(MOST_RUNS) {
        let joined =
            drive(world, &design, case, number, settings).and_then(|logged| join(&grown, number, logged.drive));
        let Ok(joined) = joined else { continue };
        grown = joined;
        let (_, standings) = diagnose_leaving(&grown, options);
        found = (is_truth(&standings[0].effects), standings[0].probability >= ENOUGH);
        if found.1 {
            return (number, found.0, found.1);
        }
    }
    (MOST_RUNS, found.0, found.1)
}
