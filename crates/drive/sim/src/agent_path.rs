//! The route of a reactive agent: its own logged path, resampled every metre, extended 60 m along the road ahead.
//!
//! World frame. Headings are the logged ones (so a reversing car stays reversed); the desired speed at a place is the
//! highest logged speed within 20 m of it, at least 3 m/s. Agents that hardly move have no path.

use ds_space::angle::wrap;
use ds_space::plane::Polyline;
use ds_space::{DVec2, PoseSe2, Tick};
use ds_world::{AgentClass, Track, TrackPoint};

use crate::lane_index::LaneIndex;

/// Distance between the knots of a path, in metres.
pub(crate) const KNOT_M: f64 = 1.0;
const SHORTEST_M: f64 = 5.0;
const SHORTEST_WALK_M: f64 = 2.0;
const SLOWEST_WALK_MPS: f64 = 0.3;
const EXTENSION_KNOTS: usize = 60;
/// Logged points closer than this to the last kept one are measurement noise of a standing agent.
const NOISE_M: f64 = 0.3;
const SPEED_REACH_M: f64 = 20.0;
const SLOWEST_DESIRED_MPS: f64 = 3.0;
/// No logged path is followed farther than this.
const LONGEST_M: f64 = 20_000.0;

/// A place on a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knot {
    /// Centre and heading.
    pub pose: PoseSe2,
    /// Height above the ground plane, m.
    pub z_m: f64,
    /// Desired speed, m/s.
    pub desired_mps: f64,
}

/// A path with a knot every metre.
#[derive(Debug, Clone)]
pub struct AgentPath {
    knots: Vec<Knot>,
    /// Distance along the path at each logged tick; `NaN` where the agent was not seen.
    along_at_tick_m: Vec<f64>,
}

struct Logged {
    along_m: f64,
    point: TrackPoint,
}

impl AgentPath {
    /// Makes the path of a track, or `None` if it does not drive anywhere.
    pub(crate) fn of(track: &Track, lanes: &LaneIndex<'_>) -> Option<Self> {
        if !matches!(track.class, AgentClass::Vehicle | AgentClass::Cyclist) {
            return None;
        }
        let (kept, along_at_tick_m) = moved(track, SHORTEST_M)?;
        let mut knots = resample(&kept);
        let (from, direction) = (knots.last()?.pose.position, ahead(&knots)?);
        extend(&mut knots, lanes.road_ahead(from, direction, KNOT_M, EXTENSION_KNOTS));
        Some(Self { knots, along_at_tick_m })
    }

    /// Makes the path of somebody on foot, straight on at its end and wanted at the mean speed of walking; `None` if
    /// it does not walk anywhere.
    pub(crate) fn on_foot(track: &Track) -> Option<Self> {
        let (kept, along_at_tick_m) = moved(track, SHORTEST_WALK_M)?;
        let speeds = track.points.iter().flatten().map(|point| point.velocity_mps.length());
        let (sum, count) =
            speeds.filter(|speed| *speed > SLOWEST_WALK_MPS).fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
        let mut knots = resample(&kept);
        let (from, direction) = (knots.last()?.pose.position, ahead(&knots)?);
        extend(&mut knots, (1..=EXTENSION_KNOTS).map(|k| from + direction * (k as f64 * KNOT_M)));
        let desired_mps = if count > 0.0 { (sum / count).clamp(SLOWEST_WALK_MPS, 5.0) } else { 1.3 };
        knots.iter_mut().for_each(|knot| knot.desired_mps = desired_mps);
        Some(Self { knots, along_at_tick_m })
    }

    /// Makes a path along points.
    pub(crate) fn along(points: &[DVec2]) -> Option<Self> {
        let line = Polyline::new(points).filter(|line| (2.0..=LONGEST_M).contains(&line.length_m()))?;
        let knot = |k: u32| {
            let along_m = f64::from(k) * KNOT_M;
            let pose = PoseSe2 { position: line.at(along_m), heading_rad: line.direction_at(along_m).to_angle() };
            Knot { pose, z_m: 0.0, desired_mps: SLOWEST_DESIRED_MPS }
        };
        Some(Self { knots: (0..=line.length_m() as u32).map(knot).collect(), along_at_tick_m: Vec::new() })
    }

