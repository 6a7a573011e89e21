//! What every effect would do to the statistics: it is applied to the simulated stream along a path of values, and the
//! change is interpolated in between. Displacements act on their own statistics directly.
//!
//! The effect acts on real frames, whose grain and fine detail differ from the generator's: what is added in quadrature
//! weighs less where there is more already (`on_real`).

use ds_effect::FrameChain;
use ds_effect::frame::{Act, FrameEffect};
use ds_effect::frame_library;
use ds_space::draw::Draws;
use nalgebra::{DMatrix, DVector};

use crate::pairing::edges;
use crate::pairing::layers::layered;
use crate::pairing::looks::{ALL, FINE, MOVED, OWN, Stream, beyond, own};
use crate::pairing::statistics::Scope;
use crate::scene::{DETAIL, Scene};

/// Values along which an effect grows from nothing, and what each does to the statistics.
#[derive(Clone)]
pub struct Path {
    /// The effect.
    pub effect: &'static FrameEffect,
    /// The parameter that moves, of a displacement.
    pub parameter: Option<usize>,
    /// Values; the first are neutral.
    pub values: Vec<Vec<f64>>,
    /// Change of the statistics at each.
    pub change: Vec<DVector<f64>>,
}

impl Path {
    /// Tells whether both go the same way: the same effect through the same values.
    #[must_use]
    pub fn same_way(&self, other: &Self) -> bool {
        self.effect.id == other.effect.id && self.parameter == other.parameter && self.values == other.values
    }

    /// Returns the path in other units of the statistics.
    #[must_use]
    pub fn scaled(&self, root: &DMatrix<f64>) -> Self {
        Self { values: self.values.clone(), change: self.change.iter().map(|c| root * c).collect(), ..*self }
    }
}

impl std::fmt::Debug for Path {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {:?} {:?}", self.effect.id, self.values, self.change)
    }
}

/// Returns the mean of the paths of several scenes, each over the scenes that show its effect.
#[must_use]
pub fn mean(scenes: &[Vec<Path>]) -> Vec<Path> {
    let mut out: Vec<Path> = Vec::new();
    for path in scenes.iter().flatten() {
        if out.iter().any(|known| known.same_way(path)) {
            continue;
        }
        let all: Vec<&Path> = scenes.iter().flatten().filter(|other| other.same_way(path)).collect();
        let mut sum = path.clone();
        for other in &all[1..] {
            sum.change.iter_mut().zip(&other.change).for_each(|(sum, own)| *sum += own);
        }
        sum.change.iter_mut().for_each(|sum| *sum /= all.len() as f64);
        out.push(sum);
    }
    out
}

/// Returns the values tried for an effect that edits pictures or repeats frames.
fn grid(id: &str) -> Vec<Vec<Vec<f64>>> {
    let one = |values: &[&[f64]]| values.iter().map(|v| v.to_vec()).collect::<Vec<_>>();
    match id {
        "gamma" => vec![one(&[&[1.15], &[1.4]]), one(&[&[0.88], &[0.7]])],
        "white_balance" => [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, -1.0]]
            .into_iter()
            .flat_map(|[r, b]: [f64; 2]| [1.0, -1.0].map(|s| vec![vec![0.2 * s * r, 0.2 * s * b]]))
            .collect(),
        "vignetting" => vec![one(&[&[0.3, 2.5], &[0.6, 2.5]])],
        "sensor_noise" => vec![one(&[&[2.0, 1.0], &[4.0, 2.0], &[8.0, 4.0]])],
        "fog_haze" => vec![one(&[&[0.006, 0.75], &[0.015, 0.75], &[0.03, 0.75]])],
        "rain_streaks" => vec![one(&[&[80.0, 35.0], &[300.0, 35.0]])],
        "lens_dirt" => vec![one(&[&[0.4, 8.0, 60.0], &[0.8, 8.0, 60.0]])],
        "night_illumination" => vec![one(&[&[0.6, 0.4], &[0.35, 0.6], &[0.15, 0.6]])],
        "defocus" => vec![one(&[&[0.9], &[1.6], &[2.6]])],
        "motion_blur" => vec![one(&[&[10.0], &[25.0]])],
        "jpeg_loss" => vec![one(&[&[60.0], &[35.0], &[18.0]])],
        "texture_washing" => vec![one(&[&[0.5, 12.0], &[0.95, 12.0]])],
        "temporal_flicker" => vec![one(&[&[0.04], &[0.1]])],
        "rollout_drift" => vec![one(&[&[1.2, 0.07, 0.1], &[3.0, 0.07, 0.1]])],
        "exposure_lag" => vec![one(&[&[0.2], &[0.8]])],
        "dropped_frames" => vec![one(&[&[0.15], &[0.35]])],
        "object_dropout" => vec![one(&[&[0.4], &[0.8]])],
        _ => Vec::new(),
    }
}

/// The same for effects on objects that only the statistics by layers tell.
fn grid_of_objects(id: &str) -> Vec<Vec<Vec<f64>>> {
    match id {
        "object_hallucination" => vec![vec![vec![0.7], vec![2.0]]],
        "identity_switch" => vec![vec![vec![0.3], vec![0.7]]],
        "layout_misalignment" => vec![vec![vec![4.0], vec![9.0]]],
        _ => Vec::new(),
    }
}

