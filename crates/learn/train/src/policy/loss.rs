//! The loss of the camera policy with its gradient, and the displacement error on held-out samples.
//!
//! Winner takes all: the candidate nearest to the teacher in metres is drawn to it, the others a little; the logits learn
//! which one was nearest (cross entropy). Distances are smooth L1 in the units of the outputs.

use ds_nn::Array;
use ds_policy::camera::eye::known_camera;
use ds_policy::camera::proposals::{KNOT_SECS, KNOTS, MODES, OUTPUTS, TARGETS, decode, encode};
use ds_policy::{EgoView, Observation, Policy};
use ds_raster::RgbImage;
use ds_space::{DVec2, Draws, PoseSe2, SimTime};
use ds_world::Trajectory;

use super::PolicyTrainError;
use super::dataset::{Sample, Samples};

/// How much the candidates that were not nearest are drawn to the teacher, in sum.
const OTHERS_SHARE: f32 = 0.06;
/// Weight of the cross entropy of the logits.
const CHOICE_WEIGHT: f32 = 0.3;
/// Errors below this are squared, in units of the outputs.
const SMOOTH: f32 = 0.1;

/// Returns the mean loss of a batch and its gradient by the outputs.
pub(super) fn grade(outputs: &Array, targets: &[[f32; TARGETS]], speeds_mps: &[f64]) -> (f64, Array) {
    let mut by_outputs = Array::zeros(outputs.shape());
    let share = 1.0 / targets.len() as f32;
    let mut sum = 0.0;
    let rows = outputs.values().chunks_exact(OUTPUTS).zip(by_outputs.values_mut().chunks_exact_mut(OUTPUTS));
    for ((row, slope), (target, speed_mps)) in rows.zip(targets.iter().zip(speeds_mps)) {
        sum += f64::from(grade_row(row, slope, target, *speed_mps));
        slope.iter_mut().for_each(|value| *value *= share);
    }
    (sum * f64::from(share), by_outputs)
}

fn grade_row(row: &[f32], slope: &mut [f32], target: &[f32; TARGETS], speed_mps: f64) -> f32 {
    let mut as_outputs = vec![0.0; OUTPUTS];
    as_outputs[..TARGETS].copy_from_slice(target);
    let teacher = decode(speed_mps, &as_outputs)[0].knots;
    let candidates = decode(speed_mps, row);
    let nearest = (0..MODES)
        .min_by(|a, b| {
            displacement_m(&candidates[*a].knots, &teacher).total_cmp(&displacement_m(&candidates[*b].knots, &teacher))
        })
        .expect("there are candidates");
    let mut loss = 0.0;
    for mode in 0..MODES {
        let weight = if mode == nearest { 1.0 } else { OTHERS_SHARE / (MODES - 1) as f32 } / TARGETS as f32;
        for k in 0..TARGETS {
            let error = row[mode * TARGETS + k] - target[k];
            let (value, by_error) = smooth(error);
            loss += weight * value;
            slope[mode * TARGETS + k] = weight * by_error;
        }
        #[expect(clippy::cast_possible_truncation, reason = "gradients are single precision")]
        let probability = candidates[mode].score as f32;
        let is_nearest = f32::from(u8::from(mode == nearest));
        slope[MODES * TARGETS + mode] = CHOICE_WEIGHT * (probability - is_nearest);
        loss -= CHOICE_WEIGHT * is_nearest * probability.max(1e-9).ln();
    }
    loss
}

/// Returns the smooth L1 of an error in units of the outputs, and its slope.
pub(super) fn smooth(error: f32) -> (f32, f32) {
    if error.abs() < SMOOTH {
        (0.5 * error * error / SMOOTH, error / SMOOTH)
    } else {
        (error.abs() - 0.5 * SMOOTH, error.signum())
    }
}

/// Returns the mean distance between the poses of two plans.
fn displacement_m(a: &[PoseSe2; KNOTS], b: &[PoseSe2; KNOTS]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.position.distance(b.position)).sum::<f64>() / KNOTS as f64
}

/// Mean distances between plans and the teacher's poses over 4 s, in metres.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Displacement {
    /// Of the candidate with the best score.
    pub policy_m: f64,
    /// Of the candidate that is nearest.
    pub best_mode_m: f64,
    /// Of going straight on at the present speed.
    pub constant_velocity_m: f64,
    /// Sideways at the last pose (4 s), of the candidate with the best score.
    pub lateral_m: f64,
    /// Sideways at the last pose, of going straight on.
    pub constant_velocity_lateral_m: f64,
}

/// Measures a policy on samples, without any change of the frames.
pub(super) fn displacement(policy: &mut dyn Policy, samples: &Samples) -> Result<Displacement, PolicyTrainError> {
    let mut sum = Displacement::default();
    for sample in &samples.0 {
        let teacher = sample.poses();
        let failed = |source| PolicyTrainError::Policy { name: "held-out samples".to_owned(), source };
        let answer = policy.plan(&observation(sample), None).map_err(failed)?;
        let best = knots(&answer.trajectory);
        let straight = decode(f64::from(sample.speed_mps), &[0.0; OUTPUTS])[0].knots;
        let distances = answer.proposals.iter().map(|one| displacement_m(&knots(&one.trajectory), &teacher));
        let lateral = |plan: &[PoseSe2; KNOTS]| teacher[KNOTS - 1].to_local(plan[KNOTS - 1].position).y.abs();
        sum.policy_m += displacement_m(&best, &teacher);
        sum.best_mode_m += distances.fold(f64::INFINITY, f64::min);
        sum.constant_velocity_m += displacement_m(&straight, &teacher);
        sum.lateral_m += lateral(&best);
        sum.constant_velocity_lateral_m += lateral(&straight);
    }
    let share = 1.0 / samples.len().max(1) as f64;
    Ok(Displacement {
        policy_m: share * sum.policy_m,
        best_mode_m: share * sum.best_mode_m,
        constant_velocity_m: share * sum.constant_velocity_m,
        lateral_m: share * sum.lateral_m,
        constant_velocity_lateral_m: share * sum.constant_velocity_lateral_m,
    })
}

/// Returns the poses of a plan that the labels speak of.
fn knots(plan: &Trajectory) -> [PoseSe2; KNOTS] {
    std::array::from_fn(|knot| plan.at(SimTime::from_secs(KNOT_SECS * (knot + 1) as f64)))
}

fn observation(sample: &Sample) -> Observation {
    let camera = known_camera();
    let (width_px, height_px) = (camera.intrinsics.width_px, camera.intrinsics.height_px);
    let frame = RgbImage::new(width_px, height_px, sample.rgb.clone()).expect("samples are of the known camera's size");
    let [along, across] = sample.acceleration_mps2.map(f64::from);
    Observation {
        frames: vec![vec![frame]],
        cameras: vec![camera],
        ego: EgoView {
            speed_mps: f64::from(sample.speed_mps),
            yaw_rate_radps: f64::from(sample.yaw_rate_radps),
            acceleration_mps2: DVec2::new(along, across),
            ..EgoView::default()
        },
        command: sample.command,
        stamps: vec![SimTime(0)],
        horizon_ticks: 40,
        dt: SimTime::from_secs(0.1),
        draw: Draws::from_seed(0, "policy"),
    }
}

/// Returns the numbers that a sample's network should answer at a speed.
pub(super) fn target_of(sample: &Sample, speed_mps: f64) -> [f32; TARGETS] {
    encode(speed_mps, &sample.poses())
}
