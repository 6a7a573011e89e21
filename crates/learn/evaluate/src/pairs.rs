//! Frames of a video model beside the world's own of the same states: effect-free cases for the diagnosis of frames, of
//! several clips, each generated with several seeds of the noise (the layout of a case: `docs/gap-frames.md`).
//!
//! A clip follows the log of a scenario. The frame that the model starts from is the world's own and is left out, with
//! those that follow it closely. Depth in m along the axis and boxes in px are those of the layouts.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ds_camera::CameraWorld;
use ds_diagnosis::meta::{FrameMeta, FrameSplit, Pairing, PinholeEntry};
use ds_raster::{Encoding, Geometry, INVERSE_DEPTH_STEP, RgbImage};
use ds_space::{DVec3, Draws, Intrinsics};
use ds_video::Layout;
use ds_world::{AgentClass, AgentState, WorldState};
use image::ImageEncoder;

use crate::arm::Arm;
use crate::column::{look, scenario};
use crate::drive::{Drive, Route};
use crate::error::EvaluationError;

/// What is farther counts as this far, m.
const FARTHEST_M: f64 = 150.0;
/// Boxes that are narrower or lower are not listed, px.
const LEAST_BOX_PX: f64 = 4.0;
/// Share of a clip's frames that are kept from fits: one in so many, at its end.
const KEPT: u32 = 6;

/// Which cases are made.
#[derive(Debug, Clone)]
pub struct PairsPlan {
    /// Seed of the first eight scenarios, one per family; the next seed gives the next eight.
    pub first_seed: u64,
    /// Clips of a case.
    pub clips: u64,
    /// Seeds of the generator's noise.
    pub seeds: u64,
    /// The first frame that is kept, counted from the one that the model starts from.
    pub first: u32,
    /// Frames of a clip.
    pub frames: u32,
    /// The look of the scenarios, as in an evaluation's columns.
    pub look: String,
    /// Where more than 1, the world's own frames are also written this much larger, into `large`.
    pub over: u32,
}

impl PairsPlan {
    /// Says what of the plan cannot be, if anything.
    ///
    /// # Errors
    /// If a number is out of bounds.
    pub fn check(&self) -> Result<(), EvaluationError> {
        let rows = [
            ("clips", self.clips, 1, 1000),
            ("seeds", self.seeds, 1, 100),
            ("first", self.first.into(), 1, 1000),
            ("frames", self.frames.into(), 6, 1000),
            ("over", self.over.into(), 1, 8),
        ];
        match rows.iter().find(|(_, value, low, high)| !(low..=high).contains(&value)) {
            Some((field, _, low, high)) => Err(EvaluationError::config(*field, format!("must be {low} to {high}"))),
            None => Ok(()),
        }
    }
}

/// Writes a case, counted from 0, into a folder.
///
/// # Errors
/// If a frame cannot be made or a file cannot be written.
pub fn write(
    world: &dyn CameraWorld,
    arm: &Arm,
    plan: &PairsPlan,
    case: u64,
    folder: &Path,
) -> Result<(), EvaluationError> {
    let mut clips = Vec::new();
    let mut meta = None;
    for clip in 0..plan.clips {
        let index = case * plan.clips + clip;
        let scene = Arc::new(scenario(world, plan.first_seed, index));
        let last = plan.first + plan.frames - 1;
        let latest = u64::from(scene.last_tick().0.saturating_sub(last));
        let start = Draws::new(&scene.digest, "start of a clip", &[index]).below(0, latest + 1) as u32;
        let look = look(&plan.look, plan.first_seed + index)?;
        let route = Route { scene, start, pace: 1.0, look, turned_deg: 0.0 };
        let name = PathBuf::from(format!("clip_{clip:02}"));
        meta = Some(Clip::made(world, arm, plan, &route)?.write(plan, &folder.join(&name))?);
        clips.push(name);
    }
    let Some(meta) = meta else { return Ok(()) };
    let case = folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    Ok(FrameMeta { case, clips, seeds: Vec::new(), suggested_split: None, ..meta }.write(folder)?)
}

