//! The loss of the panel's networks without anchors, with its gradient: the nearest plan is drawn to the teacher's,
//! sub-scores to what the plans earn.

use ds_graph::panel::{Answer, PLAN, TERMS};
use ds_nn::Array;
use ds_policy::camera::proposals::{TARGETS, knots_of};

use super::PolicyTrainError;
use super::judge::Judge;
use super::loss::smooth;
use super::step_sample::StepSample;

/// Weight of read-outs before the last.
const EARLIER: f32 = 0.1;
/// How much plans that were not nearest are drawn to the teacher, in sum.
const OTHERS_SHARE: f32 = 0.06;
/// Weight of the cross entropy of one sub-score, mean over the plans.
const SCORE_WEIGHT: f32 = 0.25;

/// Returns the mean loss of a batch and its gradient by the answer.
pub(super) fn grade(
    answer: &Answer,
    batch: &[StepSample<'_>],
    judge: &mut Judge,
) -> Result<(f64, Answer), PolicyTrainError> {
    let (mut loss, mut slope) = draw_all(answer, batch);
    for head in 0..answer.scores.len() {
        let scored = Scored { head, weights: [SCORE_WEIGHT; TERMS], wanted: |terms| *terms };
        loss += judge_all(answer, &scored, &mut slope, batch, judge)?;
    }
    Ok((loss, slope))
}

/// Returns the loss of all read-outs of the plans of a batch and its gradient by the answer, which its scores have no part in.
pub(super) fn draw_all(answer: &Answer, batch: &[StepSample<'_>]) -> (f64, Answer) {
    let targets: Vec<[f32; TARGETS]> = batch.iter().map(StepSample::target).collect();
    let (mut loss, last, mut by_answer) = (0.0, answer.plans.len() - 1, flat(answer));
    for (index, (read, slope)) in answer.plans.iter().zip(&mut by_answer.plans).enumerate() {
        let weight = if index == last { 1.0 } else { EARLIER } / batch.len() as f32;
        let row = read.shape()[1] * PLAN;
        let rows = read.values().chunks_exact(row).zip(slope.values_mut().chunks_exact_mut(row));
        for ((row, slope), target) in rows.zip(&targets) {
            loss += f64::from(weight * draw_nearest(row, slope, target));
            slope.iter_mut().for_each(|value| *value *= weight);
        }
    }
    (loss, by_answer)
}

/// Returns the gradient of what says nothing of an answer: zeros.
pub(super) fn flat(answer: &Answer) -> Answer {
    let zeros = |heads: &[Array]| heads.iter().map(|head| Array::zeros(head.shape())).collect();
    Answer { plans: zeros(&answer.plans), scores: zeros(&answer.scores) }
}

/// Returns the distance of the plans of one sample to the teacher's and fills in its slope: of the nearest whole, of the
/// others a little.
fn draw_nearest(plans: &[f32], slope: &mut [f32], target: &[f32; TARGETS]) -> f32 {
    let count = plans.len() / PLAN;
    let distance = |plan: &[f32]| plan.iter().zip(target).map(|(a, b)| (a - b).abs()).sum::<f32>();
    let nearest = (0..count)
        .min_by(|a, b| distance(&plans[a * PLAN..][..PLAN]).total_cmp(&distance(&plans[b * PLAN..][..PLAN])))
        .expect("there are plans");
    let mut loss = 0.0;
    for (index, (plan, slope)) in plans.chunks_exact(PLAN).zip(slope.chunks_exact_mut(PLAN)).enumerate() {
        let share = if index == nearest { 1.0 } else { OTHERS_SHARE / (count - 1) as f32 } / PLAN as f32;
        for ((value, slope), target) in plan.iter().zip(slope).zip(target) {
            let (error, by_error) = smooth(value - target);
            loss += share * error;
            *slope = share * by_error;
        }
    }
    loss
}

/// A head of logits [N, plans, 8] of the scores of plans, with what they learn.
pub(super) struct Scored {
    /// Which of the answer's scores it is.
    pub(super) head: usize,
    /// Weights of the cross entropies of a plan, each the mean over the plans.
    pub(super) weights: [f32; TERMS],
    /// Returns what the logits of a plan should say that earns such sub-scores.
    pub(super) wanted: fn(&[f32; TERMS]) -> [f32; TERMS],
}

/// Returns the mean cross entropy of the scores of a batch's last plans and fills in its slope.
pub(super) fn judge_all(
    answer: &Answer,
    Scored { head, weights, wanted }: &Scored,
    slope: &mut Answer,
    batch: &[StepSample<'_>],
    judge: &mut Judge,
) -> Result<f64, PolicyTrainError> {
    let plans = answer.plans.last().expect("every network has plans");
    let (logits, slope) = (&answer.scores[*head], &mut slope.scores[*head]);
    let count = plans.shape()[1];
    let share = 1.0 / (batch.len() * count) as f32;
    let row = count * TERMS;
    let rows = logits.values().chunks_exact(row).zip(slope.values_mut().chunks_exact_mut(row));
    let mut loss = 0.0;
    for ((logits, slope), earned) in rows.zip(earned(plans, batch, judge)?) {
        let labels: Vec<[f32; TERMS]> = earned.iter().map(wanted).collect();
        loss += entropies(logits, &labels, &weights.map(|weight| share * weight), slope);
    }
    Ok(loss)
}

/// Returns the sub-scores that the plans [batch, plans, numbers] of each sample of a batch earn.
pub(super) fn earned(
    plans: &Array,
    batch: &[StepSample<'_>],
    judge: &mut Judge,
) -> Result<Vec<Vec<[f32; TERMS]>>, PolicyTrainError> {
    let rows = plans.values().chunks_exact(plans.shape()[1] * PLAN);
    let asked = rows.zip(batch).map(|(plans, shown)| {
        let knots = plans.chunks_exact(PLAN).map(|plan| knots_of(shown.speed_mps, plan)).collect();
        (shown.sample, knots)
    });
    judge.terms(&asked.collect::<Vec<_>>())
}

/// Returns the sum of the cross entropies of logits of plans, by weights of a plan's, and fills in its slope.
pub(super) fn entropies(logits: &[f32], labels: &[[f32; TERMS]], weights: &[f32; TERMS], slope: &mut [f32]) -> f64 {
    let mut loss = 0.0;
    let each = logits.iter().zip(slope).zip(labels.as_flattened()).zip(weights.iter().cycle());
    for (((logit, slope), label), weight) in each {
        let (error, by_error) = entropy(*logit, *label);
        loss += f64::from(weight * error);
        *slope = weight * by_error;
    }
    loss
}

/// Returns the cross entropy of a logit, max(x, 0) − x·y + ln(1 + e^−|x|), and its slope.
pub(super) fn entropy(logit: f32, label: f32) -> (f32, f32) {
    let error = logit.max(0.0) - logit * label + (-logit.abs()).exp().ln_1p();
    (error, 1.0 / (1.0 + (-logit).exp()) - label)
}
