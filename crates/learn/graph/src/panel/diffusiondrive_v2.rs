//! `diffusiondrive_v2`: the plans of `diffusiondrive` and copies of them at other speeds, scored, the better ones again.
//!
//! The generator is `diffusiondrive`'s, its weights as they are: its 20 plans are drawn in all steps and copied twice, each
//! copy going the plan's own way at a drawn factor of its speed, moved aside by another (multiplicative noise). The selector
//! has layers of its own: each plan reads the map at its points and attends to the map's coarse cells and the trunk's queries;
//! sub-scores of all plans, then of the best 16 after a further layer. In training plans of a vocabulary join those of the
//! generator. Plans score each by itself and carry no gradient.

use burn::tensor::Tensor;
use burn::tensor::activation::relu;
use ds_nn::array::{Array, Declared, Initial};

use super::choosing::{best, picked};
use super::diffusion::POINTS;
use super::diffusiondrive::{self, Scene, WAVES, declare_reading, embedded, points, reading, values};
use super::layers::{
    attended, declare_attention, declare_hidden, declare_norm, declare_pair, declare_tokens, hidden, norm, pair, tokens,
};
use super::sampling::Places;
use super::trunk::{self, CELLS, HEADS};
use super::vocabulary::{along_m, path_of, places, places_of, plan_of, profile_of};
use super::{Heads, Inputs, PLAN, STATE, TERMS, expected};
use crate::graph::{Graph, array_of};

/// What names of the selector's weights, the trained ones, begin with.
pub(super) const SELECTOR: &str = "selector.";
/// The name of the vocabulary's plans among the weights; not trained.
pub(super) const VOCABULARY: &str = "vocabulary";
/// Plans of the vocabulary.
const WORDS: usize = 32;
/// Copies of each plan of the generator.
const COPIES: usize = 2;
/// Normal numbers of a copy: of its speed and of how far aside it goes.
const FACTORS: usize = 2;
/// How much a normal number changes them.
const SPREAD: [f32; FACTORS] = [0.1, 0.1];
/// Plans that are scored again.
const KEPT: usize = 16;
const WIDTH: usize = 96;
const LAYERS: [&str; 2] = ["selector.coarse", "selector.fine"];
const DRAWN: usize = diffusiondrive::PLANS * POINTS;
/// Normal numbers that a sample needs: the generator's, then those of the copies.
pub(super) const NOISE: usize = DRAWN + diffusiondrive::PLANS * COPIES * FACTORS;

pub(super) fn declared() -> Vec<Declared> {
    let mut list = diffusiondrive::declared();
    list.push(Declared::new(VOCABULARY, &[WORDS, PLAN], Initial::Normal(0.5)));
    declare_pair(&mut list, "selector.plan", [2 * POINTS * WAVES + PLAN, 2 * WIDTH, WIDTH], 1.0);
    declare_pair(&mut list, "selector.state", [STATE, WIDTH, WIDTH], 1.0);
    for name in ["selector.cells", "selector.queries"] {
        Declared::linear(&mut list, name, trunk::WIDTH, WIDTH, 1.0);
    }
    declare_tokens(&mut list, "selector.places", [CELLS, WIDTH]);
    for name in LAYERS {
        declare_reading(&mut list, name, WIDTH);
        declare_attention(&mut list, &format!("{name}.scene"), WIDTH);
        declare_hidden(&mut list, &format!("{name}.mlp"), WIDTH, 4);
        declare_norm(&mut list, &format!("{name}.read.norm"), WIDTH);
        declare_pair(&mut list, &format!("{name}.read"), [WIDTH, WIDTH, TERMS], 0.2);
    }
    list
}

