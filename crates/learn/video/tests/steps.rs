//! Parity of the steps with those of the framework, for every weight, and independence from workers and scratch.

use ds_graph::step;
use ds_kernel::train;
use ds_nn::array::{Array, Weights};
use ds_nn::cache::Positions;
use ds_nn::discriminator::DiscriminatorShape;
use ds_nn::dit::DitShape;
use ds_nn::step::{Adversary, AeBatch, BidirectionalPlan, ClipBatch, DecoderBatch, Joins, Level, Prediction, Step};
use ds_nn::team::Team;
use ds_nn::tiny_ae::AeShape;

use crate::made::{Case, FRAMES, clips, distance, draw, plan, shapes, weights};

const PREDICTIONS: [Prediction; 2] = [Prediction::Clean, Prediction::Flow];

/// Clips that differ in what they were given, with uneven emphasis.
fn batch(shape: &DitShape, count: usize) -> ClipBatch {
    let emphasis = draw("emphasis", &[count, FRAMES, shape.tokens(), 4, 1]);
    let emphasis = Array::new(emphasis.shape(), emphasis.values().iter().map(|x| 0.2 + x * x).collect());
    let on = |off: usize| (0..count).map(|clip| f32::from(u8::from(clip != off))).collect();
    ClipBatch { layout_on: on(1), given_on: on(2), emphasis, ..clips(shape, count) }
}

fn check(found: &Step, expected: &Step, case: &str) {
    assert!((found.loss - expected.loss).abs() < 1e-5 * expected.loss.abs(), "{case}: loss");
    assert_eq!(found.parts.len(), expected.parts.len(), "{case}");
    for ((name, a), (other, b)) in found.parts.iter().zip(&expected.parts) {
        assert!(name == other && (a - b).abs() <= 1e-5 * b.abs(), "{case}: part {name}");
    }
    assert_eq!(found.gradient.iter().count(), expected.gradient.iter().count());
    for ((name, found), (_, expected)) in found.gradient.iter().zip(expected.gradient.iter()) {
        assert_eq!(found.shape(), expected.shape(), "{case}: {name}");
        if expected.values().iter().all(|value| *value == 0.0) {
            assert!(found.values().iter().all(|value| *value == 0.0), "{case}: {name} has influence");
            continue;
        }
        let worst = distance(found.values(), expected.values());
        assert!(worst < 1e-4, "{case}: {name} is {worst} off");
    }
}

#[test]
fn bidirectional_steps_equal_the_framework() {
    for shape in shapes() {
        let (weights, batch, n) = (weights(&shape.declare()), batch(&shape, 3), shape.tokens());
        for prediction in PREDICTIONS {
            let noise = draw("noise", &[3, FRAMES - 1, n, 4, shape.latent_channels]);
            let plan = BidirectionalPlan { levels: vec![0.9, 0.4, 0.05], noise, prediction };
            let expected = step::bidirectional(&shape, &weights, &batch, &plan);
            let found = train::bidirectional(&shape, &weights, &batch, &plan);
            check(&found, &expected, &format!("width {}, {prediction:?}", shape.dim));
        }
    }
}

fn cases() -> Vec<Case> {
    let all = 1..FRAMES;
    vec![
        (1, 3, all.clone(), true, false),
        (1, 3, all.clone(), false, true),
        (1, 2, 2..FRAMES, true, true),
        (1, FRAMES, 1..1, true, false),
        (2, 4, 1..3, true, false),
        (2, 3, all.clone(), false, false),
        (3, 4, 1..4, false, true),
        (3, 8, all, true, false),
    ]
}

