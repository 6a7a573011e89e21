//! Learns a baseline from healthy logs: each studied by itself, then put together, then each judged by the others.

pub(crate) mod statistics;
mod study;
mod traits;
mod worth;

use std::collections::{BTreeMap, BTreeSet};

use ds_diagnosis::CaseError;
use ds_diagnosis::meta::Nominal;
use ds_effect::Channel;
use rayon::prelude::*;

use crate::baseline::correlation::{Correlation, ROWS};
use crate::baseline::discrepancy::Discrepancy;
use crate::baseline::features::{NAMES, STATE};
use crate::baseline::nulls::{self, Statistics};
use crate::baseline::sampling::Sampling;
use crate::baseline::spread::{Estimate, spread};
use crate::baseline::study::{Row, Study};
use crate::baseline::windows::{Scored, Sensors, Windows};
use crate::baseline::{Baseline, Influence, SCHEMA, Spread, Units, Usual, centre, channels, digest, digest_of};
use crate::case::{Case, PartModel};
use crate::cells;
use crate::choice::Outcome;
use crate::drive::Drive;
use crate::fit::point_loss;
use crate::noise::Noise;
use crate::scatter::{Scatter, Tolerated, scatter};
use crate::search::Effort;
use crate::settings::Thresholds;
use crate::space::{Part, Space, sized};
use crate::watch::scores::scores;
use crate::windows::BLOCKS;
use traits::Asked;

/// Mean loss of a residual that is as its floor says.
const CLEAN_LOSS: f64 = 0.5;
/// Rows as which the library's floor counts.
const LIBRARY_ROWS: f64 = 100.0;
/// Least factor on the library's floor: quieter sensors leave what is uncertain about the shape of effects.
const LEAST_FACTOR: f64 = 0.7;
/// Chance below which a healthy log is called unlike the others.
const UNLIKE: f64 = 0.01;
/// Distance of a usual value from the library's, in its standard deviations, from which on the logs are studied again about it.
const FAR: f64 = 3.0;
/// How often at most.
const ROUNDS: usize = 4;
/// Effects without a usual spread that may be a trait of some vehicles.
const MOST_TRAITS: usize = 3;
/// Logs from which on logs are the units.
const FEW: usize = 3;

/// A healthy case and what it is called.
pub struct Healthy {
    /// Name.
    pub name: String,
    /// The case.
    pub case: Case,
}

/// Told after each step of the work.
pub type Progress<'a> = &'a (dyn Fn() + Sync);

/// One unit: some drives of a case.
struct Unit<'a> {
    name: String,
    case: &'a Case,
    drives: Vec<usize>,
    /// Whether it is known to be healthy.
    known: bool,
}

impl Unit<'_> {
    fn digests(&self) -> impl Iterator<Item = String> {
        self.drives.iter().map(|&d| digest_of(&self.case.drives[d]))
    }

    fn scatter(&self) -> Scatter {
        let rows: Vec<&Drive> = self.drives.iter().map(|&d| self.case.drives[d].by_rows()).collect();
        scatter(&rows, Tolerated::default())
    }
}

/// Learns a baseline.
///
/// # Errors
/// If there is no log, or the same drive twice.
pub fn learn(healthy: &[Healthy], progress: Progress<'_>) -> Result<Baseline, CaseError> {
    let units = units(healthy);
    if units.is_empty() {
        return Err(CaseError::NoHealthy);
    }
    worth::apart(&units)?;
    let all: Vec<usize> = (0..units.len()).collect();
    let mut studies = Studies::of(&units, Spread::new(), progress);
    let mut judged = judged(&units, &studies, &all, progress);
    for _ in 0..MOST_TRAITS {
        let asked: Vec<&[Asked]> = judged.iter().map(|j| j.asked.as_slice()).collect();
        let Some(traits) = traits::further(&studies.traits, &asked) else { break };
        studies = Studies::of(&units, traits, &|| ());
        judged = self::judged(&units, &studies, &all, &|| ());
    }
    let mut baseline = assemble(&units, &studies.chosen(&all), &studies.traits);
    let logs: Vec<Statistics> = judged.iter().map(|j| j.reached.clone()).collect();
    if units.len() > 1 {
        baseline.nulls = nulls::gather(&logs);
        baseline.cells = nulls::gather(&judged.iter().map(|j| j.cells.clone()).collect::<Vec<_>>());
        let logs = judged.iter().map(|j| j.windows.clone()).collect();
        baseline.windows = Some(Windows { sensors: sensors(&units), logs });
    }
    let nominal = &units[0].case.meta.nominal;
    for (out, unit) in units.iter().enumerate() {
        let others: Vec<Statistics> =
            logs.iter().enumerate().filter(|(k, _)| *k != out).map(|(_, s)| s.clone()).collect();
        let chance = nulls::chance(&nulls::gather(&others), &logs[out]);
        let moves = judged[out].without.as_ref().and_then(|without| most_moved(&baseline.spread, without, nominal));
        baseline.influence.push(Influence { unit: unit.name.clone(), chance, moves });
        if chance < UNLIKE {
            baseline
                .warnings
                .push(format!("{} is unlike the other healthy logs (chance {chance:.1e}): is it healthy?", unit.name));
        }
    }
    limits(&mut baseline);
    let doubts = worth::doubts(&baseline);
    baseline.warnings.extend(doubts);
    Ok(baseline)
}

