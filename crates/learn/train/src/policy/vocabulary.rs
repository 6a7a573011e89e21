//! Networks that put plans together of a vocabulary: which paths and profiles it holds, and the loss of their choice, with its
//! gradient.
//!
//! The words are the centres of k-means over the teacher's. Every choice, of paths and profiles in both layers and of plans,
//! is drawn to softmax(−4 · distance), distances to the teacher's drive in metres, among what the layer was shown (cross
//! entropy); sub-scores to what the plans earn. The published weights are 1 and, for the mean of the sub-scores, 5.

use ds_graph::panel::sparsedrive::LEFT_OUT;
use ds_graph::panel::vocabulary::{PATH, PROFILE, Place, STEP_M, path_of, profile_of};
use ds_graph::panel::{Answer, Kind, PLAN, Scoring, TERMS, units};
use ds_nn::Weights;
use ds_policy::Learned;
use ds_policy::camera::proposals::{KNOTS, TARGETS};

use super::PolicyTrainError;
use super::dataset::{Sample, Samples};
use super::groups::centres;
use super::judge::Judge;
use super::panel_loss::{Scored, flat, judge_all};
use super::step_sample::StepSample;

/// How much less likely what lies a metre farther from the teacher should be, as a power of e.
const SHARPNESS: f32 = 4.0;
/// Weight of the cross entropy of one sub-score, mean over the plans.
const SCORE_WEIGHT: f32 = 5.0 / TERMS as f32;
/// Drives shorter than this say nothing of a path, in metres.
const LEAST_M: f32 = 6.0;

/// Returns the names of the paths and of the profiles among the weights of a network that has a vocabulary.
fn names(kind: Kind) -> Option<[&'static str; 2]> {
    Some(kind.given()).filter(|_| kind.scoring() == Scoring::ConfidenceAndTerms)?.try_into().ok()
}

/// Puts words of the expert's samples among the weights of a network that has a vocabulary.
pub(super) fn give(student: Learned, weights: &mut Weights, expert: &Samples, seed: u64) {
    let Learned::Panel(kind) = student else { return };
    let Some([paths, profiles]) = names(kind) else { return };
    let driven: Vec<_> = expert.0.iter().map(|sample| path_of(&places(sample))).collect();
    let long = || driven.iter().filter(|(_, driven_m)| *driven_m >= LEAST_M);
    let some = if long().next().is_some() { LEAST_M } else { 0.0 };
    let roads: Vec<[f32; PATH]> =
        driven.iter().filter(|(_, driven_m)| *driven_m >= some).map(|(path, _)| *path).collect();
    let speeds: Vec<[f32; PROFILE]> =
        expert.0.iter().map(|sample| profile_of(&places(sample), f64::from(sample.speed_mps))).collect();
    fill(weights, paths, &roads, seed);
    fill(weights, profiles, &speeds, seed);
}

fn fill<const N: usize>(weights: &mut Weights, name: &str, points: &[[f32; N]], seed: u64) {
    if let Some(words) = weights.get_mut(name) {
        let found = centres(points, words.shape()[0], seed);
        words.values_mut().copy_from_slice(found.as_flattened());
    }
}

/// Returns where the teacher drives.
#[expect(clippy::cast_possible_truncation, reason = "words are single precision")]
fn places(sample: &Sample) -> [Place; KNOTS] {
    sample.poses().map(|pose| [pose.position.x as f32, pose.position.y as f32, pose.heading_rad as f32])
}

