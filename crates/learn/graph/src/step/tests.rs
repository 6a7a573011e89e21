//! The parallel causal form against the cached one, gradients against finite differences, and short trainings.

mod self_forcing;

use std::ops::Range;

use ds_nn::array::Initial;
use ds_nn::cache::{CachePolicy, KvCache, Positions, ReadOrder};
use ds_nn::dit::DitShape;
use ds_nn::optimiser::{AdamW, AdamWSettings};
use ds_nn::step::{AeBatch, BidirectionalPlan, CausalPlan, DecoderBatch, Level, Prediction};
use ds_nn::tiny_ae::{AeShape, Memory};
use ds_nn::{Declared, Weights};
use ds_space::{Digest, Draws};

use super::*;
use crate::dit::Chunk;
use crate::tiny_ae::TinyAe;

const SHAPE: DitShape = DitShape {
    layers: 3,
    dim: 48,
    heads: 2,
    ffn: 64,
    latent_channels: 3,
    control_inputs: 12,
    control_channels: 5,
    start_channels: 3,
    freq_dim: 16,
    text_dim: 8,
    text_len: 2,
    image_context: true,
    clip_dim: 0,
    reference: false,
    gelu: ds_nn::dit::Gelu::Exact,
    start_every: true,
    cross_every: 2,
    grid_h: 2,
    grid_w: 3,
};
const FRAMES: usize = 7;

fn draw(name: &str, shape: &[usize]) -> Array {
    let draws = Draws::from_seed(11, name);
    Array::new(shape, (0..shape.iter().product::<usize>() as u64).map(|i| draws.normal(i) as f32).collect())
}

/// Weights in which nothing is zero, so that no part is idle.
fn weights(declared: &[Declared]) -> Weights {
    let mut weights = Weights::initialised(declared, &Digest::of(b"test"));
    for declared in declared.iter().filter(|declared| !matches!(declared.initial, Initial::Normal(_))) {
        let draws = draw(&declared.name, &declared.shape);
        let array = weights.get(&declared.name).expect("declared").clone();
        let values = array.values().iter().zip(draws.values()).map(|(a, b)| a + 0.1 * b).collect();
        weights.insert(&declared.name, Array::new(&declared.shape, values));
    }
    weights
}

fn batch(clips: usize) -> ClipBatch {
    let n = SHAPE.tokens();
    ClipBatch {
        clean: draw("clean", &[clips, FRAMES, n, 4, 3]),
        start: draw("start", &[clips, n, 4, 3]),
        layouts: draw("layouts", &[clips, FRAMES * n, 4, 12]),
        layout_on: vec![1.0; clips],
        given_on: vec![1.0; clips],
        text: draw("text", &[clips, 2, 8]),
        emphasis: Array::new(&[clips, FRAMES, n, 4, 1], vec![1.0; clips * FRAMES * n * 4]),
    }
}

fn plan(clips: usize, chunk: usize, window: usize, positions: Positions, queries: Range<usize>) -> CausalPlan {
    let n = SHAPE.tokens();
    CausalPlan {
        cache: CachePolicy { window, sink: 1, chunk, positions, order: ReadOrder::Slot },
        context: draw("context", &[clips, FRAMES - 1, n, 4, 3]),
        context_level: Level(0.6),
        context_trained: true,
        context_detached: false,
        query: draw("query", &[clips, queries.len(), n, 4, 3]),
        query_level: Level(1.0),
        queries,
        target: draw("target", &[clips, FRAMES - 1, n, 4, 3]),
        prediction: Prediction::Clean,
    }
}

fn frames_of(array: &Array, frames: Range<usize>) -> Array {
    let n = SHAPE.tokens();
    let frame = array.values().len() / array.shape()[array.shape().len() - 4];
    let values = array.values()[frames.start * frame..frames.end * frame].to_vec();
    Array::new(&[frames.len(), n, 4, array.shape()[array.shape().len() - 1]], values)
}