/// A clip: what was made of its states.
struct Clip {
    drive: Drive,
    worlds: Vec<WorldState>,
    /// Of each frame, the depth of each pixel, cm.
    depths_cm: Vec<Vec<u16>>,
    own: Vec<RgbImage>,
    large: Vec<RgbImage>,
    generated: Vec<Vec<RgbImage>>,
}

impl Clip {
    fn made(world: &dyn CameraWorld, arm: &Arm, plan: &PairsPlan, route: &Route) -> Result<Self, EvaluationError> {
        let size = arm.size_px();
        let mut drive = Drive::new(world, route, size)?;
        let all = 0..plan.first + plan.frames;
        let kept = plan.first..plan.first + plan.frames;
        let layouts: Vec<Layout> = all.map(|frame| drive.layout(frame)).collect::<Result<_, _>>()?;
        let own = kept.clone().map(|frame| drive.frame(frame)).collect::<Result<_, _>>()?;
        let large = if plan.over > 1 {
            let drive = Drive::new(world, route, (size.0 * plan.over, size.1 * plan.over))?;
            kept.clone().map(|frame| drive.frame(frame)).collect::<Result<_, _>>()?
        } else {
            Vec::new()
        };
        let key = drive.draw_key;
        let mut generated = Vec::new();
        for seed in 0..plan.seeds {
            drive.draw_key = Draws::key(&key, "seed of the noise", seed);
            let frames = arm.roll_with(&drive, &layouts)?;
            generated.push(frames.into_iter().skip(plan.first as usize).collect());
        }
        let worlds = kept.clone().map(|frame| drive.world(frame)).collect();
        let depths = kept.map(|frame| drive.geometry(frame).map(|seen| depth_cm(&seen)));
        let depths_cm = depths.collect::<Result<_, _>>()?;
        Ok(Self { drive, worlds, depths_cm, own, large, generated })
    }

    fn write(&self, plan: &PairsPlan, folder: &Path) -> Result<FrameMeta, EvaluationError> {
        let seeds: Vec<PathBuf> = (0..plan.seeds).map(|seed| PathBuf::from(format!("sim_{seed}"))).collect();
        for (name, frames) in seeds.iter().zip(&self.generated) {
            pictures(&folder.join(name), plan.first, frames)?;
        }
        pictures(&folder.join("real"), plan.first, &self.own)?;
        if !self.large.is_empty() {
            pictures(&folder.join("large"), plan.first, &self.large)?;
        }
        let lens = &self.drive.model.intrinsics;
        put(&folder.join("depth_proxy.png"), &encoded(lens, &middle(&self.depths_cm))?)?;
        let each = folder.join("depth");
        std::fs::create_dir_all(&each).map_err(EvaluationError::io("folder of depths", &each))?;
        let mut frames = String::from("frame,time_s,real_stamp_s,speed_mps,yaw_rate_radps,light_rel\n");
        let mut boxes = String::from("frame,box,x0,y0,x1,y1,class\n");
        let step = self.drive.scene().dt.secs();
        for ((number, world), depth) in (plan.first..).zip(&self.worlds).zip(&self.depths_cm) {
            put(&each.join(format!("{number:04}.png")), &encoded(lens, depth)?)?;
            let (t, ego) = (f64::from(number) * step, &world.ego);
            let (speed, turn) = (ego.velocity_mps.length(), ego.yaw_rate_radps);
            let _infallible = writeln!(frames, "{number},{t:.4},{t:.4},{speed:.3},{turn:.5},1.000");
            for (id, (class, [x0, y0, x1, y1])) in world.agents.iter().filter_map(|a| self.seen(world, a)).enumerate() {
                let _infallible = writeln!(boxes, "{number},{id},{x0:.1},{y0:.1},{x1:.1},{y1:.1},{class}");
            }
        }
        put(&folder.join("frames.csv"), frames.as_bytes())?;
        put(&folder.join("boxes.csv"), boxes.as_bytes())?;
        let (model, last) = (&self.drive.model, u64::from(plan.first + plan.frames - 1));
        // the centre of the first pixel is at 0 in a case, at 0.5 in a lens
        let pinhole = PinholeEntry { fx: lens.fx_px, fy: lens.fy_px, cx: lens.cx_px - 0.5, cy: lens.cy_px - 0.5 };
        let kept = last + 1 - u64::from((plan.frames / KEPT).max(1));
        let size = [lens.width_px as usize, lens.height_px as usize];
        let meta = FrameMeta {
            case: self.drive.name.clone(),
            channels: Some("rgb".to_owned()),
            rollout_anchor_frames: vec![0],
            suggested_split: Some(FrameSplit { fit: Some([plan.first.into(), kept - 1]), held_out: [kept, last] }),
            pairing: Some(Pairing::SameLayout),
            camera_height_m: Some(model.rig_from_camera.translation.z),
            seeds,
            ..FrameMeta::new(size, 1.0 / step, pinhole)
        };
        meta.write(folder)?;
        Ok(meta)
    }

