//! The engine of all studies over frames: declared sources, what networks see of them, distances with their resamples.
//!
//! Features are kept per scenario and source. What a study asks of the distances is in a file of its own.

use std::collections::BTreeMap;
use std::path::Path;

use ds_fidelity::{Compared, Features, Interval, Unit, ratio, recentred};

use super::config::{Study, StudyConfig};
use super::crew::Means;
use super::found::{Found, HUNDREDTHS, Measured, Sets};
use super::outcome::{Figure, Outcome, Ratio, Row, Table};
use super::source::Source;
use super::under_way::UnderWay;
use super::{anchor, attended, correlation, page, parts, rollout, sensitivity};
use crate::Progress;
use crate::error::EvaluationError;

/// What all resamples of a network may cost, in third powers of its features: 1,000 of 464 features.
const AFFORDABLE: u64 = 100_000_000_000;
/// Fewest resamples of an interval, where as many are asked for.
const FEWEST_DRAWS: u64 = 40;

/// Makes the frames, looks at them and measures; what was looked at before is kept.
///
/// # Errors
/// If weights cannot be used, a frame cannot be made, or features cannot be compared.
pub fn run(
    study: Study,
    config: &StudyConfig,
    means: &Means<'_>,
    progress: &mut dyn Progress,
) -> Result<Outcome, EvaluationError> {
    config.check_for(study)?;
    let mut under_way = UnderWay::open(study, config, means)?;
    under_way.greet()?;
    let mut outcome = Outcome {
        study: study.name().to_owned(),
        kind: "sim-to-reference".to_owned(),
        world: format!("{:?}", config.world),
        first_seed: config.first_seed,
        held_out: Some(config.first_seed >= config.world.held_out_from()),
        scenarios: under_way.takes.len(),
        looks: under_way.looks(),
        ..Outcome::default()
    };
    if study == Study::Parts {
        outcome.parts = Some(parts::of(config, &mut under_way, progress, means.seconds)?);
        outcome.seconds = under_way.seconds;
        under_way.show(&outcome)?;
    } else {
        of_features(study, &mut under_way, &mut outcome, progress, means.seconds)?;
    }
    Ok(outcome)
}

/// Measures what networks attend to in frames, and what a study asks of that.
fn of_features(
    study: Study,
    under_way: &mut UnderWay<'_>,
    outcome: &mut Outcome,
    progress: &mut dyn Progress,
    seconds: &dyn Fn() -> f64,
) -> Result<(), EvaluationError> {
    let config = under_way.config;
    let recorded = anchor::look(config, &mut under_way.crew.lookers().panel)?;
    let seen = under_way.look(progress, seconds)?;
    let sets = under_way.sets(&seen);
    progress.note("distances and intervals");
    let names: Vec<&str> = config.sources.iter().map(Source::name).collect();
    let measured: Vec<Measured> =
        sets.iter().map(|sets| measure(sets, &names, config.draws)).collect::<Result<_, _>>()?;
    let policies = config.panel.len();
    let pdms = under_way.pdms(&seen);
    let found = Found { config, takes: &under_way.takes, sets, measured, pdms, policies };
    outcome.seconds = under_way.seconds;
    distances(&found, outcome);
    outcome.anchor = (!recorded.is_empty()).then(|| anchor::of(&found, &recorded)).transpose()?;
    let panel: Vec<&Measured> = found.panel().iter().map(|at| &found.measured[*at]).collect();
    for (at, source) in config.others() {
        outcome.worst.insert(source.name().to_owned(), under_way.worst(&panel, at, source));
    }
    under_way.show(outcome)?;
    match study {
        Study::Fidelity => outcome.attended = attended::of(under_way, &found)?,
        Study::Ablation | Study::Anchor | Study::Parts => {}
        Study::Correlation => outcome.correlation = Some(correlation::of(&found)),
        Study::Sensitivity => outcome.sensitivity = Some(sensitivity::of(&found)?),
        Study::Rollout => outcome.rollout = Some(rollout::of(&found)?),
    }
    for (at, measured) in found.measured.into_iter().enumerate() {
        let tables = match found.sets[at].unit {
            Unit::Features => &mut outcome.given,
            Unit::Variance if at < policies => &mut outcome.policies,
            Unit::Variance => &mut outcome.others,
        };
        tables.insert(measured.name, measured.table);
    }
    Ok(())
}

