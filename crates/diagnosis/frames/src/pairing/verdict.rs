//! The diagnosis of streams that do not agree pixel by pixel: forward selection over paths, what remains, the tiles that
//! the chosen effects touch, and from which size on each effect could have been seen at all.

use std::collections::{BTreeMap, BTreeSet};

use ds_diagnosis::Verdict;
use ds_diagnosis::schema::{
    Cell, Corrected, CorrectedEffect, DetectionLimit, Diagnosis, Finding, Regime, Remainder, correct,
};
use ds_effect::frame::{Act, FrameEffect};
use ds_effect::picture::Picture;
use nalgebra::DVector;
use rayon::prelude::*;

use crate::case::FrameCase;
use crate::error::FramesError;
use crate::how_far::{Correction, FLOORS, generated};
use crate::loss::{TILES, tile};
use crate::pairing::nuisance::Nuisance;
use crate::pairing::paths::{Path, paths};
use crate::pairing::statistics::{Scope, statistics};
use crate::pairing::weigh::{self, PathPoint};
use crate::places::excess;
use crate::scene::Scene;
use crate::scene::known;
use crate::settings;
use ds_diagnosis::meta::Pairing;

/// What a judgement stands on, in units of the spread of effect-free pairs.
pub struct Evidence {
    /// How the statistics deviate from those of effect-free pairs.
    pub deviation: DVector<f64>,
    /// Statistics that the deviation has of each clip; all of them of a pair.
    pub scope: Scope,
    /// What every effect would do to them.
    pub paths: Vec<Path>,
    /// Which effects can be told from what the generator does.
    pub testable: fn(&FrameEffect) -> bool,
    /// The gain that an effect must exceed.
    pub needed: f64,
    /// The squared distance that an effect-free pair may have.
    pub usual: f64,
    /// The effect that makes the content late, with its value and 90 % interval.
    pub late: Option<(&'static FrameEffect, f64, [f64; 2])>,
}

/// What was found in the evidence.
pub struct Found {
    /// Places chosen, the best first.
    pub chosen: Vec<PathPoint>,
    /// The best place of every path, the best first.
    pub ranked: Vec<PathPoint>,
    /// Effects of the model with their values.
    pub model: Vec<(String, Vec<f64>)>,
    /// The deviation that is left.
    left: DVector<f64>,
}

impl Evidence {
    /// Selects effects one after the other; `accepted` may refuse the first one that was not late.
    #[must_use]
    pub fn found(&self, accepted: &dyn Fn(&PathPoint) -> bool) -> Found {
        let mut left = self.deviation.clone();
        let mut chosen: Vec<PathPoint> = Vec::new();
        let mut ranked: Vec<PathPoint> = Vec::new();
        loop {
            let mut spots = weigh::spots(&self.paths, &left);
            spots.retain(|s| s.gain > 0.0 && allowed_beside(&chosen, s, &self.paths));
            spots.sort_by(|a, b| b.gain.total_cmp(&a.gain));
            let best = spots.first().cloned();
            if chosen.is_empty() {
                ranked = spots;
            }
            // signatures of clips are rough: a further effect must stand out from what the first one leaves
            let further =
                if self.scope == Scope::Layered && !chosen.is_empty() { settings::FURTHER_CLIP_GAIN } else { 1.0 };
            let asked = |b: &PathPoint| (further * self.needed).max(share_asked(&chosen, b, &self.paths));
            let Some(best) = best.filter(|b| b.gain > asked(b) && (!chosen.is_empty() || accepted(b))) else { break };
            left -= best.change(&self.paths);
            chosen.push(best);
        }
        let model = model(self.late.map(|(effect, value, _)| (effect, value)), &chosen, &self.paths);
        Found { chosen, ranked, model, left }
    }