/// Writes down from which evidence on an effect is told from a healthy log.
fn limits(baseline: &mut Baseline) {
    for (part, name) in nulls::GAIN.iter().enumerate() {
        let asked = baseline.thresholds(part, &Thresholds::default()).single_gain;
        baseline.detection_limits.insert((*name).to_owned(), asked);
    }
}

/// What each of some units says by itself.
struct Studies {
    each: Vec<Study>,
    /// What is usual of these vehicles though the library knows no usual spread of it.
    traits: Spread,
}

impl Studies {
    /// Studies every unit; again about what was found where that is far from the library's vehicles, whose ranges it would meet.
    fn of(units: &[Unit<'_>], traits: Spread, progress: Progress<'_>) -> Self {
        let all = |about: &Spread| -> Vec<Study> {
            units.par_iter().map(|unit| study::study(unit.case, &unit.drives, about)).collect()
        };
        let usual = |each: &[Study]| usual_values(units[0].case, &each.iter().collect::<Vec<_>>(), &traits);
        let nominal = &units[0].case.meta.nominal;
        let mut each = all(&traits);
        let mut found = usual(&each);
        let mut moved = farthest(&found, None, nominal);
        for _ in 0..ROUNDS {
            if moved < FAR {
                break;
            }
            each = all(&found);
            let again = usual(&each);
            moved = farthest(&again, Some(&found), nominal);
            found = again;
        }
        (0..units.len()).for_each(|_| progress());
        Self { each, traits }
    }

    fn chosen(&self, chosen: &[usize]) -> Vec<&Study> {
        chosen.iter().map(|k| &self.each[*k]).collect()
    }
}

/// What each of many logs says by itself, from which the baseline of any choice of them is put together.
pub(crate) struct Reference {
    studies: Studies,
}

impl Reference {
    /// Studies every log; `progress` is told once for each.
    pub(crate) fn study(logs: &[Healthy], progress: Progress<'_>) -> Self {
        Self { studies: Studies::of(&whole(logs), Spread::new(), progress) }
    }

    /// Returns the statistics that some of the logs reach, each judged by the others of them.
    pub(crate) fn judged(&self, logs: &[Healthy], chosen: &[usize]) -> BTreeMap<usize, Statistics> {
        let judged = judged(&whole(logs), &self.studies, chosen, &|| ());
        chosen.iter().copied().zip(judged.into_iter().map(|j| j.reached)).collect()
    }

    /// Returns the baseline of some of the logs, given what they reach when judged by others.
    pub(crate) fn baseline(
        &self,
        logs: &[Healthy],
        chosen: &[usize],
        reached: &BTreeMap<usize, Statistics>,
    ) -> Baseline {
        let mut baseline = chosen_of(&whole(logs), &self.studies, chosen);
        let own: Vec<Statistics> = chosen.iter().filter_map(|k| reached.get(k).cloned()).collect();
        baseline.nulls = nulls::gather(&own);
        limits(&mut baseline);
        baseline
    }
}

/// Returns the logs of a fleet, of which nobody knows which are healthy, as units, each with all its drives.
fn whole(logs: &[Healthy]) -> Vec<Unit<'_>> {
    let of = |h: &'_ Healthy| (0..h.case.drives.len()).collect();
    logs.iter().map(|h| Unit { name: h.name.clone(), case: &h.case, drives: of(h), known: false }).collect()
}

