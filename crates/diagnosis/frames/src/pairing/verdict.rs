//! The diagnosis of streams that do not agree pixel by pixel: forward selection over paths, what remains, the tiles that
//! the chosen effects touch, and from which size on each effect could have been seen at all.

use std::collections::{BTreeMap, BTreeSet};

use ds_diagnosis::Verdict;
use ds_diagnosis::schema::{
    Cell, Corrected, CorrectedEffect, DetectionLimit, Diagnosis, Finding, Regime, Remainder, correct,
};
use ds_effect::frame::{Act, FrameEffect};
use nalgebra::DVector;

use crate::case::FrameCase;
use crate::error::SightError;
use crate::how_far::{Correction, FLOORS, generated};
use crate::loss::{TILES, tile};
use crate::pairing::nuisance::{Nuisance, statistics};
use crate::pairing::paths::{Path, paths};
use crate::pairing::weigh::{self, Spot};
use crate::places::excess;
use crate::scene::Scene;
use crate::scene::known;
use crate::settings;
use ds_diagnosis::meta::Pairing;

/// Diagnoses a scene of another pairing than aligned.
///
/// # Errors
/// If features of the held-out frames are not finite.
pub fn judged(
    scene: &Scene<'_>,
    pairing: Pairing,
    nuisance: &Nuisance,
    without: &[String],
) -> Result<Diagnosis, SightError> {
    let paired = pairing != Pairing::Unpaired;
    let (x, moved) = statistics(scene, pairing);
    let paths = paths(scene, &nuisance.mean, paired, without);
    let needed = weigh::needed(nuisance, &paths);
    let mut deviation = &x - &nuisance.mean;
    let mut chosen: Vec<Spot> = Vec::new();
    let mut ranked: Vec<Spot> = Vec::new();
    loop {
        let mut spots = weigh::spots(&nuisance.precision, &paths, &deviation);
        spots.retain(|s| s.gain > 0.0 && allowed_beside(&chosen, s, &paths));
        spots.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let best = spots.first().cloned();
        if chosen.is_empty() {
            ranked = spots;
        }
        let Some(best) = best.filter(|b| b.gain > needed.max(share_asked(&chosen, b, &paths))) else { break };
        deviation -= best.change(&paths);
        chosen.push(best);
    }
    let remains = weigh::square(&nuisance.precision, &deviation);
    let lateness = moved.and_then(|m| Some((m.late.effect?, m.late.interval90)));
    let late = lateness.map(|(effect, _)| effect);
    // the stand-in of a strong effect leaves a share of it
    let taken: f64 = chosen.iter().map(|c| c.gain).sum();
    let allowed = settings::STRANGE_REMAINS * (weigh::usual(nuisance) + needed) + settings::STRANGE_SHARE * taken;
    let excess = remains / allowed;
    let model = model(late, &chosen, &paths);
    let verdict = match model.len() {
        _ if excess > 1.0 => Verdict::Unknown,
        0 => Verdict::None,
        1 => Verdict::Single,
        _ => Verdict::Multiple,
    };
    let p_unknown = 1.0 / (1.0 + (-(excess.max(1e-6).ln()) / (2.0 * settings::UNKNOWN_WIDTH)).exp());
    let best = ranked.first().map_or(0.0, |s| s.gain);
    let p_none =
        if late.is_some() { 0.0 } else { (1.0 - p_unknown) / (1.0 + ((best - needed) / 6.0).clamp(-30.0, 30.0).exp()) };
    let told = Told { paths: &paths, ranked: &ranked, chosen: &chosen, model: &model, needed };
    let correction = correction(&model);
    let held = generated(
        scene.case,
        &correction,
        &|n| scene.case.held.iter().any(|f| f.number == n),
        nuisance.gap,
        "heldout",
    )?;
    let fit =
        generated(scene.case, &correction, &|n| scene.case.fit.iter().any(|f| f.number == n), nuisance.gap, "fit")?;
    let effects = told.findings(lateness, 1.0 - p_unknown - p_none);
    let limits = told.limits(nuisance);
    Ok(Diagnosis {
        verdict,
        indistinguishable: effects.iter().take(1).filter(|e| e.group.len() > 1).map(|e| e.group.clone()).collect(),
        effects,
        p_none,
        p_unknown,
        chosen: model.iter().map(|(id, _)| id.clone()).collect(),
        cells: if verdict == Verdict::None { Vec::new() } else { cells(scene, &correction) },
        how_far: held,
        predicted_share: fit.first().and_then(|s| s.share_explained),
        unknown_description: (verdict == Verdict::Unknown).then(|| describe(nuisance, &deviation, &told)),
        corrected_model: Corrected {
            effects: model.into_iter().map(|(id, values)| CorrectedEffect { id, value: values[0], values }).collect(),
            nuisance: FLOORS.iter().zip(nuisance.gap).map(|(name, gap)| ((*name).to_owned(), gap)).collect(),
            ..Corrected::default()
        },
        floor_source: if nuisance.count > 0 { "effect-free pairs" } else { "practice" }.to_owned(),
        warnings: warnings(scene.case, pairing, nuisance, &limits),
        detection_limits: limits,
        ..Diagnosis::blank(&scene.case.name)
    })
}

