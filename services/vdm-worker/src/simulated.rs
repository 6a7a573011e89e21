//! A stage that generates nothing: it waits so long for each chunk and returns one grey frame for every tick.
//!
//! It stands in for devices that are not there when the rest of the fleet is measured. It says so in its compute class, and
//! the digest that it gives for its model is no model's, so its results never pass for driven ones.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use ds_process::maker::{Abilities, Fault, Inputs, Maker, MakerFactory, Output, output};
use ds_raster::{Encoding, RgbImage};
use ds_space::{CameraModel, Digest, Tick};
use ds_topic::body::Tensor;
use ds_topic::{Advance, Cache, Frame, Layout, ObservationSource, Role, SceneMessage, Slot, Topic};
use ds_video::ModelConfig;

use crate::models::load_config;

/// What every pixel shows.
const GREY: [u8; 3] = [128; 3];

/// Opens episodes that only wait, with chunks and frames of a model's size.
pub struct SimulatedStage {
    config: ModelConfig,
    wait: Duration,
}

impl SimulatedStage {
    /// Takes the sizes of a model, whose weights are not read, and how long to wait for each chunk.
    ///
    /// # Errors
    /// If the configuration is refused, or the time is no time.
    pub fn new(model: &Path, secs: f64) -> anyhow::Result<Self> {
        let config = load_config(model).map_err(anyhow::Error::msg)?;
        let wait = Duration::try_from_secs_f64(secs)
            .map_err(|error| anyhow::anyhow!("setting \"video.simulated_secs\" is {secs}: {error}"))?;
        Ok(Self { config, wait })
    }

    fn name(&self) -> String {
        format!("simulated video, {} s a chunk of {} ticks", self.wait.as_secs_f64(), self.config.frames_per_chunk())
    }
}

impl MakerFactory for SimulatedStage {
    fn role(&self) -> Role {
        Role::Video
    }

    fn compute_class(&self) -> String {
        self.name()
    }

    fn abilities(&self) -> Abilities {
        Abilities {
            video_model: Digest::of(self.name().as_bytes()),
            chunk_ticks: u32::try_from(self.config.frames_per_chunk()).unwrap_or(u32::MAX),
            layout_memory_ticks: u32::try_from(self.config.layout_memory_ticks()).unwrap_or(u32::MAX),
            layout_geometry: self.config.control.carried,
            frame_px: [self.config.video.width_px, self.config.video.height_px],
            ..Abilities::default()
        }
    }

    fn open(&self, scene: Arc<SceneMessage>) -> Result<Box<dyn Maker>, Fault> {
        if scene.spec.observation != ObservationSource::Dreamstream {
            let asked = scene.spec.observation.name();
            return Err(Fault::deterministic("simulated", format!("a simulated worker makes no {asked} frames")));
        }
        Ok(Box::new(Simulated { scene, wait: self.wait }))
    }
}

/// An episode that is waited for.
struct Simulated {
    scene: Arc<SceneMessage>,
    wait: Duration,
}

/// Returns how many chunks the ticks of an order lie in; one that is cut is made again by the next order, as a model would.
fn chunks(first: Tick, last: Tick, chunk_ticks: u32) -> u32 {
    let chunk = |tick: Tick| tick.0.saturating_sub(1) / chunk_ticks.max(1);
    if last.0 == 0 { 0 } else { 1 + chunk(last) - chunk(first) }
}

/// Returns the log entry of a chunk of which nothing was computed.
fn empty(chunk: u32, chunk_ticks: u32) -> Cache {
    let ticks = if chunk == 0 { 1 } else { chunk_ticks };
    Cache {
        chunk,
        first: Tick((chunk * chunk_ticks + 1).saturating_sub(ticks)),
        ticks,
        cached_input: Tensor::default(),
        clean: Tensor::default(),
        control: Tensor::default(),
        conditioning: Digest::default(),
        cache_digest: Digest::default(),
        encoder_digest: Digest::default(),
        decoder_digest: Digest::default(),
        frame: None,
    }
}

fn frame(camera: &CameraModel) -> Frame {
    let lens = &camera.intrinsics;
    Frame { image: RgbImage::filled(lens.width_px, lens.height_px, GREY), encoding: Encoding::None, seam: 0.0 }
}

impl Maker for Simulated {
    fn restore(&mut self, _order: &Advance, _inputs: &Inputs) -> Result<(), Fault> {
        Ok(())
    }

    fn work(&mut self, order: &Advance, inputs: &Inputs) -> Result<Vec<Output>, Fault> {
        let (spec, mut outputs) = (&self.scene.spec, Vec::new());
        for (index, camera) in (0u16..).zip(&self.scene.scene.cameras) {
            let made = frame(camera);
            for tick in order.first.to(order.last) {
                // What a model would look at has to be there.
                inputs.decode::<Layout>(Slot::of_camera(Topic::Layout, tick.0, index))?;
                outputs.push(output(Slot::of_camera(Topic::Frame, tick.0, index), tick, &made));
            }
            for chunk in spec.chunks_of(order.iteration) {
                let cache = empty(chunk, spec.chunk_ticks);
                outputs.push(output(Slot::of_camera(Topic::Cache, chunk, index), cache.first, &cache));
            }
        }
        std::thread::sleep(self.wait * chunks(order.first, order.last, spec.chunk_ticks));
        Ok(outputs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_chunks_as_a_model_would_make() {
        let orders = [(0, 0), (1, 5), (6, 10), (1, 4), (17, 20), (5, 5)].map(|(first, last)| (Tick(first), Tick(last)));
        assert_eq!(orders.map(|order| chunks(order.0, order.1, 4)), [0, 2, 2, 1, 1, 1]);
        let firsts = [0, 1, 2].map(|chunk| (empty(chunk, 4).first.0, empty(chunk, 4).ticks));
        assert_eq!(firsts, [(0, 1), (1, 4), (5, 4)]);
    }

    #[test]
    fn it_says_that_it_is_simulated_and_gives_a_digest_of_its_own() {
        let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/models/smoke.toml");
        let [fast, slow] = [0.1, 0.2].map(|secs| SimulatedStage::new(&model, secs).expect("a sound preset"));
        assert!(fast.compute_class().starts_with("simulated video, 0.1 s a chunk"), "{}", fast.compute_class());
        assert_ne!(fast.abilities().video_model, slow.abilities().video_model);
        assert_ne!(fast.abilities().video_model, Digest::default());
        for bad in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(SimulatedStage::new(&model, bad).is_err(), "{bad} is no time");
        }
    }
}
