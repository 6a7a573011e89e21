//! What a track shows of motion at positions half a second apart: speed, acceleration, jerk and yaw rate; and how far logged
//! positions scatter by themselves.

use ds_space::{DVec2, Draws, PoseSe2, Tick, angle};
use ds_stats::mean;
use ds_world::{AgentClass, Scene, Track};

use crate::model::STEP_TICKS;

const STEP_SECS: f64 = 0.5;
/// A vehicle that comes no farther than this does not move, in metres.
const STANDING_M: f64 = 1.0;
/// A standing vehicle is seen this often at least.
const SEEN: usize = 20;
/// Draws of noise between two tracks.
const DRAWS_OF_TRACK: u64 = 10_000;

/// A quantity of motion with the bins of its histogram.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Quantity {
    pub name: &'static str,
    pub low: f64,
    pub high: f64,
    pub bins: usize,
}

const fn quantity(name: &'static str, low: f64, high: f64, bins: usize) -> Quantity {
    Quantity { name, low, high, bins }
}

/// The quantities, in the order of [`Motion::values`].
pub(super) const QUANTITIES: [Quantity; 4] = [
    quantity("speed_mps", 0.0, 50.0, 100),
    quantity("acceleration_mps2", -10.0, 10.0, 200),
    quantity("jerk_mps3", -20.0, 20.0, 200),
    quantity("yaw_rate_radps", -1.5, 1.5, 100),
];

impl Quantity {
    /// Counts values into bins; what lies beyond counts at the end.
    pub(super) fn histogram<'a>(&self, values: impl Iterator<Item = &'a f64>) -> Vec<f64> {
        let mut counts = vec![0.0; self.bins];
        for value in values {
            let place = (value - self.low) / (self.high - self.low) * self.bins as f64;
            counts[(place.max(0.0) as usize).min(self.bins - 1)] += 1.0;
        }
        counts
    }
}

/// How far logged poses scatter.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Noise {
    pub position_m: f64,
    pub heading_rad: f64,
}

impl Noise {
    /// Learns it of the standing vehicles of scenes; none where nobody stands.
    pub(super) fn of<'a>(scenes: impl Iterator<Item = &'a Scene>) -> Self {
        let (mut positions, mut headings) = (Vec::new(), Vec::new());
        for track in scenes.flat_map(|scene| &scene.tracks).filter(|track| track.class == AgentClass::Vehicle) {
            let poses: Vec<PoseSe2> = track.points.iter().flatten().map(|point| point.pose).collect();
            if poses.len() < SEEN || extent_m(&poses) > STANDING_M {
                continue;
            }
            let centre = poses.iter().map(|pose| pose.position).sum::<DVec2>() / poses.len() as f64;
            positions.extend(poses.iter().map(|pose| 0.5 * pose.position.distance_squared(centre)));
            headings.extend(poses.iter().map(|pose| angle::turn(poses[0].heading_rad, pose.heading_rad).powi(2)));
        }
        let deviation = |squares: Vec<f64>| mean(squares).unwrap_or(0.0).sqrt();
        Self { position_m: deviation(positions), heading_rad: deviation(headings) }
    }

    fn added(&self, pose: &PoseSe2, draws: &Draws, index: u64) -> PoseSe2 {
        let by = |k: u64, scale: f64| scale * draws.normal(index + 2 * k);
        let off = DVec2::new(by(0, self.position_m), by(1, self.position_m));
        PoseSe2 { position: pose.position + off, heading_rad: pose.heading_rad + by(2, self.heading_rad) }
    }
}

fn extent_m(poses: &[PoseSe2]) -> f64 {
    poses.iter().map(|pose| pose.position.distance(poses[0].position)).fold(0.0, f64::max)
}

/// Values of a track, one list for each of [`QUANTITIES`].
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Motion {
    pub values: [Vec<f64>; 4],
}

impl Motion {
    /// Returns what a track shows between two ticks, both included, with noise added if some is given; nothing if it is seen
    /// for less than two seconds there or stands.
    pub(super) fn of(track: &Track, (first, last): (Tick, Tick), noise: Option<(&Noise, &Draws, u64)>) -> Option<Self> {
        let end = (last.0 as usize).min(track.points.len().saturating_sub(1));
        let seen = track.points.get(first.0 as usize..=end)?;
        let mut poses: Vec<PoseSe2> = seen.iter().flatten().step_by(STEP_TICKS).map(|point| point.pose).collect();
        if poses.len() < 5 || extent_m(&poses) <= STANDING_M {
            return None;
        }
        if let Some((noise, draws, index)) = noise {
            let begin = index * DRAWS_OF_TRACK;
            let noisy = poses.iter().zip(0u64..).map(|(pose, k)| noise.added(pose, draws, begin + 8 * k));
            poses = noisy.collect();
        }
        let slopes =
            |values: &[f64]| values.windows(2).map(|pair| (pair[1] - pair[0]) / STEP_SECS).collect::<Vec<f64>>();
        let speeds: Vec<f64> =
            poses.windows(2).map(|pair| pair[0].position.distance(pair[1].position) / STEP_SECS).collect();
        let turn = |pair: &[PoseSe2]| angle::turn(pair[0].heading_rad, pair[1].heading_rad) / STEP_SECS;
        let yaw_rates = poses.windows(2).map(turn).collect();
        let accelerations = slopes(&speeds);
        let jerks = slopes(&accelerations);
        Some(Self { values: [speeds, accelerations, jerks, yaw_rates] })
    }
}
