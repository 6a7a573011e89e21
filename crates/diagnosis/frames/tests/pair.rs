//! Writes a synthetic case of two paired streams in the practice schema; used by the other tests of this folder.

use std::path::Path;

use ds_effect::frame::{FrameContext, Pinhole};
use ds_effect::picture::Picture;
use ds_effect::{FrameChain, find_frame};
use ds_space::draw::Draws;

const SIZE: [usize; 2] = [208, 128];
const FRAMES: u64 = 12;

/// Writes the case; the effects act on the real side.
pub(crate) fn write(folder: &Path, seed: u64, effects: &[(&str, &[f64])]) {
    let chosen: Vec<_> =
        effects.iter().map(|(id, v)| (find_frame(id).expect("the effect is in the library"), v.to_vec())).collect();
    let mut chain = FrameChain::new(&chosen);
    let draws = Draws::from_seed(seed, "pair");
    let mut rows = "frame,time_s,real_stamp_s,speed_mps,yaw_rate_radps,light_rel\n".to_owned();
    for side in ["sim", "real"] {
        std::fs::create_dir_all(folder.join(side)).expect("a folder");
    }
    for k in 0..FRAMES {
        let sim = texture(seed, k as f64 * 2.5);
        let context = FrameContext {
            frame: k,
            time_secs: 0.1 * k as f64,
            frames_since_anchor: k as f64,
            speed_mps: None,
            yaw_rate_radps: None,
            light: 1.0,
            depth_m: None,
            boxes: &[],
            camera: Pinhole { fx: 150.0, fy: 150.0, cx: 104.0, cy: 60.0 },
            size: SIZE,
            sensor_rows: 1280.0,
            seed,
        };
        let shift = [draws.range(4 * k, -0.25, 0.25), draws.range(4 * k + 1, -0.25, 0.25)];
        let moved = sim.warped(|x, y| [x as f32 + shift[0] as f32, y as f32 + shift[1] as f32]);
        let mut real = chain.next(&moved, &context);
        let noise = Draws::from_seed(seed * 1000 + k, "grain");
        for (i, v) in (0..).zip(&mut real.data) {
            *v += noise.normal(i) as f32;
        }
        save(&sim, &folder.join(format!("sim/{k:04}.jpg")), 95);
        save(&real, &folder.join(format!("real/{k:04}.jpg")), 92);
        rows += &format!("{k},{:.4},{:.4},,,1.0\n", context.time_secs, context.time_secs);
    }
    std::fs::write(folder.join("frames.csv"), rows).expect("frames.csv");
    let meta = r#"{"case": "pair", "width": 208, "height": 128, "channels": "grey", "frame_rate_hz": 10.0,
        "contiguous": true, "intrinsics": {"fx": 150.0, "fy": 150.0, "cx": 104.0, "cy": 60.0}, "sensor_rows": 1280,
        "rollout_anchor_frames": [0], "suggested_split": {"fit": [0, 8], "held_out": [9, 11]}}"#;
    std::fs::write(folder.join("meta.json"), meta).expect("meta.json");
}

/// A smooth random texture that moves to the left from frame to frame.
fn texture(seed: u64, moved_px: f64) -> Picture {
    let draws = Draws::from_seed(seed, "waves");
    let waves: Vec<[f64; 4]> = (0..24)
        .map(|w| [0, 1, 2, 3].map(|d| draws.uniform(4 * w + d)))
        .map(|[a, b, c, d]| [0.02 + 0.5 * a * a, std::f64::consts::TAU * b, std::f64::consts::TAU * c, 6.0 + 16.0 * d])
        .collect();
    let mut picture = Picture::filled(SIZE[0], SIZE[1], 1, 0.0);
    for (k, v) in picture.data.iter_mut().enumerate() {
        let (x, y) = ((k % SIZE[0]) as f64 + moved_px, (k / SIZE[0]) as f64);
        let sum: f64 = waves
            .iter()
            .map(|[f, angle, phase, size]| size * (f * (x * angle.cos() + y * angle.sin()) + phase).sin())
            .sum();
        *v = (125.0 + sum).clamp(4.0, 246.0) as f32;
    }
    picture
}

fn save(picture: &Picture, path: &Path, quality: u8) {
    let bytes: Vec<u8> = picture.data.iter().map(|v| v.round().clamp(0.0, 255.0) as u8).collect();
    let file = std::fs::File::create(path).expect("a picture file");
    image::codecs::jpeg::JpegEncoder::new_with_quality(file, quality)
        .encode(&bytes, SIZE[0] as u32, SIZE[1] as u32, image::ExtendedColorType::L8)
        .expect("a picture");
}