/// Returns how far the usual values lie from others, or from the library's, in the library's standard deviations.
fn farthest(found: &Spread, from: Option<&Spread>, nominal: &Nominal) -> f64 {
    let far = |(id, all): (&String, &Vec<Option<Usual>>)| {
        let effect = ds_effect::find(id)?;
        let each = all.iter().zip(sized(effect, nominal)).enumerate().filter_map(|(k, (usual, parameter))| {
            let library = parameter.nuisance?;
            let other = from.map_or(Some(library.mean), |f| Some(f.get(id)?.get(k).copied().flatten()?.mean))?;
            Some(((*usual)?.mean - other).abs() / library.sd)
        });
        each.reduce(f64::max)
    };
    found.iter().filter_map(far).fold(0.0, f64::max)
}

/// Returns how often the progress of learning from some logs is told.
#[must_use]
pub fn steps(healthy: &[Healthy]) -> u64 {
    2 * units(healthy).len() as u64
}

/// Returns the units: logs, or the drives of the logs where these are few.
fn units(healthy: &[Healthy]) -> Vec<Unit<'_>> {
    let mut out = Vec::new();
    for h in healthy {
        let drives: Vec<usize> = (0..h.case.drives.len()).collect();
        if healthy.len() >= FEW {
            out.push(Unit { name: h.name.clone(), case: &h.case, drives, known: true });
        } else {
            out.extend(drives.into_iter().map(|d| Unit {
                name: format!("{}/{}", h.name, h.case.drives[d].file),
                case: &h.case,
                drives: vec![d],
                known: true,
            }));
        }
    }
    out
}

/// Puts the studies of some units together.
fn assemble(units: &[Unit<'_>], studies: &[&Study], traits: &Spread) -> Baseline {
    let cases: Vec<&Case> = units.iter().map(|unit| unit.case).collect();
    let names = |of: &dyn Fn(&Unit<'_>) -> String| units.iter().map(of).collect::<BTreeSet<_>>().into_iter().collect();
    let discrepancy = Discrepancy::learn(studies);
    let unexplained = unexplained(studies);
    let noise = noise(studies, &unexplained);
    // drives of one log share what is its own, and a fault that some have is nothing that healthy ones have in common
    let whole = units.iter().all(|unit| unit.known && unit.drives.len() == unit.case.drives.len());
    let several = whole && units.len() > 1;
    let correlation = if several { correlation(studies, &unexplained, &noise) } else { Correlation::default() };
    let mut warnings = Vec::new();
    if units.len() < FEW {
        warnings.push(format!(
            "{} healthy drive{}: usual values and spreads can be told, how often a healthy log is called faulty cannot; three logs or more are needed",
            units.len(),
            if units.len() == 1 { "" } else { "s" }
        ));
    }
    let days: BTreeSet<_> = cases.iter().map(|case| case.meta.day.clone()).collect();
    if days.len() == 1 && days.iter().all(Option::is_some) {
        warnings.push(
            "all healthy logs are of one day: what the day brings and what a fault brings cannot be told apart"
                .to_owned(),
        );
    }
    Baseline {
        schema_version: SCHEMA,
        nominal_hash: cases
            .iter()
            .map(|case| digest(&case.meta.nominal))
            .collect::<BTreeSet<_>>()
            .into_iter()
            .collect(),
        channels: cases.iter().flat_map(|case| channels(&case.drives)).collect::<BTreeSet<_>>().into_iter().collect(),
        simulator: cases[0].stand_in.as_ref().map(|stand_in| stand_in.kind.clone()),
        wheelbase_m: Some(cases[0].meta.nominal.lf + cases[0].meta.nominal.lr),
        mass_kg: cases.iter().map(|case| [case.meta.nominal.mass; 2]).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]),
        rate_hz: 1.0 / ds_diagnosis::table::STEP_SECS,
        units: Units {
            vehicle: names(&|unit| unit.case.meta.vehicle.clone().unwrap_or_else(|| digest(&unit.case.meta.nominal))),
            day: names(&|unit| unit.case.meta.day.clone().unwrap_or_else(|| unit.name.clone())),
            drive: units.iter().map(|unit| unit.name.clone()).collect(),
            digest: units.iter().flat_map(Unit::digests).collect(),
        },
        noise,
        correlation,
        spread: usual_values(cases[0], studies, traits),
        sampling: Sampling::of(&units.iter().map(Unit::scatter).collect::<Vec<_>>()),
        discrepancy,
        nulls: Vec::new(),
        cells: Vec::new(),
        windows: None,
        detection_limits: BTreeMap::new(),
        domain: domain(studies),
        influence: Vec::new(),
        warnings,
    }
}