/// Runs the cached form over the same sequence and returns the largest difference of any output.
fn largest_difference(plan: &CausalPlan) -> f32 {
    let (weights, batch) = (weights(&SHAPE.declare()), batch(1));
    let parallel = causal_output(&SHAPE, &weights, &batch, plan);
    let dit = Dit::new(&SHAPE, &weights).expect("the weights fit");
    let n = SHAPE.tokens();
    let context = dit.context(&batch.text, &batch.start);
    let mut cache = KvCache::new(plan.cache);
    let mut worst = 0.0f32;
    let mut compare = |output: &Array, at: usize| {
        let expected = frames_of(&parallel, at..at + output.shape()[0]);
        worst = output.values().iter().zip(expected.values()).fold(worst, |w, (a, b)| w.max((a - b).abs()));
    };
    let mut start = 0;
    while start < FRAMES {
        let count = if start == 0 { 1 } else { plan.cache.chunk.min(FRAMES - start) };
        let range = start..start + count;
        let layouts = Array::new(
            &[1, count * n, 4, 12],
            batch.layouts.values()[start * n * 48..(start + count) * n * 48].to_vec(),
        );
        let control = dit.control(&layouts);
        let clean = frames_of(&batch.clean, range.clone());
        let starts = Array::new(clean.shape(), batch.start.values().repeat(count));
        let run = |noisy: &Array, level: f32, first: &Array, cache: &KvCache| {
            let chunk = Chunk { noisy, start: first, control: &control, time: 1000.0 * level };
            dit.denoise(&chunk, &cache.window(&dit, count), &context)
        };
        if plan.queries.contains(&start) {
            let at = start - plan.queries.start;
            let noisy = frames_of(&plan.query, at..at + count);
            compare(&run(&noisy, plan.query_level.0, &starts, &cache).0, FRAMES + at);
        }
        let (output, kv) = if start == 0 {
            run(&clean, 0.0, &starts, &cache)
        } else {
            let noisy = frames_of(&plan.context, start - 1..start - 1 + count);
            run(&noisy, plan.context_level.0, &starts, &cache)
        };
        compare(&output, start);
        cache.commit(&kv);
        start += count;
    }
    worst
}

#[test]
fn the_cached_form_equals_the_parallel_form() {
    for (chunk, window, queries) in [(1, 8, 1..7), (1, 4, 2..6), (1, 2, 5..7), (2, 8, 1..7), (2, 5, 3..7), (3, 4, 4..7)]
    {
        for positions in [Positions::CacheRelative, Positions::Absolute] {
            let worst = largest_difference(&plan(1, chunk, window, positions, queries.clone()));
            assert!(worst < 1e-4, "chunk {chunk}, window {window}, {positions:?}: {worst}");
        }
    }
}

#[test]
fn positions_agree_until_something_is_evicted() {
    let output = |positions, window| {
        let plan = plan(1, 1, window, positions, 1..7);
        causal_output(&SHAPE, &weights(&SHAPE.declare()), &batch(1), &plan)
    };
    assert_eq!(output(Positions::CacheRelative, 8), output(Positions::Absolute, 8));
    assert_ne!(output(Positions::CacheRelative, 4), output(Positions::Absolute, 4));
}

#[test]
fn a_head_of_zeros_gives_its_bias() {
    let mut weights = weights(&SHAPE.declare());
    weights.insert("head.head.weight", Array::zeros(&[12, 48]));
    let bias = weights.get("head.head.bias").expect("declared").clone();
    let output = causal_output(&SHAPE, &weights, &batch(1), &plan(1, 1, 8, Positions::CacheRelative, 1..3));
    let worst = output.values().chunks_exact(12).flat_map(|row| row.iter().zip(bias.values()));
    assert!(worst.fold(0.0f32, |w, (a, b)| w.max((a - b).abs())) < 1e-6);
}

