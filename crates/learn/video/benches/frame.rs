//! Milliseconds and GFLOP/s per part of the video model beside the matrix product of the `gemm` crate, in one run:
//! `cargo bench -p ds-video`, or `cargo bench -p ds-video -- smoke cpu_train framework`.
//!
//! One thread is measured in processor time, which a shared machine can still tell; two threads in wall time. Every
//! round measures each part and the yardstick once, so that their ratios come from the same moments.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use ds_kernel::peak::Yardstick;
use ds_nn::Array;
use ds_nn::tiny_ae::Memory;
use ds_nn::work;
use ds_raster::RgbImage;
use ds_space::Digest;
use ds_video::{Backend, Denoising, ModelConfig, Rollout, VideoModel, sampler};

const ROUNDS: usize = 5;
const LEAST_MS: u128 = 40;
const SIDE: usize = 768;

/// Returns milliseconds of this thread's processor time if one thread works, else of wall time.
fn now_ms(start: Instant, threads: usize) -> f64 {
    let spent = (threads == 1).then(|| std::fs::read_to_string("/proc/thread-self/schedstat").ok()).flatten();
    let nanos = spent.as_deref().and_then(|text| text.split(' ').next()).and_then(|word| word.parse::<f64>().ok());
    nanos.map_or_else(|| start.elapsed().as_secs_f64() * 1e3, |nanos| nanos * 1e-6)
}