    /// Returns class and box of an agent that the camera sees, px.
    fn seen(&self, world: &WorldState, agent: &AgentState) -> Option<(&'static str, [f64; 4])> {
        let class = match agent.class {
            AgentClass::Vehicle => "car",
            AgentClass::Pedestrian => "pedestrian",
            AgentClass::Cyclist => "cyclist",
            AgentClass::Cone | AgentClass::Barrier => return None,
        };
        let model = &self.drive.model;
        let camera_from_world = (world.ego.pose.world_from_rig(0.0) * model.rig_from_camera).inverse();
        let mut edges = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        for corner in agent.corners() {
            for z in [agent.z_m, agent.z_m + agent.size.height_m] {
                let at = model.intrinsics.project(camera_from_world * DVec3::new(corner.x, corner.y, z))?;
                edges = [edges[0].min(at.x), edges[1].min(at.y), edges[2].max(at.x), edges[3].max(at.y)];
            }
        }
        let (width, height) = (f64::from(model.intrinsics.width_px), f64::from(model.intrinsics.height_px));
        let edges = [
            edges[0].clamp(0.0, width),
            edges[1].clamp(0.0, height),
            edges[2].clamp(0.0, width),
            edges[3].clamp(0.0, height),
        ];
        let large = edges[2] - edges[0] >= LEAST_BOX_PX && edges[3] - edges[1] >= LEAST_BOX_PX;
        large.then_some((class, edges))
    }
}

fn pictures(folder: &Path, first: u32, frames: &[RgbImage]) -> Result<(), EvaluationError> {
    std::fs::create_dir_all(folder).map_err(EvaluationError::io("folder of frames", folder))?;
    for (number, frame) in (first..).zip(frames) {
        put(&folder.join(format!("{number:04}.png")), &frame.encode(Encoding::Png)?)?;
    }
    Ok(())
}

/// Returns the depth of each pixel, cm.
fn depth_cm(geometry: &Geometry) -> Vec<u16> {
    let cm = |inverse: &u16| {
        let depth_m = (1.0 / (f64::from(*inverse) * INVERSE_DEPTH_STEP)).min(FARTHEST_M);
        (100.0 * depth_m).round() as u16
    };
    geometry.inverse_depths.iter().map(cm).collect()
}

/// Returns the middle of the depths that each pixel has.
fn middle(depths: &[Vec<u16>]) -> Vec<u16> {
    let of = |pixel: usize| {
        let mut own: Vec<u16> = depths.iter().map(|depth| depth[pixel]).collect();
        own.sort_unstable();
        own[own.len() / 2]
    };
    (0..depths.first().map_or(0, Vec::len)).map(of).collect()
}

fn encoded(lens: &Intrinsics, depth_cm: &[u16]) -> Result<Vec<u8>, EvaluationError> {
    let bytes: Vec<u8> = depth_cm.iter().flat_map(|cm| cm.to_ne_bytes()).collect();
    let mut out = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut out);
    encoder
        .write_image(&bytes, lens.width_px, lens.height_px, image::ExtendedColorType::L16)
        .map_err(ds_raster::ImageError::Encode)?;
    Ok(out)
}

fn put(path: &Path, bytes: &[u8]) -> Result<(), EvaluationError> {
    std::fs::write(path, bytes).map_err(EvaluationError::io("file of a case", path))
}
