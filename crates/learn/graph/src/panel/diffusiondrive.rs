//! `diffusiondrive`: truncated diffusion; 20 anchored plans are drawn through a map of the ground, each with one logit.
//!
//! The trunk's coarse and fine cells become a map of 16×16 cells, the context. Anchors (k-means of the teacher's plans)
//! with noise go through two decoder layers: each reads the map at the plan's own points, attends to the trunk's queries,
//! which know the state, and is told the time of the schedule; it answers how far points lie from where they should be,
//! headings, and the logit. Answering takes two steps of DDIM, learning one of a drawn time. Points go from layer to layer
//! and from step to step as plain numbers, cut off from the gradient.

use burn::tensor::Tensor;
use burn::tensor::activation::{relu, softmax};
use ds_nn::array::{Array, Declared, Initial};

use super::diffusion::{POINTS, START, STEPS, noised, scaled, stepped};
use super::layers::{attended, declare_attention, declare_hidden, declare_norm, declare_pair, hidden, norm, pair};
use super::sampling::{MAP, POSES, Places};
use super::trunk::{self, CELLS, FINE, HEADS, LATENT, WIDTH, doubled, halved};
use super::{Heads, Inputs, PLAN};
use crate::graph::{Graph, array_of};

/// The name of the anchors among the weights: x and y of eight poses each, in the units of plans; not trained.
pub(super) const ANCHORS: &str = "anchors";
/// Anchors, hence plans.
pub(super) const PLANS: usize = 20;
const LAYERS: usize = 2;
/// Octaves of the embedding of a number.
const OCTAVES: usize = 6;
/// Numbers that stand for one.
pub(super) const WAVES: usize = 1 + 2 * OCTAVES;

pub(super) fn declared() -> Vec<Declared> {
    let mut list = Vec::new();
    trunk::declare(&mut list);
    trunk::declare_queries(&mut list);
    Declared::linear(&mut list, "map", WIDTH + FINE, WIDTH, 1.0);
    declare_norm(&mut list, "map.norm", WIDTH);
    list.push(Declared::new(ANCHORS, &[PLANS, POINTS], Initial::Normal(0.5)));
    declare_pair(&mut list, "points", [2 * POINTS * WAVES, 2 * WIDTH, WIDTH], 1.0);
    declare_pair(&mut list, "time", [WAVES, WIDTH, WIDTH], 1.0);
    for index in 0..LAYERS {
        let name = format!("plans{index}");
        declare_reading(&mut list, &name, WIDTH);
        declare_attention(&mut list, &format!("{name}.queries"), WIDTH);
        declare_hidden(&mut list, &format!("{name}.mlp"), WIDTH, 4);
        Declared::linear(&mut list, &format!("{name}.time"), WIDTH, 2 * WIDTH, 0.1);
        declare_norm(&mut list, &format!("{name}.read.norm"), WIDTH);
        declare_pair(&mut list, &format!("{name}.read"), [WIDTH, WIDTH, PLAN], 0.2);
        declare_pair(&mut list, &format!("{name}.score"), [WIDTH, WIDTH, 1], 0.2);
    }
    list
}

/// Declares what tokens of a width read the map by.
pub(super) fn declare_reading(list: &mut Vec<Declared>, name: &str, width: usize) {
    declare_norm(list, &format!("{name}.map.norm"), width);
    Declared::linear(list, &format!("{name}.map.weights"), width, POSES, 0.3);
    Declared::linear(list, &format!("{name}.map.values"), WIDTH, width, 1.0);
    Declared::linear(list, &format!("{name}.map.out"), width, width, 1.0);
}

/// What a map offers to the tokens of `name`.
pub(super) fn values(graph: &Graph, name: &str, map: Tensor<3>) -> Tensor<3> {
    relu(graph.linear(&format!("{name}.map.values")).apply(map))
}

/// Adds what the tokens of plans read of `values` at the plans' points, with weights that they choose.
pub(super) fn reading(graph: &Graph, name: &str, x: Tensor<3>, (places, values): (&Places, &Tensor<3>)) -> Tensor<3> {
    let linear = |part: &str| graph.linear(&format!("{name}.map.{part}"));
    let weights = linear("weights").apply(norm(graph, &format!("{name}.map.norm"), x.clone()));
    x + linear("out").apply(places.read(values.clone(), softmax(weights, 2)))
}

/// The cells of the map, [N, 256, 128], row by row.
pub(super) fn context(graph: &Graph, images: Tensor<4>) -> Tensor<3> {
    let ground = trunk::ground(graph, images);
    let cells = Tensor::cat(vec![doubled(ground.coarse, LATENT), ground.fine], 3);
    let [batch, rows, columns, _] = cells.dims();
    norm(graph, "map.norm", graph.linear("map").apply(cells).reshape([batch, rows * columns, WIDTH]))
}

pub(super) fn plan(graph: &Graph, context: Tensor<3>, state: Tensor<2>, inputs: &Inputs<'_>) -> Heads {
    let scene = Scene::of(graph, context, state, inputs.speeds_mps());
    match inputs.times {
        Some(times) => scene.drawn(noised(&anchors(graph), inputs.noise, times), times),
        None => scene.answered(inputs.noise),
    }
}

fn anchors(graph: &Graph) -> Array {
    array_of(graph.weight::<2>(ANCHORS, [PLANS, POINTS]))
}

