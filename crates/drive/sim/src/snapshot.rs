//! The bytes of a snapshot: everything that a simulation cannot derive from its scene and configuration.
//!
//! Little-endian: "DSIM", version, digests of scene and configuration, tick, ego (by its bits), what the car
//! remembers, plan, motions, pending reactions, the adversary and lane changes where there are any, and a BLAKE3 digest of all before it. Lengths are checked before anything is allocated; a changed byte is refused.

use ds_space::{DVec2, Digest, PoseSe2, SimTime, Tick};
use ds_world::trajectory::MAX_POINTS;
use ds_world::{EgoState, Trajectory, TrajectoryPoint};

use crate::actuation::{Moment, Past, Sent};
use crate::adversary::NUMBERS;
use crate::dynamics::Body;
use crate::error::SnapshotError;
use crate::participant::Motion;

const MAGIC: [u8; 4] = *b"DSIM";
const VERSION: u32 = 2;
const DIGEST_BYTES: usize = 32;
/// No coordinate or rate of a world lies beyond.
pub(crate) const LARGEST: f64 = 1e8;

/// What a snapshot holds.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Content {
    pub(crate) tick: Tick,
    pub(crate) body: Body,
    /// The plan with its tick and anchor; `None` while the log is followed.
    pub(crate) plan: Option<(Trajectory, Tick, PoseSe2)>,
    pub(crate) motions: Vec<Motion>,
    /// Pending reactions of each follower.
    pub(crate) wishes: Vec<Vec<f64>>,
    /// Lane changes of each agent; nothing where nobody changes lanes.
    pub(crate) weaves: Vec<[f64; 3]>,
    /// The adversary, where there is one that does not only replay its track.
    pub(crate) hunter: Option<[f64; NUMBERS]>,
}

/// Writes a snapshot.
pub(crate) fn write(content: &Content, scene: &Digest, config: &Digest) -> Vec<u8> {
    let mut out = Vec::with_capacity(1024 + 17 * content.motions.len());
    out.extend(MAGIC);
    out.extend(VERSION.to_le_bytes());
    out.extend(scene.0);
    out.extend(config.0);
    out.extend(content.tick.0.to_le_bytes());
    let ego = &content.body.ego;
    put_pose(&mut out, &ego.pose);
    let rates = [ego.velocity_mps.x, ego.velocity_mps.y, ego.yaw_rate_radps, ego.acceleration_mps2.x];
    let actuators = [ego.acceleration_mps2.y, ego.steering_rad, ego.steering_rate_radps, content.body.drive_mps2];
    rates.into_iter().chain(actuators).for_each(|value| out.extend(value.to_le_bytes()));
    put_memory(&mut out, &content.body);
    let points = content.plan.as_ref().map_or(&[][..], |(plan, ..)| plan.points());
    out.extend((points.len() as u32).to_le_bytes());
    if let Some((_, tick, anchor)) = &content.plan {
        out.extend(tick.0.to_le_bytes());
        put_pose(&mut out, anchor);
    }
    for point in points {
        out.extend(point.after.0.to_le_bytes());
        put_pose(&mut out, &point.pose);
    }
    out.extend((content.motions.len() as u32).to_le_bytes());
    for motion in &content.motions {
        match motion {
            Motion::Replay => out.push(0),
            Motion::Following { along_m, speed_mps } => {
                out.push(1);
                out.extend(along_m.to_le_bytes());
                out.extend(speed_mps.to_le_bytes());
            }
            Motion::Gone => out.push(2),
        }
    }
    for wishes in &content.wishes {
        put_all(&mut out, wishes.len(), wishes.iter().copied());
    }
    if let Some(numbers) = &content.hunter {
        put_all(&mut out, 1, numbers.iter().copied());
    }
    if !content.weaves.is_empty() {
        put_all(&mut out, content.weaves.len(), content.weaves.iter().flatten().copied());
    }
    let digest = Digest::of(&out);
    out.extend(digest.0);
    out
}

