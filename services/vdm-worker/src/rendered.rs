//! The observation sources without a video model: reference camera, plain game-engine look, the layout itself, the log as
//! the reference camera saw it (as it is, or warped to where the ego stands), the second world's camera.

use std::sync::Arc;

use ds_camera::{Appearance, Condition, PlainCamera, ReferenceCamera, ReprojectedCamera};
use ds_process::maker::{Fault, Inputs, Maker, Output, bad, output};
use ds_raster::{Encoding, ImageError, RgbImage};
use ds_second_camera::SecondCamera;
use ds_space::{CameraModel, Tick};
use ds_topic::{Advance, Frame, Layout, ObservationSource, SceneMessage, Slot, Topic, World};

use crate::lens::{Lens, Motion};

/// Renders frames of an episode without a video model.
pub struct Rendered {
    lens: Option<Lens>,
    scene: Arc<SceneMessage>,
    source: Source,
}

enum Source {
    Reference(Box<ReferenceCamera>),
    Plain(Box<PlainCamera>),
    Logged(Box<ReferenceCamera>),
    Reprojected(Box<ReprojectedCamera>),
    Abroad(Box<SecondCamera>),
    Layout,
}

impl Rendered {
    /// Prepares the renderer that the episode asks for.
    ///
    /// # Errors
    /// If the appearance is unknown.
    pub fn new(scene: Arc<SceneMessage>) -> Result<Self, Fault> {
        let look = || Appearance::named(&scene.spec.appearance).map_err(|error| bad("bad_settings", &error));
        let reference = || Ok::<_, Fault>(Box::new(ReferenceCamera::new(&scene.scene, look()?)));
        let source = match scene.spec.observation {
            ObservationSource::Reference => Source::Reference(reference()?),
            ObservationSource::Logged => Source::Logged(reference()?),
            ObservationSource::Reprojected => {
                Source::Reprojected(Box::new(ReprojectedCamera::new(Arc::clone(&scene.scene), look()?)))
            }
            ObservationSource::Abroad => {
                let look = look()?;
                let condition = look.condition.unwrap_or(Condition::DAY);
                Source::Abroad(Box::new(SecondCamera::new(&scene.scene, condition, look.palette_seed)))
            }
            ObservationSource::SimRgb => Source::Plain(Box::new(PlainCamera::new(&scene.scene))),
            ObservationSource::Layout => Source::Layout,
            source => return Err(Fault::deterministic("not_rendered", format!("{} is generated", source.name()))),
        };
        Ok(Self { lens: Lens::of(&scene), scene, source })
    }

    fn image(&self, inputs: &Inputs, tick: Tick, camera: (u16, &CameraModel)) -> Result<RgbImage, Fault> {
        let unseen = |error: ImageError| bad("frame_refused", &error);
        let seen = || {
            let state = inputs.decode::<World>(Slot::new(Topic::World, tick.0))?.state;
            let rig = state.ego.pose.world_from_rig(0.0);
            Ok::<_, Fault>((state, rig))
        };
        match &self.source {
            Source::Layout => Ok(inputs.decode::<Layout>(Slot::of_camera(Topic::Layout, tick.0, camera.0))?.image),
            Source::Logged(renderer) => {
                let state = self.scene.scene.logged_world(tick);
                renderer.render(&state, camera.1, state.ego.pose.world_from_rig(0.0)).map_err(unseen)
            }
            Source::Reference(renderer) => {
                let (state, rig) = seen()?;
                renderer.render(&state, camera.1, rig).map_err(unseen)
            }
            Source::Plain(renderer) => {
                let (state, rig) = seen()?;
                renderer.render(&state, camera.1, rig).map_err(unseen)
            }
            Source::Reprojected(renderer) => {
                let (state, rig) = seen()?;
                renderer.render(&state, camera.1, rig).map_err(unseen)
            }
            Source::Abroad(renderer) => {
                let (state, rig) = seen()?;
                renderer.render(&state, camera.1, rig).map_err(unseen)
            }
        }
    }
}

impl Rendered {
    /// Returns the ego's motion where this source sees the world.
    fn motion(&self, inputs: &Inputs, tick: Tick) -> Result<Option<Motion>, Fault> {
        if matches!(self.source, Source::Layout) {
            return Ok(None);
        }
        let ego = inputs.decode::<World>(Slot::new(Topic::World, tick.0))?.state.ego;
        Ok(Some((ego.speed_mps(), ego.yaw_rate_radps)))
    }
}

impl Maker for Rendered {
    fn restore(&mut self, _order: &Advance, _inputs: &Inputs) -> Result<(), Fault> {
        Ok(())
    }

    fn work(&mut self, order: &Advance, inputs: &Inputs) -> Result<Vec<Output>, Fault> {
        let mut outputs = Vec::new();
        for tick in order.first.to(order.last) {
            for (index, camera) in (0..).zip(&self.scene.scene.cameras) {
                let mut image = self.image(inputs, tick, (index, camera))?;
                if let Some(lens) = &self.lens {
                    image = lens.see(&image, tick, index, self.motion(inputs, tick)?)?;
                }
                let frame = Frame { image, encoding: Encoding::None, seam: 0.0 };
                outputs.push(output(Slot::of_camera(Topic::Frame, tick.0, index), tick, &frame));
            }
        }
        Ok(outputs)
    }
}
