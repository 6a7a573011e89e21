//! The tiny autoencoder, on frames alone.
//!
//! Loss: L1 + 0.1·L1 of the image gradients + a small penalty on the latents. Latents get a little noise, so that the
//! decoder forgives the errors of a generator. After training, mean and deviation per latent channel are measured and
//! stored beside the weights (`latent.mean`, `latent.std`).

use ds_clips::Clip;
use ds_nn::body::Autoencoder;
use ds_nn::safetensors::WeightsFile;
use ds_nn::step::AeBatch;
use ds_nn::tiny_ae::{AeShape, Memory};
use ds_nn::{Array, Weights};
use ds_raster::RgbImage;
use ds_space::{Digest, DigestWriter, Draws};
use ds_video::{ModelConfig, VideoModel, tokens};

use crate::batch::{self, mean_step};
use crate::checkpoint::{Member, Run};
use crate::colour::{Colour, Steps};
use crate::condition::latent_steps;
use crate::config::{StageConfig, TrainConfig};
use crate::emphasis::Emphasis;
use crate::error::TrainError;
use crate::frames::Frames;
use crate::{Progress, Report, sheet};

const NAME: &str = "autoencoder";
const LATENT_NOISE: f32 = 0.05;
const LATENT_PENALTY: f32 = 1e-4;
/// Clips that statistics and PSNR are measured on.
const EVALUATION_CLIPS: u64 = 48;
/// Frames of a held-out clip that are measured.
const HELD_OUT_FRAMES: usize = 41;
/// Clips of the contact sheet.
const SHOWN_CLIPS: u64 = 8;

/// Trains the autoencoder to its configured number of steps.
///
/// # Errors
/// If a file cannot be used or the loss is not finite.
pub fn run(config: &TrainConfig, progress: &mut dyn Progress) -> Result<Report, TrainError> {
    let stage = config.autoencoder.as_ref().ok_or_else(|| TrainError::no_stage(NAME))?;
    let shape = unguided(&config.model()?);
    let frames = Frames::open(config, &stage.sets)?;
    let seed = DigestWriter::new().text(NAME).u64(config.seed).finish();
    let initial = config.initial("vae.")?;
    let member = Member::new("model", &shape.declare(), stage.optimiser(), &seed).grown_from(&initial);
    let mut run = Run::open(config, NAME, stage, vec![member])?;
    let team = config.backend.team();
    while run.unfinished() {
        let (weights, at) = (run.weights(), run.step);
        let step = mean_step(&team, stage, |clip| {
            let batch = self::batch(config, stage, &frames, &shape, &seed, at, clip)?;
            Ok(config.backend.reconstruction(&shape, weights, &batch))
        })?;
        if !run.apply(step, progress)? {
            break;
        }
    }
    let mut figures = evaluate(config, &frames, &shape, run.average())?;
    figures.extend(held_out(config, &shape, run.average())?);
    if run.step == 0 {
        keep_statistics(config, &initial)?;
    }
    Ok(run.report(figures))
}

/// Returns the sizes of the autoencoder without the decoder's guidance, as its own stage trains it.
pub(crate) fn unguided(model: &ModelConfig) -> AeShape {
    AeShape { guides: 0, carried: false, ..model.ae() }
}