/// Returns the effects of the model with their values: the lateness, if there is one, and what was chosen.
fn model(late: Option<(&FrameEffect, f64)>, chosen: &[Spot], paths: &[Path]) -> Vec<(String, Vec<f64>)> {
    let mut model: Vec<(String, Vec<f64>)> = Vec::new();
    if let Some((effect, value)) = late {
        model.push((effect.id.to_owned(), vec![value]));
    }
    for spot in chosen {
        let (effect, values) = (paths[spot.path].effect, spot.values(paths));
        match model.iter_mut().find(|(id, _)| id == effect.id) {
            // another parameter of an effect that is in the model already
            Some((_, known)) => {
                let added = values.iter().zip(effect.neutral()).map(|(value, neutral)| value - neutral);
                known.iter_mut().zip(added).for_each(|(known, added)| *known += added);
            }
            None => model.push((effect.id.to_owned(), values)),
        }
    }
    model
}

fn moves(effect: &ds_effect::FrameEffect) -> bool {
    matches!(effect.act, Act::Warp(_))
}

/// Says whether a spot may join: two effects at most, and of a chosen one only other parameters of a displacement.
fn allowed_beside(chosen: &[Spot], spot: &Spot, paths: &[Path]) -> bool {
    let path = &paths[spot.path];
    let mut same = chosen.iter().map(|c| &paths[c.path]).filter(|p| p.effect.id == path.effect.id).peekable();
    if same.peek().is_some() {
        return moves(path.effect) && same.all(|p| p.parameter != path.parameter);
    }
    chosen.iter().map(|c| paths[c.path].effect.id).collect::<BTreeSet<&str>>().len() < 2
}

/// What a further spot must gain beside those chosen: edges tell displacements apart only roughly.
fn share_asked(chosen: &[Spot], spot: &Spot, paths: &[Path]) -> f64 {
    let gained: f64 = chosen.iter().map(|c| c.gain).sum();
    let effect = paths[spot.path].effect;
    if chosen.iter().any(|c| paths[c.path].effect.id == effect.id) {
        return 0.0;
    }
    let moved = moves(effect) && chosen.iter().any(|c| moves(paths[c.path].effect));
    gained * if moved { settings::FURTHER_MOVED_SHARE } else { settings::FURTHER_SHARE }
}

fn correction(model: &[(String, Vec<f64>)]) -> Correction {
    let effects = model.iter().map(|(id, values)| (known(id), values.clone())).collect();
    Correction { effects, shift: [0.0; 2], noise: 0.0, dirt: None }
}

fn warnings(case: &FrameCase, pairing: Pairing, nuisance: &Nuisance, limits: &[DetectionLimit]) -> Vec<String> {
    let mut out = case.warnings.clone();
    out.push(format!("the streams are paired as {}", pairing.name()));
    if nuisance.count == 0 {
        out.push("no effect-free pairs of this generator are given: its own gap is assumed, and wide".to_owned());
    }
    let hidden: Vec<&str> = limits.iter().filter(|l| l.limit.is_none()).map(|l| l.id.as_str()).collect();
    if !hidden.is_empty() {
        out.push(format!("not testable with this generator: {}", hidden.join(", ")));
    }
    out
}