/// Returns the mean loss of a batch and its gradient by the answer.
pub(super) fn grade(
    answer: &Answer,
    kind: Kind,
    weights: &Weights,
    batch: &[StepSample<'_>],
    judge: &mut Judge,
) -> Result<(f64, Answer), PolicyTrainError> {
    let mut slope = flat(answer);
    let words = |which: usize| {
        let array = names(kind).and_then(|names| weights.get(names[which]));
        array.expect("a network with a vocabulary has its words").values()
    };
    let plans = answer.plans[0].values();
    let mut loss = 0.0;
    for (sample, shown) in batch.iter().enumerate() {
        let places = places(shown.sample);
        let (path, driven_m) = path_of(&places);
        let profile = profile_of(&places, shown.speed_mps);
        let target = shown.target();
        let far_of_paths: Vec<f32> = words(0).chunks_exact(PATH).map(|word| aside_m(word, &path, driven_m)).collect();
        let far_of_profiles: Vec<f32> = words(1).chunks_exact(PROFILE).map(|word| behind_m(word, &profile)).collect();
        let row = plans.len() / batch.len();
        let far_of_plans: Vec<f32> =
            plans[sample * row..][..row].chunks_exact(PLAN).map(|plan| away_m(plan, &target)).collect();
        let far = [&far_of_paths, &far_of_profiles, &far_of_paths, &far_of_profiles, &far_of_plans];
        for ((far, logits), slope) in far.into_iter().zip(&answer.scores).zip(&mut slope.scores) {
            let row = far.len();
            let part = sample * row..(sample + 1) * row;
            let share = 1.0 / batch.len() as f32;
            loss += choice(&logits.values()[part.clone()], far, share, &mut slope.values_mut()[part]);
        }
    }
    let scored = Scored { head: answer.scores.len() - 1, weights: [SCORE_WEIGHT; TERMS], wanted: |terms| *terms };
    loss += judge_all(answer, &scored, &mut slope, batch, judge)?;
    Ok((loss, slope))
}

/// Returns the cross entropy of logits against softmax(−4 · distance), both among what was not left out, and fills in its
/// slope.
fn choice(logits: &[f32], far_m: &[f32], weight: f32, slope: &mut [f32]) -> f64 {
    let shown: Vec<usize> = (0..logits.len()).filter(|index| logits[*index] > LEFT_OUT).collect();
    let softened = |of: &dyn Fn(usize) -> f32| -> Vec<f32> {
        let highest = shown.iter().map(|index| of(*index)).fold(f32::NEG_INFINITY, f32::max);
        let powers: Vec<f32> = shown.iter().map(|index| (of(*index) - highest).exp()).collect();
        let sum: f32 = powers.iter().sum();
        powers.iter().map(|power| power / sum).collect()
    };
    let said = softened(&|index| logits[index]);
    let wanted = softened(&|index| -SHARPNESS * far_m[index]);
    let mut loss = 0.0;
    for ((index, said), wanted) in shown.iter().zip(said).zip(wanted) {
        loss -= f64::from(weight * wanted * said.max(1e-20).ln());
        slope[*index] = weight * (said - wanted);
    }
    loss
}

/// Returns how far a path lies from the teacher's over what that drives, mean over its points, in metres.
fn aside_m(word: &[f32], path: &[f32; PATH], driven_m: f32) -> f32 {
    let driven = word.chunks_exact(2).zip(path.chunks_exact(2)).take((driven_m / STEP_M).floor() as usize);
    mean(driven.map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])))
}

/// Returns how far ahead or behind a profile is, mean over the poses, in metres.
#[expect(clippy::cast_possible_truncation, reason = "losses are single precision")]
fn behind_m(word: &[f32], profile: &[f32; PROFILE]) -> f32 {
    mean(word.iter().zip(profile).enumerate().map(|(pose, (a, b))| units(pose)[0] as f32 * (a - b).abs()))
}

/// Returns how far a plan lies from the teacher's, mean over the poses, in metres.
#[expect(clippy::cast_possible_truncation, reason = "losses are single precision")]
fn away_m(plan: &[f32], target: &[f32; TARGETS]) -> f32 {
    let poses = plan.chunks_exact(3).zip(target.chunks_exact(3)).enumerate();
    mean(poses.map(|(pose, (a, b))| {
        let [along, across, _] = units(pose).map(|unit| unit as f32);
        (along * (a[0] - b[0])).hypot(across * (a[1] - b[1]))
    }))
}

/// Returns the mean, of nothing 0.
fn mean(values: impl Iterator<Item = f32>) -> f32 {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
    sum / count.max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_choice_is_drawn_to_what_is_near_among_what_was_shown() {
        let (logits, far_m) = ([0.3, LEFT_OUT, -0.4, 1.1], [0.5, 0.0, 0.1, 2.0]);
        let at = |logits: &[f32]| choice(logits, &far_m, 0.5, &mut [0.0; 4]);
        let mut slope = [0.0; 4];
        choice(&logits, &far_m, 0.5, &mut slope);
        assert!(slope[1] == 0.0 && slope[2] < 0.0 && slope[3] > 0.0, "{slope:?}");
        for index in [0, 2, 3] {
            let by = |offset: f32| {
                let mut moved = logits;
                moved[index] += offset;
                at(&moved)
            };
            let numeric = (by(1e-2) - by(-1e-2)) / 2e-2;
            assert!((numeric - f64::from(slope[index])).abs() < 1e-3, "{index}: {numeric} {}", slope[index]);
        }
        // Where nothing is driven, no path is better than another.
        assert_eq!(aside_m(&[5.0; PATH], &[0.0; PATH], 1.9), 0.0);
        assert!((aside_m(&[3.0; PATH], &[0.0; PATH], 9.0) - 18f32.sqrt()).abs() < 1e-5);
        assert!((behind_m(&[1.0; PROFILE], &[0.0; PROFILE]) - 3.0).abs() < 1e-5, "mean of 0.9 to 5.1 m");
    }
}