fn put_memory(out: &mut Vec<u8>, body: &Body) {
    let [front, rear] = body.slip_rad;
    [body.sensed_rad, front, rear].into_iter().for_each(|value| out.extend(value.to_le_bytes()));
    let sent = |sent: &Sent| [sent.steer_rad, sent.accel_mps2, sent.speed_mps, sent.brake_work_mj];
    put_all(out, body.past.sent.len(), body.past.sent.iter().flat_map(sent));
    put_all(out, body.past.moments.len(), body.past.moments.iter().flat_map(|moment| moment.to_array()));
}

fn put_all(out: &mut Vec<u8>, count: usize, values: impl Iterator<Item = f64>) {
    out.extend((count as u32).to_le_bytes());
    values.for_each(|value| out.extend(value.to_le_bytes()));
}

fn put_pose(out: &mut Vec<u8>, pose: &PoseSe2) {
    for value in [pose.position.x, pose.position.y, pose.heading_rad] {
        out.extend(value.to_le_bytes());
    }
}

/// Reads a snapshot that was taken of this scene under this configuration.
pub(crate) fn read(bytes: &[u8], scene: &Digest, config: &Digest, hunted: bool) -> Result<Content, SnapshotError> {
    let length = SnapshotError::Length { bytes: bytes.len() };
    if !bytes.starts_with(&MAGIC) {
        return Err(SnapshotError::Magic);
    }
    let body = bytes.len().checked_sub(DIGEST_BYTES).map(|end| bytes.split_at(end));
    let Some((body, checksum)) = body else { return Err(length) };
    let mut reader = Reader { left: body, whole: bytes.len() };
    reader.take::<4>()?;
    let version = reader.u32()?;
    if version != VERSION {
        return Err(SnapshotError::Version { version, known: VERSION });
    }
    if Digest::of(body).0 != checksum {
        return Err(SnapshotError::Checksum { bytes: bytes.len() });
    }
    if reader.take::<DIGEST_BYTES>()? != scene.0 {
        return Err(SnapshotError::Scene);
    }
    if reader.take::<DIGEST_BYTES>()? != config.0 {
        return Err(SnapshotError::Config);
    }
    let tick = Tick(reader.u32()?);
    let body = reader.body()?;
    let plan = reader.plan(tick)?;
    let motions = reader.motions()?;
    let wishes = motions.iter().map(|_| reader.wishes()).collect::<Result<_, _>>()?;
    let hunter = if hunted { Some(*reader.rows("adversary")?.first().ok_or(length.clone())?) } else { None };
    let weaves = if reader.left.is_empty() { Vec::new() } else { reader.rows("agent.weaves")? };
    if reader.left.is_empty() { Ok(Content { tick, body, plan, motions, wishes, weaves, hunter }) } else { Err(length) }
}

