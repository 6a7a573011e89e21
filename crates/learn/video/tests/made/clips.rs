//! What both tests of bodies draw: weights in which nothing is zero, shapes, clips, and the distance of two results.

use ds_nn::array::{Array, Declared, Initial, Weights};
use ds_nn::cache::{CachePolicy, Positions, ReadOrder};
use ds_nn::dit::DitShape;
use ds_nn::step::{CausalPlan, ClipBatch, Level, Prediction};
use ds_space::{Digest, Draws};
use ds_video::ModelConfig;

pub(crate) fn draw(name: &str, shape: &[usize]) -> Array {
    Array::normal(shape, &Draws::from_seed(7, name))
}

/// Weights in which nothing is zero, so that no part is idle.
pub(crate) fn weights(declared: &[Declared]) -> Weights {
    let mut weights = Weights::initialised(declared, &Digest::of(b"fast"));
    for declared in declared.iter().filter(|declared| !matches!(declared.initial, Initial::Normal(_))) {
        let draws = draw(&declared.name, &declared.shape);
        let array = weights.get(&declared.name).expect("declared").clone();
        let values = array.values().iter().zip(draws.values()).map(|(a, b)| a + 0.1 * b).collect();
        weights.insert(&declared.name, Array::new(&declared.shape, values));
    }
    weights
}

/// The presets of configs/models, and one of odd sizes.
pub(crate) fn shapes() -> [DitShape; 3] {
    let preset = |text| ModelConfig::parse(text).expect("a preset is valid").dit();
    let smoke = preset(include_str!("../../../../../configs/models/smoke.toml"));
    let cpu_train = preset(include_str!("../../../../../configs/models/cpu_train.toml"));
    let odd = DitShape {
        layers: 3,
        dim: 60,
        heads: 3,
        ffn: 70,
        latent_channels: 3,
        control_inputs: 12,
        control_channels: 5,
        start_channels: 3,
        freq_dim: 18,
        image_context: true,
        cross_every: 2,
        grid_h: 3,
        grid_w: 7,
        ..smoke.clone()
    };
    [smoke, cpu_train, odd]
}

/// Returns the largest difference over the largest expected value.
pub(crate) fn distance(found: &[f32], expected: &[f32]) -> f32 {
    assert_eq!(found.len(), expected.len());
    let largest = expected.iter().fold(0.0f32, |w, x| w.max(x.abs()));
    let worst = found.iter().zip(expected).fold(0.0f32, |w, (a, b)| if (a - b).abs() <= w { w } else { (a - b).abs() });
    worst / largest
}

pub(crate) const FRAMES: usize = 6;

pub(crate) fn clips(shape: &DitShape, clips: usize) -> ClipBatch {
    let n = shape.tokens();
    ClipBatch {
        clean: draw("clean", &[clips, FRAMES, n, 4, shape.latent_channels]),
        start: draw("start", &[clips, n, 4, shape.latent_channels]),
        given_on: (0..clips).map(|clip| if clip == 2 { 0.0 } else { 1.0 }).collect(),
        layouts: draw("layouts", &[clips, FRAMES * n, 4, shape.control_inputs]),
        layout_on: (0..clips).map(|clip| if clip == 1 { 0.0 } else { 1.0 }).collect(),
        text: draw("text", &[clips, shape.text_len, shape.text_dim]),
        emphasis: Array::new(&[clips, FRAMES, n, 4, 1], vec![1.0; clips * FRAMES * n * 4]),
    }
}

/// Chunk, window, queries, whether context is trained, whether it is detached.
pub(crate) type Case = (usize, usize, std::ops::Range<usize>, bool, bool);

/// A causal step of a case.
pub(crate) fn plan(
    shape: &DitShape,
    count: usize,
    case: &Case,
    positions: Positions,
    prediction: Prediction,
) -> CausalPlan {
    let (chunk, window, queries, trained, detached) = case.clone();
    let (n, z) = (shape.tokens(), shape.latent_channels);
    CausalPlan {
        cache: CachePolicy { window, sink: 1, chunk, positions, order: ReadOrder::Slot },
        context: draw("context", &[count, FRAMES - 1, n, 4, z]),
        context_level: Level(0.6),
        context_trained: trained,
        context_detached: detached,
        query: draw("query", &[count, queries.len(), n, 4, z]),
        query_level: Level(0.95),
        queries,
        target: draw("target", &[count, FRAMES - 1, n, 4, z]),
        prediction,
    }
}
