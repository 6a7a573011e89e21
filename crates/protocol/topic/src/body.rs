//! The bodies of the topics as values, each with the digest over its fields in a fixed order.

use std::sync::Arc;

use ds_raster::{Encoding, Mover, RgbImage};
use ds_space::{Digest, DigestWriter, Intrinsics, PoseSe2, SimTime, Tick};
use ds_world::{EgoState, Proposal, Reading, RouteCommand, Scene, Trajectory, WorldState};

use crate::spec::EpisodeSpec;

/// Body of `scene`: the fully resolved episode.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneMessage {
    /// The settings.
    pub spec: EpisodeSpec,
    /// The scenario.
    pub scene: Arc<Scene>,
    /// The first frame o_0 of each camera, in camera order; empty where no video model runs.
    pub first_frames: Vec<RgbImage>,
    /// Lens and image size that each camera has in the scenario, in camera order, where those of `scene` are a part of these
    /// images brought to the size of the video model's frames; empty where they are the scenario's own.
    pub originals: Vec<Intrinsics>,
}

/// Body of `world`.
#[derive(Debug, Clone, PartialEq)]
pub struct World {
    /// The state after the step to this tick.
    pub state: WorldState,
    /// Content digest of the state before it; zero at the first tick.
    pub before: Digest,
    /// Restorable state of the simulator; only at the last tick of an iteration.
    pub snapshot: Option<Vec<u8>>,
    /// How the iteration's proposals were ranked; only at its first tick, and only if they were.
    pub verdict: Option<Verdict>,
    /// What the car recorded of itself since the last tick; empty unless the episode asks for a vehicle log.
    pub readings: Vec<Reading>,
}

/// The simulator's ranking of the proposals of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// Index of the proposal that is driven.
    pub chosen: u32,
    /// Score of each proposal, 0 to 1.
    pub scores: Vec<f64>,
    /// Score of the reference plan, 0 to 1.
    pub reference: f64,
}

/// Body of `ego`: what a car knows of itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Ego {
    /// The estimated state, pose in the world frame (policies see it relative to their own start only).
    pub estimate: EgoState,
    /// What the navigation says.
    pub command: RouteCommand,
}

/// Body of `layout`.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// The condition image.
    pub image: RgbImage,
    /// How it travels; lossless.
    pub encoding: Encoding,
    /// The rig in the world at this tick.
    pub ego_in_world: PoseSe2,
    /// How far away what the picture shows is, and what of it moves by itself; none from a renderer that does not tell.
    pub geometry: Option<LayoutGeometry>,
}

/// Geometry of a layout picture; the camera is the scene's.
#[derive(Debug, Clone, PartialEq)]
pub struct LayoutGeometry {
    /// Inverse depth along the optical axis of each pixel, rows top to bottom, in steps of 1/65535 1/m; 0 is infinitely far.
    pub inverse_depths: Arc<[u16]>,
    /// What moves by itself.
    pub movers: Vec<Mover>,
}

/// Body of `frame`.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// What the camera saw.
    pub image: RgbImage,
    /// How it travels; lossless.
    pub encoding: Encoding,
    /// Mean absolute difference to the preview of the same tick that was generated with an older layout, 0 to 255; 0 if none.
    pub seam: f64,
}

/// Body of `plan`.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The answer, in the rig frame at the plan's tick.
    pub trajectory: Trajectory,
    /// All candidates, the answer among them if the policy proposes several.
    pub proposals: Vec<Proposal>,
    /// Time of the newest frame that the policy was shown, if the bridge says so.
    pub observed: Option<SimTime>,
    /// How the answer came about, in episodes that are driven by the wall clock alone.
    pub answered: Option<Answered>,
    /// What the policy attends to of the newest frames, before its own motion or the command enter: [tokens, channels].
    pub context: Option<Tensor>,
}

/// How the answer of a plan came about by the wall clock.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Answered {
    /// How long the policy took for each answer that came since the plan before, whether it is driven or not.
    pub latency_nanos: Vec<u64>,
    /// Iterations by which the observation that this plan answers is older than the plan; 0 if the answer came in time.
    pub iterations_late: u32,
}

