//! The diagnosis of a case of several clips: the real stream minus the mean over seeds is a bias of the generator, what an
//! effect does to the layouts of the clip, what is peculiar to the clip, and (1 + 1/G) of the scatter of seeds.
//!
//! With effect-free clips bias and spread are known. Without, the bias is free: what does the same to all clips cannot be
//! told from it and is not testable.

use ds_diagnosis::meta::Pairing;
use ds_diagnosis::schema::Diagnosis;
use ds_effect::frame::{FrameEffect, Needs};
use ds_space::draw::Draws;
use nalgebra::DVector;
use rayon::prelude::*;

use crate::clips::bias::{Bias, within};
use crate::clips::readout::{COUNT, Readout};
use crate::clips::stack::Stack;
use crate::clips::{ClipCase, flips, remains};
use crate::error::FramesError;
use crate::pairing::nuisance::Nuisance;
use crate::pairing::paths::Path;
use crate::pairing::statistics::Scope;
use crate::pairing::verdict::{Evidence, corrected, correction, warnings};
use crate::pairing::weigh;
use crate::settings;

/// Diagnoses a case of several clips.
///
/// # Errors
/// If a file is missing or spoiled, or there are too few clips.
pub fn judged(case: &ClipCase, nuisance: Option<&Nuisance>, without: &[String]) -> Result<Diagnosis, FramesError> {
    if case.clips.len() < settings::FEWEST_CLIPS {
        let (found, needed, case) = (case.clips.len(), settings::FEWEST_CLIPS, case.name.clone());
        return Err(FramesError::TooFewClips { found, needed, case });
    }
    let read = |clip| Readout::of(clip, Some(without));
    let readouts: Vec<Readout> = case.clips.par_iter().map(read).collect::<Result<_, _>>()?;
    let free_rows: Vec<&DVector<f64>> = nuisance.iter().flat_map(|known| &known.clips).collect();
    let rows: Vec<DVector<f64>> = readouts.iter().map(Readout::mean).collect();
    let known = free_rows.len() >= settings::FEWEST_CLIPS;
    let bias = if known {
        Bias::known(&free_rows)
    } else {
        let seeds: Vec<&[DVector<f64>]> = readouts.iter().map(|r| r.rows.as_slice()).collect();
        Bias::free(&rows.iter().collect::<Vec<_>>(), &within(&seeds), readouts[0].rows.len())
    };
    let signatures = nuisance.map(|known| known.signatures.as_slice()).unwrap_or_default();
    let clips: Vec<Vec<Path>> = readouts.iter().map(|readout| corrected_by(&readout.paths, signatures)).collect();
    let centre = bias.mean.clone().unwrap_or_else(|| rows.iter().sum::<DVector<f64>>() / rows.len() as f64);
    let deviations: Vec<DVector<f64>> = rows.iter().map(|row| row - &centre).collect();
    let stack = Stack::new(&bias, &bias.weights(&deviations));
    let of_mean = if known { &deviations } else { &rows };
    let deviation = stack.stacked(of_mean, &deviations);
    let (needed, usual) = if known {
        let (gains, sizes) = effect_free(&free_rows, &clips);
        (weigh::needed(gains), weigh::usual(sizes))
    } else {
        // a spread that is the case's own finds nothing in it strange
        (settings::FREE_GAIN, deviation.norm_squared())
    };
    let testable: fn(&FrameEffect) -> bool = if known { |_| true } else { varies };
    let paths = stack.paths(&clips);
    let evidence = Evidence { scope: Scope::Layered, testable, deviation, needed, usual, late: late(&readouts), paths };
    // the bias is known from so many clips only: its error is common to all deviations
    let widened = if known { 1.0 + rows.len() as f64 / bias.clips as f64 } else { 1.0 };
    let accused: Vec<Path> = evidence.paths.iter().filter(|path| testable(path.effect)).cloned().collect();
    let chance = flips::chance(rows.len(), widened, &|signs| {
        let [mean, clips] =
            [of_mean, &deviations].map(|rows| rows.iter().zip(signs).map(|(row, s)| row * *s).collect::<Vec<_>>());
        weigh::best(&accused, &stack.stacked(&mean, &clips))
    });
    let found = evidence.found(&|spot| chance <= settings::MOST_CHANCE && testable(evidence.paths[spot.path].effect));
    let diagnosis = evidence.diagnosis(&case.name, &found);
    let gap = nuisance.map_or_else(|| mean_gap(&readouts), |known| known.gap);
    let left = remains::measured(case, &correction(&found.model), gap)?;
    let mut odd: Vec<String> = readouts.iter().flat_map(|r| r.warnings.clone()).collect();
    odd.sort();
    odd.dedup();
    let share = 100.0 * chance;
    odd.push(format!("clips without any effect show as large a gain in {share:.1} % of the patterns of signs"));
    let cells = if diagnosis.verdict == ds_diagnosis::Verdict::None { Vec::new() } else { left.cells };
    Ok(Diagnosis {
        cells,
        how_far: left.held,
        predicted_share: left.fit.first().and_then(|s| s.share_explained),
        corrected_model: corrected(&found.model, gap),
        floor_source: if known { "effect-free pairs" } else { "self" }.to_owned(),
        warnings: warnings(&odd, Pairing::SameLayout, bias.clips, &diagnosis.detection_limits),
        ..diagnosis
    })
}

