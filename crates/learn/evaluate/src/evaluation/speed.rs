//! Speed: frames a second of a preset from layouts to frames, chunk by chunk, after the window has filled; and how near
//! its transformer comes to plain matrix products.

use std::hint::black_box;
use std::sync::Arc;

use ds_camera::{Appearance, ReferenceWorld};
use ds_kernel::peak::Yardstick;
use ds_nn::safetensors::WeightsFile;
use ds_space::Digest;
use ds_video::{Denoising, Layout, ModelConfig, Rollout, VideoError, VideoModel};

use super::Seconds;
use crate::config::{EvalConfig, SpeedConfig};
use crate::drive::{Drive, Route};
use crate::error::EvaluationError;
use crate::estimate::{Resamples, mean};
use crate::outcome::SpeedOutcome;

/// Pairs of measurements of transformer and matrix product.
const ROUNDS: usize = 15;
/// Repetitions of each, so that a clock of milliseconds tells them.
const REPEATS: u32 = 4;
const YARDSTICK_SIDE: usize = 768;

/// Times chunks of frames of one drive; the time of a chunk includes its layouts.
///
/// # Errors
/// If the model cannot be loaded or gives values that are not finite.
pub fn measure(
    config: &EvalConfig,
    speed: &SpeedConfig,
    resamples: Resamples,
    seconds: Seconds<'_>,
) -> Result<SpeedOutcome, EvaluationError> {
    let wrap =
        |source: Box<dyn std::error::Error + Send + Sync>| EvaluationError::Arm { arm: "speed".to_owned(), source };
    let preset = ModelConfig::load(&config.path(&speed.model)).map_err(|error| wrap(error.into()))?;
    let model = match &speed.weights {
        Some(weights) => {
            let file = WeightsFile::read(&config.path(weights)).map_err(|error| wrap(error.into()))?;
            VideoModel::new(&preset, &file.weights).map_err(|error| wrap(error.into()))?
        }
        None => VideoModel::untrained(&preset, &Digest::of(b"speed")),
    };
    let size_px = (preset.video.width_px, preset.video.height_px);
    let scene = ds_scenario::generate(ds_scenario::Family::LeadBraking, config.columns.first_seed + 1);
    let model = Arc::new(model);
    let route = Route { scene: Arc::new(scene), start: 0, pace: 1.0, look: Appearance::DAY, turned_deg: 0.0 };
    let mut drive = Drive::new(&ReferenceWorld, &route, size_px)?;
    let refuse = |source: VideoError| EvaluationError::Rollout {
        arm: "speed".to_owned(),
        drive: drive_name(&route),
        source: source.into(),
    };
    let (first, layout) = (drive.frame(0)?, drive.layout(0)?);
    let (mut rollout, _) =
        Rollout::new(Arc::clone(&model), drive.draw_key, "front", &drive.prompt, &first, &layout).map_err(refuse)?;
    let per_chunk = preset.frames_per_chunk() as u32;
    let warm_up = preset.causal.window as u32 * per_chunk;
    let (mut frame, mut rates) = (0, Vec::new());
    while frame < warm_up + speed.frames {
        let began = seconds();
        let layouts: Vec<Layout> =
            (frame + 1..=frame + per_chunk).map(|frame| drive.layout(frame)).collect::<Result<_, _>>()?;
        let made = rollout.generate(&layouts).map_err(refuse)?.frames;
        let took = seconds() - began;
        if frame >= warm_up {
            rates.push(took / made.len() as f64);
        }
        frame += per_chunk;
    }
    // The rate of all chunks together, not the mean of rates: slow chunks count as long as they last.
    let rate = |picks: &[usize]| mean(picks.iter().map(|pick| rates[*pick])).map(|secs| 1.0 / secs.max(1e-9));
    let rounds = rounds(&model, seconds);
    let over = |of: &dyn Fn(&(f64, f64)) -> f64| {
        resamples.estimate(rounds.len(), |picks| mean(picks.iter().map(|pick| of(&rounds[*pick]))))
    };
    Ok(SpeedOutcome {
        preset: preset.name.clone(),
        frames_per_second: resamples.estimate(rates.len(), rate),
        gemm_share: over(&|(transformer, gemm)| transformer / gemm),
        transformer_gflops: over(&|(transformer, _)| transformer * 1e-9),
        gemm_gflops: over(&|(_, gemm)| gemm * 1e-9),
        threads: std::thread::available_parallelism().map_or(1, usize::from) as u64,
    })
}

/// Times the transformer and the matrix product of the `gemm` crate in turn, on all threads: operations a second of both.
fn rounds(model: &Arc<VideoModel>, seconds: Seconds<'_>) -> Vec<(f64, f64)> {
    let (denoising, mut yardstick) = (Denoising::new(model), Yardstick::new(YARDSTICK_SIDE));
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let rate = |operations: f64, run: &mut dyn FnMut()| {
        run();
        let began = seconds();
        (0..REPEATS).for_each(|_| run());
        f64::from(REPEATS) * operations / (seconds() - began).max(1e-9)
    };
    let mut round = |_| {
        let peak = rate(yardstick.operations(), &mut || {
            black_box(yardstick.run(threads));
        });
        (rate(denoising.operations(), &mut || drop(black_box(denoising.run()))), peak)
    };
    (0..ROUNDS).map(&mut round).collect()
}

fn drive_name(route: &Route) -> String {
    format!("{}@{}", route.scene.name, route.start)
}
