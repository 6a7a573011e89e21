//! Recorded drives with their pictures: what the readers of data sets have in common.
//!
//! Poses and boxes of key frames become a scene at even ticks: the ego's path is made planar, and each box is taken to
//! the rig of its own key frame in three dimensions before it is laid out in the plane, so that hills and a nodding car
//! do not move boxes in the picture. Between key frames boxes are interpolated.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ds_scenario::MAX_STATES;
use ds_scenario::Warning;
use ds_space::{CameraModel, DQuat, DVec2, DVec3, Digest, PoseSe2, SimTime, angle};
use ds_world::{AgentClass, EgoState, Map, Origin, Scene, Size, Track, TrackPoint, VehicleParameters};

use crate::error::ImportError;
use crate::scenarionet::route;
use crate::scene::checked;

/// A drive with its pictures.
#[derive(Debug, Clone)]
pub struct Recorded {
    /// The drive; its cameras are those of the car.
    pub scene: Scene,
    /// For each camera in order, for each tick, the picture nearest in time, at most 60 ms away.
    pub pictures: Vec<Vec<Option<PathBuf>>>,
    /// What is odd about it.
    pub warnings: Vec<Warning>,
}

/// Where the ego was at a time.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stand {
    pub secs: f64,
    pub position: DVec3,
    pub rotation: DQuat,
}

/// A box of a key frame, in the world.
#[derive(Debug, Clone)]
pub(crate) struct RawBox {
    pub instance: String,
    pub class: AgentClass,
    /// Length, width, height.
    pub size_m: [f64; 3],
    pub centre: DVec3,
    pub rotation: DQuat,
}

/// A drive as a data set gives it.
#[derive(Debug)]
pub(crate) struct RawDrive {
    pub name: String,
    /// In order of time.
    pub stands: Vec<Stand>,
    /// Time and boxes of each key frame, in order.
    pub key_frames: Vec<(f64, Vec<RawBox>)>,
    pub cameras: Vec<CameraModel>,
    /// For each camera, times and files in order.
    pub pictures: Vec<Vec<(f64, PathBuf)>>,
    pub map: Map,
    pub vehicle: VehicleParameters,
    pub prompt: String,
    pub origin: Origin,
    /// Seconds between ticks; `None`: as often as there are pictures or key frames.
    pub tick_secs: Option<f64>,
    pub notes: Vec<Warning>,
}

/// How far the last tick may lie beyond the last key frame, in ticks.
pub(super) const SLACK_TICKS: f64 = 0.05;
/// The most key-frame spacings that a box may be gone for and still be interpolated.
const MOST_SPACINGS: f64 = 3.2;
/// Farther than this in time, a picture does not show a tick.
const MOST_APART_SECS: f64 = 0.06;

impl RawDrive {
    /// Makes the scene.
    pub(crate) fn recorded(self, path: &Path) -> Result<Recorded, ImportError> {
        let field =
            |at: &str, problem: String| ImportError::Field { path: path.to_owned(), at: at.to_owned(), problem };
        let times = self.times_secs();
        let Some(first) = times.first().copied() else {
            return Err(field("key frames", "there are none".to_owned()));
        };
        if self.stands.is_empty() {
            return Err(field("ego poses", "there are none".to_owned()));
        }
        let (dt, count) = (self.interval(), times.len());
        let ego_log = self.ego_log(&times, dt);
        let tracks = self.tracks(count, first, dt).map_err(|problem| field("tracks", problem))?;
        let pictures =
            self.pictures.iter().map(|pictures| times.iter().map(|secs| nearest(pictures, *secs)).collect()).collect();
        let scene = Scene {
            adversary: None,
            name: self.name.clone(),
            family: String::new(),
            digest: Digest::default(),
            dt: SimTime::from_secs(dt),
            route: route::route(&ego_log, &self.map),
            map: self.map,
            vehicle: self.vehicle,
            ego_log,
            tracks,
            cameras: self.cameras,
            prompt: self.prompt,
            origin: self.origin,
        };
        let scene = checked(&scene, path)?;
        let mut warnings = self.notes;
        warnings.extend(ds_scenario::warnings(&scene));
        Ok(Recorded { scene, pictures, warnings })
    }

