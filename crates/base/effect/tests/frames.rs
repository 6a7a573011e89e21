//! Every effect on frames at its neutral value returns its input bit for bit; away from it, it changes something; what
//! draws chance draws the same again.

use ds_effect::frame::{FrameContext, LayoutBox, Pinhole};
use ds_effect::picture::Picture;
use ds_effect::{FrameChain, FrameEffect, frame_library};

const SIZE: [usize; 2] = [64, 40];

fn scene() -> (Vec<Picture>, Vec<f32>, Vec<LayoutBox>) {
    let picture = |k: usize| {
        let data = (0..SIZE[0] * SIZE[1] * 3).map(|i| ((i * 7919 + k * 104_729) % 241) as f32 + 7.0).collect();
        Picture { width: SIZE[0], height: SIZE[1], channels: 3, data }
    };
    let depth = (0..SIZE[0] * SIZE[1]).map(|i| 5.0 + (i / SIZE[0]) as f32).collect();
    let car = LayoutBox { edges: [20.0, 18.0, 36.0, 30.0], class: "car".to_owned() };
    ((0..6).map(picture).collect(), depth, vec![car])
}

fn run(effect: &'static FrameEffect, values: &[f64]) -> Vec<Picture> {
    let (pictures, depth, boxes) = scene();
    let mut chain = FrameChain::new(&[(effect, values.to_vec())]);
    pictures
        .iter()
        .enumerate()
        .map(|(k, picture)| {
            let context = FrameContext {
                frame: k as u64,
                time_secs: 0.1 * k as f64,
                frames_since_anchor: k as f64,
                speed_mps: Some(9.0),
                yaw_rate_radps: Some(0.3),
                light: if k < 2 { 1.0 } else { 0.5 },
                depth_m: Some(&depth),
                boxes: &boxes,
                camera: Pinhole { fx: 50.0, fy: 50.0, cx: 31.0, cy: 19.0 },
                size: SIZE,
                sensor_rows: 1280.0,
                seed: 5,
            };
            chain.next(picture, &context)
        })
        .collect()
}

/// Values at which each effect shows on the scene above.
fn present(effect: &FrameEffect) -> Vec<f64> {
    let mut values = effect.neutral();
    let slab = effect.parameters[0].slab;
    values[0] = if effect.parameters[0].neutral > 1.0 { 30.0 } else { 0.1 * slab.0 + 0.9 * slab.1 };
    if effect.id == "night_illumination" {
        values[0] = 0.3;
    }
    values
}

#[test]
fn neutral_values_change_no_bit() {
    let (pictures, ..) = scene();
    for effect in frame_library() {
        for (before, after) in pictures.iter().zip(run(effect, &effect.neutral())) {
            let same = before.data.iter().zip(&after.data).all(|(a, b)| a.to_bits() == b.to_bits());
            assert!(same, "{} changes a frame at its neutral value", effect.id);
        }
    }
}

#[test]
fn effects_show_and_draw_the_same_again() {
    let (pictures, ..) = scene();
    for effect in frame_library() {
        let (first, again) = (run(effect, &present(effect)), run(effect, &present(effect)));
        assert_eq!(first, again, "{} depends on more than its seed", effect.id);
        assert!(first.iter().zip(&pictures).any(|(a, b)| a != b), "{} never shows", effect.id);
        assert!(first.iter().flat_map(|p| &p.data).all(|v| v.is_finite()), "{} is not finite", effect.id);
    }
}

#[test]
fn ids_are_unique_and_priors_make_sense() {
    let mut ids: Vec<&str> = frame_library().iter().map(|e| e.id).collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), frame_library().len());
    for effect in frame_library() {
        for p in effect.parameters {
            assert!(p.slab.0 < p.slab.1, "{}: empty slab", effect.id);
            assert!(p.neutral >= p.slab.0 && p.neutral <= p.slab.1, "{}: neutral value outside of its slab", effect.id);
        }
    }
}