/// Tells whether what an effect does varies with the layout, as by distance, speed or objects, or with the age of a rollout;
/// darkness falls on all distances alike.
fn varies(effect: &FrameEffect) -> bool {
    let layout = [Needs::Light, Needs::Motion, Needs::Depth, Needs::Boxes];
    effect.id == "rollout_drift"
        || effect.id != "night_illumination" && effect.needs.iter().any(|need| layout.contains(need))
}

/// Returns paths with what the texture of real frames changes about them.
fn corrected_by(paths: &[Path], signatures: &[Path]) -> Vec<Path> {
    let mut out = paths.to_vec();
    for path in &mut out {
        if let Some(more) = signatures.iter().find(|other| other.same_way(path)) {
            path.change.iter_mut().zip(&more.change).for_each(|(own, more)| *own += more);
        }
    }
    out
}

/// Returns gains and sizes of groups of effect-free clips, each against those outside of it.
fn effect_free(free: &[&DVector<f64>], clips: &[Vec<Path>]) -> (Vec<f64>, Vec<f64>) {
    let size = clips.len().min(free.len() / 2);
    let draws = Draws::from_seed(12, "groups");
    let judged = |group: u64| {
        let mut order: Vec<usize> = (0..free.len()).collect();
        order.sort_by_key(|clip| draws.u64(group * 65_536 + *clip as u64));
        let (own, others) = order.split_at(size);
        let bias = Bias::known(&others.iter().map(|k| free[*k]).collect::<Vec<_>>());
        let centre = bias.mean.clone().unwrap_or_else(|| DVector::zeros(COUNT));
        let deviations: Vec<DVector<f64>> = own.iter().map(|k| free[*k] - &centre).collect();
        let stack = Stack::new(&bias, &bias.weights(&deviations));
        let deviation = stack.of(&deviations);
        (weigh::best(&stack.paths(&clips[..size]), &deviation), deviation.norm_squared())
    };
    (0..settings::FREE_GROUPS).into_par_iter().map(judged).unzip()
}

/// Returns the lateness that most streams show, with its middle value.
fn late(readouts: &[Readout]) -> Option<(&'static FrameEffect, f64, [f64; 2])> {
    let all: Vec<Option<(&'static FrameEffect, f64)>> = readouts.iter().flat_map(|r| r.late.clone()).collect();
    let mut best: Option<(&'static FrameEffect, Vec<f64>)> = None;
    for (effect, _) in all.iter().flatten() {
        let values: Vec<f64> =
            all.iter().flatten().filter(|(other, _)| other.id == effect.id).map(|(_, v)| *v).collect();
        if values.len() * 2 > all.len() {
            best = Some((effect, values));
        }
    }
    let (effect, mut values) = best?;
    let interval = ds_stats::percentiles(values.clone(), 0.05)?;
    Some((effect, ds_stats::quantile(&mut values, 0.5), interval))
}

fn mean_gap(readouts: &[Readout]) -> [f64; 2] {
    [0, 1].map(|k| readouts.iter().map(|r| r.gap[k]).sum::<f64>() / readouts.len() as f64)
}