/// Body of `cache`: the log entry of one committed chunk, opaque to all but the video model.
#[derive(Debug, Clone, PartialEq)]
pub struct Cache {
    /// The chunk; 0 is the first frame.
    pub chunk: u32,
    /// The first tick of the chunk.
    pub first: Tick,
    /// Ticks of the chunk.
    pub ticks: u32,
    /// The exact tensor fed to the forward pass that wrote the cache, [frames, tokens, 4, z].
    pub cached_input: Tensor,
    /// The clean latent that was decoded, [frames, tokens, 4, z], normalised.
    pub clean: Tensor,
    /// The control latent of the chunk, [frames, tokens, 4, channels].
    pub control: Tensor,
    /// Digest of all that does not change during a rollout: draw key, camera, prompt, first frame.
    pub conditioning: Digest,
    /// Digest over all keys and values committed so far; of a published model over the outputs of the passes that made
    /// them.
    pub cache_digest: Digest,
    /// Digest of the encoder's memory after the first frame, or of the first frame's latent.
    pub encoder_digest: Digest,
    /// Digest of the decoder's memory after the chunk; of a published model over the last frame of every chunk.
    pub decoder_digest: Digest,
    /// The last frame of the chunk, where the next chunk is made from it too.
    pub frame: Option<RgbImage>,
}

/// A dense tensor of 32-bit floats, row-major.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tensor {
    /// Extent of each axis.
    pub shape: Vec<u32>,
    /// Elements; their count is the product of the extents.
    pub values: Vec<f32>,
}

/// Body of `score`: sub-metrics so far.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Score {
    /// Lower-case name and value (0 to 1), sorted by name; `None` where the metric does not apply.
    pub values: Vec<(String, Option<f64>)>,
}

/// What kind of thing an event tells of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum EventKind {
    /// The attempt began.
    Started,
    /// The episode ended by plan.
    Completed,
    /// The episode ended early by rule (policy fault) or cannot go on.
    Failed,
    /// The episode was cancelled or ran out of retries.
    Aborted,
    /// Something broke and was dealt with.
    Fault,
    /// A role was given to another instance.
    Reassigned,
}

/// Body of `event`.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// What kind.
    pub kind: EventKind,
    /// A named reason such as `policy_deadline`, then details.
    pub reason: String,
}

/// Adds a trajectory to a digest.
pub fn digest_trajectory(writer: &mut DigestWriter, trajectory: &Trajectory) {
    writer.u64(trajectory.points().len() as u64);
    for point in trajectory.points() {
        writer.i64(point.after.0);
        digest_pose(writer, &point.pose);
    }
}

fn digest_pose(writer: &mut DigestWriter, pose: &PoseSe2) {
    writer.f64s(&[pose.position.x, pose.position.y, pose.heading_rad]);
}

fn digest_ego(writer: &mut DigestWriter, ego: &EgoState) {
    digest_pose(writer, &ego.pose);
    writer.f64s(&[ego.velocity_mps.x, ego.velocity_mps.y, ego.yaw_rate_radps]);
    writer.f64s(&[ego.acceleration_mps2.x, ego.acceleration_mps2.y, ego.steering_rad, ego.steering_rate_radps]);
}

impl World {
    /// Adds the payload fields to a digest; the snapshot, being derived, is left out.
    pub fn digest_into(&self, writer: &mut DigestWriter) {
        let state = &self.state;
        writer.u32(state.tick.0).i64(state.time.0);
        digest_ego(writer, &state.ego);
        writer.u64(state.agents.len() as u64);
        for agent in &state.agents {
            writer.u32(agent.id.0).u32(agent.class as u32);
            writer.f64s(&[agent.size.length_m, agent.size.width_m, agent.size.height_m]);
            digest_pose(writer, &agent.pose);
            writer.f64s(&[agent.z_m, agent.velocity_mps.x, agent.velocity_mps.y]);
        }
        writer.u64(state.lights.len() as u64);
        for light in &state.lights {
            writer.u32(*light as u32);
        }
        writer.u64(state.contacts.len() as u64);
        for contact in &state.contacts {
            writer.u32(contact.agent.0).u32(contact.kind as u32).bool(contact.at_fault).f64(contact.closing_speed_mps);
        }
        if let Some(verdict) = &self.verdict {
            writer.u32(verdict.chosen).u64(verdict.scores.len() as u64).f64s(&verdict.scores).f64(verdict.reference);
        }
        for reading in &self.readings {
            writer.f64s(&reading.to_array());
        }
    }
}

impl Ego {
    /// Adds the payload fields to a digest.
    pub fn digest_into(&self, writer: &mut DigestWriter) {
        digest_ego(writer, &self.estimate);
        writer.u32(self.command as u32);
    }
}

impl Layout {
    /// Adds width, height and raw RGB rows to a digest.
    pub fn digest_into(&self, writer: &mut DigestWriter) {
        self.image.digest_into(writer);
    }
}