fn usual_values(case: &Case, studies: &[&Study], traits: &Spread) -> Spread {
    let mut out = Spread::new();
    for (part, which) in [Part::Ego, Part::Following].into_iter().enumerate() {
        let mut space = Space::new(which, &case.meta.nominal, case.lacks());
        // what these logs do not show is neutral in a simulated world, as it is for a diagnosis of them
        if case.meta.simulated {
            space.expect_nothing();
        }
        centre(&mut space, traits);
        for (k, coordinate) in space.coordinates.iter().enumerate() {
            let estimates: Vec<Estimate> = studies.iter().filter_map(|s| s.estimates[part][k]).collect();
            let usual = coordinate.nuisance.map(|library| spread(&estimates, library));
            let line = out.entry(space.effects[coordinate.effect].id.to_owned()).or_default();
            line.push(usual.map(|n| Usual { mean: n.mean, sd: n.sd }));
        }
    }
    out
}

/// Returns what the residuals of healthy logs leave, each predicted from the others, in the order of their rows.
fn unexplained(studies: &[&Study]) -> Vec<Vec<f64>> {
    let of = |(out, study): (usize, &&Study)| {
        let others: Vec<&Study> = studies.iter().enumerate().filter(|(k, _)| *k != out).map(|(_, s)| *s).collect();
        let discrepancy = Discrepancy::learn(&others);
        let widening: Vec<f64> = study.features.iter().map(|f| discrepancy.widening(f)).collect();
        let left =
            |row: &Row| (row.residual - discrepancy.at(row.channel, &study.features[row.place])) / widening[row.place];
        study.rows.iter().map(left).collect()
    };
    studies.iter().enumerate().map(of).collect()
}

/// Returns the factor on the library's floor by channel and block at which what healthy logs leave has the loss of
/// residuals that are as their floor says.
fn noise(studies: &[&Study], unexplained: &[Vec<f64>]) -> BTreeMap<String, Vec<f64>> {
    let mut left: BTreeMap<(usize, usize), Vec<f64>> = BTreeMap::new();
    for (study, unexplained) in studies.iter().zip(unexplained) {
        for (row, z) in study.rows.iter().zip(unexplained) {
            left.entry((row.channel, row.block)).or_default().push(*z);
        }
        for (channel, block, z) in &study.followers {
            left.entry((*channel, *block)).or_default().push(*z);
        }
    }
    let mut out: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for ((channel, _), residuals) in left {
        let found = scale(&residuals);
        let weight = residuals.len() as f64 / (residuals.len() as f64 + LIBRARY_ROWS);
        out.entry(Channel::ALL[channel].name().to_owned()).or_default().push((weight * found.ln()).exp());
    }
    out
}

/// Returns how what healthy logs leave in a window goes together.
fn correlation(studies: &[&Study], unexplained: &[Vec<f64>], noise: &BTreeMap<String, Vec<f64>>) -> Correlation {
    let mut windows = Vec::new();
    for (study, unexplained) in studies.iter().zip(unexplained) {
        let mut own: BTreeMap<usize, Vec<Option<f64>>> = BTreeMap::new();
        for (row, z) in study.rows.iter().zip(unexplained) {
            let window = own.entry(row.place / BLOCKS).or_insert_with(|| vec![None; ROWS]);
            let factor = noise.get(Channel::ALL[row.channel].name()).and_then(|table| table.get(row.block));
            window[row.channel * BLOCKS + row.block] = Some(z / factor.copied().unwrap_or(1.0));
        }
        windows.extend(own.into_values());
    }
    Correlation::learn(&windows)
}

/// Returns the factor by which residuals exceed their floor.
fn scale(residuals: &[f64]) -> f64 {
    let loss = |factor: f64| residuals.iter().map(|z| point_loss(z / factor)).sum::<f64>() / residuals.len() as f64;
    let (mut low, mut high) = (LEAST_FACTOR, 50.0);
    for _ in 0..50 {
        let middle = (low * high).sqrt();
        if loss(middle) > CLEAN_LOSS { low = middle } else { high = middle }
    }
    (low * high).sqrt()
}