pub(super) fn plan(graph: &Graph, context: &Tensor<3>, state: &Tensor<2>, inputs: &Inputs<'_>) -> Heads {
    let speeds_mps = inputs.speeds_mps();
    let scene = Scene::of(graph, context.clone(), state.clone(), speeds_mps.clone());
    let [drawn, factors] = parts(inputs.noise);
    let generated = array_of(scene.answered(&drawn).plans.pop().expect("the generator has plans"));
    let mut plans = Plans { numbers: with_copies(&generated, &factors, &speeds_mps), speeds_mps };
    if inputs.times.is_some() {
        plans.join(&array_of(graph.weight::<2>(VOCABULARY, [WORDS, PLAN])));
    }
    let selector = Selector { graph, context, keys: keys(graph, &scene) };
    let told = relu(pair(graph, "selector.state", state.clone())).unsqueeze_dim::<3>(1);
    let x = pair(graph, "selector.plan", plans.embedded(graph)) + told;
    let (x, coarse) = selector.scored(LAYERS[0], x, &plans);
    let kept = best(&totals(&coarse), KEPT);
    let left = plans.picked(&kept);
    let (_, fine) = selector.scored(LAYERS[1], picked(graph, &x, &kept), &left);
    let read_outs = [plans, left].map(|plans| graph.tensor::<3>(&plans.numbers));
    Heads { plans: read_outs.into(), scores: vec![coarse, fine] }
}

/// Cells and queries of a scene, as the selector attends to them.
fn keys(graph: &Graph, scene: &Scene<'_>) -> Tensor<3> {
    let cells = graph.linear("selector.cells").apply(scene.cells.clone());
    let places = tokens(graph, "selector.places", cells.dims());
    Tensor::cat(vec![cells + places, graph.linear("selector.queries").apply(scene.queries.clone())], 1)
}

/// The generator's noise and that of the copies, [N, 320] and [N, 80].
fn parts(noise: &Array) -> [Array; 2] {
    let rows = || noise.values().chunks_exact(NOISE);
    let batch = noise.values().len() / NOISE;
    [0..DRAWN, DRAWN..NOISE].map(|part| {
        let values = rows().flat_map(|row| &row[part.clone()]).copied().collect();
        Array::new(&[batch, part.len()], values)
    })
}

/// Plans [N, 20, 24], then their copies: [N, 60, 24].
fn with_copies(plans: &Array, factors: &Array, speeds_mps: &[f32]) -> Array {
    let row = plans.values().len() / speeds_mps.len();
    let mut all = Vec::with_capacity((1 + COPIES) * plans.values().len());
    let samples = plans.values().chunks_exact(row).zip(factors.values().chunks_exact(NOISE - DRAWN));
    for ((plans, factors), speed_mps) in samples.zip(speeds_mps) {
        all.extend_from_slice(plans);
        for (plan, factors) in plans.chunks_exact(PLAN).cycle().zip(factors.chunks_exact(FACTORS)) {
            let [speed, aside] = [0, 1].map(|which| (1.0 + SPREAD[which] * factors[which]).max(0.0));
            all.extend(changed(plan, f64::from(*speed_mps), speed, aside));
        }
    }
    Array::new(&[speeds_mps.len(), (1 + COPIES) * row / PLAN, PLAN], all)
}

/// A plan that goes its own way at a factor of its speed, moved aside by another.
fn changed(plan: &[f32], speed_mps: f64, speed: f32, aside: f32) -> [f32; PLAN] {
    let driven = places_of(plan, speed_mps);
    let (path, _) = path_of(&driven);
    let ways = along_m(&profile_of(&driven, speed_mps), speed_mps).map(|along_m| speed * along_m);
    plan_of(&places(&path, &ways).map(|[x, y, heading]| [x, aside * y, aside * heading]), speed_mps)
}

/// What the coarse logits [N, M, 8] of each plan amount to, [N, M, 1].
#[expect(clippy::cast_possible_truncation, reason = "scores are single precision")]
fn totals(logits: &Tensor<3>) -> Array {
    let [batch, count, _] = logits.dims();
    let logits = array_of(logits.clone());
    Array::new(&[batch, count, 1], logits.values().chunks_exact(TERMS).map(|plan| expected(plan) as f32).collect())
}