/// Draws one clip of a step.
fn batch(
    config: &TrainConfig,
    stage: &StageConfig,
    sets: &Frames,
    shape: &AeShape,
    seed: &Digest,
    step: u32,
    clip: u64,
) -> Result<AeBatch, TrainError> {
    let draws = Draws::new(seed, "batch", &[u64::from(step), clip]);
    let mut clip = sets.draw(&draws, 1 + (stage.latents - 1) * shape.stride_t)?;
    if let Some(crop_px) = stage.crop_px {
        let whole = [clip.frames[0].width_px(), clip.frames[0].height_px()];
        let place =
            |draw: u64, axis: usize| draws.below(draw, u64::from(whole[axis].saturating_sub(crop_px[axis])) + 1);
        let corner_px = [place(2, 0) as u32, place(3, 1) as u32];
        for image in clip.frames.iter_mut().chain(&mut clip.layouts) {
            *image = image.part(corner_px, crop_px);
        }
    }
    let size = (clip.frames[0].height_px() as usize, clip.frames[0].width_px() as usize);
    let (mut folded, mut images, mut weights) = (Vec::new(), Vec::new(), Vec::new());
    for (frames, layouts) in
        latent_steps(&clip.frames, shape.stride_t).iter().zip(latent_steps(&clip.layouts, shape.stride_t))
    {
        folded.extend(tokens::fold(frames));
        images.extend(tokens::stacked(frames).into_values());
        weights.extend(Emphasis::of(config).of_pixels(&layouts));
    }
    let steps = folded.len() / (size.0 / 8 * (size.1 / 8) * shape.inputs());
    let (h, w) = (size.0 / 8, size.1 / 8);
    #[expect(clippy::cast_possible_truncation, reason = "noise is single precision")]
    let noise = (16..16 + (steps * h * w * shape.z) as u64).map(|i| LATENT_NOISE * draws.normal(i) as f32).collect();
    Ok(AeBatch {
        clips: 1,
        folded: Array::new(&[steps, h, w, shape.inputs()], folded),
        frames: Array::new(&[steps * shape.stride_t, size.0, size.1, 3], images),
        emphasis: Array::new(&[steps * shape.stride_t, size.0, size.1, 1], weights),
        noise: Array::new(&[steps, h, w, shape.z], noise),
        latent_penalty: LATENT_PENALTY,
    })
}

/// Encodes frames that begin a drive: [latents, h, w, z], not normalised.
#[must_use]
pub fn encode(ae: &dyn Autoencoder, shape: &AeShape, frames: &[RgbImage]) -> Array {
    let steps = latent_steps(frames, shape.stride_t);
    let (h, w) = (frames[0].height_px() as usize / 8, frames[0].width_px() as usize / 8);
    let folded = steps.iter().flat_map(|step| tokens::fold(step)).collect();
    ae.encode(&Array::new(&[steps.len(), h, w, shape.inputs()], folded), &mut Memory::default())
}

/// Encodes frames that begin a drive and decodes them beside their layouts.
#[must_use]
pub fn reconstructed(model: &VideoModel, frames: &[RgbImage], layouts: &[RgbImage]) -> Vec<RgbImage> {
    let shape = model.config().ae();
    let whole = |images: &[RgbImage]| {
        let (steps, last) = ((images.len() - 1).div_ceil(shape.stride_t), images.len() - 1);
        (0..=steps * shape.stride_t).map(|at| images[at.min(last)].clone()).collect::<Vec<_>>()
    };
    let (own, layouts) = (whole(frames), whole(layouts));
    let latents = encode(model.autoencoder(), &shape, &own);
    let guides = latent_steps(&layouts, shape.stride_t).concat();
    let guides = (shape.guides > 0).then(|| tokens::stacked(&guides));
    let mut made = decode(model.autoencoder(), &shape, &latents, guides.as_ref());
    made.truncate(frames.len());
    made
}

/// Decodes a whole clip of latents, beside layouts in the shape of its frames; the copies before the first frame are
/// dropped.
#[must_use]
pub fn decode(ae: &dyn Autoencoder, shape: &AeShape, latents: &Array, layouts: Option<&Array>) -> Vec<RgbImage> {
    let frames = ae.decode(latents, layouts, &mut Memory::default());
    let (height, width) = (frames.shape()[1], frames.shape()[2]);
    let images = frames.values().chunks_exact(height * width * 3).skip(shape.stride_t - 1);
    images.map(|values| RgbImage::of_values(values, width as u32, height as u32)).collect()
}