/// States FDπ of every source and the ratios.
fn distances(found: &Found<'_>, outcome: &mut Outcome) {
    let config = found.config;
    let all: Vec<(f64, Vec<f64>)> = (0..config.sources.len()).map(|at| found.fd_pi(at)).collect();
    for (source, (value, drawn)) in config.sources.iter().zip(&all) {
        outcome.fd_pi.insert(source.name().to_owned(), Figure::of(recentred(*value, drawn.clone()), 1.0));
    }
    for [above, below] in &config.ratios {
        let places = config.place(above).zip(config.place(below));
        let ratio = places.and_then(|(above, below)| {
            let found: Option<Interval> = ratio(all[above].0, all[below].0, (&all[above].1, &all[below].1));
            Some(Figure::of(found?, 1.0))
        });
        outcome.ratios.push(Ratio { above: above.clone(), below: below.clone(), ratio });
    }
}

/// Writes `STUDY.json` and `index.html` into the study's folder.
///
/// # Errors
/// If a file cannot be written.
pub fn write(config: &StudyConfig, outcome: &Outcome) -> Result<(), EvaluationError> {
    write_json(&config.out, outcome)?;
    let path = config.out.join("index.html");
    std::fs::write(&path, page::html(outcome)).map_err(EvaluationError::io("page", &path))
}

/// Writes `STUDY.json` alone.
///
/// # Errors
/// If the file cannot be written.
pub fn write_json(folder: &Path, outcome: &Outcome) -> Result<(), EvaluationError> {
    let path = folder.join(format!("{}.json", outcome.study));
    let text = serde_json::to_string_pretty(outcome)
        .map_err(|source| EvaluationError::Record { path: path.display().to_string(), source })?;
    std::fs::write(&path, text + "\n").map_err(EvaluationError::io("outcome", &path))
}

/// Returns how many of so many resamples a network's features allow: the time of one rises with the third power of the smaller
/// of frames and features.
fn drawable(real: &Features, draws: u64) -> u64 {
    let frames: usize = real.0.iter().map(nalgebra::DMatrix::nrows).sum();
    let side = frames.min(real.0.first().map_or(0, nalgebra::DMatrix::ncols)).max(1) as u64;
    draws.min((AFFORDABLE / side.pow(3)).max(FEWEST_DRAWS))
}

/// Measures how far sets of these names look from the real one to a network.
pub(super) fn measure(sets: &Sets, names: &[&str], draws: u64) -> Result<Measured, EvaluationError> {
    let compared = Compared::new(&sets.name, sets.real.clone())?.stated_in(sets.unit);
    let times = if sets.unit == Unit::Variance { HUNDREDTHS } else { 1.0 };
    let sources: Vec<(&str, &Features)> = names.iter().copied().zip(&sets.others).collect();
    let drawable = drawable(&sets.real, draws);
    let mut drawn = compared.resampled(&sources, drawable)?;
    drawn.iter_mut().flatten().for_each(|value| *value *= times);
    // What was not drawn is no number, as draws without variance are.
    drawn.iter_mut().for_each(|drawn| drawn.resize(usize::try_from(draws).unwrap_or(usize::MAX), f64::NAN));
    let placed = match &sets.placed {
        None => None,
        Some((real, others)) => Some((Compared::new(&sets.name, real.clone())?, others)),
    };
    let mut rows = BTreeMap::new();
    let mut pairs = Vec::new();
    let mut size = (0, 0);
    for (at, (name, other)) in sources.iter().enumerate() {
        let found = compared.distance(name, other)?;
        size = (found.frames, found.features);
        let placed = placed.as_ref().map(|(compared, others)| compared.distance(name, &others[at])).transpose()?;
        let mut warnings = found.warnings;
        if drawable < draws {
            warnings.push(format!("the interval is of {drawable} resamples: more features take longer"));
        }
        let row = Row {
            fd: Figure::of(recentred(found.value * times, drawn[at].clone()), 1.0),
            bound: found.bound * times,
            bias: found.bias * times,
            extrapolated: found.extrapolated * times,
            warnings,
            placed: placed.map(|placed| placed.value * times),
        };
        rows.insert((*name).to_owned(), row);
        pairs.push(compared.pairs(name, other)?);
    }
    let table = Table {
        control: sets.control,
        features: size.1,
        frames: size.0,
        halves: compared.halves()? * times,
        sources: rows,
        digest: sets.digest.to_string(),
    };
    Ok(Measured { name: sets.name.clone(), table, drawn, pairs })
}