fn domain(studies: &[&Study]) -> BTreeMap<String, [f64; 2]> {
    let of = |k: usize| {
        let mut values: Vec<f64> = studies.iter().flat_map(|s| s.features.iter().map(|f| f[k])).collect();
        (!values.is_empty()).then(|| [0.01, 0.99].map(|share| ds_stats::quantile(&mut values, share)))
    };
    (0..STATE).filter_map(|k| Some((NAMES[k].to_owned(), of(k)?))).collect()
}

/// What a log reaches when the others judge it.
struct Judged {
    /// Its statistics.
    reached: Statistics,
    /// What it leaves by channel and regime.
    cells: Statistics,
    /// What it leaves in its windows.
    windows: Vec<Scored>,
    /// Usual values of the others; none where there are no others.
    without: Option<Spread>,
    /// Effects without a usual spread that it asks for all the same.
    asked: Vec<Asked>,
}

/// Judges each of some units by a baseline of the others of them.
fn judged(units: &[Unit<'_>], studies: &Studies, chosen: &[usize], progress: Progress<'_>) -> Vec<Judged> {
    let one = |out: &usize| {
        let judged = judge(units, studies, chosen, *out);
        progress();
        judged
    };
    chosen.par_iter().map(one).collect()
}

fn judge(units: &[Unit<'_>], studies: &Studies, chosen: &[usize], out: usize) -> Judged {
    let others: Vec<usize> = chosen.iter().copied().filter(|k| *k != out).collect();
    if others.is_empty() {
        let (reached, cells) = (Statistics::new(), Statistics::new());
        return Judged { reached, cells, windows: Vec::new(), without: None, asked: Vec::new() };
    }
    let baseline = chosen_of(units, studies, &others);
    let unit = &units[out];
    // a log is judged by the drives that a diagnosis would fit
    let (fit, _) = unit.case.meta.split();
    let drives: Vec<usize> =
        unit.drives.iter().copied().filter(|d| unit.drives.len() == 1 || fit.contains(d)).collect();
    let models =
        [Part::Ego, Part::Following].map(|part| PartModel::against(unit.case, part, &drives, &[], Some(&baseline)));
    let outcomes: Vec<Outcome<'_, '_>> = models.iter().map(|m| Outcome::searched(m, Effort::Quick)).collect();
    let windows = scores(unit.case, &unit.drives, &baseline, &sensors(units));
    let asked = outcomes.iter().flat_map(|outcome| traits::asked(&outcome.search)).collect();
    let whole = [Part::Ego, Part::Following]
        .map(|part| PartModel::against(unit.case, part, &unit.drives, &[], Some(&baseline)));
    let fitted: Vec<_> = whole.iter().zip(&outcomes).map(|(m, o)| (m, o.fit().vector.as_slice())).collect();
    let (reached, cells) = (statistics::of_healthy(&outcomes), cells::reached(&fitted));
    Judged { reached, cells, windows, without: Some(baseline.spread), asked }
}

/// Returns the sensors of the middle one of some units.
fn sensors(units: &[Unit<'_>]) -> Sensors {
    Noise::middle(&units.iter().map(|unit| &unit.case.noise).collect::<Vec<_>>())
}

/// Puts the studies of a choice of units together.
fn chosen_of(units: &[Unit<'_>], studies: &Studies, chosen: &[usize]) -> Baseline {
    let kept: Vec<Unit<'_>> = chosen
        .iter()
        .map(|k| {
            let Unit { name, case, drives, known } = &units[*k];
            Unit { name: name.clone(), case, drives: drives.clone(), known: *known }
        })
        .collect();
    assemble(&kept, &studies.chosen(chosen), &studies.traits)
}

/// Returns the parameter whose usual value moves most when a unit is left out, and by how many of the library's spreads.
fn most_moved(whole: &Spread, without: &Spread, nominal: &Nominal) -> Option<(String, f64)> {
    let moves = |(id, all): (&String, &Vec<Option<Usual>>)| {
        let (now, then) = (all.first().copied().flatten()?, without.get(id)?.first().copied().flatten()?);
        let library = sized(ds_effect::find(id)?, nominal).next()?.nuisance?;
        Some((id.clone(), ((now.mean - then.mean) / library.sd).abs()))
    };
    whole.iter().filter_map(moves).max_by(|a, b| a.1.total_cmp(&b.1))
}