/// Plans of some cars.
struct Plans {
    /// [N, M, 24].
    numbers: Array,
    speeds_mps: Vec<f32>,
}

impl Plans {
    fn rows(&self) -> impl Iterator<Item = &[f32]> {
        self.numbers.values().chunks_exact(self.numbers.values().len() / self.speeds_mps.len())
    }

    fn of(numbers: Vec<f32>, speeds_mps: &[f32]) -> Self {
        let count = numbers.len() / speeds_mps.len() / PLAN;
        Self { numbers: Array::new(&[speeds_mps.len(), count, PLAN], numbers), speeds_mps: speeds_mps.to_vec() }
    }

    /// Adds the same plans for every car.
    fn join(&mut self, others: &Array) {
        let numbers = self.rows().flat_map(|row| row.iter().chain(others.values())).copied().collect();
        *self = Self::of(numbers, &self.speeds_mps);
    }

    fn picked(&self, kept: &[Vec<usize>]) -> Self {
        let plans = self.rows().zip(kept).flat_map(|(row, kept)| kept.iter().map(|plan| &row[plan * PLAN..][..PLAN]));
        Self::of(plans.flatten().copied().collect(), &self.speeds_mps)
    }

    fn places(&self, graph: &Graph) -> Places {
        Places::of(graph, &points(&self.numbers), &self.speeds_mps)
    }

    /// Where they lead and their numbers, [N, M, 416 + 24].
    fn embedded(&self, graph: &Graph) -> Tensor<3> {
        let waves = embedded(&points(&self.numbers), &self.places(graph));
        Tensor::cat(vec![graph.tensor(&waves), graph.tensor(&self.numbers)], 2)
    }
}

/// What plans are scored by.
struct Selector<'a> {
    graph: &'a Graph,
    context: &'a Tensor<3>,
    keys: Tensor<3>,
}

impl Selector<'_> {
    /// Takes plans through a layer and returns their tokens and sub-scores.
    fn scored(&self, name: &str, x: Tensor<3>, plans: &Plans) -> (Tensor<3>, Tensor<3>) {
        let graph = self.graph;
        let map = (&plans.places(graph), &values(graph, name, self.context.clone()));
        let x = reading(graph, name, x, map);
        let x = attended(graph, &format!("{name}.scene"), HEADS, x, Some(&self.keys));
        let x = hidden(graph, &format!("{name}.mlp"), x);
        let scores = pair(graph, &format!("{name}.read"), norm(graph, &format!("{name}.read.norm"), x.clone()));
        (x, scores)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copy_goes_the_same_way_faster_or_slower_and_aside() {
        // A left turn of 40 m radius at 8 m/s, as offsets from going straight on.
        let turn: [[f32; 3]; 8] = std::array::from_fn(|pose| {
            let angle = 4.0 * (pose + 1) as f32 / 40.0;
            [40.0 * angle.sin(), 40.0 * (1.0 - angle.cos()), angle]
        });
        let plan = plan_of(&turn, 8.0);
        let near = |one: &[f32; 3], other: [f32; 3]| {
            assert!((one[0] - other[0]).hypot(one[1] - other[1]) < 0.3 && (one[2] - other[2]).abs() < 0.05, "{one:?}");
        };
        let same = places_of(&changed(&plan, 8.0, 1.0, 1.0), 8.0);
        same.iter().zip(turn).for_each(|(one, other)| near(one, other));
        let half = places_of(&changed(&plan, 8.0, 0.5, 1.0), 8.0);
        (0..4).for_each(|pose| near(&half[2 * pose + 1], turn[pose]));
        let aside = places_of(&changed(&plan, 8.0, 1.0, 0.9), 8.0);
        aside.iter().zip(turn).for_each(|(one, [x, y, heading])| near(one, [x, 0.9 * y, 0.9 * heading]));
        assert!(places_of(&changed(&plan, 8.0, 0.0, 1.0), 8.0).as_flattened().iter().all(|value| value.abs() < 1e-5));
    }
}