/// Compares the gradient along a random direction with the central difference of the loss.
fn check_gradient(weights: &Weights, step: impl Fn(&Weights) -> Step) {
    let mut direction = weights.zeros_like();
    for (name, array) in direction.iter_mut() {
        let drawn = draw(&format!("direction/{name}"), array.shape());
        array.values_mut().copy_from_slice(drawn.values());
    }
    let moved = |by: f32| {
        let mut moved = weights.clone();
        for ((_, array), (_, direction)) in moved.iter_mut().zip(direction.iter()) {
            array.values_mut().iter_mut().zip(direction.values()).for_each(|(value, d)| *value += by * d);
        }
        f64::from(step(&moved).loss)
    };
    let gradient = step(weights).gradient;
    let pairs = gradient.iter().zip(direction.iter());
    let along: f64 = pairs
        .flat_map(|((_, g), (_, d))| g.values().iter().zip(d.values()))
        .map(|(g, d)| f64::from(*g) * f64::from(*d))
        .sum();
    let difference = (moved(5e-4) - moved(-5e-4)) / 1e-3;
    assert!((along - difference).abs() < 0.02 * along.abs().max(0.5), "gradient {along}, difference {difference}");
}

#[test]
fn gradients_match_finite_differences() {
    let dit = weights(&SHAPE.declare());
    let (batch, plan) = (batch(2), plan(2, 1, 4, Positions::CacheRelative, 2..5));
    check_gradient(&dit, |weights| causal(&SHAPE, weights, &batch, &plan));
    for prediction in [Prediction::Clean, Prediction::Flow] {
        let noise = draw("noise", &[2, FRAMES - 1, SHAPE.tokens(), 4, 3]);
        let plan = BidirectionalPlan { levels: vec![0.3, 0.9], noise, prediction };
        check_gradient(&dit, |weights| bidirectional(&SHAPE, weights, &batch, &plan));
    }
}

#[test]
fn the_mean_of_single_clips_is_the_batch() {
    let (weights, batch) = (weights(&SHAPE.declare()), batch(2));
    let noise = draw("noise", &[2, FRAMES - 1, SHAPE.tokens(), 4, 3]);
    let plan = BidirectionalPlan { levels: vec![0.3, 0.9], noise, prediction: Prediction::Flow };
    let whole = bidirectional(&SHAPE, &weights, &batch, &plan);
    let half = |array: &Array, clip: usize| {
        let values = array.values().len() / 2;
        let mut shape = array.shape().to_vec();
        shape[0] = 1;
        Array::new(&shape, array.values()[clip * values..(clip + 1) * values].to_vec())
    };
    let single = |clip: usize| {
        let batch = ClipBatch {
            clean: half(&batch.clean, clip),
            start: half(&batch.start, clip),
            layouts: half(&batch.layouts, clip),
            layout_on: vec![1.0],
            given_on: vec![1.0],
            text: half(&batch.text, clip),
            emphasis: half(&batch.emphasis, clip),
        };
        let plan =
            BidirectionalPlan { levels: vec![plan.levels[clip]], noise: half(&plan.noise, clip), ..plan.clone() };
        bidirectional(&SHAPE, &weights, &batch, &plan)
    };
    let mean = Step::mean(vec![single(0), single(1)]);
    assert!((mean.loss - whole.loss).abs() < 1e-5, "{} and {}", mean.loss, whole.loss);
    for ((name, a), (_, b)) in mean.gradient.iter().zip(whole.gradient.iter()) {
        let worst = a.values().iter().zip(b.values()).fold(0.0f32, |w, (a, b)| w.max((a - b).abs()));
        assert!(worst < 1e-5, "{name}: {worst}");
    }
}

