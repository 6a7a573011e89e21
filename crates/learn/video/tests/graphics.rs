//! A graphics processor gives the processor's frames up to rounding; in a process of its own, which may hold one device.

use std::sync::Arc;

use ds_nn::Weights;
use ds_raster::RgbImage;
use ds_space::Digest;
use ds_video::{Backend, ModelConfig, Rollout, VideoModel};

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
    // A published model of drawn weights runs there too.
    let wan = ModelConfig::parse(WAN).expect("the preset is valid");
    assert_eq!(frames(VideoModel::drawn(backend, &wan).expect("draws"), 12).len(), 12);
}
