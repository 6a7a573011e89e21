//! A step of training by who is trained: the `camera` policy's network or one of the panel, each with its own inputs and
//! loss.

use ds_graph::panel::{self, Inputs, Scoring};
use ds_graph::planner;
use ds_nn::{Array, Weights};
use ds_policy::Learned;
use ds_policy::camera::{SIZE, proposals};
use ds_policy::panel::state_of;

use super::PolicyTrainError;
use super::judge::Judge;
use super::step_sample::StepSample;
use super::{anchors, loss, panel_loss, selection, total_loss, vocabulary};

/// Returns the loss of a batch and its gradient by the weights; `images` are [N, 96, 160, 3], `reversal` is how strongly a context
/// unlearns whether it is of a raster.
pub(super) fn gradient(
    student: Learned,
    weights: &Weights,
    images: &Array,
    reversal: f32,
    batch: &[StepSample<'_>],
    judge: &mut Judge,
) -> Result<(f64, Weights), PolicyTrainError> {
    match student {
        Learned::Camera => {
            let rows = batch.iter().flat_map(|shown| proposals::state_of(shown.speed_mps, shown.sample.command));
            let state = Array::new(&[batch.len(), proposals::STATE], rows.collect());
            let targets: Vec<_> = batch.iter().map(StepSample::target).collect();
            let speeds: Vec<f64> = batch.iter().map(|shown| shown.speed_mps).collect();
            let grade = |outputs: &Array| loss::grade(outputs, &targets, &speeds);
            Ok(planner::gradient(SIZE, weights, images, &state, grade)?)
        }
        Learned::Panel(kind) => {
            let rows = batch.iter().flat_map(|shown| state_of(&shown.ego(), shown.sample.command));
            let state = Array::new(&[batch.len(), panel::STATE], rows.collect());
            let noise = batch.iter().flat_map(|shown| shown.noise(kind));
            let noise = Array::new(&[batch.len(), kind.noise()], noise.collect());
            let times: Option<Vec<u32>> = batch.iter().map(|shown| shown.time(kind)).collect();
            let inputs = Inputs { images, state: &state, noise: &noise, times: times.as_deref(), reversal };
            let mut refused = None;
            let mut graded = |answer: &panel::Answer| match (kind.scoring(), kind.given()) {
                (Scoring::Confidence, [name]) => {
                    let anchors = weights.get(name).expect("the network was checked");
                    let targets: Vec<_> = batch.iter().map(StepSample::target).collect();
                    Ok(anchors::grade(answer, anchors, &targets))
                }
                (Scoring::FilteredTerms, _) => selection::grade(answer, batch, judge),
                (Scoring::Total, _) => total_loss::grade(answer, batch, judge),
                (Scoring::ConfidenceAndTerms, _) => vocabulary::grade(answer, kind, weights, batch, judge),
                (_, _) => panel_loss::grade(answer, batch, judge),
            };
            let grade = |answer: &panel::Answer| match graded(answer) {
                Ok(found) => found,
                Err(error) => {
                    refused = Some(error);
                    (f64::NAN, answer.clone())
                }
            };
            let found = panel::gradient(kind, weights, &inputs, grade)?;
            refused.map_or(Ok(found), Err)
        }
    }
}