/// The times of every part, and its operations.
#[derive(Default)]
struct Record(BTreeMap<&'static str, (Vec<f64>, f64)>);

impl Record {
    /// Times a part often enough for the clock of processor time, which moves by some milliseconds.
    fn time<T>(&mut self, threads: usize, part: &'static str, operations: f64, mut run: impl FnMut() -> T) -> T {
        let began = Instant::now();
        let start = now_ms(began, threads);
        let mut result = run();
        let mut count = 1;
        while began.elapsed().as_millis() < LEAST_MS {
            result = run();
            count += 1;
        }
        let entry = self.0.entry(part).or_insert((Vec::new(), operations));
        entry.0.push((now_ms(began, threads) - start) / f64::from(count));
        result
    }

    fn median(&mut self, part: &str) -> f64 {
        let times = &mut self.0.get_mut(part).expect("every part was measured").0;
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    }
}

fn picture(config: &ModelConfig, k: u32) -> RgbImage {
    let (width, height) = (config.video.width_px, config.video.height_px);
    let mut image = RgbImage::filled(width, height, [40, 90, 150]);
    for (x, y) in (0..width).flat_map(|x| (height / 2..height).map(move |y| (x, y))) {
        image.set_pixel(x, y, if (x + 3 * k) % 16 < 3 { [230, 220, 40] } else { [90, 90, 95] });
    }
    image
}

fn rollout(model: &Arc<VideoModel>) -> Rollout {
    let (first, layout) = (picture(model.config(), 0), picture(model.config(), 100));
    let started = Rollout::new(Arc::clone(model), Digest::of(b"bench"), "front", "a road", &first, &layout);
    started.expect("random weights give finite values").0
}

/// Runs every part once with a full window, then a chunk of the whole path, then Δr = 5.
fn round(model: &Arc<VideoModel>, record: &mut Record, threads: usize, state: &mut [Rollout; 2]) {
    let config = model.config();
    let (dit, shape) = (model.transformer(), config.dit());
    let size = [config.causal.chunk, shape.tokens(), 4, config.vae.z];
    let layouts = Array::zeros(&[1, size[0] * size[1], 4, shape.control_inputs]);
    record.time(threads, "control", work::control(&shape, size[0]), || dit.control(&layouts));
    let noise = |step| sampler::noise(&Digest::of(b"bench"), "front", 1, step, &size);
    let noisy = record.time(threads, "noise", 0.0, || noise(1));
    let denoising = Denoising::new(model);
    record.time(threads, "denoise, one step", denoising.operations(), || denoising.run());
    let (h, w) = config.latent_size();
    let latents = Array::new(&[size[0], h, w, size[3]], noisy.values().to_vec());
    let frames = config.frames_per_chunk();
    let guide = Array::zeros(&[frames, 8 * h, 8 * w, 3]);
    let mut memory = Memory::default();
    model.autoencoder().decode(&latents, None, &mut memory);
    let operations = work::decode(&config.ae(), size[0], h, w);
    let guide = (config.control.decoder_layers > 0).then_some(&guide);
    record.time(threads, "decode", operations, || model.autoencoder().decode(&latents, guide, &mut memory));
    let pictures: Vec<RgbImage> = (0..20.max(frames)).map(|k| picture(config, k as u32)).collect();
    let [exact, replanned] = state;
    record.time(threads, "chunk, layouts to frames", 0.0, || exact.generate(&pictures[..frames]).expect("finite"));
    record.time(threads, "20 frames, 5 per replan", 0.0, || {
        for part in pictures[..20].chunks(5) {
            replanned.generate(part).expect("finite");
        }
    });
}

fn measure(model: &Arc<VideoModel>, threads: usize) -> String {
    let mut record = Record::default();
    let mut yardstick = Yardstick::new(SIDE);
    let mut state = [rollout(model), rollout(model)];
    // Until the window is full.
    let pictures: Vec<RgbImage> =
        (0..model.config().frames_per_chunk() as u32).map(|k| picture(model.config(), k)).collect();
    for _ in 0..model.config().causal.window {
        state.iter_mut().for_each(|rollout| drop(rollout.generate(&pictures).expect("finite")));
    }
    round(model, &mut Record::default(), threads, &mut state);
    yardstick.run(threads);
    for _ in 0..ROUNDS {
        let operations = yardstick.operations();
        record.time(threads, "gemm, the yardstick", operations, || yardstick.run(threads));
        round(model, &mut record, threads, &mut state);
    }
    let rate = |record: &mut Record, part: &str| record.0[part].1 / record.median(part) * 1e-6;
    let peak = rate(&mut record, "gemm, the yardstick");
    let clock = if threads == 1 { "processor" } else { "wall" };
    let mut text = format!("  {threads} thread(s), median {clock} time of {ROUNDS} rounds\n");
    let parts: Vec<&'static str> = record.0.keys().copied().collect();
    for part in parts {
        let (ms, operations) = (record.median(part), record.0[part].1);
        text += &format!("    {part:<28} {ms:>9.3} ms");
        if operations > 0.0 {
            let rate = rate(&mut record, part);
            text += &format!(" {:>8.3} GFLOP {rate:>8.1} GFLOP/s {:>6.1} %", operations * 1e-9, 100.0 * rate / peak);
        }
        let frames = match part {
            "chunk, layouts to frames" => model.config().frames_per_chunk() as f64,
            "20 frames, 5 per replan" => 20.0,
            _ => 0.0,
        };
        if frames > 0.0 {
            text += &format!(" {:>8.2} ms per frame, {:.1} frames/s", ms / frames, 1e3 * frames / ms);
        }
        text += "\n";
    }
    text
}

fn main() {
    let names: Vec<String> = std::env::args().skip(1).filter(|name| !name.starts_with("--")).collect();
    let backend = if names.iter().any(|name| name == "framework") { Backend::Framework } else { Backend::Cpu };
    let mut presets: Vec<&str> = names.iter().map(String::as_str).filter(|name| *name != "framework").collect();
    if presets.is_empty() {
        presets.push("embedded");
    }
    let say = |text: &str| std::io::Write::write_all(&mut std::io::stdout(), text.as_bytes()).expect("stdout is open");
    for preset in presets {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../../configs/models/{preset}.toml"));
        let config = ModelConfig::load(&path).expect("the preset is valid");
        let weights = ds_nn::Weights::initialised(&VideoModel::declare(&config), &Digest::of(b"weights"));
        let model = Arc::new(VideoModel::new_on(backend, &config, &weights).expect("the weights fit"));
        say(&format!("{preset}, backend {}\n", backend.name()));
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
            say(&pool.install(|| measure(&model, threads)));
        }
    }
}
