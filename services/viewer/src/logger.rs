//! Turns messages, one by one and in any order, into entities of the viewer at their simulation time.
//!
//! Keeps the path driven so far and the newest ego poses, which plans and overlays are placed by. Images are sent as
//! JPEG (about a thirtieth of raw); nothing of what is logged is read back.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use ds_raster::{Encoding, RgbImage};
use ds_record::pictures::top_view::{class_colour, in_world, light_colour};
use ds_space::{DQuat, DVec2, DVec3, PoseSe2, SimTime, Tick};
use ds_topic::{Envelope, Event, EventKind, Frame, Layout, Plan, SceneMessage, Score, Topic, World};
use ds_wire::Body;
use ds_world::{AgentState, Scene, WorldState};
use rerun::{Boxes3D, EncodedImage, LineStrips2D, LineStrips3D, RecordingStream, Scalars, TextLog, Transform3D};

use crate::diagnosis::Findings;
use crate::map::{self, strip};
use crate::stream::TIMELINE;
use crate::{ViewError, boxes};

const EGO: [u8; 3] = [64, 222, 128];
const PLAN: [u8; 3] = [255, 150, 40];
const PROPOSAL: [u8; 3] = [150, 112, 160];
/// World states that are kept for messages that come late.
const KEPT: usize = 64;

/// Logs the messages of one episode.
pub struct Logger {
    stream: RecordingStream,
    scene: Arc<Scene>,
    path: Vec<DVec2>,
    states: BTreeMap<Tick, (PoseSe2, Vec<AgentState>)>,
    findings: Findings,
}

impl Logger {
    /// Logs the still part of the scene.
    ///
    /// # Errors
    /// If the stream does not take it.
    pub fn new(scene: &SceneMessage, stream: RecordingStream) -> Result<Self, ViewError> {
        stream.set_log_tick_enabled(false);
        stream.set_log_time_enabled(false);
        map::log(&scene.scene, &stream)?;
        let scene = scene.scene.clone();
        Ok(Self { stream, scene, path: Vec::new(), states: BTreeMap::new(), findings: Findings::default() })
    }

    /// Logs a message.
    ///
    /// # Errors
    /// If its body cannot be decoded or the stream does not take it.
    pub fn log(&mut self, envelope: &Envelope) -> Result<(), ViewError> {
        self.set_time(envelope.header.time);
        let (tick, camera) = (envelope.header.tick, envelope.header.slot.camera);
        match envelope.header.slot.topic {
            Topic::World => self.world(&body::<World>(envelope)?.state),
            Topic::Layout => self.image(camera, "layout", &body::<Layout>(envelope)?.image),
            Topic::Frame => {
                self.image(camera, "frame", &body::<Frame>(envelope)?.image)?;
                self.overlay(camera, tick)
            }
            Topic::Plan => self.plan(tick, &body(envelope)?),
            Topic::Score => self.score(&body(envelope)?),
            Topic::Event => self.event(&body(envelope)?),
            Topic::Diagnosis => self.findings.log(&body(envelope)?, &self.stream),
            Topic::Scene | Topic::Advance | Topic::Ego | Topic::Cache => Ok(()),
        }
    }

    fn set_time(&self, time: SimTime) {
        self.stream.set_time(TIMELINE, Duration::from_nanos(u64::try_from(time.0).unwrap_or_default()));
    }

    fn world(&mut self, state: &WorldState) -> Result<(), ViewError> {
        self.path.push(state.ego.pose.position);
        self.states.insert(state.tick, (state.ego.pose, state.agents.clone()));
        if self.states.len() > KEPT {
            self.states.pop_first();
        }
        let agents = Boxes3D::from_centers_and_half_sizes(
            state.agents.iter().map(|agent| centre(&agent.pose, agent.z_m + 0.5 * agent.size.height_m)),
            state.agents.iter().map(|agent| half(agent.size.length_m, agent.size.width_m, agent.size.height_m)),
        )
        .with_quaternions(state.agents.iter().map(|agent| turn(agent.pose.heading_rad)))
        .with_colors(state.agents.iter().map(|agent| class_colour(agent.class)))
        .with_labels(state.agents.iter().map(|agent| format!("{:?} {}", agent.class, agent.id).to_lowercase()))
        .with_show_labels(false);
        self.stream.log("world/agents", &agents)?;
        self.ego(state)?;
        self.lights(state)?;
        self.stream.log("curves/speed_mps", &Scalars::new([state.ego.speed_mps()]))?;
        for contact in &state.contacts {
            let fault = if contact.at_fault { "at fault" } else { "not at fault" };
            let text = format!("contact ({:?}) with agent {}, {fault}", contact.kind, contact.agent).to_lowercase();
            self.stream.log("event", &TextLog::new(text).with_level("WARN"))?;
        }
        Ok(())
    }