#[test]
fn causal_steps_equal_the_framework() {
    for (shape, count) in shapes().into_iter().zip([3, 1, 2]) {
        let (weights, batch) = (weights(&shape.declare()), batch(&shape, count));
        for case in cases() {
            for (positions, prediction) in [Positions::CacheRelative, Positions::Absolute].into_iter().zip(PREDICTIONS)
            {
                let plan = plan(&shape, count, &case, positions, prediction);
                let expected = step::causal(&shape, &weights, &batch, &plan);
                let found = train::causal(&shape, &weights, &batch, &plan);
                check(&found, &expected, &format!("width {}, {case:?}, {positions:?}", shape.dim));
            }
        }
    }
}

#[test]
fn the_step_of_joined_clips_is_the_mean_of_their_steps() {
    let [shape, ..] = shapes();
    let (weights, n, z) = (weights(&shape.declare()), shape.tokens(), shape.latent_channels);
    let alone = |clip: usize| {
        let named = |what: &str| format!("{what} of clip {clip}");
        let emphasis = draw(&named("emphasis"), &[1, FRAMES, n, 4, 1]);
        let emphasis = Array::new(emphasis.shape(), emphasis.values().iter().map(|x| 0.2 + x * x).collect());
        let batch = ClipBatch {
            clean: draw(&named("clean"), &[1, FRAMES, n, 4, z]),
            layout_on: vec![if clip == 1 { 0.0 } else { 1.0 }],
            emphasis,
            ..clips(&shape, 1)
        };
        let noise = draw(&named("noise"), &[1, FRAMES - 1, n, 4, z]);
        let whole = BidirectionalPlan { levels: vec![0.9 / (1 + clip) as f32], noise, prediction: Prediction::Clean };
        let causal = plan(&shape, 1, &(1, 3, 1..FRAMES, true, false), Positions::CacheRelative, Prediction::Clean);
        ((batch.clone(), whole), (batch, causal))
    };
    let (whole, causal): (Vec<_>, Vec<_>) = (0..3).map(alone).unzip();
    assert!(whole[0].joins(&whole[2]) && causal[0].joins(&causal[2]));
    let apart =
        Step::mean(whole.iter().map(|(batch, plan)| train::bidirectional(&shape, &weights, batch, plan)).collect());
    let (batch, plan) = Joins::joined(&whole);
    check(&train::bidirectional(&shape, &weights, &batch, &plan), &apart, "whole clips");
    check(&step::bidirectional(&shape, &weights, &batch, &plan), &apart, "whole clips, framework");
    let apart = Step::mean(causal.iter().map(|(batch, plan)| train::causal(&shape, &weights, batch, plan)).collect());
    let (batch, mut plan) = Joins::joined(&causal);
    check(&train::causal(&shape, &weights, &batch, &plan), &apart, "sequences");
    plan.query_level = Level(0.5);
    assert!(!causal[0].joins(&(batch, plan)), "what is seen at another level is another step");
}

#[test]
fn what_is_not_given_does_not_count() {
    let [shape, ..] = shapes();
    let weights = weights(&shape.declare());
    let noise = draw("noise", &[1, FRAMES - 1, shape.tokens(), 4, shape.latent_channels]);
    let plan = BidirectionalPlan { levels: vec![0.7], noise, prediction: Prediction::Flow };
    let step = |given: f32, layout: f32, layouts: &str| {
        let layouts = draw(layouts, clips(&shape, 1).layouts.shape());
        let batch = ClipBatch { layout_on: vec![layout], given_on: vec![given], layouts, ..clips(&shape, 1) };
        train::bidirectional(&shape, &weights, &batch, &plan)
    };
    assert_eq!(step(1.0, 0.0, "one"), step(1.0, 0.0, "other"));
    assert_ne!(step(1.0, 1.0, "one"), step(1.0, 1.0, "other"));
    let unseen = step(0.0, 0.0, "one").gradient;
    for name in ["control_embedding.weight", "control_embedding.bias", "text_embedding.0.weight"] {
        assert!(unseen.get(name).expect("declared").values().iter().all(|value| *value == 0.0), "{name}");
    }
}

