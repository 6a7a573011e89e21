//! The chance that clips without any effect show such a gain: signs of the clips' deviations are flipped, which changes
//! nothing about clips that deviate by chance, and takes away what they have in common with an effect.

use ds_space::draw::Draws;

/// Clips of which all patterns of signs are tried; of more, so many as these have.
const MOST_CLIPS: usize = 8;

/// Returns the share of sign patterns whose gain reaches that of the deviations as they are, which count themselves; `gain`
/// takes a sign per clip, and `widened` is by how much a deviation of the mean is larger than that of clips of one bias.
#[must_use]
pub fn chance(clips: usize, widened: f64, gain: &(dyn Fn(&[f64]) -> f64 + Sync)) -> f64 {
    let found = gain(&vec![1.0; clips]);
    let patterns = 1u64 << clips.min(MOST_CLIPS);
    let draws = Draws::from_seed(11, "signs");
    let reached = (1..patterns).filter(|pattern| {
        let negative = |clip: u64| {
            if clips > MOST_CLIPS { draws.below(pattern * 65_536 + clip, 2) == 1 } else { pattern >> clip & 1 == 1 }
        };
        let signs: Vec<f64> = (0..clips as u64).map(|clip| if negative(clip) { -1.0 } else { 1.0 }).collect();
        widened * gain(&signs) >= found
    });
    (1 + reached.count()) as f64 / patterns as f64
}