/// What plans are drawn through, for all steps.
pub(super) struct Scene<'a> {
    graph: &'a Graph,
    /// The map in cells of the coarse grid, [N, 64, 128].
    pub(super) cells: Tensor<3>,
    /// The trunk's, which know the state: [N, 13, 128].
    pub(super) queries: Tensor<3>,
    values: [Tensor<3>; LAYERS],
    speeds_mps: Vec<f32>,
}

impl<'a> Scene<'a> {
    /// Prepares the context of some cars.
    pub(super) fn of(graph: &'a Graph, context: Tensor<3>, state: Tensor<2>, speeds_mps: Vec<f32>) -> Self {
        let [batch, ..] = context.dims();
        let cells = halved(context.clone().reshape([batch, MAP[0], MAP[1], WIDTH])).reshape([batch, CELLS, WIDTH]);
        Self {
            graph,
            queries: trunk::queries(graph, cells.clone(), state),
            cells,
            values: std::array::from_fn(|index| values(graph, &format!("plans{index}"), context.clone())),
            speeds_mps,
        }
    }

    /// Draws the anchors with noise [N, 20·16] to plans, in all steps.
    pub(super) fn answered(&self, noise: &Array) -> Heads {
        let batch = self.speeds_mps.len();
        let points = noised(&anchors(self.graph), noise, &vec![START; batch]);
        let first = self.drawn(points.clone(), &vec![STEPS[0]; batch]);
        let found = points_of(first.plans.last().expect("there are layers"));
        self.drawn(stepped(&points, &found, STEPS), &vec![STEPS[1]; batch])
    }

    /// Draws points [N, 20, 16] of some times towards plans, read out after each layer.
    fn drawn(&self, mut points: Array, times: &[u32]) -> Heads {
        let graph = self.graph;
        let time = relu(pair(graph, "time", graph.tensor::<2>(&of_times(times))));
        let mut places = Places::of(graph, &points, &self.speeds_mps);
        let mut x = pair(graph, "points", graph.tensor::<3>(&embedded(&points, &places)));
        let (mut plans, mut scores) = (Vec::with_capacity(LAYERS), Vec::with_capacity(LAYERS));
        for (index, values) in self.values.iter().enumerate() {
            let name = format!("plans{index}");
            x = self.layer(&name, x, (&places, values), &time);
            let read = norm(graph, &format!("{name}.read.norm"), x.clone());
            let plan = pair(graph, &format!("{name}.read"), read.clone()) + graph.tensor::<3>(&headed(&points));
            points = points_of(&plan);
            places = Places::of(graph, &points, &self.speeds_mps);
            plans.push(plan);
            scores.push(pair(graph, &format!("{name}.score"), read));
        }
        Heads { plans, scores }
    }

    fn layer(&self, name: &str, x: Tensor<3>, (places, values): (&Places, &Tensor<3>), time: &Tensor<2>) -> Tensor<3> {
        let linear = |part: &str| self.graph.linear(&format!("{name}.{part}"));
        let x = reading(self.graph, name, x, (places, values));
        let x = attended(self.graph, &format!("{name}.queries"), HEADS, x, Some(&self.queries));
        let x = hidden(self.graph, &format!("{name}.mlp"), x);
        let told = linear("time").apply(time.clone()).unsqueeze_dim::<3>(1);
        let [batch, ..] = told.dims();
        let part = |from: usize| told.clone().slice([0..batch, 0..1, from..from + WIDTH]);
        x * (part(0) + 1.0) + part(WIDTH)
    }
}

/// The points of plans [N, M, 24], without a gradient.
fn points_of(plans: &Tensor<3>) -> Array {
    points(&array_of(plans.clone()))
}

/// The points of plans [N, M, 24].
pub(super) fn points(plans: &Array) -> Array {
    let &[batch, count, _] = plans.shape() else { unreachable!("plans have three sides") };
    let points = plans.values().chunks_exact(3).flat_map(|pose| [pose[0], pose[1]]);
    Array::new(&[batch, count, POINTS], points.collect())
}

/// Points as plans of heading 0.
fn headed(points: &Array) -> Array {
    let &[batch, plans, _] = points.shape() else { unreachable!("points have three sides") };
    let poses = points.values().chunks_exact(2).flat_map(|point| [point[0], point[1], 0.0]);
    Array::new(&[batch, plans, PLAN], poses.collect())
}

/// Each number with its sines and cosines at octaves of half a turn.
fn waves(value: f32) -> impl Iterator<Item = f32> {
    let octave = move |octave: usize| {
        let angle = std::f32::consts::PI * value * (1 << octave) as f32;
        [angle.sin(), angle.cos()]
    };
    std::iter::once(value).chain((0..OCTAVES).flat_map(octave))
}

/// Points on the scale of diffusion and where they lie on the map.
pub(super) fn embedded(points: &Array, places: &Places) -> Array {
    let &[batch, plans, _] = points.shape() else { unreachable!("points have three sides") };
    let numbers = scaled(points);
    let rows = numbers.values().chunks_exact(POINTS).zip(places.from_middle.values().chunks_exact(POINTS));
    let values =
        rows.flat_map(|(numbers, from_middle)| numbers.iter().chain(from_middle)).flat_map(|value| waves(*value));
    Array::new(&[batch, plans, 2 * POINTS * WAVES], values.collect())
}

fn of_times(times: &[u32]) -> Array {
    let values = times.iter().flat_map(|time| waves(*time as f32 / super::diffusion::TIMES as f32));
    Array::new(&[times.len(), WAVES], values.collect())
}