    /// Returns the last tick of the log.
    pub(crate) fn last_tick(&self) -> u32 {
        u32::try_from(self.along_at_tick_m.len().saturating_sub(1)).unwrap_or(u32::MAX)
    }

    /// Returns the length with the extension, in metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        (self.knots.len() - 1) as f64 * KNOT_M
    }

    /// Returns where on the path the agent was logged at a tick.
    #[must_use]
    pub fn along_at(&self, tick: Tick) -> Option<f64> {
        let along_m = *self.along_at_tick_m.get(tick.0 as usize)?;
        along_m.is_finite().then(|| along_m.min(self.length_m()))
    }

    /// Returns the place at a distance along the path, clamped to its ends.
    #[must_use]
    pub fn at(&self, along_m: f64) -> Knot {
        let segment = self.segment(along_m);
        let (a, b) = (&self.knots[segment], &self.knots[segment + 1]);
        let share = (along_m / KNOT_M - segment as f64).clamp(0.0, 1.0);
        Knot {
            pose: a.pose.lerp(&b.pose, share),
            z_m: a.z_m + share * (b.z_m - a.z_m),
            desired_mps: a.desired_mps + share * (b.desired_mps - a.desired_mps),
        }
    }

    /// Returns the direction of travel at a distance along the path.
    #[must_use]
    pub fn direction_at(&self, along_m: f64) -> DVec2 {
        let segment = self.segment(along_m);
        (self.knots[segment + 1].pose.position - self.knots[segment].pose.position).normalize_or(DVec2::X)
    }

    /// Returns the knots from just before one distance to just after another.
    pub(crate) fn stretch(&self, from_m: f64, to_m: f64) -> Stretch<'_> {
        let (first, last) = (self.segment(from_m), self.segment(to_m) + 1);
        Stretch { first, knots: &self.knots[first..=last] }
    }

    /// Returns where a point lies beside the path: distance along it and to its left, beyond its ends too.
    #[must_use]
    pub fn project(&self, point: DVec2) -> [f64; 2] {
        let near = self.stretch(0.0, self.length_m()).nearest(point);
        [near.along_m + near.direction.dot(near.off), near.direction.perp_dot(near.off)]
    }

    /// Returns the positions of all knots.
    pub(crate) fn positions(&self) -> impl ExactSizeIterator<Item = DVec2> {
        self.knots.iter().map(|knot| knot.pose.position)
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the index range")]
    fn segment(&self, along_m: f64) -> usize {
        ((along_m / KNOT_M).max(0.0) as usize).min(self.knots.len() - 2)
    }
}

/// A part of a path.
pub(crate) struct Stretch<'a> {
    first: usize,
    knots: &'a [Knot],
}

/// A point relative to a stretch of a path.
pub(crate) struct Nearest {
    pub(crate) along_m: f64,
    pub(crate) distance_m: f64,
    pub(crate) direction: DVec2,
    /// From the nearest place to the point.
    pub(crate) off: DVec2,
}

impl Stretch<'_> {
    /// Returns the corners of the box around the stretch.
    pub(crate) fn bounds(&self) -> (DVec2, DVec2) {
        let start = self.knots[0].pose.position;
        self.knots
            .iter()
            .fold((start, start), |(low, high), knot| (low.min(knot.pose.position), high.max(knot.pose.position)))
    }

    /// Returns the place of the stretch that is nearest to a point.
    pub(crate) fn nearest(&self, point: DVec2) -> Nearest {
        let mut best = (f64::INFINITY, 0, 0.0);
        for (index, ends) in self.knots.windows(2).enumerate() {
            let (start, edge) = (ends[0].pose.position, ends[1].pose.position - ends[0].pose.position);
            let share = ((point - start).dot(edge) / edge.length_squared().max(1e-12)).clamp(0.0, 1.0);
            let squared = (start + edge * share - point).length_squared();
            if squared < best.0 {
                best = (squared, index, share);
            }
        }
        let (squared, index, share) = best;
        let edge = self.knots[index + 1].pose.position - self.knots[index].pose.position;
        Nearest {
            along_m: ((self.first + index) as f64 + share) * KNOT_M,
            distance_m: squared.sqrt(),
            direction: edge.normalize_or(DVec2::X),
            off: point - (self.knots[index].pose.position + edge * share),
        }
    }
}

