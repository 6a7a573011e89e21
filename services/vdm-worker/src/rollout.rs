//! The video model's rollouts, one per camera, and their `cache` log.

use std::sync::Arc;

use ds_process::maker::{Fault, Inputs, Maker, Output, bad, output};
use ds_raster::{Encoding, Geometry, RgbImage};
use ds_space::Tick;
use ds_topic::{Advance, Cache, Frame, SceneMessage, Slot, Topic};
use ds_video::{Generated, Layout, Replay, Rollout, VideoError, VideoModel};
use rayon::prelude::*;

use crate::lens::Lens;

/// All cameras of one episode.
pub struct Rollouts {
    model: Arc<VideoModel>,
    scene: Arc<SceneMessage>,
    cameras: Vec<Rollout>,
    lens: Option<Lens>,
}

impl Rollouts {
    /// Prepares an episode; its rollouts start with iteration 0 or are restored.
    #[must_use]
    pub fn new(model: Arc<VideoModel>, scene: Arc<SceneMessage>) -> Self {
        Self { model, lens: Lens::of(&scene), scene, cameras: Vec::new() }
    }

    fn first_frame(&self, camera: usize) -> Result<&RgbImage, Fault> {
        let frames = &self.scene.first_frames;
        frames
            .get(camera)
            .ok_or_else(|| Fault::deterministic("missing_input", format!("no first frame of camera {camera}")))
    }

    /// Returns the layout of a tick with its geometry, as the renderer tells it.
    fn layout(&self, inputs: &Inputs, tick: Tick, camera: u16) -> Result<Layout, Fault> {
        let layout: ds_topic::Layout = inputs.decode(Slot::of_camera(Topic::Layout, tick.0, camera))?;
        let model = &self.scene.scene.cameras[usize::from(camera)];
        let geometry = layout.geometry.map(|told| {
            let world_from_camera = layout.ego_in_world.world_from_rig(0.0) * model.rig_from_camera;
            let (inverse_depths, movers) = (told.inverse_depths, told.movers);
            Arc::new(Geometry { lens: model.intrinsics, world_from_camera, inverse_depths, movers })
        });
        Ok(Layout { image: layout.image, geometry })
    }

    fn start(&mut self, inputs: &Inputs) -> Result<Vec<Output>, Fault> {
        self.cameras.clear();
        let mut outputs = Vec::new();
        for (index, camera) in (0u16..).zip(&self.scene.scene.cameras) {
            let layout = self.layout(inputs, Tick(0), index)?;
            let first = self.first_frame(usize::from(index))?;
            let key = self.scene.spec.draw_key();
            let prompt = self.scene.prompt();
            let started = Rollout::new(Arc::clone(&self.model), key, camera.id.as_str(), prompt, first, &layout);
            let (rollout, entry) = started.map_err(|error| bad("rollout_refused", &error))?;
            let seen = seen(self.lens.as_ref(), rollout.first_frame().clone(), Tick(0), index)?;
            outputs.push(frame_output(Tick(0), index, seen, 0.0));
            outputs.push(cache_output(index, &entry));
            self.cameras.push(rollout);
        }
        Ok(outputs)
    }
}

/// Returns a frame as it leaves the camera.
fn seen(lens: Option<&Lens>, image: RgbImage, tick: Tick, camera: u16) -> Result<RgbImage, Fault> {
    match lens {
        Some(lens) => lens.see(&image, tick, camera, None),
        None => Ok(image),
    }
}

fn frame_output(tick: Tick, camera: u16, image: RgbImage, seam: f64) -> Output {
    let frame = Frame { image, encoding: Encoding::None, seam };
    output(Slot::of_camera(Topic::Frame, tick.0, camera), tick, &frame)
}

fn cache_output(camera: u16, cache: &Cache) -> Output {
    output(Slot::of_camera(Topic::Cache, cache.chunk, camera), cache.first, cache)
}

impl Maker for Rollouts {
    fn restore(&mut self, order: &Advance, inputs: &Inputs) -> Result<(), Fault> {
        self.cameras.clear();
        let Some(before) = order.first.previous().filter(|_| order.iteration > 0) else {
            return Ok(());
        };
        let spec = &self.scene.spec;
        let committed = 1 + before.0 / spec.chunk_ticks.max(1);
        for (index, camera) in (0u16..).zip(&self.scene.scene.cameras) {
            let mut entries = Vec::new();
            for chunk in 0..committed {
                entries.push(inputs.decode::<Cache>(Slot::of_camera(Topic::Cache, chunk, index))?);
            }
            let layouts = |ticks: std::ops::Range<u32>| -> Result<Vec<Layout>, Fault> {
                ticks.map(|tick| self.layout(inputs, Tick(tick), index)).collect()
            };
            let since = (committed - 1) * spec.chunk_ticks + 1;
            let past = match spec.layout_memory_ticks {
                0 => Vec::new(),
                remembered => layouts((since - 1).saturating_sub(remembered)..since)?,
            };
            let rollout = Rollout::replay(Replay {
                model: Arc::clone(&self.model),
                draw_key: spec.draw_key(),
                camera: camera.id.as_str(),
                prompt: self.scene.prompt(),
                first_frame: self.first_frame(usize::from(index))?,
                entries: &entries,
                past: &past,
                layouts: &layouts(since..before.0 + 1)?,
            })
            .map_err(|error| bad(Fault::RECOVERY_MISMATCH, &error))?;
            self.cameras.push(rollout);
        }
        Ok(())
    }

    fn work(&mut self, order: &Advance, inputs: &Inputs) -> Result<Vec<Output>, Fault> {
        if order.iteration == 0 {
            return self.start(inputs);
        }
        let mut layouts = Vec::new();
        for index in (0u16..).take(self.cameras.len()) {
            let ticks = order.first.to(order.last);
            let layout = |tick| self.layout(inputs, tick, index);
            layouts.push(ticks.map(layout).collect::<Result<Vec<Layout>, Fault>>()?);
        }
        // Cameras of one episode know nothing of each other, so each may have a thread of its own.
        let made = self.cameras.par_iter_mut().zip(layouts).map(|(rollout, layouts)| rollout.generate(&layouts));
        let made: Vec<Result<Generated, VideoError>> = made.collect();
        let mut outputs = Vec::new();
        for (index, made) in (0u16..).zip(made) {
            let made = made.map_err(|error| bad("generation_failed", &error))?;
            for (tick, image) in order.first.to(order.last).zip(made.frames) {
                let seam = if tick == order.first { f64::from(made.seam) } else { 0.0 };
                outputs.push(frame_output(tick, index, seen(self.lens.as_ref(), image, tick, index)?, seam));
            }
            outputs.extend(made.committed.iter().map(|committed| cache_output(index, committed)));
        }
        Ok(outputs)
    }
}

#[cfg(test)]
mod tests;
