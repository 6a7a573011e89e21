//! Networks that start from anchors: which plans those are, and the loss of what is made of them, with its gradient.
//!
//! Anchors are the centres of k-means over x and y of the teacher's plans, in the units of plans. The anchor nearest to the
//! teacher's plan is the one that should have become it: in every read-out its plan is drawn there (smooth L1), and the
//! logits learn which one it is (focal loss, Lin et al. 2017, γ 2, α ¼). The published weights are 8 and 10.

use ds_graph::panel::{Answer, PLAN, Scoring};
use ds_nn::{Array, Weights};
use ds_policy::Learned;
use ds_policy::camera::proposals::TARGETS;

use super::dataset::Samples;
use super::groups::{centres, nearest};
use super::loss::{smooth, target_of};

/// Numbers of an anchor: x and y of eight poses.
const POINTS: usize = TARGETS / 3 * 2;
/// Weight of the focal loss of a read-out, summed over the plans, that of the nearest plan's mean smooth L1 being 1.
const CHOICE_WEIGHT: f32 = 10.0 / 8.0;
/// Weight of a plan that is the right one in the focal loss; the others have the rest.
const RIGHT: f32 = 0.25;

/// Puts anchors of the expert's samples among the weights of a network that starts from some.
pub(super) fn give(student: Learned, weights: &mut Weights, expert: &Samples, seed: u64) {
    let Learned::Panel(kind) = student else { return };
    let [name] = kind.given() else { return };
    if let (Scoring::Confidence, Some(anchors)) = (kind.scoring(), weights.get_mut(name)) {
        let points = expert.0.iter().map(|sample| points_of(&target_of(sample, f64::from(sample.speed_mps))));
        let centres = centres(&points.collect::<Vec<_>>(), anchors.shape()[0], seed);
        anchors.values_mut().copy_from_slice(centres.as_flattened());
    }
}

fn points_of(target: &[f32; TARGETS]) -> [f32; POINTS] {
    std::array::from_fn(|k| target[k / 2 * 3 + k % 2])
}

/// Returns the mean loss of a batch, summed over the read-outs, and its gradient by the answer.
pub(super) fn grade(answer: &Answer, anchors: &Array, targets: &[[f32; TARGETS]]) -> (f64, Answer) {
    let anchors: Vec<&[f32]> = anchors.values().chunks_exact(POINTS).collect();
    let rights: Vec<usize> = targets.iter().map(|target| nearest(&anchors, |anchor| way(anchor, target))).collect();
    let share = 1.0 / targets.len() as f32;
    let mut slope = Answer { plans: Vec::new(), scores: Vec::new() };
    let mut loss = 0.0;
    for (plans, logits) in answer.plans.iter().zip(&answer.scores) {
        let (mut by_plans, mut by_logits) = (Array::zeros(plans.shape()), Array::zeros(logits.shape()));
        for (sample, (target, right)) in targets.iter().zip(&rights).enumerate() {
            let at = (sample * anchors.len() + right) * PLAN;
            let plan = plans.values()[at..][..PLAN].iter().zip(&mut by_plans.values_mut()[at..][..PLAN]);
            for ((value, slope), target) in plan.zip(target) {
                let (error, by_error) = smooth(value - target);
                loss += f64::from(share * error / PLAN as f32);
                *slope = share * by_error / PLAN as f32;
            }
            let row = sample * anchors.len()..(sample + 1) * anchors.len();
            let logits = logits.values()[row.clone()].iter().zip(&mut by_logits.values_mut()[row]);
            for (plan, (logit, slope)) in logits.enumerate() {
                let weight = share * CHOICE_WEIGHT;
                let (error, by_error) = focal(*logit, plan == *right);
                loss += f64::from(weight * error);
                *slope = weight * by_error;
            }
        }
        slope.plans.push(by_plans);
        slope.scores.push(by_logits);
    }
    (loss, slope)
}

/// Returns the sum of the distances between the points of an anchor and those of the teacher's plan.
fn way(anchor: &&[f32], target: &[f32; TARGETS]) -> f64 {
    let pairs = anchor.chunks_exact(2).zip(target.chunks_exact(3));
    pairs.map(|(a, b)| f64::from((a[0] - b[0]).hypot(a[1] - b[1]))).sum()
}

/// Returns the focal loss of a logit and its slope.
fn focal(logit: f32, is_right: bool) -> (f32, f32) {
    let (sign, weight) = if is_right { (1.0, RIGHT) } else { (-1.0, 1.0 - RIGHT) };
    let margin = sign * logit;
    // 1 − p and −ln p of the probability given to what is so.
    let wrong = 1.0 / (1.0 + margin.exp());
    let surprise = (-margin).max(0.0) + (-margin.abs()).exp().ln_1p();
    let slope = -wrong * wrong * (2.0 * (1.0 - wrong) * surprise + wrong);
    (weight * wrong * wrong * surprise, sign * weight * slope)
}

#[cfg(test)]
mod tests;