struct Reader<'a> {
    left: &'a [u8],
    whole: usize,
}

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], SnapshotError> {
        let (taken, left) = self.left.split_first_chunk().ok_or(SnapshotError::Length { bytes: self.whole })?;
        self.left = left;
        Ok(*taken)
    }

    fn u32(&mut self) -> Result<u32, SnapshotError> {
        self.take().map(u32::from_le_bytes)
    }

    fn f64(&mut self, field: &'static str) -> Result<f64, SnapshotError> {
        let value = f64::from_le_bytes(self.take()?);
        if value.abs() <= LARGEST { Ok(value) } else { Err(SnapshotError::Field { field, value }) }
    }

    fn pose(&mut self, field: &'static str) -> Result<PoseSe2, SnapshotError> {
        Ok(PoseSe2::new(self.f64(field)?, self.f64(field)?, self.f64(field)?))
    }

    fn vector(&mut self, field: &'static str) -> Result<DVec2, SnapshotError> {
        Ok(DVec2::new(self.f64(field)?, self.f64(field)?))
    }

    fn body(&mut self) -> Result<Body, SnapshotError> {
        let pose = self.pose("ego.pose")?;
        let velocity_mps = self.vector("ego.velocity_mps")?;
        let yaw_rate_radps = self.f64("ego.yaw_rate_radps")?;
        let acceleration_mps2 = self.vector("ego.acceleration_mps2")?;
        let steering_rad = self.f64("ego.steering_rad")?;
        let steering_rate_radps = self.f64("ego.steering_rate_radps")?;
        let ego = EgoState { pose, velocity_mps, yaw_rate_radps, acceleration_mps2, steering_rad, steering_rate_radps };
        let drive_mps2 = self.f64("ego.drive_mps2")?;
        let sensed_rad = self.f64("ego.sensed_rad")?;
        let slip_rad = [self.f64("ego.slip_rad")?, self.f64("ego.slip_rad")?];
        let mut past = Past::default();
        for [steer_rad, accel_mps2, speed_mps, brake_work_mj] in self.rows("ego.commands")? {
            past.sent.push(Sent { steer_rad, accel_mps2, speed_mps, brake_work_mj });
        }
        past.moments = self.rows("ego.moments")?.into_iter().map(Moment::from_array).collect();
        Ok(Body { ego, drive_mps2, sensed_rad, slip_rad, past })
    }

    /// Reads a count and that many rows of numbers.
    fn rows<const N: usize>(&mut self, field: &'static str) -> Result<Vec<[f64; N]>, SnapshotError> {
        let count = self.u32()? as usize;
        if count > self.left.len() / (8 * N) {
            return Err(SnapshotError::Length { bytes: self.whole });
        }
        let mut rows = Vec::with_capacity(count);
        for _ in 0..count {
            let mut row = [0.0; N];
            for value in &mut row {
                *value = self.f64(field)?;
            }
            rows.push(row);
        }
        Ok(rows)
    }

    fn wishes(&mut self) -> Result<Vec<f64>, SnapshotError> {
        Ok(self.rows::<1>("agent.wishes")?.into_iter().map(|[wish]| wish).collect())
    }

    fn plan(&mut self, tick: Tick) -> Result<Option<(Trajectory, Tick, PoseSe2)>, SnapshotError> {
        let count = self.u32()? as usize;
        if count == 0 {
            return Ok(None);
        }
        if count > MAX_POINTS {
            return Err(SnapshotError::Field { field: "plan.points", value: count as f64 });
        }
        let plan_tick = Tick(self.u32()?);
        if plan_tick > tick {
            return Err(SnapshotError::Field { field: "plan.tick", value: f64::from(plan_tick.0) });
        }
        let anchor = self.pose("plan.anchor")?;
        let mut points = Vec::with_capacity(count);
        for _ in 0..count {
            let after = SimTime(i64::from_le_bytes(self.take()?));
            points.push(TrajectoryPoint { after, pose: self.pose("plan.pose")? });
        }
        let refused = |_| SnapshotError::Field { field: "plan.points", value: count as f64 };
        Ok(Some((Trajectory::new(points).map_err(refused)?, plan_tick, anchor)))
    }

    fn motions(&mut self) -> Result<Vec<Motion>, SnapshotError> {
        let count = self.u32()? as usize;
        if count > self.left.len() {
            return Err(SnapshotError::Length { bytes: self.whole });
        }
        let mut motions = Vec::with_capacity(count);
        for _ in 0..count {
            motions.push(match self.take::<1>()?[0] {
                0 => Motion::Replay,
                1 => Motion::Following { along_m: self.f64("agent.along_m")?, speed_mps: self.f64("agent.speed_mps")? },
                2 => Motion::Gone,
                other => return Err(SnapshotError::Field { field: "agent.motion", value: f64::from(other) }),
            });
        }
        Ok(motions)
    }
}
