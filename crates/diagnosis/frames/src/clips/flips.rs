//! The chance that clips without any effect show such a gain: signs of the clips' deviations are flipped, which changes
//! nothing about clips that deviate by chance, and takes away what they have in common with an effect.

use ds_space::draw::Draws;
use nalgebra::DVector;

/// Signs that are tried at most.
const MOST: u64 = 256;

/// Returns the share of sign patterns whose `gain` reaches that of the deviations as they are, which count themselves;
/// `widened` is by how much a deviation of the mean is larger than clips of one bias would have it.
#[must_use]
pub fn chance(deviations: &[DVector<f64>], widened: f64, gain: &dyn Fn(&[DVector<f64>]) -> f64) -> f64 {
    let found = gain(deviations);
    let count = if deviations.len() < 9 { 1 << deviations.len() } else { MOST };
    let draws = Draws::from_seed(11, "signs");
    let mut reached = 1;
    for pattern in 1..count {
        let negative = |clip: u64| {
            if count < MOST || deviations.len() == 8 {
                pattern >> clip & 1 == 1
            } else {
                draws.below(pattern * 4096 + clip, 2) == 1
            }
        };
        let flipped: Vec<DVector<f64>> =
            (0..).zip(deviations).map(|(clip, d)| if negative(clip) { -d } else { d.clone() }).collect();
        reached += u64::from(widened * gain(&flipped) >= found);
    }
    reached as f64 / count as f64
}
