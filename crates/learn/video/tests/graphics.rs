//! A graphics processor gives the processor's frames and training steps up to rounding; in a process of its own, which may
//! hold one device.

use std::sync::Arc;

use ds_nn::cache::Positions;
use ds_nn::step::{BidirectionalPlan, ClipBatch, Prediction, Step};
use ds_nn::{Array, Weights};
use ds_raster::RgbImage;
use ds_space::Digest;
use ds_video::{Backend, ModelConfig, Rollout, VideoModel};

use crate::made::{FRAMES, clips, distance, draw, plan, shapes, weights};

const SMOKE: &str = include_str!("../../../../configs/models/smoke.toml");
const WAN: &str = include_str!("../../../../configs/models/wan-smoke.toml");

/// A picture that moves with `k`.
fn picture(size_px: (u32, u32), k: u32) -> RgbImage {
    let mut image = RgbImage::filled(size_px.0, size_px.1, [40, 90, 150]);
    for (x, y) in (0..size_px.0).flat_map(|x| (size_px.1 / 2..size_px.1).map(move |y| (x, y))) {
        image.set_pixel(x, y, if (x + 3 * k) % 16 < 3 { [230, 220, 40] } else { [90, 90, 95] });
    }
    image
}

fn frames(model: VideoModel, ticks: u32) -> Vec<RgbImage> {
    let video = &model.config().video;
    let size_px = (video.width_px, video.height_px);
    let layouts: Vec<RgbImage> = (0..=ticks).map(|k| picture(size_px, k + 100)).collect();
    let first = picture(size_px, 0);
    let begun = Rollout::new(Arc::new(model), Digest::of(b"key"), "front", "driving by day", &first, &layouts[0]);
    let (mut rollout, _) = begun.expect("starts");
    rollout.generate(&layouts[1..]).expect("generates").frames
}

#[test]
fn a_graphics_processor_gives_the_frames_of_the_processor() {
    let ready = |backend: Backend| match backend.ready() {
        Ok(device) => Some((backend, device)),
        Err(error) => {
            eprintln!("skipped: {error}");
            None
        }
    };
    let Some((backend, device)) = [Backend::Cuda, Backend::Vulkan].into_iter().find_map(ready) else { return };
    eprintln!("on {device}");
    let config = ModelConfig::parse(SMOKE).expect("the preset is valid");
    let weights = Weights::initialised(&VideoModel::declare(&config), &Digest::of(b"weights"));
    let on = |backend| frames(VideoModel::new_on(backend, &config, &weights).expect("first weights fit"), 24);
    let (cpu, found) = (on(Backend::Cpu), on(backend));
    let pairs = || cpu.iter().zip(&found).flat_map(|(a, b)| a.rgb().iter().zip(b.rgb()));
    assert!(pairs().all(|(a, b)| a.abs_diff(*b) <= 1), "rounding to a byte may fall either way, no more");
    assert!(pairs().filter(|(a, b)| a != b).count() < pairs().count() / 100);
    steps_are_those_of_the_processor(backend);
    // A published model of drawn weights runs there too.
    let wan = ModelConfig::parse(WAN).expect("the preset is valid");
    assert_eq!(frames(VideoModel::drawn(backend, &wan).expect("draws"), 12).len(), 12);
}

fn steps_are_those_of_the_processor(backend: Backend) {
    let [smoke, _, odd] = shapes();
    for shape in [smoke, odd] {
        let (weights, n, z) = (weights(&shape.declare()), shape.tokens(), shape.latent_channels);
        let batch = ClipBatch {
            emphasis: Array::new(&[3, FRAMES, n, 4, 1], vec![1.0; 3 * FRAMES * n * 4]),
            ..clips(&shape, 3)
        };
        let whole = BidirectionalPlan {
            levels: vec![0.9, 0.4, 0.2],
            noise: draw("noise", &[3, FRAMES - 1, n, 4, z]),
            prediction: Prediction::Clean,
        };
        let case = (1, 3, 1..FRAMES, true, false);
        let causal = plan(&shape, 3, &case, Positions::CacheRelative, Prediction::Clean);
        let both = |backend: Backend| {
            let whole = backend.bidirectional(&shape, &weights, &batch, &whole);
            [whole, backend.causal(&shape, &weights, &batch, &causal)]
        };
        for (found, expected) in both(backend).iter().zip(&both(Backend::Cpu)) {
            near(found, expected, shape.dim);
        }
    }
}

fn near(found: &Step, expected: &Step, width: usize) {
    let off = (found.loss - expected.loss).abs() / expected.loss.abs();
    // Large layers and attention are bf16 where the device multiplies it: 8 bits of significance.
    assert!(off < 1e-2, "width {width}: loss {} is not {}", found.loss, expected.loss);
    for ((name, found), (_, expected)) in found.gradient.iter().zip(expected.gradient.iter()) {
        let worst = if expected.values().iter().all(|value| *value == 0.0) {
            found.values().iter().fold(0.0f32, |worst, value| worst.max(value.abs()))
        } else {
            distance(found.values(), expected.values())
        };
        assert!(worst < 6e-2, "width {width}: gradient of {name} is {worst} off");
    }
}
