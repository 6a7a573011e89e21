//! The loss of the camera policy with its gradient, and the displacement error on held-out samples.
//!
//! Winner takes all: the candidate nearest to the teacher in metres is drawn to it, the others a little; the logits learn
//! which one was nearest (cross entropy). Distances are smooth L1 in the units of the outputs.

use ds_graph::planner::Planner;
use ds_nn::{Array, Weights};
use ds_policy::camera::proposals::{KNOTS, MODES, OUTPUTS, STATE, TARGETS, decode, encode, state_of};
use ds_policy::camera::{SIZE, normalise_into};
use ds_space::PoseSe2;

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
            let (value, by_error) = if error.abs() < SMOOTH {
                (0.5 * error * error / SMOOTH, error / SMOOTH)
            } else {
                (error.abs() - 0.5 * SMOOTH, error.signum())
            };
            loss += weight * value;
            slope[mode * TARGETS + k] = weight * by_error;
        }
        #[expect(clippy::cast_possible_truncation, reason = "gradients are single precision")]
        let probability = candidates[mode].probability as f32;
        let is_nearest = f32::from(u8::from(mode == nearest));
        slope[MODES * TARGETS + mode] = CHOICE_WEIGHT * (probability - is_nearest);
        loss -= CHOICE_WEIGHT * is_nearest * probability.max(1e-9).ln();
    }
    loss
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

/// Measures weights on samples, without any change of the frames.
pub(super) fn displacement(weights: &Weights, samples: &Samples) -> Result<Displacement, PolicyTrainError> {
    let planner = Planner::new(SIZE, weights)?;
    let mut sum = Displacement::default();
    for sample in &samples.0 {
        let speed_mps = f64::from(sample.speed_mps);
        let teacher = sample.poses();
        let candidates = decode(speed_mps, &answer(&planner, sample));
        let best = candidates.iter().reduce(|a, b| if b.probability > a.probability { b } else { a });
        let best = &best.expect("there are candidates").knots;
        let straight = decode(speed_mps, &[0.0; OUTPUTS])[0].knots;
        let nearest = candidates.iter().map(|c| displacement_m(&c.knots, &teacher)).fold(f64::INFINITY, f64::min);
        let lateral = |plan: &[PoseSe2; KNOTS]| teacher[KNOTS - 1].to_local(plan[KNOTS - 1].position).y.abs();
        sum.policy_m += displacement_m(best, &teacher);
        sum.best_mode_m += nearest;
        sum.constant_velocity_m += displacement_m(&straight, &teacher);
        sum.lateral_m += lateral(best);
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

fn answer(planner: &Planner, sample: &Sample) -> Vec<f32> {
    let mut pixels = Vec::with_capacity(sample.rgb.len());
    normalise_into(&sample.rgb, &mut pixels);
    let images = Array::new(&[1, ds_graph::planner::HEIGHT_PX, ds_graph::planner::WIDTH_PX, 3], pixels);
    let state = state_of(f64::from(sample.speed_mps), sample.command).to_vec();
    planner.answer(&images, &Array::new(&[1, STATE], state)).into_values()
}

/// Returns the numbers that a sample's network should answer at a speed.
pub(super) fn target_of(sample: &Sample, speed_mps: f64) -> [f32; TARGETS] {
    encode(speed_mps, &sample.poses())
}
