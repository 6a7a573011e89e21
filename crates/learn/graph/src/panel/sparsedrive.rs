//! `sparsedrive`: plans out of a vocabulary of paths and of profiles of speed, filtered twice, then scored together.
//!
//! Frame → maps of 12×20 and 6×10 cells; both, cell by cell, are the context. Every path reads the maps where its points
//! on the ground, and half a metre above, lie in the known camera; profiles attend to the coarse map; a logit each. The
//! better ones go through a second layer. The best paths with the best profiles are plans, which read the maps at their
//! own poses and get a logit and sub-scores. What is left out on the way keeps the logit [`LEFT_OUT`], without a
//! gradient, and so do the plans: they are the vocabulary's.

use burn::tensor::Tensor;
use burn::tensor::activation::{relu, softmax};
use ds_nn::array::{Array, Declared, Initial};

use super::choosing::{best, ones, picked};
use super::layers::{
    attended, block, declare_attention, declare_block, declare_hidden, declare_norm, declare_pair, declare_stage,
    declare_tokens, hidden, norm, pair, stage, tokens,
};
use super::trunk::{doubled, halved};
use super::view::{MAPS, Views};
use super::vocabulary::{self, PATH, POINTS, PROFILE};
use super::{Heads, Inputs, PLAN, STATE, TERMS};
use crate::graph::{Graph, array_of};

/// The name of the paths among the weights, in metres; not trained.
pub(super) const PATHS: &str = "paths";
/// The name of the profiles, in the unit of x; not trained.
pub(super) const PROFILES: &str = "profiles";
/// The logit of what a layer was not shown.
pub const LEFT_OUT: f32 = -30.0;

/// Paths and profiles of the vocabulary, then those that each layer keeps.
const KEPT: [[usize; 2]; 3] = [[128, 32], [32, 16], [8, 8]];
const WIDTH: usize = 96;
const HEADS: usize = 4;
/// Heights above the ground at which maps are read.
const HEIGHTS: usize = 2;
/// Metres that are one to the network.
const SCALE_M: f32 = 20.0;
const COARSE: usize = MAPS[1][0] * MAPS[1][1];

pub(super) fn declared() -> Vec<Declared> {
    let mut list = Vec::new();
    declare_stage(&mut list, "stage0", 48, 32);
    declare_stage(&mut list, "stage1", 4 * 32, 64);
    declare_stage(&mut list, "stage2", 4 * 64, 128);
    for (name, width) in [("fine", 64), ("coarse", 128)] {
        Declared::linear(&mut list, &format!("{name}.neck"), width, WIDTH, 1.0);
        Declared::linear(&mut list, &format!("{name}.convolution"), 9 * WIDTH, WIDTH, 1.0);
        declare_norm(&mut list, &format!("{name}.norm"), WIDTH);
    }
    list.push(Declared::new(PATHS, &[KEPT[0][0], PATH], Initial::Normal(10.0)));
    list.push(Declared::new(PROFILES, &[KEPT[0][1], PROFILE], Initial::Normal(0.5)));
    declare_tokens(&mut list, "places", [COARSE, WIDTH]);
    declare_pair(&mut list, "state", [STATE, WIDTH, WIDTH], 1.0);
    declare_pair(&mut list, "path", [PATH, WIDTH, WIDTH], 1.0);
    declare_pair(&mut list, "profile", [PROFILE, WIDTH, WIDTH], 1.0);
    for layer in 0..2 {
        declare_reading(&mut list, &format!("paths{layer}"), POINTS);
        declare_block(&mut list, &format!("profiles{layer}"), WIDTH, 2, true);
        for name in ["paths", "profiles"] {
            declare_norm(&mut list, &format!("{name}{layer}.read.norm"), WIDTH);
            declare_pair(&mut list, &format!("{name}{layer}.read"), [WIDTH, WIDTH, 1], 0.2);
        }
    }
    declare_reading(&mut list, "plans", PROFILE);
    declare_norm(&mut list, "plans.read.norm", WIDTH);
    declare_pair(&mut list, "plans.choice", [WIDTH, WIDTH, 1], 0.2);
    declare_pair(&mut list, "plans.terms", [WIDTH, WIDTH, TERMS], 0.2);
    list
}