/// What was found, for reports.
struct Told<'a> {
    paths: &'a [Path],
    ranked: &'a [Spot],
    chosen: &'a [Spot],
    model: &'a [(String, Vec<f64>)],
    needed: f64,
}

impl Told<'_> {
    fn id(&self, spot: &Spot) -> &'static str {
        self.paths[spot.path].effect.id
    }

    fn findings(&self, late: Option<((&'static FrameEffect, f64), [f64; 2])>, mass: f64) -> Vec<Finding> {
        let mut list: Vec<Finding> = Vec::new();
        if let Some(((effect, value), interval90)) = late {
            list.push(Finding {
                interval90,
                params: [(effect.parameters[0].name.to_owned(), value)].into(),
                ..self.empty(effect.id, value, 4.0 * self.needed)
            });
        }
        let firsts = self.chosen.iter().chain(self.ranked);
        for spot in firsts {
            let id = self.id(spot);
            if list.iter().any(|f| f.id == id) {
                continue;
            }
            let values = self.model.iter().find(|(known, _)| known == id).map(|(_, values)| values.clone());
            let values = values.unwrap_or_else(|| spot.values(self.paths));
            let path = &self.paths[spot.path];
            let width = (path.values[spot.at.0 + 1][0] - path.values[spot.at.0][0]).abs();
            let half = spot.error * width + settings::pairing_shape(id) * (values[0] - path.values[0][0]).abs();
            let slab = path.effect.parameters[0].slab;
            let mut finding = self.empty(id, values[0], spot.gain);
            finding.interval90 = [(values[0] - half).max(slab.0), (values[0] + half).min(slab.1)];
            finding.params = path.effect.parameters.iter().zip(&values).map(|(p, v)| (p.name.to_owned(), *v)).collect();
            finding.group = self.group(spot);
            list.push(finding);
        }
        let top = list.iter().map(|f| f.evidence_gain).fold(0.0, f64::max);
        let chosen = |f: &Finding| {
            self.chosen.iter().any(|c| self.id(c) == f.id) || late.is_some_and(|((effect, _), _)| effect.id == f.id)
        };
        let weights: Vec<f64> =
            list.iter().map(|f| if chosen(f) { 1.0 } else { ((f.evidence_gain - top) / 8.0).exp() }).collect();
        let total: f64 = weights.iter().sum();
        for (finding, weight) in list.iter_mut().zip(weights) {
            finding.probability = mass.max(0.0) * weight / total.max(1e-12);
        }
        list
    }

    fn empty(&self, id: &str, value: f64, gain: f64) -> Finding {
        Finding {
            id: id.to_owned(),
            probability: 0.0,
            value,
            unit: known(id).parameters[0].unit.to_owned(),
            interval90: [value; 2],
            group: vec![id.to_owned()],
            heldout_gain: None,
            evidence_gain: gain,
            params: BTreeMap::new(),
        }
    }

    /// Effects whose gain is nearly that of a spot.
    fn group(&self, spot: &Spot) -> Vec<String> {
        let mut group = vec![self.id(spot).to_owned()];
        for other in self.ranked {
            let id = self.id(other).to_owned();
            if group.len() < 4 && !group.contains(&id) && spot.gain - other.gain < 6.0 && other.gain > 0.5 * spot.gain {
                group.push(id);
            }
        }
        group
    }

    fn limits(&self, nuisance: &Nuisance) -> Vec<DetectionLimit> {
        let mut out: BTreeMap<&str, Option<f64>> = BTreeMap::new();
        for path in self.paths {
            let end = path.values[path.values.len() - 1][0];
            if (end - path.values[0][0]).abs() < 1e-12 {
                continue;
            }
            let found = weigh::limit(&nuisance.precision, path, self.needed);
            let entry = out.entry(path.effect.id).or_default();
            let nearer = |v: f64, w: f64| (v - path.values[0][0]).abs() < (w - path.values[0][0]).abs();
            if let Some(v) = found
                && entry.is_none_or(|w| nearer(v, w))
            {
                *entry = Some(v);
            }
        }
        for effect in ds_effect::frame_library() {
            if matches!(effect.act, Act::Warp(_)) {
                out.entry(effect.id).or_default();
            }
        }
        out.into_iter()
            .map(|(id, limit)| DetectionLimit {
                id: id.to_owned(),
                limit,
                unit: known(id).parameters[0].unit.to_owned(),
            })
            .collect()
    }
}

fn describe(nuisance: &Nuisance, left: &DVector<f64>, told: &Told<'_>) -> Remainder {
    let weighted = &nuisance.precision * left;
    let mut parts: Vec<(usize, f64)> = (0..left.len()).map(|k| (k, left[k] * weighted[k])).collect();
    parts.sort_by(|a, b| b.1.total_cmp(&a.1));
    let name = |k: usize| match k {
        0..=6 => "tone",
        7..=11 => "sharpness",
        12 | 13 => "noise",
        14 => "block edges",
        15 => "upright lines",
        16..=19 => "brightness by place",
        20 => "contrast by distance",
        21..=23 => "colour",
        24 | 25 => "fixed places",
        26..=29 => "changes over time",
        30..=34 => "brightness ratios",
        35..=42 => "displacement",
        _ => "objects",
    };
    let mut channels = BTreeMap::new();
    for (k, size) in parts.iter().take(3) {
        channels.insert(format!("camera:{}", name(*k)), size.max(0.0).sqrt());
    }
    let nearest: Vec<String> = told.ranked.iter().take(3).map(|s| told.id(s).to_owned()).collect();
    let text = format!(
        "the streams differ most in {}; nearest known effects: {}",
        parts.iter().take(2).map(|(k, _)| name(*k)).collect::<Vec<_>>().join(" and "),
        nearest.join(", ")
    );
    Remainder { channels, time_pattern: "constant".to_owned(), nearest, text, ..Remainder::default() }
}

/// Tiles in which the real frames differ from the simulated ones by a quarter more than from the corrected ones.
fn cells(scene: &Scene<'_>, correction: &Correction) -> Vec<Cell> {
    let frames: Vec<&crate::case::Frame> = scene.frames.clone();
    let changed = crate::how_far::rendered(scene.case, correction, &frames);
    // by frame and tile: sums of squares to the corrected and to the simulated frame, pixels
    let mut sums = vec![[[0.0f64; 3]; TILES]; frames.len()];
    for ((frame, picture), sums) in frames.iter().zip(&changed).zip(&mut sums) {
        let c = picture.channels;
        for (i, ((e, s), r)) in picture.data.iter().zip(&frame.sim.data).zip(&frame.real.data).enumerate() {
            let sum = &mut sums[tile(i / c % picture.width, i / c / picture.width, picture.width, picture.height)];
            sum[0] += f64::from((r - e).powi(2));
            sum[1] += f64::from((r - s).powi(2));
            sum[2] += 1.0;
        }
    }
    let mut cells = Vec::new();
    for t in 0..TILES {
        let [after, before, n] = [0, 1, 2].map(|k| sums.iter().map(|frame| frame[t][k]).sum::<f64>());
        let (after, before) = (after / n, before / n);
        if before - after > settings::TILE_EXCESS * (after + 1.0) {
            let tile = Some([t / settings::TILES[1], t % settings::TILES[1]]);
            let spans = vec![[frames[0].time_secs, frames[frames.len() - 1].time_secs]];
            let effect_size = (before / after.max(1e-9)).sqrt();
            let regime = Regime { tile, ..Regime::default() };
            let over: Vec<f64> = sums.iter().map(|frame| (frame[t][1] - frame[t][0]) / frame[t][2]).collect();
            let q_value = Some(excess(&over));
            cells.push(Cell { channel: "camera".to_owned(), regime, effect_size, q_value, t: spans });
        }
    }
    correct(&mut cells, TILES);
    cells.sort_by(|a, b| b.effect_size.total_cmp(&a.effect_size));
    cells
}