fn autoencoders() -> [AeShape; 4] {
    let narrow = AeShape {
        z: 3,
        stride_t: 4,
        encoder_widths: vec![10],
        encoder_blocks: vec![2],
        decoder_widths: [20, 7, 5],
        decoder_blocks: [2, 1, 1],
        decoder_skip: true,
        guides: 2,
        sketch_widths: None,
        carried: false,
    };
    let two = AeShape {
        stride_t: 2,
        decoder_blocks: [1, 0, 2],
        decoder_skip: false,
        sketch_widths: Some([6, 4, 3]),
        carried: true,
        ..narrow.clone()
    };
    let bare =
        AeShape { z: 16, stride_t: 1, encoder_blocks: vec![0], decoder_blocks: [0, 0, 0], guides: 0, ..narrow.clone() };
    let staged = AeShape { encoder_widths: vec![6, 5, 9], encoder_blocks: vec![1, 0, 2], guides: 0, ..two.clone() };
    [narrow, two, bare, staged]
}

/// The loss falls along the gradient by as much as the gradient says, in every layer of an encoder in stages.
#[test]
fn a_staged_encoder_learns_along_its_gradient() {
    let [.., shape] = autoencoders();
    let (weights, [steps, h, w]) = (weights(&shape.declare()), [4, 2, 3]);
    let frames = [steps * shape.stride_t, 8 * h, 8 * w];
    let batch = AeBatch {
        clips: 2,
        folded: draw("folded", &[steps, h, w, shape.inputs()]),
        frames: draw("frames", &[frames[0], frames[1], frames[2], 3]),
        emphasis: Array::new(&[frames[0], frames[1], frames[2], 1], vec![1.0; frames.iter().product()]),
        noise: Array::zeros(&[steps, h, w, shape.z]),
        latent_penalty: 0.3,
    };
    let step = |weights: &Weights| train::autoencoder(&shape, weights, &batch);
    let gradient = step(&weights).gradient;
    for name in weights.iter().map(|(name, _)| name).filter(|name| name.starts_with("encoder.")) {
        let along = gradient.get(name).expect("declared").values();
        let length = along.iter().map(|d| d * d).sum::<f32>().sqrt();
        let by = 1e-2;
        let shifted = |by: f32| {
            let mut weights = weights.clone();
            let values = weights.get_mut(name).expect("declared").values_mut();
            values.iter_mut().zip(along).for_each(|(value, d)| *value += by * d / length);
            step(&weights).loss
        };
        let slope = (shifted(by) - shifted(-by)) / (2.0 * by);
        assert!((slope - length).abs() < 0.03 * length + 1e-4, "{name}: {slope} is not {length}");
    }
}

#[test]
fn reconstruction_steps_equal_the_framework() {
    for shape in autoencoders() {
        let (weights, clips, steps, h, w) = (weights(&shape.declare()), 2, 6, 3, 2);
        let images = [steps * shape.stride_t, 8 * h, 8 * w];
        let image = |name: &str, c: usize| draw(name, &[images[0], images[1], images[2], c]);
        let emphasis = image("emphasis", 1);
        let emphasis = Array::new(emphasis.shape(), emphasis.values().iter().map(|x| 0.2 + x * x).collect());
        let batch = AeBatch {
            clips,
            folded: draw("folded", &[steps, h, w, shape.inputs()]),
            frames: image("frames", 3),
            emphasis: emphasis.clone(),
            noise: draw("noise", &[steps, h, w, shape.z]),
            latent_penalty: 0.3,
        };
        let case = format!("{shape:?}");
        check(&train::autoencoder(&shape, &weights, &batch), &step::autoencoder(&shape, &weights, &batch), &case);
        let latents = draw("latents", &[steps, h, w, shape.z]);
        let guide = image("layouts", shape.guide_channels());
        let batch = DecoderBatch {
            clips,
            latents,
            guide,
            frames: image("frames", 3),
            told: true,
            emphasis,
            change: 0.4,
            texture: 0.6,
        };
        check(&train::decoder(&shape, &weights, &batch), &step::decoder(&shape, &weights, &batch), &case);
    }
}

