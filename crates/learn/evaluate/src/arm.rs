//! An arm: weights and the way frames are made of them.

mod teacher;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use ds_nn::Weights;
use ds_raster::RgbImage;
use ds_space::{Digest, DigestWriter, Tick};
use ds_topic::ObservationSource;
use ds_train::guidance::{Guidance, Teacher};
use ds_video::ablation::{per_frame_digest, replace_transformer, silenced};
use ds_video::{Ablated, Ablation, Backend, Layout, ModelConfig, PerFrame, Rollout, VideoModel};

use teacher::Sampling;

use crate::config::{ArmConfig, ArmKind, EvalConfig};
use crate::drive::Drive;
use crate::error::EvaluationError;

/// Weights that a configuration names and that are not there.
#[derive(Debug, thiserror::Error)]
#[error("there are no weights {0:?}; `just arms` makes those that do not ship (docs/training.md)")]
struct Absent(PathBuf);

type Cause = Box<dyn std::error::Error + Send + Sync>;

/// How a teacher is sampled that names nothing.
const TEACHER: Sampling = Sampling {
    guidance: Guidance { weight: 2.5, keep_look: false, levels: Guidance::EVERYWHERE },
    steps: 16,
    window: 6,
    layouts: true,
};

/// Weights, ready to make frames.
pub struct Arm {
    /// Name in the configuration.
    pub name: String,
    /// How frames are made.
    pub kind: ArmKind,
    /// What the configuration remarks on it.
    pub remark: String,
    /// Whether its layouts leave out what stands beside the road.
    bare: bool,
    model: Arc<VideoModel>,
    /// The network of a teacher or prior and how it is sampled.
    teacher: Option<(Teacher, Sampling)>,
    digest: Digest,
}

impl Arm {
    /// Loads an arm of a configuration.
    ///
    /// # Errors
    /// If a file is broken or weights do not fit the preset.
    pub fn load(config: &EvalConfig, name: &str) -> Result<Self, EvaluationError> {
        let wrap = |source: Cause| EvaluationError::Arm { arm: name.to_owned(), source };
        let arm = &config.arms[name];
        for file in [Some(&arm.weights), arm.dit.as_ref()].into_iter().flatten().map(|file| config.path(file)) {
            if !file.exists() {
                return Err(wrap(Absent(file).into()));
            }
        }
        Self::open(config, name, arm).map_err(wrap)
    }

    /// Loads what makes the frames of a generated source: a preset's own weights, or, without guidance, another
    /// transformer.
    ///
    /// # Errors
    /// If a file is absent or broken or weights do not fit the preset.
    pub fn of_source(
        source: ObservationSource,
        preset: &Path,
        weights: &Path,
        no_guidance: &Path,
    ) -> Result<Self, EvaluationError> {
        let ablation = match source {
            ObservationSource::DreamstreamCleanCache => Some(Ablation::CleanCache),
            ObservationSource::DreamstreamNoLayout => Some(Ablation::NoLayout),
            ObservationSource::DreamstreamNoGuidance => Some(Ablation::Transformer(no_guidance.to_path_buf())),
            _ => None,
        };
        let open = || {
            if ablation.as_ref() == Some(&Ablation::Transformer(no_guidance.to_path_buf())) && !no_guidance.is_file() {
                return Err(Cause::from(Absent(no_guidance.to_path_buf())));
            }
            let preset = ModelConfig::load(preset)?;
            let model = match &ablation {
                None => VideoModel::load(&preset, weights)?,
                Some(ablation) => Ablated::read(&preset, weights, ablation)?.model(Backend::default())?,
            };
            let per_frame = source == ObservationSource::PerFrame;
            let digest = if per_frame { per_frame_digest(&model.digest()) } else { model.digest() };
            let kind = if per_frame { ArmKind::PerFrame } else { ArmKind::Student };
            let (name, remark, model) = (source.name().to_owned(), String::new(), Arc::new(model));
            Ok(Self { name, kind, remark, bare: false, model, teacher: None, digest })
        };
        open().map_err(|cause: Cause| EvaluationError::Arm { arm: source.name().to_owned(), source: cause })
    }

    fn open(config: &EvalConfig, name: &str, arm: &ArmConfig) -> Result<Self, Cause> {
        let mut preset = ModelConfig::load(&config.path(&arm.model))?;
        let mut weights = VideoModel::read(&preset, &config.path(&arm.weights))?;
        if let Some(source) = &arm.cache_source {
            preset.causal.cache_source.clone_from(source);
        }
        if let Some(dit) = &arm.dit {
            replace_transformer(&mut weights, &preset, &config.path(dit))?;
        }
        preset.causal.ablation |= arm.cache_source.is_some();
        let (steps, keep_look) = (&arm.steps, &arm.keep_look);
        let settings = [&arm.kind as &dyn std::fmt::Debug, &arm.guidance, steps, &arm.dropout, &arm.window, keep_look]
            .map(|part| format!("{part:?}"));
        Self::new(name, arm, &preset, &weights, &settings.join(" "))
    }