    /// Returns the diagnosis as far as it does not depend on frames.
    #[must_use]
    pub fn diagnosis(&self, case: &str, found: &Found) -> Diagnosis {
        let remains = found.left.norm_squared();
        // the stand-in of a strong effect leaves a share of it
        let taken: f64 = found.chosen.iter().map(|c| c.gain).sum();
        let allowed = settings::STRANGE_REMAINS * (self.usual + self.needed) + settings::STRANGE_SHARE * taken;
        let excess = remains / allowed;
        let verdict = match found.model.len() {
            _ if excess > 1.0 => Verdict::Unknown,
            0 => Verdict::None,
            1 => Verdict::Single,
            _ => Verdict::Multiple,
        };
        let p_unknown = 1.0 / (1.0 + (-(excess.max(1e-6).ln()) / (2.0 * settings::UNKNOWN_WIDTH)).exp());
        let best = found.ranked.first().map_or(0.0, |s| s.gain);
        let p_none = if self.late.is_some() {
            0.0
        } else {
            (1.0 - p_unknown) / (1.0 + ((best - self.needed) / 6.0).clamp(-30.0, 30.0).exp())
        };
        let told = Findings { evidence: self, found };
        let effects = told.findings(1.0 - p_unknown - p_none);
        Diagnosis {
            verdict,
            indistinguishable: ds_diagnosis::schema::group_of_first(&effects),
            effects,
            p_none,
            p_unknown,
            chosen: found.model.iter().map(|(id, _)| id.clone()).collect(),
            unknown_description: (verdict == Verdict::Unknown).then(|| told.describe()),
            detection_limits: told.limits(),
            ..Diagnosis::blank(case)
        }
    }
}

/// Diagnoses a scene of another pairing than aligned.
///
/// # Errors
/// If features of the held-out frames are not finite.
pub fn judged(
    scene: &Scene<'_>,
    pairing: Pairing,
    nuisance: &Nuisance,
    without: &[String],
) -> Result<Diagnosis, FramesError> {
    let scope = Scope::of(pairing);
    let (x, moved) = statistics(scene, scope);
    let paths: Vec<Path> =
        paths(scene, &nuisance.mean, scope, without).iter().map(|path| path.scaled(&nuisance.root)).collect();
    let rows: Vec<DVector<f64>> = nuisance.rows.iter().map(|row| &nuisance.root * row).collect();
    let evidence = Evidence {
        scope,
        testable: |_| true,
        deviation: &nuisance.root * (&x - &nuisance.mean),
        needed: weigh::needed(rows.iter().map(|row| weigh::best(&paths, row)).collect()),
        usual: weigh::usual(rows.iter().map(DVector::norm_squared).collect()),
        late: moved.and_then(|moved| moved.late.effect.map(|(effect, value)| (effect, value, moved.late.interval90))),
        paths,
    };
    let found = evidence.found(&|_| true);
    let diagnosis = evidence.diagnosis(&scene.case.name, &found);
    let correction = correction(&found.model);
    let measured = |wanted: &[crate::case::Frame], data: &str| {
        let wanted = |n| wanted.iter().any(|f| f.number == n);
        generated(scene.case, &correction, &wanted, nuisance.gap, data)
    };
    let fit = measured(&scene.case.fit, "fit")?;
    Ok(Diagnosis {
        cells: if diagnosis.verdict == Verdict::None { Vec::new() } else { cells(scene, &correction) },
        how_far: measured(&scene.case.held, "heldout")?,
        predicted_share: fit.first().and_then(|s| s.share_explained),
        corrected_model: corrected(&found.model, nuisance.gap),
        floor_source: if nuisance.count > 0 { "effect-free pairs" } else { "practice" }.to_owned(),
        warnings: warnings(&scene.case.warnings, pairing, nuisance.count, &diagnosis.detection_limits),
        ..diagnosis
    })
}

/// Returns the corrected model as it is written: effects with their values, and the floors of this generator.
#[must_use]
pub fn corrected(model: &[(String, Vec<f64>)], gap: [f64; 2]) -> Corrected {
    let effect = |(id, values): &(String, Vec<f64>)| CorrectedEffect {
        id: id.clone(),
        value: values[0],
        values: values.clone(),
    };
    Corrected {
        effects: model.iter().map(effect).collect(),
        nuisance: FLOORS.iter().zip(gap).map(|(name, gap)| ((*name).to_owned(), gap)).collect(),
        ..Corrected::default()
    }
}

/// Returns the effects of the model with their values: the lateness, if there is one, and what was chosen.
fn model(late: Option<(&FrameEffect, f64)>, chosen: &[PathPoint], paths: &[Path]) -> Vec<(String, Vec<f64>)> {
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
fn allowed_beside(chosen: &[PathPoint], spot: &PathPoint, paths: &[Path]) -> bool {
    let path = &paths[spot.path];
    let mut same = chosen.iter().map(|c| &paths[c.path]).filter(|p| p.effect.id == path.effect.id).peekable();
    if same.peek().is_some() {
        return moves(path.effect) && same.all(|p| p.parameter != path.parameter);
    }
    chosen.iter().map(|c| paths[c.path].effect.id).collect::<BTreeSet<&str>>().len() < 2
}

/// What a further spot must gain beside those chosen: edges tell displacements apart only roughly.
fn share_asked(chosen: &[PathPoint], spot: &PathPoint, paths: &[Path]) -> f64 {
    let gained: f64 = chosen.iter().map(|c| c.gain).sum();
    let effect = paths[spot.path].effect;
    if chosen.iter().any(|c| paths[c.path].effect.id == effect.id) {
        return 0.0;
    }
    let moved = moves(effect) && chosen.iter().any(|c| moves(paths[c.path].effect));
    gained * if moved { settings::FURTHER_MOVED_SHARE } else { settings::FURTHER_SHARE }
}

/// Returns what a model does to frames.
#[must_use]
pub fn correction(model: &[(String, Vec<f64>)]) -> Correction {
    let effects = model.iter().map(|(id, values)| (known(id), values.clone())).collect();
    Correction { effects, shift: [0.0; 2], noise: 0.0, dirt: None }
}

/// Returns what a reader must know beside the warnings of the case.
#[must_use]
pub fn warnings(case: &[String], pairing: Pairing, free_pairs: usize, limits: &[DetectionLimit]) -> Vec<String> {
    let mut out = case.to_vec();
    out.push(format!("the streams are paired as {}", pairing.name()));
    if free_pairs == 0 {
        out.push("no effect-free pairs of this generator are given: its own gap is assumed, and wide".to_owned());
    }
    let hidden: Vec<&str> = limits.iter().filter(|l| l.limit.is_none()).map(|l| l.id.as_str()).collect();
    if !hidden.is_empty() {
        out.push(format!("not testable with this generator: {}", hidden.join(", ")));
    }
    out
}

/// What was found, for reports.
struct Findings<'a> {
    evidence: &'a Evidence,
    found: &'a Found,
}

impl Findings<'_> {
    fn id(&self, spot: &PathPoint) -> &'static str {
        self.evidence.paths[spot.path].effect.id
    }

    fn findings(&self, mass: f64) -> Vec<Finding> {
        let mut list: Vec<Finding> = Vec::new();
        if let Some((effect, value, interval90)) = self.evidence.late {
            list.push(Finding {
                interval90,
                params: [(effect.parameters[0].name.to_owned(), value)].into(),
                ..self.empty(effect.id, value, 4.0 * self.evidence.needed)
            });
        }
        let firsts = self.found.chosen.iter().chain(&self.found.ranked);
        for spot in firsts {
            let id = self.id(spot);
            if list.iter().any(|f| f.id == id) {
                continue;
            }
            let values = self.found.model.iter().find(|(known, _)| known == id).map(|(_, values)| values.clone());
            let values = values.unwrap_or_else(|| spot.values(&self.evidence.paths));
            let path = &self.evidence.paths[spot.path];
            let width = (path.values[spot.at.0 + 1][0] - path.values[spot.at.0][0]).abs();
            let shape = match self.evidence.scope {
                Scope::Layered => settings::clip_shape(moves(path.effect)).max(settings::pairing_shape(id)),
                Scope::Own | Scope::Paired => settings::pairing_shape(id),
            };
            let half = spot.error * width + shape * (values[0] - path.values[0][0]).abs();
            let slab = path.effect.parameters[0].slab;
            let mut finding = self.empty(id, values[0], spot.gain);
            finding.interval90 = [(values[0] - half).max(slab.0), (values[0] + half).min(slab.1)];
            finding.params = path.effect.parameters.iter().zip(&values).map(|(p, v)| (p.name.to_owned(), *v)).collect();
            finding.group = self.group(spot);
            list.push(finding);
        }
        let top = list.iter().map(|f| f.evidence_gain).fold(0.0, f64::max);
        let chosen = |f: &Finding| self.found.model.iter().any(|(id, _)| *id == f.id);
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
    fn group(&self, spot: &PathPoint) -> Vec<String> {
        let mut group = vec![self.id(spot).to_owned()];
        for other in &self.found.ranked {
            let id = self.id(other).to_owned();
            if group.len() < 4 && !group.contains(&id) && spot.gain - other.gain < 6.0 && other.gain > 0.5 * spot.gain {
                group.push(id);
            }
        }
        group
    }

    fn limits(&self) -> Vec<DetectionLimit> {
        let Evidence { paths, needed, testable, scope, .. } = self.evidence;
        let layered = *scope == Scope::Layered;
        let limits: Vec<Option<f64>> = paths
            .par_iter()
            .map(|path| {
                let others: Vec<Path> = if layered {
                    paths.iter().filter(|o| o.effect.id != path.effect.id).cloned().collect()
                } else {
                    Vec::new()
                };
                testable(path.effect).then(|| weigh::limit(path, *needed, &others)).flatten()
            })
            .collect();
        let mut out: BTreeMap<&str, Option<f64>> = BTreeMap::new();
        for (path, found) in paths.iter().zip(limits) {
            let end = path.values[path.values.len() - 1][0];
            if (end - path.values[0][0]).abs() < 1e-12 {
                continue;
            }
            let entry = out.entry(path.effect.id).or_default();
            let nearer = |v: f64, w: f64| (v - path.values[0][0]).abs() < (w - path.values[0][0]).abs();
            if let Some(v) = found
                && entry.is_none_or(|w| nearer(v, w))
            {
                *entry = Some(v);
            }
        }
        for effect in ds_effect::frame_library() {
            // the age of the content is no statistic
            let aged = matches!(effect.id, "obs_latency" | "condition_delay");
            if matches!(effect.act, Act::Warp(_)) || (layered && !aged) {
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

    /// Describes what is left of the deviation.
    fn describe(&self) -> Remainder {
        let count = self.evidence.scope.count();
        let mut parts: Vec<(usize, f64)> = (0..count).map(|k| (k, 0.0)).collect();
        for (k, left) in self.found.left.iter().enumerate() {
            parts[k % count].1 += left * left;
        }
        parts.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut channels = BTreeMap::new();
        for (k, size) in parts.iter().take(3) {
            channels.insert(format!("camera:{}", subject(*k)), size.sqrt());
        }
        let nearest: Vec<String> = self.found.ranked.iter().take(3).map(|s| self.id(s).to_owned()).collect();
        let text = format!(
            "the streams differ most in {}; nearest known effects: {}",
            parts.iter().take(2).map(|(k, _)| subject(*k)).collect::<Vec<_>>().join(" and "),
            nearest.join(", ")
        );
        Remainder { channels, time_pattern: "constant".to_owned(), nearest, text, ..Remainder::default() }
    }
}

/// Returns what a statistic is about.
fn subject(statistic: usize) -> &'static str {
    match statistic {
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
        43 => "objects",
        44..=47 => "brightness by distance",
        48..=53 => "contrast by distance",
        54..=56 => "edges",
        57 | 58 => "changes over time",
        _ => "objects",
    }
}

/// Tiles in which the real frames differ from the simulated ones by a quarter more than from the corrected ones.
fn cells(scene: &Scene<'_>, correction: &Correction) -> Vec<Cell> {
    let frames = &scene.frames;
    let span = [frames[0].time_secs, frames[frames.len() - 1].time_secs];
    let rows = by_frame(scene.case, correction);
    let of = |t: usize| cell(t, &rows.iter().map(|row| row[t]).collect::<Vec<_>>(), span, &excess);
    let mut cells: Vec<Cell> = (0..TILES).filter_map(of).collect();
    correct(&mut cells, TILES);
    cells.sort_by(|a, b| b.effect_size.total_cmp(&a.effect_size));
    cells
}

/// Returns a tile as a cell, if it counts: mean squares to the corrected and to the simulated stream in each unit, and the
/// chance of units to differ by so much if they do not.
#[must_use]
pub fn cell(t: usize, units: &[[f64; 2]], span: [f64; 2], chance: &dyn Fn(&[f64]) -> f64) -> Option<Cell> {
    let mean = |k: usize| units.iter().map(|unit| unit[k]).sum::<f64>() / units.len() as f64;
    let (after, before) = (mean(0), mean(1));
    let over: Vec<f64> = units.iter().map(|unit| unit[1] - unit[0]).collect();
    let tile = Some([t / settings::TILES[1], t % settings::TILES[1]]);
    (before - after > settings::TILE_EXCESS * (after + 1.0)).then(|| Cell {
        channel: "camera".to_owned(),
        regime: Regime { tile, ..Regime::default() },
        effect_size: (before / after.max(1e-9)).sqrt(),
        q_value: Some(chance(&over)),
        t: vec![span],
    })
}

/// Returns the mean squares of every tile over the frames of a fit: to the corrected and to the simulated stream.
#[must_use]
pub fn tiles(case: &FrameCase, correction: &Correction) -> [[f64; 2]; TILES] {
    let rows = by_frame(case, correction);
    let mean = |t: usize, k: usize| rows.iter().map(|row| row[t][k]).sum::<f64>() / rows.len().max(1) as f64;
    std::array::from_fn(|t| [mean(t, 0), mean(t, 1)])
}

/// The same frame by frame.
fn by_frame(case: &FrameCase, correction: &Correction) -> Vec<[[f64; 2]; TILES]> {
    let frames: Vec<&crate::case::Frame> = case.fit.iter().collect();
    let changed = crate::how_far::rendered(case, correction, &frames);
    let of = |(frame, picture): (&&crate::case::Frame, &Picture)| {
        let mut sums = [[0.0f64; 3]; TILES];
        let c = picture.channels;
        for (i, ((e, s), r)) in picture.data.iter().zip(&frame.sim.data).zip(&frame.real.data).enumerate() {
            let sum = &mut sums[tile(i / c % picture.width, i / c / picture.width, picture.width, picture.height)];
            sum[0] += f64::from((r - e).powi(2));
            sum[1] += f64::from((r - s).powi(2));
            sum[2] += 1.0;
        }
        sums.map(|[after, before, n]| [after / n, before / n])
    };
    frames.iter().zip(&changed).map(of).collect()
}
