//! Frames of the video model made one by one, for source `per-frame`: nothing is remembered, so there is nothing to restore.

use std::sync::Arc;

use ds_process::maker::{Fault, Inputs, Maker, Output, bad, output};
use ds_raster::Encoding;
use ds_topic::{Advance, Frame, Layout, SceneMessage, Slot, Topic};
use ds_video::{PerFrame, VideoModel};

use crate::lens::Lens;

/// All cameras of one episode.
pub struct OneByOne {
    cameras: Vec<PerFrame>,
    lens: Option<Lens>,
}

impl OneByOne {
    /// Prepares an episode.
    ///
    /// # Errors
    /// If a first frame is missing or the prompt is refused.
    pub fn new(model: &Arc<VideoModel>, scene: &Arc<SceneMessage>) -> Result<Self, Fault> {
        let camera = |(index, camera): (usize, &ds_space::CameraModel)| {
            let first = scene.first_frames.get(index);
            let first = first
                .ok_or_else(|| Fault::deterministic("missing_input", format!("no first frame of camera {index}")))?;
            let (model, key) = (Arc::clone(model), scene.spec.draw_key());
            PerFrame::new(model, key, camera.id.as_str(), scene.prompt(), first)
                .map_err(|error| bad("rollout_refused", &error))
        };
        let cameras = scene.scene.cameras.iter().enumerate().map(camera).collect::<Result<_, _>>()?;
        Ok(Self { lens: Lens::of(scene), cameras })
    }
}

impl Maker for OneByOne {
    fn restore(&mut self, _order: &Advance, _inputs: &Inputs) -> Result<(), Fault> {
        Ok(())
    }

    fn work(&mut self, order: &Advance, inputs: &Inputs) -> Result<Vec<Output>, Fault> {
        let mut outputs = Vec::new();
        for tick in order.first.to(order.last) {
            for (index, camera) in (0u16..).zip(&self.cameras) {
                let layout: Layout = inputs.decode(Slot::of_camera(Topic::Layout, tick.0, index))?;
                let mut image = camera.frame(tick, &layout.image).map_err(|error| bad("generation_failed", &error))?;
                if let Some(lens) = &self.lens {
                    image = lens.see(&image, tick, index, None)?;
                }
                let frame = Frame { image, encoding: Encoding::None, seam: 0.0 };
                outputs.push(output(Slot::of_camera(Topic::Frame, tick.0, index), tick, &frame));
            }
        }
        Ok(outputs)
    }
}