/// A decoder's batch of two clips with a discriminator's sizes.
fn opposed(shape: &AeShape, told: bool) -> (DecoderBatch, DiscriminatorShape) {
    let image = |name: &str, c: usize| draw(name, &[4 * shape.stride_t, 16, 24, c]);
    let emphasis = Array::new(&[4 * shape.stride_t, 16, 24, 1], vec![1.0; 4 * shape.stride_t * 16 * 24]);
    let latents = draw("latents", &[4, 2, 3, shape.z]);
    let (guide, frames) = (image("layouts", shape.guide_channels()), image("frames", 3));
    (
        DecoderBatch { clips: 2, latents, guide, frames, told, emphasis, change: 0.0, texture: 0.0 },
        DiscriminatorShape { widths: [6, 5, 7] },
    )
}

/// A discriminator whose verdicts lie on both sides of the hinges.
fn judge(shape: DiscriminatorShape) -> Weights {
    let mut weights = weights(&shape.declare());
    weights.get_mut("layer.3.weight").expect("declared").values_mut().iter_mut().for_each(|value| *value *= 8.0);
    weights
}

fn against<'a>(shape: DiscriminatorShape, weights: &'a Weights, batch: &DecoderBatch, share: f32) -> Adversary<'a> {
    let noise = draw("noise", batch.frames.shape());
    Adversary { shape, weights, noise, smoothness: 0.7, share, features: 2.0, colour: 1.0 }
}

/// Returns weights of which one value is moved.
fn moved(weights: &Weights, name: &str, at: usize, by: f32) -> Weights {
    let mut weights = weights.clone();
    weights.get_mut(name).expect("declared").values_mut()[at] += by;
    weights
}

#[test]
fn adversarial_steps_equal_the_framework() {
    for (shape, told) in autoencoders().into_iter().zip([true, false, true, false]) {
        let (mut batch, sizes) = opposed(&shape, told);
        batch.emphasis.values_mut().iter_mut().step_by(3).for_each(|weight| *weight = 0.2);
        (batch.change, batch.texture) = (0.4, 0.6);
        let (decoder, judge) = (weights(&shape.declare()), judge(sizes));
        let against = Adversary { colour: 0.3, ..against(sizes, &judge, &batch, 0.8) };
        let own = train::adversarial(&shape, &decoder, &batch, &against);
        let graph = step::adversarial(&shape, &decoder, &batch, &against);
        for ((own, graph), network) in own.iter().zip(&graph).zip(["decoder", "discriminator"]) {
            check(own, graph, &format!("{network} of {shape:?}"));
        }
    }
}

#[test]
fn the_discriminator_learns_along_its_gradient() {
    let shape = AeShape { guides: 1, ..autoencoders()[0].clone() };
    let (batch, sizes) = opposed(&shape, true);
    let (decoder, judge) = (weights(&shape.declare()), judge(sizes));
    let step = |judge: &Weights| {
        let [_, step] = train::adversarial(&shape, &decoder, &batch, &against(sizes, judge, &batch, 1.0));
        step
    };
    let gradient = step(&judge).gradient;
    for name in ["layer.0.weight", "layer.1.bias", "layer.2.weight", "layer.3.weight", "layer.3.bias"] {
        let along = gradient.get(name).expect("declared").values();
        let at = (0..along.len()).max_by(|a, b| along[*a].abs().total_cmp(&along[*b].abs())).expect("not empty");
        let by = 2e-3;
        let slope = (step(&moved(&judge, name, at, by)).loss - step(&moved(&judge, name, at, -by)).loss) / (2.0 * by);
        assert!((slope - along[at]).abs() < 0.03 * along[at].abs() + 1e-4, "{name}: {slope} is not {}", along[at]);
    }
}

