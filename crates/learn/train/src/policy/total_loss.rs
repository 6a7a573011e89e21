//! The loss of a network that predicts the total score and tells rasters from frames, with its gradient.
//!
//! Plans are drawn as the other networks'. The total learns what the plans earn, seven of the sub-scores beside it as auxiliaries,
//! the classifier what it was shown; that the context unlearns it is the network's affair.

use ds_graph::panel::{Answer, TERMS, total};

use super::PolicyTrainError;
use super::judge::Judge;
use super::panel_loss::{Scored, draw_all, entropy, judge_all};
use super::step_sample::StepSample;

/// Weights of the total and of the sub-scores beside it.
const WEIGHTS: [f32; TERMS] = [1.0, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25];
/// The classifier among the scores.
const DOMAIN: usize = 0;
/// The total with the sub-scores beside it among the scores.
const TOTAL: usize = 1;
/// Weight of the classifier.
const DOMAIN_WEIGHT: f32 = 0.1;

/// Returns the mean loss of a batch and its gradient by the answer.
pub(super) fn grade(
    answer: &Answer,
    batch: &[StepSample<'_>],
    judge: &mut Judge,
) -> Result<(f64, Answer), PolicyTrainError> {
    let (mut loss, mut slope) = draw_all(answer, batch);
    let scored = Scored { head: TOTAL, weights: WEIGHTS, wanted };
    loss += judge_all(answer, &scored, &mut slope, batch, judge)?;
    let share = DOMAIN_WEIGHT / batch.len() as f32;
    let logits = answer.scores[DOMAIN].values().iter().zip(slope.scores[DOMAIN].values_mut());
    for ((logit, slope), shown) in logits.zip(batch) {
        let (error, by_error) = entropy(*logit, f32::from(u8::from(shown.raster)));
        loss += f64::from(share * error);
        *slope = share * by_error;
    }
    Ok((loss, slope))
}

/// Returns what the logits of a plan should say that earns such sub-scores.
#[expect(clippy::cast_possible_truncation, reason = "labels are single precision")]
fn wanted(terms: &[f32; TERMS]) -> [f32; TERMS] {
    let all = total(terms.map(f64::from)) as f32;
    std::array::from_fn(|place| if place == 0 { all } else { terms[place - 1] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_total_comes_first_and_comfort_is_left_out() {
        let terms = [1.0, 1.0, 0.0, 1.0, 0.4, 1.0, 1.0, 0.5];
        assert_eq!(wanted(&terms), [0.0, 1.0, 1.0, 0.0, 1.0, 0.4, 1.0, 1.0]);
        assert!((wanted(&[1.0; TERMS])[0] - 1.0).abs() < 1e-6);
    }
}
