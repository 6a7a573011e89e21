//! The published sizes, and that streaming gives what a whole clip gives.

use ds_space::{Digest, Draws};

use super::*;

#[test]
fn published_sizes_ask_for_the_published_tensors() {
    let check = |shape: WanVaeShape, tensors: usize, encoder: usize, decoder: usize, all: usize| {
        let declared = shape.declare();
        let count = |front: &str| {
            let of = declared.iter().filter(|weight| weight.name.starts_with(front));
            // In units of ten thousand, as the figures are published.
            (of.map(|weight| weight.shape.iter().product::<usize>()).sum::<usize>() + 5_000) / 10_000
        };
        assert_eq!(declared.len(), tensors);
        assert_eq!([count("encoder."), count("decoder."), count("")], [encoder, decoder, all]);
    };
    check(WanVaeShape::WAN21, 194, 5360, 7330, 12_689);
    check(WanVaeShape::WAN22, 196, 14_963, 55_505, 70_469);
}

fn draw(name: &str, shape: &[usize]) -> Array {
    let draws = Draws::from_seed(3, name);
    Array::new(shape, (0..shape.iter().product::<usize>() as u64).map(|i| draws.normal(i) as f32).collect())
}

fn difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn the_encoder_forgets_what_is_out_of_reach() {
    for folded in [false, true] {
        let shape = WanVaeShape { z: 4, encoder_width: 4, decoder_width: 4, folded };
        let vae = WanVae::new(&shape, &Weights::initialised(&shape.declare(), &Digest::of(b"vae"))).expect("fits");
        let side = shape.stride();
        let steps = shape.encoder_reach().div_ceil(STEP);
        let clip = draw("clip", &[1 + STEP * (steps + 3), side, side, 3]);
        let run = |skipped: usize| {
            let mut memory = WanMemory::default();
            let mut newest = Array::default();
            let kept = Array::new(
                &[clip.shape()[0] - STEP * skipped, side, side, 3],
                clip.values()[STEP * skipped * side * side * 3..].to_vec(),
            );
            for piece in pieces(&kept, &[&[1][..], &vec![STEP; steps + 3 - skipped]].concat()) {
                newest = vae.encode(&piece, &mut memory);
            }
            (memory.digest(), newest)
        };
        assert_eq!(run(0), run(2), "{shape:?}");
        assert_ne!(run(0).0, run(steps).0, "the reach is not far too long");
    }
}

fn pieces(array: &Array, cuts: &[usize]) -> Vec<Array> {
    let shape = array.shape();
    let frame: usize = shape[1..].iter().product();
    let mut at = 0;
    let mut piece = |count: &usize| {
        at += count;
        let values = array.values()[(at - count) * frame..at * frame].to_vec();
        Array::new(&[*count, shape[1], shape[2], shape[3]], values)
    };
    cuts.iter().map(&mut piece).collect()
}

#[test]
fn streaming_is_the_whole_clip() {
    for folded in [false, true] {
        let shape = WanVaeShape { z: 4, encoder_width: 4, decoder_width: 4, folded };
        let vae = WanVae::new(&shape, &Weights::initialised(&shape.declare(), &Digest::of(b"vae"))).expect("fits");
        let side = 2 * shape.stride();
        let clip = draw("clip", &[13, side, side, 3]);
        let whole = vae.encode(&clip, &mut WanMemory::default());
        assert_eq!(whole.shape(), [4, 2, 2, 4]);
        for cuts in [&[1, 4, 4, 4][..], &[5, 8], &[1, 12]] {
            let mut memory = WanMemory::default();
            let parts = pieces(&clip, cuts);
            let streamed: Vec<f32> =
                parts.iter().flat_map(|part| vae.encode(part, &mut memory).into_values()).collect();
            assert!(difference(whole.values(), &streamed) < 1e-5, "encoder of {shape:?} in {cuts:?}");
        }
        let frames = vae.decode(&whole, &mut WanMemory::default());
        assert_eq!(frames.shape(), [13, side, side, 3]);
        for cuts in [&[1, 1, 1, 1][..], &[2, 2], &[1, 3]] {
            let mut memory = WanMemory::default();
            let parts = pieces(&whole, cuts);
            let streamed: Vec<f32> =
                parts.iter().flat_map(|part| vae.decode(part, &mut memory).into_values()).collect();
            assert!(difference(frames.values(), &streamed) < 1e-5, "decoder of {shape:?} in {cuts:?}");
        }
    }
}
