//! The shapes of the published checkpoints, and that chunks with a cache and whole clips agree.

use ds_nn::array::Initial;
use ds_nn::cache::{CachePolicy, KvCache, Positions, ReadOrder};
use ds_space::{Digest, Draws};

use super::*;

/// Wan2.1 T2V 1.3B.
fn wan_1_3b() -> DitShape {
    DitShape {
        layers: 30,
        dim: 1536,
        heads: 12,
        ffn: 8960,
        latent_channels: 16,
        control_inputs: 0,
        control_channels: 0,
        start_channels: 0,
        freq_dim: 256,
        text_dim: 4096,
        text_len: 512,
        image_context: false,
        clip_dim: 0,
        reference: false,
        gelu: Gelu::Tanh,
        start_every: false,
        cross_every: 1,
        grid_h: 30,
        grid_w: 52,
    }
}

#[track_caller]
fn check(shape: &DitShape, in_dim: usize, tensors: usize, parameters: usize) {
    let declared = shape.declare();
    assert_eq!(shape.in_dim(), in_dim);
    assert_eq!(declared.len(), tensors);
    assert_eq!(declared.iter().map(|weight| weight.shape.iter().product::<usize>()).sum::<usize>(), parameters);
}

#[test]
fn published_sizes_ask_for_the_published_tensors() {
    let small = wan_1_3b();
    check(&small, 16, 825, 1_418_996_800);
    let control = DitShape { control_channels: 16, start_channels: 16, clip_dim: 1280, ..small.clone() };
    check(&control, 48, 983, 1_564_502_336);
    check(&DitShape { reference: true, ..control }, 48, 985, 1_564_602_176);
    let large = DitShape { dim: 3072, heads: 24, ffn: 14_336, latent_channels: 48, ..small };
    check(&large, 48, 825, 4_999_787_712);
}

fn draw(name: &str, shape: &[usize]) -> Array {
    let draws = Draws::from_seed(5, name);
    Array::new(shape, (0..shape.iter().product::<usize>() as u64).map(|i| draws.normal(i) as f32).collect())
}

fn tiny() -> DitShape {
    DitShape {
        layers: 2,
        dim: 48,
        heads: 2,
        ffn: 64,
        latent_channels: 4,
        control_channels: 4,
        start_channels: 4,
        freq_dim: 16,
        text_dim: 8,
        text_len: 3,
        clip_dim: 6,
        reference: true,
        grid_h: 2,
        grid_w: 3,
        ..wan_1_3b()
    }
}

fn network(shape: &DitShape) -> Dit {
    let mut weights = Weights::initialised(&shape.declare(), &Digest::of(b"wan"));
    for declared in shape.declare().iter().filter(|declared| !matches!(declared.initial, Initial::Normal(_))) {
        let array = weights.get(&declared.name).expect("declared").clone();
        let noise = draw(&declared.name, &declared.shape);
        let values = array.values().iter().zip(noise.values()).map(|(a, b)| a + 0.1 * b).collect();
        weights.insert(&declared.name, Array::new(&declared.shape, values));
    }
    Dit::new(shape, &weights).expect("weights fit")
}

fn difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn a_chunk_without_past_is_a_whole_clip() {
    let shape = tiny();
    let dit = network(&shape);
    let context = dit.context(&draw("text", &[1, 3, 8]), &draw("clip", &[1, 5, 6]));
    let [noisy, control, start] = ["noisy", "control", "start"].map(|name| draw(name, &[3, 6, 4, 4]));
    let clip = Clip { noisy: &noisy, control: Some(&control), start: Some(&start), reference: None, times: &[700.0] };
    let whole = dit.whole(&clip, &context);
    let policy =
        CachePolicy { window: 4, sink: 1, chunk: 3, positions: Positions::CacheRelative, order: ReadOrder::Slot };
    let window = KvCache::new(policy).window(&dit, 3);
    let control = dit.control(&Array::new(&[1, 18, 4, 4], control.into_values()));
    let chunk = Chunk { noisy: &noisy, start: &start, control: &control, time: 700.0 };
    let (chunked, _) = dit.denoise(&chunk, &window, &context);
    assert!(difference(whole.values(), chunked.values()) < 1e-5);
}

#[test]
fn every_condition_has_influence() {
    let shape = tiny();
    let dit = network(&shape);
    let context = |clip: &str, text: &str| dit.context(&draw(text, &[1, 3, 8]), &draw(clip, &[1, 5, 6]));
    let noisy = draw("noisy", &[3, 6, 4, 4]);
    let (extra, reference) = (draw("extra", &[3, 6, 4, 4]), draw("reference", &[1, 6, 4, 4]));
    let plain = Clip { noisy: &noisy, control: None, start: None, reference: None, times: &[700.0] };
    let base = dit.whole(&plain, &context("clip", "text"));
    let changed = [
        dit.whole(&plain, &context("other clip", "text")),
        dit.whole(&plain, &context("clip", "other text")),
        dit.whole(&Clip { control: Some(&extra), ..plain }, &context("clip", "text")),
        dit.whole(&Clip { start: Some(&extra), ..plain }, &context("clip", "text")),
        dit.whole(&Clip { reference: Some(&reference), ..plain }, &context("clip", "text")),
        dit.whole(&Clip { times: &[0.0, 700.0, 700.0], ..plain }, &context("clip", "text")),
    ];
    for (index, output) in changed.iter().enumerate() {
        assert!(difference(base.values(), output.values()) > 1e-3, "condition {index} changes nothing");
    }
    let per_frame = dit.whole(&Clip { times: &[700.0; 3], ..plain }, &context("clip", "text"));
    assert!(difference(base.values(), per_frame.values()) < 1e-5, "a time per frame differs from one for all");
}