#[test]
fn what_is_not_given_does_not_count() {
    let weights = weights(&SHAPE.declare());
    let noisy = draw("noisy", &[1, FRAMES - 1, SHAPE.tokens(), 4, 3]);
    let output = |given: f32, layout: f32, first: f32, layouts: &str| {
        let mut batch = batch(1);
        batch.given_on = vec![given];
        batch.layout_on = vec![layout];
        batch.clean.values_mut()[0] += first;
        batch.start.values_mut()[0] += first;
        batch.layouts = draw(layouts, &[1, FRAMES * SHAPE.tokens(), 4, 12]);
        bidirectional_clean(&SHAPE, &weights, &batch, &noisy, &[0.7], Prediction::Flow)
    };
    assert_ne!(output(1.0, 1.0, 0.0, "layouts"), output(1.0, 1.0, 1.0, "layouts"));
    assert_ne!(output(1.0, 1.0, 0.0, "layouts"), output(1.0, 1.0, 0.0, "others"));
    assert_eq!(output(0.0, 1.0, 0.0, "layouts"), output(0.0, 1.0, 1.0, "layouts"));
    assert_eq!(output(1.0, 0.0, 0.0, "layouts"), output(1.0, 0.0, 0.0, "others"));
}

fn ae() -> (AeShape, AeBatch) {
    let shape = AeShape {
        z: 3,
        stride_t: 4,
        encoder_widths: vec![8],
        encoder_blocks: vec![1],
        decoder_widths: [8, 6, 4],
        decoder_blocks: [1, 1, 1],
        decoder_skip: true,
        guides: 0,
        sketch_widths: None,
        carried: false,
    };
    let frames = draw("frames", &[2 * 2 * 4, 16, 24, 3]);
    let batch = AeBatch {
        clips: 2,
        folded: draw("folded", &[4, 2, 3, shape.inputs()]),
        frames,
        emphasis: Array::new(&[2 * 2 * 4, 16, 24, 1], vec![1.0; 2 * 2 * 4 * 16 * 24]),
        noise: Array::zeros(&[4, 2, 3, 3]),
        latent_penalty: 1e-3,
    };
    (shape, batch)
}

#[test]
fn the_autoencoder_fits_what_it_sees() {
    let (shape, batch) = ae();
    let mut weights = Weights::initialised(&shape.declare(), &Digest::of(b"ae"));
    let mut adam = AdamW::new(AdamWSettings::default(), &weights);
    let first = autoencoder(&shape, &weights, &batch).loss;
    for _ in 0..30 {
        let step = autoencoder(&shape, &weights, &batch);
        adam.update(&mut weights, &step.gradient, 5e-3);
    }
    let last = autoencoder(&shape, &weights, &batch).loss;
    assert!(last < 0.9 * first, "{first} to {last}");
}

#[test]
fn emphasis_moves_the_fit_to_where_it_lies() {
    let (shape, batch) = ae();
    let halves = |left: f32, right: f32| {
        let row = [vec![left; 12], vec![right; 12]].concat();
        Array::new(&[2 * 2 * 4, 16, 24, 1], row.repeat(2 * 2 * 4 * 16))
    };
    let fit = |emphasis: Array| {
        let batch = AeBatch { emphasis, ..ae().1 };
        let mut weights = Weights::initialised(&shape.declare(), &Digest::of(b"ae"));
        let mut adam = AdamW::new(AdamWSettings::default(), &weights);
        for _ in 0..20 {
            let step = autoencoder(&shape, &weights, &batch);
            adam.update(&mut weights, &step.gradient, 5e-3);
        }
        weights
    };
    let left_error =
        |weights: &Weights| autoencoder(&shape, weights, &AeBatch { emphasis: halves(1.0, 0.0), ..ae().1 }).loss;
    assert!(left_error(&fit(halves(1.0, 0.0))) < left_error(&fit(halves(0.0, 1.0))));
    // Scaling all weights alike changes nothing but rounding.
    let loss = |factor: f32| {
        autoencoder(&shape, &fit(halves(1.0, 1.0)), &AeBatch { emphasis: halves(factor, 2.0 * factor), ..ae().1 }).loss
    };
    assert!((loss(1.0) - loss(8.0)).abs() < 1e-5);
    assert_eq!(batch.emphasis, halves(1.0, 1.0));
}