    fn ego(&self, state: &WorldState) -> Result<(), ViewError> {
        let (size, pose) = (self.scene.vehicle.size, state.ego.pose);
        let place = Transform3D::from_translation(centre(&pose, 0.0))
            .with_quaternion(rerun::Quaternion::from_xyzw(turn(pose.heading_rad)));
        self.stream.log("world/ego", &place)?;
        let middle = PoseSe2::new(self.scene.vehicle.rear_axle_to_centre_m, 0.0, 0.0);
        let body = Boxes3D::from_centers_and_half_sizes(
            [centre(&middle, 0.5 * size.height_m)],
            [half(size.length_m, size.width_m, size.height_m)],
        );
        self.stream.log("world/ego/body", &body.with_colors([EGO]))?;
        let path = LineStrips3D::new([strip(&self.path, 0.06)]).with_radii([0.1]).with_colors([EGO]);
        Ok(self.stream.log("world/path", &path)?)
    }

    fn lights(&self, state: &WorldState) -> Result<(), ViewError> {
        let lines = &self.scene.map.stop_lines;
        if lines.is_empty() {
            return Ok(());
        }
        let colour = |light: Option<u32>| {
            light
                .and_then(|light| state.lights.get(light as usize))
                .map_or([235, 235, 235], |state| light_colour(*state))
        };
        let strips = LineStrips3D::new(lines.iter().map(|line| strip(&line.points, 0.05)));
        let strips = strips.with_radii([0.15]).with_colors(lines.iter().map(|line| colour(line.light)));
        Ok(self.stream.log("world/stop_lines", &strips)?)
    }

    fn plan(&self, tick: Tick, plan: &Plan) -> Result<(), ViewError> {
        let Some((made_at, _)) = self.states.get(&tick) else { return Ok(()) };
        let answer = LineStrips3D::new([strip(&in_world(made_at, &plan.trajectory), 0.12)]);
        self.stream.log("world/plan/answer", &answer.with_radii([0.15]).with_colors([PLAN]))?;
        let lines = plan.proposals.iter().map(|proposal| strip(&in_world(made_at, &proposal.trajectory), 0.1));
        let labels = plan.proposals.iter().map(|proposal| format!("{:.3}", proposal.score));
        let proposals = LineStrips3D::new(lines).with_radii([0.06]).with_colors([PROPOSAL]).with_labels(labels);
        Ok(self.stream.log("world/plan/proposals", &proposals.with_show_labels(false))?)
    }

    fn image(&self, camera: u16, kind: &str, image: &RgbImage) -> Result<(), ViewError> {
        let Some(model) = self.scene.cameras.get(usize::from(camera)) else { return Ok(()) };
        let bytes = image.encode(Encoding::Jpeg)?;
        let picture = EncodedImage::new(bytes).with_media_type("image/jpeg");
        Ok(self.stream.log(format!("camera/{}/{kind}", model.id), &picture)?)
    }

    /// Draws the boxes of the agents over the frame.
    fn overlay(&self, camera: u16, tick: Tick) -> Result<(), ViewError> {
        let Some(model) = self.scene.cameras.get(usize::from(camera)) else { return Ok(()) };
        let Some((ego, agents)) = self.states.get(&tick) else { return Ok(()) };
        let (mut strips, mut colours) = (Vec::new(), Vec::new());
        for agent in agents {
            let edges = boxes::edges(model, ego, agent);
            colours.extend(edges.iter().map(|_| class_colour(agent.class)));
            strips.extend(edges);
        }
        let lines = LineStrips2D::new(strips).with_colors(colours).with_radii([0.4]);
        Ok(self.stream.log(format!("camera/{}/frame/boxes", model.id), &lines)?)
    }

    fn score(&self, score: &Score) -> Result<(), ViewError> {
        for (name, value) in &score.values {
            if let Some(value) = value {
                self.stream.log(format!("score/{name}"), &Scalars::new([*value]))?;
            }
        }
        Ok(())
    }

    fn event(&self, event: &Event) -> Result<(), ViewError> {
        let level = match event.kind {
            EventKind::Started | EventKind::Completed => "INFO",
            EventKind::Fault | EventKind::Reassigned | EventKind::Aborted => "WARN",
            EventKind::Failed => "ERROR",
        };
        let text = format!("{:?} {}", event.kind, event.reason).to_lowercase();
        Ok(self.stream.log("event", &TextLog::new(text.trim_end()).with_level(level))?)
    }
}

/// Reads the body of a message and compares it with its header.
fn body<B: Body>(envelope: &Envelope) -> Result<B, ViewError> {
    ds_wire::verify(envelope).map_err(|source| ViewError::Message { slot: envelope.header.slot, source })
}

#[expect(clippy::cast_possible_truncation, reason = "the viewer works in single precision")]
fn single(value: DVec3) -> [f32; 3] {
    [value.x as f32, value.y as f32, value.z as f32]
}

fn centre(pose: &PoseSe2, z_m: f64) -> [f32; 3] {
    single(pose.position.extend(z_m))
}

fn half(length_m: f64, width_m: f64, height_m: f64) -> [f32; 3] {
    single(DVec3::new(length_m, width_m, height_m) * 0.5)
}

/// Returns a turn about the vertical as x, y, z, w.
#[expect(clippy::cast_possible_truncation, reason = "the viewer works in single precision")]
fn turn(heading_rad: f64) -> [f32; 4] {
    DQuat::from_rotation_z(heading_rad).to_array().map(|value| value as f32)
}