/// Returns the paths of all effects that this scene can show; `gap` is what real frames have beyond simulated ones
/// without any effect. By layers, effects act on the real stream of a scene that has none, and `gap` is in it.
#[must_use]
pub fn paths(scene: &Scene<'_>, gap: &DVector<f64>, scope: Scope, without: &[String]) -> Vec<Path> {
    let paired = scope != Scope::Own;
    let plain = Stream::of(scene, false);
    let simulated = own(scene, &plain);
    let layers = scope == Scope::Layered;
    let base = if layers { Stream::of(scene, true) } else { Stream::of(scene, false) };
    let measured = |changed: &Stream| {
        let mut change = beyond(scene, &plain, &simulated, changed, paired);
        if !layers {
            on_real(&mut change, &simulated, gap);
        }
        let mut change = change.to_vec();
        if layers {
            change.extend(layered(scene, &plain, changed));
        }
        DVector::from_vec(change)
    };
    let before = if layers { measured(&base) } else { DVector::zeros(scope.count()) };
    let mut out = Vec::new();
    for effect in frame_library() {
        if without.iter().any(|w| w == effect.id) || !scene.can_show(effect) {
            continue;
        }
        let objects = if layers { grid_of_objects(effect.id) } else { Vec::new() };
        for nodes in grid(effect.id).into_iter().chain(objects) {
            let mut path = Path {
                effect,
                parameter: None,
                values: vec![effect.neutral()],
                change: vec![DVector::zeros(scope.count())],
            };
            for values in nodes {
                path.change.push(measured(&applied(scene, &base, effect, &values)) - &before);
                path.values.push(values);
            }
            out.push(path);
        }
    }
    if paired {
        out.extend(displaced(scene, scope, without));
    }
    out
}

/// Turns what an effect adds to the fine statistics of the simulated stream into what it would add to the real one's.
fn on_real(change: &mut [f64; ALL], simulated: &[f64; OWN], gap: &DVector<f64>) {
    for (k, offset) in FINE {
        if change[k] > 0.0 {
            let size = |statistic: f64| (statistic.exp() - offset).max(0.05);
            let (before, after, real) =
                (size(simulated[k]), size(simulated[k] + change[k]), size(simulated[k] + gap[k]));
            let added = after.powi(2) - before.powi(2);
            change[k] = (real.hypot(added.sqrt()) + offset).ln() - (real + offset).ln();
        }
    }
}

fn displaced(scene: &Scene<'_>, scope: Scope, without: &[String]) -> Vec<Path> {
    let mut out = Vec::new();
    for (at, axis) in edges::axes().into_iter().enumerate() {
        let (effect, k) = axis;
        if without.iter().any(|w| w == effect.id) || !scene.can_show(effect) {
            continue;
        }
        let slab = effect.parameters[k].slab;
        for end in [slab.0, slab.1].into_iter().filter(|e| *e != 0.0) {
            let mut values = effect.neutral();
            values[k] = end;
            let mut change = DVector::zeros(scope.count());
            change[MOVED + at] = end / edges::unit(axis);
            out.push(Path {
                effect,
                parameter: Some(k),
                values: vec![effect.neutral(), values],
                change: vec![DVector::zeros(scope.count()), change],
            });
        }
    }
    out
}

/// Returns the simulated stream with one effect.
fn applied(scene: &Scene<'_>, plain: &Stream, effect: &'static FrameEffect, values: &[f64]) -> Stream {
    let chosen = vec![(effect, values.to_vec())];
    if matches!(effect.act, Act::Age(_)) {
        return repeated(plain, values[0]);
    }
    // what is given in px is smaller in small pictures
    let small = if effect.id == "layout_misalignment" { values[0] / crate::settings::SMALL as f64 } else { values[0] };
    let small = [&[small], &values[1..]].concat();
    let (mut fine, mut coarse) = (FrameChain::new(&chosen), FrameChain::new(&[(effect, small)]));
    let case = scene.case;
    let single = DETAIL.contains(&effect.id) || matches!(effect.id, "sensor_noise" | "rain_streaks" | "motion_blur");
    let mut out = Stream { full: Vec::new(), small: Vec::new() };
    for (k, frame) in scene.frames.iter().enumerate() {
        if let Some(at) = scene.full.iter().position(|f| *f == k) {
            let mut edited = fine.edited(plain.full[at].clone(), &case.context(frame, 1, case.depth_m.as_deref()));
            edited.clip();
            out.full.push(edited);
        }
        let small = &plain.small[k];
        out.small.push(if single {
            small.clone()
        } else {
            let boxes = shrunk_boxes(frame);
            let mut context = case.context(frame, crate::settings::SMALL, scene.small_depth_m.as_deref());
            context.boxes = &boxes;
            coarse.edited(small.clone(), &context)
        });
    }
    out
}

fn shrunk_boxes(frame: &crate::case::Frame) -> Vec<ds_effect::frame::LayoutBox> {
    let s = crate::settings::SMALL as f64;
    let shrunk = |b: &ds_effect::frame::LayoutBox| ds_effect::frame::LayoutBox {
        edges: b.edges.map(|e| e / s),
        class: b.class.clone(),
    };
    frame.boxes.iter().map(shrunk).collect()
}

/// Shows the frame before instead of some frames.
fn repeated(plain: &Stream, rate: f64) -> Stream {
    let draws = Draws::from_seed(3, "repeated");
    let mut small = plain.small.clone();
    for k in 1..small.len() {
        if draws.uniform(k as u64) < rate {
            small[k] = small[k - 1].clone();
        }
    }
    Stream { full: plain.full.clone(), small }
}
