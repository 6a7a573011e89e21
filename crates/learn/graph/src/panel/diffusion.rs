//! The schedule of truncated diffusion over the points of plans, as plain numbers: mixing noise in and one step of DDIM.
//!
//! β_t = (√β_0 + t/999 (√β_999 − √β_0))², ᾱ_t = Π_{s≤t} (1 − β_s). A plan at time t is √ᾱ_t u + √(1−ᾱ_t) ε with ε normal;
//! u are its points on the scale of [`SPAN`], −1 to 1. Published: Song et al. 2021 (DDIM), Liao et al. 2025 (truncation).

use ds_nn::array::Array;

/// Numbers of the points of a plan: x and y of eight poses.
pub(super) const POINTS: usize = 16;
/// Times are drawn below this one in training.
pub(super) const TIMES: u32 = 50;
/// The time whose noise anchors get before the first step.
pub(super) const START: u32 = 8;
/// The times of the two steps.
pub(super) const STEPS: [u32; 2] = [10, 0];

/// Lowest and highest x, then y, of points that diffusion knows, in the units of plans.
const SPAN: [[f32; 2]; 2] = [[-8.0, 4.0], [-6.0, 6.0]];
const BETAS: [f64; 2] = [1e-4, 0.02];
const LENGTH: f64 = 999.0;

/// Returns how much of a plan and how much noise are left at a time: √ᾱ, √(1−ᾱ).
#[expect(clippy::cast_possible_truncation, reason = "points are single precision")]
pub(super) fn shares(time: u32) -> [f32; 2] {
    let [first, last] = BETAS.map(f64::sqrt);
    let left = |step: u32| 1.0 - (first + f64::from(step) / LENGTH * (last - first)).powi(2);
    let kept: f64 = (0..=time).map(left).product();
    [kept.sqrt() as f32, (1.0 - kept).sqrt() as f32]
}

/// Returns points [.., 16] on the scale −1 to 1, cut off there.
pub(super) fn scaled(points: &Array) -> Array {
    each(points, |[low, high], value| ((2.0 * (value - low)) / (high - low) - 1.0).clamp(-1.0, 1.0))
}

fn unscaled(points: &Array) -> Array {
    each(points, |[low, high], value| low + 0.5 * (value.clamp(-1.0, 1.0) + 1.0) * (high - low))
}

fn each(points: &Array, change: impl Fn([f32; 2], f32) -> f32) -> Array {
    let values = points.values().iter().enumerate().map(|(index, value)| change(SPAN[index % 2], *value));
    Array::new(points.shape(), values.collect())
}

/// Returns the anchors [M, 16] with noise [N, M·16] of each sample's time: [N, M, 16].
pub(super) fn noised(anchors: &Array, noise: &Array, times: &[u32]) -> Array {
    let plain = scaled(anchors);
    let row = plain.values().len();
    let mut points = Vec::with_capacity(times.len() * row);
    for (noise, time) in noise.values().chunks_exact(row).zip(times) {
        let [kept, mixed] = shares(*time);
        points.extend(plain.values().iter().zip(noise).map(|(plain, noise)| kept * plain + mixed * noise));
    }
    unscaled(&Array::new(&[times.len(), row / POINTS, POINTS], points))
}

/// Returns points of time `from` one step of DDIM later, at time `to`, where the network holds `found` for the plan.
pub(super) fn stepped(points: &Array, found: &Array, [from, to]: [u32; 2]) -> Array {
    let ([kept, mixed], [keeps, mixes]) = (shares(from), shares(to));
    let (points, found) = (scaled(points), scaled(found));
    let pairs = points.values().iter().zip(found.values());
    let next = pairs.map(|(point, found)| keeps * found + mixes * (point - kept * found) / mixed);
    unscaled(&Array::new(points.shape(), next.collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXPECTED: [(u32, f32); 4] = [(0, 0.01), (8, 0.031_588_067), (10, 0.035_364_671), (49, 0.094_253_97)];

    #[test]
    fn the_schedule_is_the_published_one() {
        // √(1−ᾱ) of the product worked out apart from this code, in double precision.
        for (time, expected) in EXPECTED {
            let [kept, mixed] = shares(time);
            assert!(
                (mixed - expected).abs() < 1e-6 && (kept * kept + mixed * mixed - 1.0).abs() < 1e-6,
                "{time}: {mixed}"
            );
        }
    }

    #[test]
    fn a_step_moves_points_to_where_the_network_holds_the_plan() {
        let anchors = Array::new(&[1, POINTS], (0..16).map(|k| 0.2 * k as f32 - 2.0).collect());
        let noise = Array::new(&[1, POINTS], (0..16).map(|k| 0.5 - 0.1 * k as f32).collect());
        let points = noised(&anchors, &noise, &[STEPS[0]]);
        // The noise that was mixed in is found again, and its share at the later time remains.
        let next = stepped(&points, &Array::new(&[1, 1, POINTS], anchors.values().to_vec()), STEPS);
        let expected = noised(&anchors, &noise, &[STEPS[1]]);
        next.values().iter().zip(expected.values()).for_each(|(a, b)| assert!((a - b).abs() < 1e-4, "{a} {b}"));
        let nearer =
            |points: &Array| points.values().iter().zip(anchors.values()).map(|(a, b)| (a - b).abs()).sum::<f32>();
        assert!(nearer(&next) < 0.5 * nearer(&points));
    }

    #[test]
    fn points_beyond_the_span_are_cut_off() {
        let far = Array::new(&[1, 2], vec![-90.0, 90.0]);
        assert_eq!(unscaled(&scaled(&far)).values(), [SPAN[0][0], SPAN[1][1]]);
    }
}