    /// Returns the times of the ticks, from the first key frame to the last.
    pub(crate) fn times_secs(&self) -> Vec<f64> {
        let (Some((first, _)), Some((last, _))) = (self.key_frames.first(), self.key_frames.last()) else {
            return Vec::new();
        };
        let dt = self.interval();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded")]
        let count = (((last - first) / dt + SLACK_TICKS).floor().clamp(0.0, 1e5)) as usize + 1;
        (0..count).map(|tick| first + tick as f64 * dt).collect()
    }

    /// Moves poses and boxes in the plane, so that a place becomes the origin.
    pub(crate) fn recentre(&mut self, origin: DVec2) {
        let by = origin.extend(0.0);
        self.stands.iter_mut().for_each(|stand| stand.position -= by);
        for raw in self.key_frames.iter_mut().flat_map(|(_, boxes)| boxes) {
            raw.centre -= by;
        }
    }

    /// Ten ticks a second where there are pictures or key frames for them, else two, unless it is said.
    fn interval(&self) -> f64 {
        if let Some(secs) = self.tick_secs {
            return secs;
        }
        let pictures = self.pictures.iter().flat_map(|pictures| pictures.windows(2).map(|pair| pair[1].0 - pair[0].0));
        let often = |spacing: Option<f64>| spacing.is_some_and(|secs| secs < 0.2);
        if often(middle(pictures)) || often(self.spacing()) { 0.1 } else { 0.5 }
    }

    /// Returns the middle one of the times between key frames.
    fn spacing(&self) -> Option<f64> {
        middle(self.key_frames.windows(2).map(|pair| pair[1].0 - pair[0].0))
    }

    fn ego_log(&self, times: &[f64], dt: f64) -> Vec<EgoState> {
        let poses: Vec<PoseSe2> = times.iter().map(|secs| planar(&stand(&self.stands, *secs))).collect();
        let at = |tick: usize| &poses[tick.min(poses.len() - 1)];
        let moved = |tick: usize| {
            let (before, after) = (at(tick.saturating_sub(1)), at(tick + 1));
            let span = dt * ((tick + 1).min(poses.len() - 1) - tick.saturating_sub(1)).max(1) as f64;
            let local = poses[tick].relative(&PoseSe2 {
                position: poses[tick].position + (after.position - before.position),
                heading_rad: poses[tick].heading_rad,
            });
            (local.position / span, angle::turn(before.heading_rad, after.heading_rad) / span)
        };
        (0..poses.len())
            .map(|tick| {
                let (velocity, yaw_rate) = moved(tick);
                let (before, after) = (moved(tick.saturating_sub(1)).0, moved((tick + 1).min(poses.len() - 1)).0);
                let steering =
                    if velocity.x > 0.5 { (yaw_rate * self.vehicle.wheel_base_m / velocity.x).atan() } else { 0.0 };
                EgoState {
                    pose: poses[tick],
                    velocity_mps: DVec2::new(velocity.x, 0.0),
                    yaw_rate_radps: yaw_rate.clamp(-3.0, 3.0),
                    acceleration_mps2: DVec2::new(((after.x - before.x) / (2.0 * dt)).clamp(-15.0, 15.0), 0.0),
                    steering_rad: steering.clamp(-self.vehicle.max_steering_rad, self.vehicle.max_steering_rad),
                    steering_rate_radps: 0.0,
                }
            })
            .collect()
    }