impl Frame {
    /// Adds width, height and raw RGB rows to a digest.
    pub fn digest_into(&self, writer: &mut DigestWriter) {
        self.image.digest_into(writer);
    }
}

impl Plan {
    /// Adds the payload fields to a digest; stamp and latency, being derived and measured, are left out.
    pub fn digest_into(&self, writer: &mut DigestWriter) {
        digest_trajectory(writer, &self.trajectory);
        writer.u64(self.proposals.len() as u64);
        for proposal in &self.proposals {
            digest_trajectory(writer, &proposal.trajectory);
            writer.f64(proposal.score);
        }
        if let Some(context) = &self.context {
            context.digest_into(writer);
        }
    }
}

impl Tensor {
    fn digest_into(&self, writer: &mut DigestWriter) {
        writer.u64(self.shape.len() as u64);
        for extent in &self.shape {
            writer.u32(*extent);
        }
        for value in &self.values {
            writer.raw(&value.to_le_bytes());
        }
    }
}

impl Cache {
    /// Adds the payload fields to a digest.
    pub fn digest_into(&self, writer: &mut DigestWriter) {
        writer.u32(self.chunk).u32(self.first.0).u32(self.ticks);
        for tensor in [&self.cached_input, &self.clean, &self.control] {
            tensor.digest_into(writer);
        }
        for digest in [&self.conditioning, &self.cache_digest, &self.encoder_digest, &self.decoder_digest] {
            writer.digest(digest);
        }
        if let Some(frame) = &self.frame {
            frame.digest_into(writer);
        }
    }
}

impl Score {
    /// Adds the payload fields to a digest.
    pub fn digest_into(&self, writer: &mut DigestWriter) {
        writer.u64(self.values.len() as u64);
        for (name, value) in &self.values {
            writer.text(name).bool(value.is_some()).f64(value.unwrap_or(0.0));
        }
    }
}

impl Event {
    /// Adds the payload fields to a digest.
    pub fn digest_into(&self, writer: &mut DigestWriter) {
        writer.u32(self.kind as u32).text(&self.reason);
    }
}

impl SceneMessage {
    /// Returns the prompt of the video model; in recordings without one in their settings it is the scenario's.
    #[must_use]
    pub fn prompt(&self) -> &str {
        if self.spec.prompt.is_empty() { &self.scene.prompt } else { &self.spec.prompt }
    }

    /// Adds the settings, the scenario's digest and the first frames to a digest.
    pub fn digest_into(&self, writer: &mut DigestWriter) {
        let spec = &self.spec;
        writer.text(spec.episode.as_str()).text(&spec.scenario).digest(&spec.scenario_digest).text(&spec.policy);
        writer.u32(spec.observation as u32).text(&spec.appearance).u64(spec.seed);
        writer.u32(spec.replan_period).u32(spec.horizon).u32(spec.history).u32(spec.warm_up).u32(spec.last_tick.0);
        writer
            .u32(spec.agents as u32)
            .text(spec.tracker.name())
            .text(spec.layout_backend.name())
            .u32(spec.alignment as u32);
        writer.u32(spec.chunk_ticks).digest(&spec.video_model).digest(&spec.policy_model).digest(&spec.configuration);
        if (spec.scorer, spec.score_profile) != Default::default() {
            writer.u32(spec.scorer as u32).u32(spec.score_profile as u32);
        }
        for effect in &spec.effects {
            writer.text(&effect.id).f64s(&effect.values);
        }
        if spec.vehicle_log || spec.observation_delay > 0 {
            writer.bool(spec.vehicle_log).u32(spec.observation_delay);
        }
        if spec.layout_memory_ticks > 0 {
            writer.text("layout_memory_ticks").u32(spec.layout_memory_ticks);
        }
        if spec.layout_geometry {
            writer.text("layout_geometry");
        }
        if !spec.prompt.is_empty() {
            writer.text("prompt").text(&spec.prompt);
        }
        if spec.wall_clock {
            writer.text("wall_clock");
        }
        writer.digest(&self.scene.digest).u64(self.first_frames.len() as u64);
        for frame in &self.first_frames {
            frame.digest_into(writer);
        }
        if !self.originals.is_empty() {
            let lens = |of: &Intrinsics, writer: &mut DigestWriter| {
                writer.u32(of.width_px).u32(of.height_px);
                writer.f64s(&[of.fx_px, of.fy_px, of.cx_px, of.cy_px, of.k1, of.k2]);
            };
            writer.text("original_intrinsics");
            for (original, camera) in self.originals.iter().zip(&self.scene.cameras) {
                lens(original, writer);
                lens(&camera.intrinsics, writer);
            }
        }
    }
}
