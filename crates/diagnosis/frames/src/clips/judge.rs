//! The diagnosis of a case of several clips: the real stream minus the mean over seeds is a bias of the generator, what an
//! effect does to the layouts of the clip, what is peculiar to the clip, and (1 + 1/G) of the scatter of seeds.
//!
//! With effect-free clips bias and spread are known. Without, the bias is free: what does the same to all clips cannot be
//! told from it and is not testable.

use ds_diagnosis::meta::Pairing;
use ds_diagnosis::schema::Diagnosis;
use ds_effect::frame::FrameEffect;
use ds_space::draw::Draws;
use nalgebra::DVector;
use rayon::prelude::*;

use crate::clips::bias::{Bias, within};
use crate::clips::readout::Readout;
use crate::clips::stack::Stack;
use crate::clips::{ClipCase, flips, remains};
use crate::error::SightError;
use crate::pairing::looks::ALL;
use crate::pairing::nuisance::Nuisance;
use crate::pairing::paths::Path;
use crate::pairing::verdict::{Evidence, corrected, correction, warnings};
use crate::pairing::weigh;
use crate::settings;

/// Diagnoses a case of several clips.
///
/// # Errors
/// If a file is missing or spoiled, or there are too few clips.
pub fn judged(case: &ClipCase, nuisance: Option<&Nuisance>, without: &[String]) -> Result<Diagnosis, SightError> {
    if case.clips.len() < settings::FEWEST_CLIPS {
        let (found, needed, case) = (case.clips.len(), settings::FEWEST_CLIPS, case.name.clone());
        return Err(SightError::TooFewClips { found, needed, case });
    }
    let gap = nuisance.map_or_else(|| DVector::zeros(ALL), |known| known.mean.clone());
    let readouts: Vec<Readout> =
        case.clips.par_iter().map(|clip| Readout::of(clip, Some(&gap), without)).collect::<Result<_, _>>()?;
    let free_rows: Vec<&DVector<f64>> = nuisance.iter().flat_map(|known| &known.raw).collect();
    let rows: Vec<DVector<f64>> = readouts.iter().map(Readout::mean).collect();
    let bias = if free_rows.is_empty() {
        let seeds: Vec<&[DVector<f64>]> = readouts.iter().map(|r| r.rows.as_slice()).collect();
        Bias::free(&rows.iter().collect::<Vec<_>>(), &within(&seeds), readouts[0].rows.len())
    } else {
        Bias::known(&free_rows)
    };
    let clips: Vec<Vec<Path>> = readouts.iter().map(|r| r.paths.clone()).collect();
    let stack = Stack::new(&bias, rows.len());
    let paths = stack.paths(&clips);
    let centre = bias.mean.clone().unwrap_or_else(|| rows.iter().sum::<DVector<f64>>() / rows.len() as f64);
    let deviations: Vec<DVector<f64>> = rows.iter().map(|row| row - &centre).collect();
    let (gains, sizes) = effect_free(&free_rows, &clips);
    let deviation = stack.of(&deviations);
    // a spread that is the case's own finds nothing in it strange
    let usual = if sizes.is_empty() { deviation.norm_squared() } else { weigh::usual(sizes) };
    let evidence = Evidence { deviation, needed: weigh::needed(gains), usual, late: late(&readouts), paths };
    // the bias is known from so many clips only: its error is common to all deviations
    let widened = if bias.clips > 0 { 1.0 + rows.len() as f64 / bias.clips as f64 } else { 1.0 };
    let chance = flips::chance(&deviations, widened, &|flipped| weigh::best(&evidence.paths, &stack.of(flipped)));
    let found = evidence.found(&|_| chance <= settings::MOST_CHANCE);
    let diagnosis = evidence.diagnosis(&case.name, &found);
    let gap = nuisance.map_or_else(|| mean_gap(&readouts), |known| known.gap);
    let left = remains::measured(case, &correction(&found.model), gap)?;
    let odd: Vec<String> = readouts.iter().flat_map(|r| r.warnings.clone()).collect();
    let cells = if diagnosis.verdict == ds_diagnosis::Verdict::None { Vec::new() } else { left.cells };
    Ok(Diagnosis {
        cells,
        how_far: left.held,
        predicted_share: left.fit.first().and_then(|s| s.share_explained),
        corrected_model: corrected(&found.model, gap),
        floor_source: if bias.clips > 0 { "effect-free pairs" } else { "self" }.to_owned(),
        warnings: warnings(&odd, Pairing::SameLayout, bias.clips, &diagnosis.detection_limits),
        ..diagnosis
    })
}

/// Returns gains and sizes of groups of effect-free clips, each against those outside of it.
fn effect_free(free: &[&DVector<f64>], clips: &[Vec<Path>]) -> (Vec<f64>, Vec<f64>) {
    let size = clips.len().min(free.len() / 2);
    let draws = Draws::from_seed(12, "groups");
    let groups = if size < 2 { 0 } else { settings::FREE_GROUPS };
    let judged = |group: u64| {
        let mut order: Vec<usize> = (0..free.len()).collect();
        order.sort_by_key(|clip| draws.u64(group * 65_536 + *clip as u64));
        let (own, others) = order.split_at(size);
        let bias = Bias::known(&others.iter().map(|k| free[*k]).collect::<Vec<_>>());
        let stack = Stack::new(&bias, size);
        let centre = bias.mean.unwrap_or_else(|| DVector::zeros(ALL));
        let deviation = stack.of(&own.iter().map(|k| free[*k] - &centre).collect::<Vec<_>>());
        (weigh::best(&stack.paths(&clips[..size]), &deviation), deviation.norm_squared())
    };
    (0..groups).into_par_iter().map(judged).unzip()
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