/// A layer that reads the maps at so many points on the ground, then compares its tokens.
fn declare_reading(list: &mut Vec<Declared>, name: &str, points: usize) {
    declare_norm(list, &format!("{name}.map.norm"), WIDTH);
    Declared::linear(list, &format!("{name}.map.weights"), WIDTH, MAPS.len() * HEIGHTS * points, 0.3);
    Declared::linear(list, &format!("{name}.map.values"), WIDTH, WIDTH, 1.0);
    Declared::linear(list, &format!("{name}.map.out"), WIDTH, WIDTH, 1.0);
    declare_attention(list, &format!("{name}.self"), WIDTH);
    declare_hidden(list, &format!("{name}.mlp"), WIDTH, 2);
}

/// What the frame shows, [N, cells, 96] each: 12×20 cells, then 6×10.
fn maps(graph: &Graph, images: Tensor<4>) -> [Tensor<3>; 2] {
    let fine = stage(graph, "stage1", 2, stage(graph, "stage0", 4, images));
    let coarse = graph.linear("coarse.neck").apply(stage(graph, "stage2", 2, fine.clone()));
    let [batch, rows, columns, _] = coarse.dims();
    let below = doubled(coarse.clone().reshape([batch, rows * columns, WIDTH]), [rows, columns]);
    let fine = graph.linear("fine.neck").apply(fine) + below;
    [("fine", fine), ("coarse", coarse)].map(|(name, map)| {
        let [batch, rows, columns, _] = map.dims();
        let map = map.clone() + relu(graph.linear(&format!("{name}.convolution")).convolve(map));
        norm(graph, &format!("{name}.norm"), map.reshape([batch, rows * columns, WIDTH]))
    })
}

/// Both maps, [N, 60, 192]: each coarse cell with the mean of the fine ones in it, so that the mean over cells is that of each map.
pub(super) fn context(graph: &Graph, images: Tensor<4>) -> Tensor<3> {
    let [fine, coarse] = maps(graph, images);
    let [batch, ..] = fine.dims();
    Tensor::cat(vec![coarse, halved(fine.reshape([batch, MAPS[0][0], MAPS[0][1], WIDTH]))], 2)
}

pub(super) fn plan(graph: &Graph, inputs: &Inputs<'_>) -> Heads {
    let maps = maps(graph, graph.tensor::<4>(inputs.images));
    let [batch, ..] = maps[0].dims();
    let scene = Scene {
        graph,
        keys: maps[1].clone() + tokens(graph, "places", [batch, COARSE, WIDTH]),
        maps,
        paths: array_of(graph.weight::<2>(PATHS, [KEPT[0][0], PATH])),
        profiles: array_of(graph.weight::<2>(PROFILES, [KEPT[0][1], PROFILE])),
        speeds_mps: inputs.speeds_mps(),
    };
    let told = relu(pair(graph, "state", graph.tensor::<2>(inputs.state))).unsqueeze_dim::<3>(1);
    let embedded = |name: &str, words: &Array, scale: f32| {
        let words = pair(graph, name, graph.tensor::<2>(words) / scale);
        words.unsqueeze_dim::<3>(0).repeat_dim(0, batch) + told.clone()
    };
    let mut chosen = [KEPT[0][0], KEPT[0][1]].map(|count| vec![(0..count).collect::<Vec<usize>>(); batch]);
    let mut words = [embedded("path", &scene.paths, SCALE_M), embedded("profile", &scene.profiles, 1.0)];
    let mut scores = Vec::new();
    for layer in 0..2 {
        let [paths, profiles] = words;
        let views = scene.views_of_paths(&chosen[0]);
        let paths = scene.reading(&format!("paths{layer}"), paths, &views);
        let profiles = block(graph, &format!("profiles{layer}"), HEADS, profiles, Some(&scene.keys));
        words = [("paths", paths, 0), ("profiles", profiles, 1)].map(|(name, x, which)| {
            let read = norm(graph, &format!("{name}{layer}.read.norm"), x.clone());
            let logits = pair(graph, &format!("{name}{layer}.read"), read);
            let kept = best(&array_of(logits.clone()), KEPT[layer + 1][which]);
            scores.push(spread(graph, logits, &chosen[which], KEPT[0][which]));
            let left = picked(graph, &x, &kept);
            for (chosen, kept) in chosen[which].iter_mut().zip(&kept) {
                *chosen = kept.iter().map(|place| chosen[*place]).collect();
            }
            left
        });
    }
    let (plans, logits) = scene.plans(words, &chosen);
    scores.extend(logits);
    Heads { plans: vec![plans], scores }
}