#[test]
fn a_guided_decoder_learns_from_layouts_and_leaves_the_encoder_alone() {
    let (shape, batch) = ae();
    let shape = AeShape { guides: 2, ..shape };
    let mut weights = weights(&shape.declare());
    let batch = DecoderBatch {
        clips: 2,
        latents: draw("latents", &[4, 2, 3, 3]),
        guide: batch.frames.clone(),
        frames: batch.frames,
        told: true,
        emphasis: batch.emphasis,
        change: 0.3,
        texture: 0.0,
    };
    let encoder = weights.part("encoder.");
    let mut adam = AdamW::new(AdamWSettings::default(), &weights);
    let first = decoder(&shape, &weights, &batch).loss;
    for _ in 0..30 {
        let step = decoder(&shape, &weights, &batch);
        adam.update(&mut weights, &step.gradient, 1e-2);
    }
    assert!(decoder(&shape, &weights, &batch).loss < 0.9 * first);
    assert_eq!(weights.part("encoder."), encoder);
    // What the decoder remembers does not depend on the layout.
    let ae = TinyAe::new(&shape, &weights).expect("the weights fit");
    let (mut with, mut without) = (Memory::default(), Memory::default());
    let latents = draw("latents", &[4, 2, 3, 3]);
    let guided = ae.decode(&latents, Some(&batch.guide), &mut with);
    assert_ne!(guided, ae.decode(&latents, None, &mut without));
    assert_eq!(with.digest(), without.digest());
}

#[test]
fn streaming_equals_whole_clip_work() {
    let (shape, _) = ae();
    for stride_t in [1, 2, 4] {
        let shape = AeShape { stride_t, ..shape.clone() };
        let ae = TinyAe::new(&shape, &weights(&shape.declare())).expect("the weights fit");
        let steps = draw("steps", &[5, 2, 3, shape.inputs()]);
        let latents = ae.encode(&steps, &mut Memory::default());
        let frames = ae.decode(&latents, None, &mut Memory::default());
        assert_eq!(frames.shape(), [5 * stride_t, 16, 24, 3]);
        let (mut encoder, mut decoder) = (Memory::default(), Memory::default());
        let (mut latents_in_parts, mut frames_in_parts) = (Vec::new(), Vec::new());
        for part in [0..1, 1..3, 3..5] {
            let slice = |array: &Array| {
                let row = array.values().len() / 5;
                let mut shape = array.shape().to_vec();
                shape[0] = part.len();
                Array::new(&shape, array.values()[part.start * row..part.end * row].to_vec())
            };
            let latents = ae.encode(&slice(&steps), &mut encoder);
            frames_in_parts.extend(ae.decode(&latents, None, &mut decoder).into_values());
            latents_in_parts.extend(latents.into_values());
        }
        let worst = |a: &[f32], b: &[f32]| a.iter().zip(b).fold(0.0f32, |w, (a, b)| w.max((a - b).abs()));
        assert!(worst(&latents_in_parts, latents.values()) < 1e-5 && latents_in_parts.len() == latents.values().len());
        assert!(worst(&frames_in_parts, frames.values()) < 1e-5 && frames_in_parts.len() == frames.values().len());
    }
}

#[test]
fn wrong_weights_are_named() {
    let good = weights(&SHAPE.declare());
    let check = |change: &dyn Fn(&mut Weights), expected: &str| {
        let mut weights = good.clone();
        change(&mut weights);
        let message = match Dit::new(&SHAPE, &weights) {
            Ok(_) => "accepted".to_owned(),
            Err(error) => error.to_string(),
        };
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    };
    check(&|_| (), "accepted");
    check(&|w| drop(w.remove("blocks.1.ffn.0.bias")), "\"blocks.1.ffn.0.bias\" is missing");
    check(&|w| w.insert("blocks.9.q", Array::zeros(&[1])), "\"blocks.9.q\" is not part of the model");
    check(&|w| w.insert("head.head.weight", Array::zeros(&[48, 12])), "has shape [48, 12], [12, 48] expected");
    let mut nan = Array::zeros(&[12]);
    nan.values_mut()[3] = f32::NAN;
    check(&|w| w.insert("head.head.bias", nan.clone()), "\"head.head.bias\" holds NaN at index 3");
}
