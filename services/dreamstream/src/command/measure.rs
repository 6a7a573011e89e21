//! `measure`: a published video model with drawn weights on a device: ms per frame, memory, share of the roofline.
//!
//! The yardstick is one square matrix product in the number format of the large layers, measured in the same process;
//! a maker's figure may stand beside it. Operations are counted from shapes. Values of the network mean nothing here.

use std::time::Instant;

use anyhow::{Context, Result, bail};
use ds_process::terminal::answer;
use ds_stats::upper_median;
use ds_video::workload::{self, Workload};
use ds_video::{Backend, ModelConfig};

use crate::cli::MeasureArgs;

/// The most operations of a chunk that a processor is asked for: some minutes of its time.
const MAX_ON_PROCESSOR: f64 = 4e12;

/// Measures and prints one line per part.
///
/// # Errors
/// If the configuration is wrong or of no published model, or the device is absent or fails.
pub(crate) fn run(args: &MeasureArgs) -> Result<()> {
    let config = ModelConfig::load(&args.model).with_context(|| format!("configuration {:?}", args.model))?;
    if !config.is_published() {
        bail!("configuration {:?} is of an own model, measure those by `dreamstream bench --model`", args.model);
    }
    let backend = args.backend;
    let device = backend.ready()?;
    let operations = workload::operations(&config);
    let chunk = operations.denoise + operations.decode + operations.encode;
    if backend == Backend::Framework && chunk > MAX_ON_PROCESSOR {
        bail!(
            "no graphics processor is in use, and {:?} asks for {:.0} TFLOP per chunk, hours on a processor; choose --backend \
             cuda or vulkan in a build with that feature, or --model configs/models/wan-tiny.toml",
            config.name,
            chunk * 1e-12,
        );
    }
    answer(&format!("device     {device}"));
    let peak = yardstick(args, &config, backend)?;
    let frames = config.frames_per_chunk() as f64;
    answer(&format!(
        "model      {}, {}x{}, chunk {}, window {}, {} steps, cache {}",
        config.name,
        config.video.width_px,
        config.video.height_px,
        config.causal.chunk,
        config.causal.window,
        config.sampler.steps,
        config.causal.cache_source,
    ));
    let mut work = Workload::new(backend, &config)?;
    answer("part        ms per chunk  ms per frame       GFLOP    GFLOP/s  of yardstick  of maker's figure");
    let parts: [(&str, f64, Part); 3] = [
        ("denoise", operations.denoise, Workload::denoise),
        ("decode", operations.decode, |work| work.decode().map(drop)),
        ("encode", operations.encode, Workload::encode),
    ];
    let mut total = 0.0;
    for (name, count, part) in parts.into_iter().filter(|(_, count, _)| *count > 0.0) {
        let ms = timed(&mut work, part, args.rounds)?;
        total += ms;
        line(name, ms, frames, count, peak, args.peak_tflops);
    }
    line("all", total, frames, chunk, peak, args.peak_tflops);
    match workload::memory() {
        Some((used, reserved)) => {
            answer(&format!(
                "memory      {:.2} GB in use, {:.2} GB reserved",
                used as f64 * 1e-9,
                reserved as f64 * 1e-9
            ));
        }
        None => answer("memory      the back end does not tell"),
    }
    Ok(())
}

/// What is timed of a chunk.
type Part = fn(&mut Workload) -> Result<(), String>;

/// Returns the median time of one part of a chunk in milliseconds, over so many rounds after one that is not counted.
fn timed(work: &mut Workload, part: Part, rounds: u32) -> Result<f64> {
    let mut times = Vec::new();
    for round in 0..=rounds {
        let began = Instant::now();
        part(work).map_err(|fault| anyhow::anyhow!("the device reports a fault: {fault}"))?;
        if round > 0 {
            times.push(began.elapsed().as_secs_f64() * 1e3);
        }
    }
    median(&mut times)
}

fn median(times: &mut [f64]) -> Result<f64> {
    upper_median(times).context("nothing was timed")
}

/// Measures the matrix product; returns operations per second.
fn yardstick(args: &MeasureArgs, config: &ModelConfig, backend: Backend) -> Result<f64> {
    let side = match (args.yardstick, backend) {
        (0, Backend::Framework) => 1024,
        (0, _) => 8192,
        (side, _) => side,
    };
    let product = workload::yardstick(config, side);
    let mut times = Vec::new();
    for round in 0..=args.rounds {
        let began = Instant::now();
        let value = product.run();
        if round > 0 && value.is_finite() {
            times.push(began.elapsed().as_secs_f64() * 1e3);
        }
    }
    let rate = product.operations() / (median(&mut times)? * 1e-3);
    answer(&format!(
        "yardstick  product of {side}x{side} in {:?}: {:.3} TFLOP/s",
        config.precision.linear,
        rate * 1e-12
    ));
    Ok(rate)
}
fn line(name: &str, ms: f64, frames: f64, count: f64, peak: f64, maker: Option<f64>) {
    let rate = count / (ms * 1e-3);
    let share = maker.map_or_else(|| "-".to_owned(), |maker| format!("{:.1} %", 100.0 * rate / (maker * 1e12)));
    answer(&format!(
        "{name:<10} {ms:>13.2} {:>13.2} {:>11.1} {:>10.1} {:>11.1} % {share:>18}",
        ms / frames,
        count * 1e-9,
        rate * 1e-9,
        100.0 * rate / peak,
    ));
}