#[test]
fn where_nothing_is_told_the_discriminator_moves_brightness_alone() {
    let shape = AeShape { guides: 1, ..autoencoders()[0].clone() };
    let (mut batch, sizes) = opposed(&shape, false);
    let (decoder, judge) = (weights(&shape.declare()), judge(sizes));
    let mut pulls = |weight: f32, colour: f32| {
        batch.emphasis.values_mut().fill(weight);
        let [with, without] = [1.0, 0.0].map(|share| {
            let against = Adversary { colour, ..against(sizes, &judge, &batch, share) };
            let [step, _] = train::adversarial(&shape, &decoder, &batch, &against);
            step.gradient.get("decoder.head.bias").expect("declared").values().to_vec()
        });
        with.iter().zip(&without).map(|(with, without)| with - without).collect::<Vec<f32>>()
    };
    let grey = |pull: &[f32]| {
        pull.chunks_exact(3).all(|rgb| rgb.iter().all(|d| (d - rgb[0]).abs() < 1e-5 * d.abs().max(1e-3)))
    };
    assert!(grey(&pulls(0.5, 0.0)));
    assert!(!grey(&pulls(0.5, 1.0)));
    assert!(!grey(&pulls(1.0, 0.0)), "what is told keeps its colour");
}

#[test]
fn the_decoder_learns_to_be_taken_for_true() {
    for (told, features) in [(false, 0.0), (true, 2.0)] {
        let shape = AeShape { guides: 1, ..autoencoders()[0].clone() };
        let (batch, sizes) = opposed(&shape, told);
        let (decoder, judge) = (weights(&shape.declare()), judge(sizes));
        let step = |decoder: &Weights, share: f32| {
            let [step, _] = train::adversarial(&shape, decoder, &batch, &against(sizes, &judge, &batch, share));
            step
        };
        let (with, without) = (step(&decoder, 1.0), step(&decoder, 0.0));
        assert_eq!(without.gradient, train::decoder(&shape, &decoder, &batch).gradient);
        let name = "decoder.head.bias";
        let of = |step: &Step| step.gradient.get(name).expect("declared").values().to_vec();
        let pull: Vec<f32> = of(&with).iter().zip(of(&without)).map(|(a, b)| a - b).collect();
        let told_of = |step: &Step| {
            let part = |name: &str| step.parts.iter().find(|(part, _)| *part == name).expect("told").1;
            features * part("features") - part("fake")
        };
        let slope = |at: usize| {
            let by = 2e-3;
            (told_of(&step(&moved(&decoder, name, at, by), 0.0)) - told_of(&step(&moved(&decoder, name, at, -by), 0.0)))
                / (2.0 * by)
        };
        let slopes: Vec<f32> = (0..12).map(slope).collect();
        let norm = |values: &[f32]| values.iter().map(|x| x * x).sum::<f32>().sqrt();
        let both: f32 = pull.iter().zip(&slopes).map(|(a, b)| a * b).sum();
        assert!(both / norm(&pull) / norm(&slopes) > 0.999, "{told}: {pull:?} is not along {slopes:?}");
    }
}

/// Steps of different clips and kinds, one after the other through the same buffers or side by side.
#[test]
fn steps_have_the_same_bits_whatever_the_workers() {
    let [smoke, _, odd] = shapes();
    let steps = |workers: usize| {
        Team::new(workers).run(cases().len(), |at| {
            let shape = if at.is_multiple_of(3) { &odd } else { &smoke };
            let (weights, batch) = (weights(&shape.declare()), batch(shape, 1 + at % 2));
            let plan = plan(shape, 1 + at % 2, &cases()[at], Positions::CacheRelative, Prediction::Clean);
            train::causal(shape, &weights, &batch, &plan)
        })
    };
    let alone = steps(1);
    assert!(steps(2) == alone && steps(3) == alone);
}
