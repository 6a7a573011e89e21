//! Stage 0: the tiny autoencoder, on frames alone.
//!
//! Loss: L1 + 0.1·L1 of the image gradients + a small penalty on the latents. Latents get a little noise, so that the
//! decoder forgives the errors of a generator. After training, mean and deviation per latent channel are measured and
//! stored beside the weights (`latent.mean`, `latent.std`).

use ds_nn::step::{self, AeBatch};
use ds_nn::tiny_ae::{AeShape, Memory, TinyAe};
use ds_nn::{Array, Weights};
use ds_raster::RgbImage;
use ds_space::{Digest, DigestWriter, Draws};
use ds_video::pixels;

use crate::batch::{self, latent_steps};
use crate::checkpoint::Run;
use crate::clips::{Clip, ClipFile};
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::latents::unguided;
use crate::{Progress, Report, emphasis, sheet};

const NAME: &str = "autoencoder";
const LATENT_NOISE: f32 = 0.05;
const LATENT_PENALTY: f32 = 1e-4;
const EVALUATION_CLIPS: u64 = 8;

/// Trains the autoencoder to its configured number of steps.
///
/// # Errors
/// If a file cannot be used or the loss is not finite.
pub fn run(config: &TrainConfig, progress: &mut dyn Progress) -> Result<Report, TrainError> {
    let model = config.model()?;
    let shape = unguided(&model);
    let clips = batch::clip_file(config, &model);
    let seed = DigestWriter::new().text(NAME).u64(config.seed).finish();
    let mut run = Run::open(&config.folder, NAME, &config.autoencoder, &shape.declare(), &seed)?;
    let initial = config.initial("vae.")?;
    run.start_from(&initial);
    while run.unfinished() {
        let batch = self::batch(config, &clips, &shape, &seed, run.step)?;
        let step = step::autoencoder(&shape, &run.weights, &batch);
        if !run.apply(&step, progress)? {
            break;
        }
    }
    let figures = evaluate(config, &clips, &shape, &run.average)?;
    if run.step == 0 {
        keep_statistics(config, &initial)?;
    }
    Ok(run.report(figures))
}

fn batch(
    config: &TrainConfig,
    clips: &ClipFile,
    shape: &AeShape,
    seed: &Digest,
    step: u32,
) -> Result<AeBatch, TrainError> {
    let stage = &config.autoencoder;
    let frames = 1 + (stage.latents - 1) * shape.stride_t;
    let (mut folded, mut images, mut emphasis, mut size) = (Vec::new(), Vec::new(), Vec::new(), (0, 0));
    for index in 0..stage.clips {
        let draws = Draws::new(seed, "batch", &[u64::from(step), index as u64]);
        let clip = batch::training_clip(config, clips, &draws)?;
        let from = draws.below(1, (config.data.frames - frames + 1) as u64) as usize;
        let clip = clips.read(clip, from, frames)?;
        size = (clip.frames[0].height_px() as usize, clip.frames[0].width_px() as usize);
        for step in latent_steps(&clip.frames, shape.stride_t) {
            folded.extend(pixels::fold(&step));
            images.extend(pixels::to_values(&step).into_values());
        }
        for step in latent_steps(&clip.layouts, shape.stride_t) {
            emphasis.extend(emphasis::of_pixels(&step, config.data.road_users));
        }
    }
    let steps = stage.clips * stage.latents;
    let (h, w) = (size.0 / 8, size.1 / 8);
    let noise = Draws::new(seed, "latent-noise", &[u64::from(step)]);
    #[expect(clippy::cast_possible_truncation, reason = "noise is single precision")]
    let noise = (0..(steps * h * w * shape.z) as u64).map(|i| LATENT_NOISE * noise.normal(i) as f32).collect();
    Ok(AeBatch {
        clips: stage.clips,
        folded: Array::new(&[steps, h, w, shape.inputs()], folded),
        frames: Array::new(&[steps * shape.stride_t, size.0, size.1, 3], images),
        emphasis: Array::new(&[steps * shape.stride_t, size.0, size.1, 1], emphasis),
        noise: Array::new(&[steps, h, w, shape.z], noise),
        latent_penalty: LATENT_PENALTY,
    })
}