/// What plans are chosen by.
struct Scene<'a> {
    graph: &'a Graph,
    maps: [Tensor<3>; 2],
    /// The coarse map with places, for profiles.
    keys: Tensor<3>,
    paths: Array,
    profiles: Array,
    speeds_mps: Vec<f32>,
}

impl Scene<'_> {
    fn path(&self, index: usize) -> &[f32] {
        &self.paths.values()[index * PATH..][..PATH]
    }

    /// Where the points of each sample's paths lie in the maps.
    fn views_of_paths(&self, chosen: &[Vec<usize>]) -> Views {
        let points = chosen.iter().flatten().flat_map(|index| self.path(*index).chunks_exact(2));
        let points = points.map(|point| [point[0], point[1]]);
        Views::of(self.graph, points, [chosen.len(), chosen[0].len(), POINTS])
    }

    /// Reads the maps, compares the tokens, and goes through two layers.
    fn reading(&self, name: &str, x: Tensor<3>, views: &Views) -> Tensor<3> {
        let graph = self.graph;
        let linear = |part: &str| graph.linear(&format!("{name}.map.{part}"));
        let weights = softmax(linear("weights").apply(norm(graph, &format!("{name}.map.norm"), x.clone())), 2);
        let values = linear("values");
        let read = views.read([0, 1].map(|map: usize| values.apply(self.maps[map].clone())), &weights);
        let x = x + linear("out").apply(read);
        hidden(graph, &format!("{name}.mlp"), attended(graph, &format!("{name}.self"), HEADS, x, None))
    }

    /// Every path that is left with every profile: plans, the logit of each and its sub-scores.
    fn plans(&self, [paths, profiles]: [Tensor<3>; 2], chosen: &[Vec<Vec<usize>>; 2]) -> (Tensor<3>, [Tensor<3>; 2]) {
        let graph = self.graph;
        let [batch, ways, _] = paths.dims();
        let [_, speeds, _] = profiles.dims();
        let (mut plans, mut points) = (Vec::new(), Vec::new());
        for (sample, speed_mps) in self.speeds_mps.iter().enumerate() {
            let speed_mps = f64::from(*speed_mps);
            for path in &chosen[0][sample] {
                for profile in &chosen[1][sample] {
                    let profile = &self.profiles.values()[profile * PROFILE..][..PROFILE];
                    let places = vocabulary::places(self.path(*path), &vocabulary::along_m(profile, speed_mps));
                    plans.extend(vocabulary::plan_of(&places, speed_mps));
                    points.extend(places.map(|[x, y, _]| [x, y]));
                }
            }
        }
        let views = Views::of(graph, points.into_iter(), [batch, ways * speeds, PROFILE]);
        let paths = paths.unsqueeze_dim::<4>(2).repeat_dim(2, speeds);
        let x = (paths + profiles.unsqueeze_dim::<4>(1)).reshape([batch, ways * speeds, WIDTH]);
        let read = norm(graph, "plans.read.norm", self.reading("plans", x, &views));
        let logits = ["plans.choice", "plans.terms"].map(|name| pair(graph, name, read.clone()));
        (graph.tensor(&Array::new(&[batch, ways * speeds, PLAN], plans)), logits)
    }
}

/// Logits [N, M, 1] at their places among all words; what is not there was left out.
fn spread(graph: &Graph, logits: Tensor<3>, places: &[Vec<usize>], words: usize) -> Tensor<3> {
    let mut absent = vec![LEFT_OUT; places.len() * words];
    for (sample, place) in places.iter().enumerate().flat_map(|(sample, all)| all.iter().map(move |p| (sample, p))) {
        absent[sample * words + place] = 0.0;
    }
    let absent = graph.tensor(&Array::new(&[places.len(), words, 1], absent));
    ones(graph, places, words).swap_dims(1, 2).matmul(logits) + absent
}
