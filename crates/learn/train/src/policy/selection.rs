//! The loss of a network that selects among plans which it does not train, with its gradient, and the plans of its vocabulary.
//!
//! The sub-scores of both read-outs learn what the plans earn (cross entropy, mean over the plans); and that of progress the order
//! of the plans: of two of which one earns more it should say so by [`MARGIN`]. The published weights are 1 and 2.

use ds_graph::panel::{Answer, PLAN, Scoring, TERMS, sigmoid};
use ds_nn::Weights;
use ds_policy::Learned;

use super::PolicyTrainError;
use super::dataset::Samples;
use super::groups::centres;
use super::judge::Judge;
use super::loss::target_of;
use super::panel_loss::{earned, entropies, flat};
use super::step_sample::StepSample;

/// How far apart the progress of two plans should be said to be.
const MARGIN: f32 = 0.05;
/// Weight of the order of progress, mean over the pairs.
const ORDER_WEIGHT: f32 = 2.0;
/// Progress among the sub-scores.
const PROGRESS: usize = 4;

/// Puts plans of the expert's samples, centres of k-means, among the weights of a network that selects.
pub(super) fn give(student: Learned, weights: &mut Weights, expert: &Samples, seed: u64) {
    let Learned::Panel(kind) = student else { return };
    let [name] = kind.given() else { return };
    if let (Scoring::FilteredTerms, Some(words)) = (kind.scoring(), weights.get_mut(name)) {
        let plans: Vec<[f32; PLAN]> =
            expert.0.iter().map(|sample| target_of(sample, f64::from(sample.speed_mps))).collect();
        let found = centres(&plans, words.shape()[0], seed);
        words.values_mut().copy_from_slice(found.as_flattened());
    }
}

/// Returns the mean loss of a batch, summed over the read-outs, and its gradient by the answer.
pub(super) fn grade(
    answer: &Answer,
    batch: &[StepSample<'_>],
    judge: &mut Judge,
) -> Result<(f64, Answer), PolicyTrainError> {
    let (mut loss, mut slope) = (0.0, flat(answer));
    for ((plans, logits), slope) in answer.plans.iter().zip(&answer.scores).zip(&mut slope.scores) {
        let count = plans.shape()[1];
        let share = 1.0 / batch.len() as f32;
        let row = count * TERMS;
        let rows = logits.values().chunks_exact(row).zip(slope.values_mut().chunks_exact_mut(row));
        for ((logits, slope), labels) in rows.zip(earned(plans, batch, judge)?) {
            loss += entropies(logits, &labels, &[share / count as f32; TERMS], slope);
            loss += order(logits, &labels, share * ORDER_WEIGHT, slope);
        }
    }
    Ok((loss, slope))
}

/// Returns the mean over pairs of plans, of which one earns more progress, of what the difference said lacks of the margin, and adds
/// its slope.
#[expect(clippy::cast_possible_truncation, reason = "losses are single precision")]
fn order(logits: &[f32], labels: &[[f32; TERMS]], weight: f32, slope: &mut [f32]) -> f64 {
    let said: Vec<f32> = logits.chunks_exact(TERMS).map(|plan| sigmoid(plan[PROGRESS]) as f32).collect();
    let ahead = |a: usize, b: usize| labels[a][PROGRESS] > labels[b][PROGRESS];
    let pairs =
        || (0..labels.len()).flat_map(|a| (0..labels.len()).map(move |b| (a, b))).filter(|(a, b)| ahead(*a, *b));
    let share = weight / pairs().count().max(1) as f32;
    let mut loss = 0.0;
    for (a, b) in pairs() {
        let lacks = MARGIN - (said[a] - said[b]);
        if lacks > 0.0 {
            loss += f64::from(share * lacks);
            for (plan, sign) in [(a, -1.0), (b, 1.0)] {
                slope[plan * TERMS + PROGRESS] += sign * share * said[plan] * (1.0 - said[plan]);
            }
        }
    }
    loss
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_of_progress_is_learned_and_its_gradient_is_the_slope() {
        let labels = [0.2, 0.9, 0.9, 0.4].map(|progress| [1.0, 1.0, 1.0, 1.0, progress, 1.0, 1.0, 1.0]);
        let logits: Vec<f32> = (0..4 * TERMS).map(|k| (1.3 * k as f32).sin()).collect();
        let at = |logits: &[f32]| order(logits, &labels, 2.0, &mut [0.0; 4 * TERMS]);
        let mut slope = [0.0; 4 * TERMS];
        assert!(order(&logits, &labels, 2.0, &mut slope) > 0.0);
        for (index, slope) in slope.iter().enumerate() {
            let by = |offset: f32| {
                let mut moved = logits.clone();
                moved[index] += offset;
                at(&moved)
            };
            let numeric = (by(1e-2) - by(-1e-2)) / 2e-2;
            assert!((numeric - f64::from(*slope)).abs() < 1e-3, "{index}: {numeric} by difference, {slope}");
            assert!(index % TERMS == PROGRESS || *slope == 0.0);
        }
        // Said in order and by the margin, nothing is left to learn; equal plans have no order.
        let right: Vec<f32> =
            labels.iter().flat_map(|label| [0.0, 0.0, 0.0, 0.0, 4.0 * label[PROGRESS], 0.0, 0.0, 0.0]).collect();
        assert_eq!(at(&right), 0.0);
        assert_eq!(order(&logits, &[[1.0; TERMS]; 4], 2.0, &mut [0.0; 4 * TERMS]), 0.0);
    }
}