/// Encodes a whole clip: [latents, h, w, z], not normalised.
#[must_use]
pub fn encode(ae: &TinyAe, shape: &AeShape, clip: &Clip) -> Array {
    let steps = latent_steps(&clip.frames, shape.stride_t);
    let (h, w) = (clip.frames[0].height_px() as usize / 8, clip.frames[0].width_px() as usize / 8);
    let folded = steps.iter().flat_map(|step| pixels::fold(step)).collect();
    ae.encode(&Array::new(&[steps.len(), h, w, shape.inputs()], folded), &mut Memory::default())
}

/// Decodes a whole clip of latents; the copies before the first frame are dropped.
#[must_use]
pub fn decode(ae: &TinyAe, shape: &AeShape, latents: &Array) -> Vec<RgbImage> {
    let frames = ae.decode(latents, None, &mut Memory::default());
    let (height, width) = (frames.shape()[1], frames.shape()[2]);
    let images = frames.values().chunks_exact(height * width * 3).skip(shape.stride_t - 1);
    images.map(|values| pixels::to_image(values, width as u32, height as u32)).collect()
}

/// Measures PSNR on held-out clips, writes a sheet, and stores mean and deviation of the latents.
fn evaluate(
    config: &TrainConfig,
    clips: &ClipFile,
    shape: &AeShape,
    weights: &Weights,
) -> Result<Vec<(String, f32)>, TrainError> {
    let ae = TinyAe::new(shape, weights)?;
    let (mut sums, mut squares, mut count) = (vec![0.0f64; shape.z], vec![0.0f64; shape.z], 0.0f64);
    let (mut rows, mut psnr) = (Vec::new(), 0.0);
    let (first, held_out) = batch::held_out(config, clips);
    let evaluated = held_out.min(EVALUATION_CLIPS);
    for index in first..first + evaluated {
        let clip = clips.read(index, 0, config.data.frames)?;
        let latents = encode(&ae, shape, &clip);
        for pixel in latents.values().chunks_exact(shape.z) {
            count += 1.0;
            for (channel, value) in pixel.iter().enumerate() {
                sums[channel] += f64::from(*value);
                squares[channel] += f64::from(*value).powi(2);
            }
        }
        let decoded = decode(&ae, shape, &latents);
        psnr += batch::psnr_db(&clip.frames, &decoded) / evaluated as f32;
        rows.extend([every_third(&clip.frames), every_third(&decoded)]);
    }
    #[expect(clippy::cast_possible_truncation, reason = "statistics are stored in single precision")]
    let mean: Vec<f32> = sums.iter().map(|sum| (sum / count) as f32).collect();
    let deviation = |(sum, square): (&f64, &f64)| (square / count - (sum / count).powi(2)).max(1e-8).sqrt();
    #[expect(clippy::cast_possible_truncation, reason = "statistics are stored in single precision")]
    let std: Vec<f32> = sums.iter().zip(&squares).map(|pair| deviation(pair) as f32).collect();
    sheet::write(&config.folder.join("autoencoder.png"), &rows)?;
    let mut file = ds_nn::safetensors::WeightsFile { weights: weights.clone(), ..Default::default() };
    file.weights.insert("latent.mean", Array::new(&[shape.z], mean));
    file.weights.insert("latent.std", Array::new(&[shape.z], std));
    file.metadata.insert("psnr_db".to_owned(), psnr.to_string());
    file.write(&Run::weights_path(&config.folder, NAME))?;
    Ok(vec![("psnr_db".to_owned(), psnr)])
}

/// Gives an autoencoder that was taken over as it is the statistics that came with it: they belong to its latents.
fn keep_statistics(config: &TrainConfig, initial: &Weights) -> Result<(), TrainError> {
    let path = Run::weights_path(&config.folder, NAME);
    let mut file = ds_nn::safetensors::WeightsFile::read(&path)?;
    for name in ["latent.mean", "latent.std"] {
        if let Some(array) = initial.get(name) {
            file.weights.insert(name, array.clone());
        }
    }
    Ok(file.write(&path)?)
}

fn every_third(frames: &[RgbImage]) -> Vec<RgbImage> {
    frames.iter().step_by(3).cloned().collect()
}