    fn new(
        name: &str,
        arm: &ArmConfig,
        preset: &ModelConfig,
        weights: &Weights,
        settings: &str,
    ) -> Result<Self, Cause> {
        let prior = arm.kind == ArmKind::Prior;
        let teacher = (prior || arm.kind == ArmKind::Teacher).then(|| {
            let weight = if prior { 1.0 } else { arm.guidance.unwrap_or(TEACHER.guidance.weight) };
            let sampling = Sampling {
                guidance: Guidance { weight, keep_look: arm.keep_look, ..TEACHER.guidance },
                steps: arm.steps.unwrap_or(TEACHER.steps),
                window: arm.window.unwrap_or(TEACHER.window),
                layouts: !prior,
            };
            Ok::<_, Cause>((Teacher::new(preset, &weights.part("dit."), arm.dropout.unwrap_or_default())?, sampling))
        });
        let model = match arm.kind {
            ArmKind::NoLayout => VideoModel::new(preset, &silenced(&preset.ae(), weights))?,
            ArmKind::Student | ArmKind::Teacher | ArmKind::Prior | ArmKind::Autoencoder | ArmKind::PerFrame => {
                VideoModel::new(preset, weights)?
            }
        };
        let digest = DigestWriter::new().digest(&model.digest()).text(settings).bool(arm.bare).finish();
        let (name, remark) = (name.to_owned(), arm.remark.clone());
        let (kind, bare) = (arm.kind, arm.bare);
        Ok(Self { name, kind, remark, bare, model: Arc::new(model), teacher: teacher.transpose()?, digest })
    }

    /// Returns the digest of preset, weights and way of making frames.
    #[must_use]
    pub fn digest(&self) -> Digest {
        self.digest
    }

    /// Returns the width and height of the frames, in pixels.
    #[must_use]
    pub fn size_px(&self) -> (u32, u32) {
        let video = &self.model.config().video;
        (video.width_px, video.height_px)
    }

    /// Returns the frames of a chunk; what is encoded and decoded at once has none.
    #[must_use]
    pub fn frames_per_chunk(&self) -> u32 {
        if self.kind == ArmKind::Autoencoder { u32::MAX } else { self.model.config().frames_per_chunk() as u32 }
    }

    /// Makes frames 0 to `last` of a drive, frame 0 being the world's own.
    ///
    /// # Errors
    /// If a layout cannot be rendered or the model gives values that are not finite.
    pub fn roll(&self, drive: &mut Drive, last: u32) -> Result<Vec<RgbImage>, EvaluationError> {
        let layout = |frame| if self.bare { drive.bare_layout(frame) } else { drive.layout(frame) };
        let layouts: Vec<Layout> = (0..=last).map(layout).collect::<Result<_, _>>()?;
        self.roll_with(drive, &layouts)
    }

    /// Makes a frame per layout, frame 0 being the drive's own.
    ///
    /// # Errors
    /// If the model gives values that are not finite.
    pub fn roll_with(&self, drive: &Drive, layouts: &[Layout]) -> Result<Vec<RgbImage>, EvaluationError> {
        self.roll_from(drive, drive.frame(0)?, layouts)
    }

    /// Makes a frame per layout, frame 0 being given.
    ///
    /// # Errors
    /// As [`Self::roll_with`].
    pub fn roll_from(
        &self,
        drive: &Drive,
        first: RgbImage,
        layouts: &[Layout],
    ) -> Result<Vec<RgbImage>, EvaluationError> {
        if self.kind == ArmKind::Autoencoder {
            let own: Vec<RgbImage> =
                (0..layouts.len() as u32).map(|frame| drive.frame(frame)).collect::<Result<_, _>>()?;
            return Ok(ds_train::autoencoder::reconstructed(&self.model, &own, &images(layouts)));
        }
        let made = match &self.teacher {
            None if self.kind == ArmKind::PerFrame => {
                one_by_one(&self.model, drive, &first, &images(layouts)).map_err(Into::into)
            }
            Some((teacher, sampling)) => {
                teacher::clip(&self.model, teacher, drive, &first, &images(layouts), *sampling).map_err(Into::into)
            }
            None => student(&self.model, drive, &first, layouts).map_err(Into::into),
        };
        let refuse =
            |source: Cause| EvaluationError::Rollout { arm: self.name.clone(), drive: drive.name.clone(), source };
        let mut frames = vec![first];
        frames.extend(made.map_err(refuse)?);
        Ok(frames)
    }
}

fn images(layouts: &[Layout]) -> Vec<RgbImage> {
    layouts.iter().map(|layout| layout.image.clone()).collect()
}

fn one_by_one(
    model: &Arc<VideoModel>,
    drive: &Drive,
    first: &RgbImage,
    layouts: &[RgbImage],
) -> Result<Vec<RgbImage>, ds_video::VideoError> {
    let frames = PerFrame::new(Arc::clone(model), drive.draw_key, "front", &drive.prompt, first)?;
    (0..).zip(layouts).skip(1).map(|(tick, layout)| frames.frame(Tick(tick), layout)).collect()
}

fn student(
    model: &Arc<VideoModel>,
    drive: &Drive,
    first: &RgbImage,
    layouts: &[Layout],
) -> Result<Vec<RgbImage>, ds_video::VideoError> {
    let (mut rollout, _) = Rollout::new(Arc::clone(model), drive.draw_key, "front", &drive.prompt, first, &layouts[0])?;
    Ok(rollout.generate(&layouts[1..])?.frames)
}

#[cfg(test)]
mod tests;