/// Returns the places of a track apart from noise, and the distance at each tick; nothing if it does not go anywhere.
fn moved(track: &Track, shortest_m: f64) -> Option<(Vec<Logged>, Vec<f64>)> {
    let mut kept: Vec<Logged> = Vec::new();
    let mut along_at_tick_m = Vec::with_capacity(track.points.len());
    for point in &track.points {
        let Some(point) = point else {
            along_at_tick_m.push(f64::NAN);
            continue;
        };
        let along_m =
            kept.last().map_or(0.0, |last| last.along_m + (point.pose.position - last.point.pose.position).length());
        if kept.last().is_none_or(|last| along_m - last.along_m >= NOISE_M) {
            kept.push(Logged { along_m, point: *point });
        }
        along_at_tick_m.push(along_m);
    }
    let (first, last) = (kept.first()?, kept.last()?);
    let moved_m = (last.point.pose.position - first.point.pose.position).length();
    let sound = (shortest_m..=LONGEST_M).contains(&last.along_m) && (0.5 * shortest_m..=LONGEST_M).contains(&moved_m);
    sound.then_some((kept, along_at_tick_m))
}

fn resample(kept: &[Logged]) -> Vec<Knot> {
    let desired: Vec<f64> = (0..kept.len()).map(|index| desired_speed(kept, index)).collect();
    let mut knots = Vec::new();
    let mut along_m = 0.0;
    for (index, ends) in kept.windows(2).enumerate() {
        let (a, b) = (&ends[0], &ends[1]);
        while along_m <= b.along_m {
            let share = (along_m - a.along_m) / (b.along_m - a.along_m);
            knots.push(Knot {
                pose: a.point.pose.lerp(&b.point.pose, share),
                z_m: a.point.z_m + share * (b.point.z_m - a.point.z_m),
                desired_mps: desired[index] + share * (desired[index + 1] - desired[index]),
            });
            along_m += KNOT_M;
        }
    }
    knots
}

fn desired_speed(kept: &[Logged], index: usize) -> f64 {
    let here_m = kept[index].along_m;
    let near = |logged: &&Logged| (logged.along_m - here_m).abs() <= SPEED_REACH_M;
    let before = kept[..index].iter().rev().take_while(near);
    let after = kept[index..].iter().take_while(near);
    before.chain(after).map(|logged| logged.point.velocity_mps.length()).fold(SLOWEST_DESIRED_MPS, f64::max).min(60.0)
}

fn ahead(knots: &[Knot]) -> Option<DVec2> {
    let [.., before, last] = knots else { return None };
    Some((last.pose.position - before.pose.position).normalize_or(last.pose.forward()))
}

fn extend(knots: &mut Vec<Knot>, road: impl IntoIterator<Item = DVec2>) {
    let (Some(direction), Some(last)) = (ahead(knots), knots.last().copied()) else { return };
    let mut previous = last.pose.position;
    // A car that was reversing goes on reversing.
    let flip = if direction.dot(last.pose.forward()) < 0.0 { std::f64::consts::PI } else { 0.0 };
    for position in road {
        let step = (position - previous).normalize_or(direction);
        let pose = PoseSe2 { position, heading_rad: wrap(step.to_angle() + flip) };
        knots.push(Knot { pose, ..last });
        previous = position;
    }
}