/// Measures PSNR on drawn clips, writes a sheet, and stores mean and deviation of the latents.
fn evaluate(
    config: &TrainConfig,
    sets: &Frames,
    shape: &AeShape,
    weights: &Weights,
) -> Result<Vec<(String, f32)>, TrainError> {
    let ae = config.backend.autoencoder(shape, weights)?;
    let (mut sums, mut squares, mut count) = (vec![0.0f64; shape.z], vec![0.0f64; shape.z], 0.0f64);
    let (mut rows, mut psnr) = (Vec::new(), 0.0);
    for index in 0..EVALUATION_CLIPS {
        let draws = Draws::from_seed(index, "autoencoder-evaluation");
        let clip = sets.draw(&draws, usize::MAX)?;
        let latents = encode(ae.as_ref(), shape, &clip.frames);
        for pixel in latents.values().chunks_exact(shape.z) {
            count += 1.0;
            for (channel, value) in pixel.iter().enumerate() {
                sums[channel] += f64::from(*value);
                squares[channel] += f64::from(*value).powi(2);
            }
        }
        let decoded = decode(ae.as_ref(), shape, &latents, None);
        psnr += batch::psnr_db(&clip.frames, &decoded) / EVALUATION_CLIPS as f32;
        if index < SHOWN_CLIPS {
            rows.extend([every_third(&clip.frames), every_third(&decoded)]);
        }
    }
    #[expect(clippy::cast_possible_truncation, reason = "statistics are stored in single precision")]
    let mean: Vec<f32> = sums.iter().map(|sum| (sum / count) as f32).collect();
    let deviation = |(sum, square): (&f64, &f64)| (square / count - (sum / count).powi(2)).max(1e-8).sqrt();
    #[expect(clippy::cast_possible_truncation, reason = "statistics are stored in single precision")]
    let std: Vec<f32> = sums.iter().zip(&squares).map(|pair| deviation(pair) as f32).collect();
    sheet::write(&config.folder.join("autoencoder.png"), &rows)?;
    let mut file = WeightsFile { weights: weights.clone(), ..Default::default() };
    file.weights.insert("latent.mean", Array::new(&[shape.z], mean));
    file.weights.insert("latent.std", Array::new(&[shape.z], std));
    file.metadata.insert("psnr_db".to_owned(), psnr.to_string());
    file.write(&config.folder.join("autoencoder.safetensors"))?;
    Ok(vec![("psnr_db".to_owned(), psnr)])
}

/// Measures reconstructions of the first frames of every held-out clip, a guided decoder's beside their layouts: PSNR,
/// detail as a ratio of the true frames', and of both the steps at the borders of 8×8 blocks over those inside (1 is free
/// of blocks). Nothing without such a set.
pub(crate) fn held_out(
    config: &TrainConfig,
    shape: &AeShape,
    weights: &Weights,
) -> Result<Vec<(String, f32)>, TrainError> {
    let Some(set) = &config.held_out else { return Ok(Vec::new()) };
    let ae = config.backend.autoencoder(shape, weights)?;
    let (mut psnr, mut detail, mut steps, mut count) = (0.0, [0.0; 2], [Steps::default(); 2], 0.0);
    for clip in Frames::open(config, std::slice::from_ref(set))?.beginnings(HELD_OUT_FRAMES) {
        let Clip { frames, layouts, .. } = clip?;
        let layouts = (shape.guides > 0).then(|| tokens::stacked(&latent_steps(&layouts, shape.stride_t).concat()));
        let decoded = decode(ae.as_ref(), shape, &encode(ae.as_ref(), shape, &frames), layouts.as_ref());
        let frames = &frames[..decoded.len()];
        psnr += f64::from(batch::psnr_db(frames, &decoded));
        count += 1.0;
        for (of, images) in [frames, &decoded].into_iter().enumerate() {
            for image in images {
                let Steps { across, inside } = Steps::of(image);
                detail[of] += Colour::of(image).detail;
                steps[of] = Steps { across: steps[of].across + across, inside: steps[of].inside + inside };
            }
        }
    }
    let border = steps.map(|steps| steps.across / steps.inside);
    let figures = [
        ("held_out_psnr_db", psnr / count),
        ("held_out_laplacian_ratio", detail[1] / detail[0]),
        ("held_out_border_ratio", border[1]),
        ("held_out_reference_border_ratio", border[0]),
    ];
    #[expect(clippy::cast_possible_truncation, reason = "figures for people")]
    Ok(figures.map(|(name, value)| (name.to_owned(), value as f32)).to_vec())
}

/// Gives an autoencoder that was taken over as it is the statistics that came with it: they belong to its latents.
fn keep_statistics(config: &TrainConfig, initial: &Weights) -> Result<(), TrainError> {
    let path = config.folder.join("autoencoder.safetensors");
    let mut file = WeightsFile::read(&path)?;
    for name in ["latent.mean", "latent.std"] {
        if let Some(array) = initial.get(name) {
            file.weights.insert(name, array.clone());
        }
    }
    Ok(file.write(&path)?)
}

fn every_third(frames: &[RgbImage]) -> Vec<RgbImage> {
    frames.iter().step_by(3).take(12).cloned().collect()
}