    /// Lays the boxes of each key frame out in the plane and fills the ticks between.
    fn tracks(&self, count: usize, first: f64, dt: f64) -> Result<Vec<Track>, String> {
        struct Seen {
            class: AgentClass,
            size: Size,
            at: Vec<(f64, PoseSe2, f64)>,
        }
        let mut seen: BTreeMap<&str, Seen> = BTreeMap::new();
        for (secs, boxes) in &self.key_frames {
            let stand = stand(&self.stands, *secs);
            let (ego, to_rig) = (planar(&stand), stand.rotation.inverse());
            for raw in boxes {
                let [length_m, width_m, height_m] = raw.size_m;
                if !(length_m > 0.0 && width_m > 0.0 && height_m > 0.0) {
                    continue;
                }
                let (centre, turned) = (to_rig * (raw.centre - stand.position), to_rig * raw.rotation * DVec3::X);
                let local = PoseSe2 { position: centre.truncate(), heading_rad: turned.truncate().to_angle() };
                let size = Size { length_m, width_m, height_m };
                let entry =
                    seen.entry(&raw.instance).or_insert_with(|| Seen { class: raw.class, size, at: Vec::new() });
                entry.at.push((*secs, ego.compose(&local), centre.z - 0.5 * height_m));
            }
        }
        if seen.len().saturating_mul(count) > MAX_STATES {
            return Err(format!("are {} over {count} ticks, over {MAX_STATES} states", seen.len()));
        }
        let apart_secs = MOST_SPACINGS * self.spacing().unwrap_or_default();
        let track = |(name, seen): (&str, Seen)| {
            let points = (0..count).map(|tick| between(&seen.at, first + tick as f64 * dt, apart_secs)).collect();
            Track { name: name.to_owned(), class: seen.class, size: seen.size, points }
        };
        Ok(seen.into_iter().map(track).filter(|track| track.points.iter().any(Option::is_some)).collect())
    }
}

/// Returns where the ego was between poses in order of time.
pub(crate) fn stand(stands: &[Stand], secs: f64) -> Stand {
    let after = stands.partition_point(|stand| stand.secs <= secs);
    let (a, b) = (stands[after.saturating_sub(1)], stands[after.min(stands.len() - 1)]);
    let share = if b.secs > a.secs { ((secs - a.secs) / (b.secs - a.secs)).clamp(0.0, 1.0) } else { 0.0 };
    Stand { secs, position: a.position.lerp(b.position, share), rotation: a.rotation.slerp(b.rotation, share) }
}

fn middle(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

fn planar(stand: &Stand) -> PoseSe2 {
    PoseSe2 { position: stand.position.truncate(), heading_rad: (stand.rotation * DVec3::X).truncate().to_angle() }
}

/// Interpolates a box between its key frames; none before the first and after the last of them, nor where it was gone
/// for longer than `apart_secs`.
fn between(at: &[(f64, PoseSe2, f64)], secs: f64, apart_secs: f64) -> Option<TrackPoint> {
    const NEAR: f64 = 0.02;
    let after = at.partition_point(|(time, ..)| *time < secs - NEAR);
    let (b_secs, b_pose, b_z) = at.get(after)?;
    let appears = after == 0 || b_secs - at[after - 1].0 > apart_secs;
    if appears && *b_secs > secs + NEAR {
        return None;
    }
    // Where it appears it already moves towards the next key frame.
    let from = if appears { after } else { after - 1 };
    let to = (from + 1).min(at.len() - 1);
    let (a_secs, a_pose, a_z) = at[from];
    let passed = at[to].0 - a_secs;
    let span = b_secs - a_secs;
    let share = if span > 0.0 { ((secs - a_secs) / span).clamp(0.0, 1.0) } else { 0.0 };
    Some(TrackPoint {
        pose: a_pose.lerp(b_pose, share),
        z_m: a_z + share * (b_z - a_z),
        velocity_mps: if passed > 0.0 && passed < apart_secs {
            (at[to].1.position - at[from].1.position) / passed
        } else {
            DVec2::ZERO
        },
    })
}

fn nearest(pictures: &[(f64, PathBuf)], secs: f64) -> Option<PathBuf> {
    let after = pictures.partition_point(|(time, _)| *time < secs);
    let near = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|i| pictures.get(i));
    near.filter(|(time, _)| (time - secs).abs() <= MOST_APART_SECS)
        .min_by(|a, b| (a.0 - secs).abs().total_cmp(&(b.0 - secs).abs()))
        .map(|(_, path)| path.clone())
}
