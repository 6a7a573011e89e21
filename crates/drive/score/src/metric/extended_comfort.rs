//! EC ∈ {0, 1}: how much the executed motion of two consecutive frames differs where they overlap (`scoring.md` §4).
//!
//! Root-mean-square differences of acceleration magnitude, its jerk, yaw rate and yaw acceleration; the latter with a
//! second-order polynomial where comfort uses the third (PDM `pdm_comfort_metrics.py:35-39,397-467`).

use crate::constants::comfort::{ACCELERATION_WINDOW, HEADING_WINDOW, JERK_WINDOW};
use crate::constants::extended_comfort::{ACCELERATION, FARTHEST_S, JERK, YAW_ACCELERATION, YAW_RATE};
use crate::constants::horizon::DT_S;
use crate::error::ScoreError;
use crate::motion::VehicleState;
use crate::smoothing::{Smoother, round, unwrap};

const LIMITS: [f64; 4] = [ACCELERATION, JERK, YAW_RATE, YAW_ACCELERATION];
const FEWEST_OVERLAPPING: usize = 3;

/// The names of the differences, in order.
pub const DIFFERENCE_NAMES: [&str; 4] = ["acceleration", "jerk", "yaw_rate", "yaw_accel"];

/// The score and its differences.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExtendedComfort {
    /// 1 if all differences stay within their limits, else 0.
    pub score: f64,
    /// Root-mean-square differences in the order of [`DIFFERENCE_NAMES`], SI units.
    pub rms: [f64; 4],
}

/// Compares the executed states of a frame with those of the frame `shift_s` before it.
///
/// # Errors
/// [`ScoreError::BadShift`] unless 0 < shift < 0.55 s, [`ScoreError::TooFewStates`] if less than three states overlap.
pub fn extended_comfort(
    current: &[VehicleState],
    previous: &[VehicleState],
    shift_s: f64,
) -> Result<ExtendedComfort, ScoreError> {
    if !(shift_s > 0.0 && shift_s < FARTHEST_S) {
        return Err(ScoreError::BadShift { shift_s });
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 6 and not negative")]
    let shift = (shift_s / DT_S).round_ties_even() as usize;
    for states in [current, previous] {
        if let Some((name, value)) = states.iter().find_map(VehicleState::not_finite) {
            return Err(ScoreError::NotFinite { field: format!("states.{name}"), value });
        }
    }
    let overlap = current.len().min(previous.len()).saturating_sub(shift);
    if shift == 0 {
        return Err(ScoreError::BadShift { shift_s });
    }
    if overlap < FEWEST_OVERLAPPING {
        return Err(ScoreError::TooFewStates { what: "overlap", found: overlap, needed: FEWEST_OVERLAPPING });
    }
    let a = series(&current[..overlap]);
    let b = series(&previous[shift..shift + overlap]);
    let rms: [f64; 4] = std::array::from_fn(|i| {
        let sum: f64 = a[i].iter().zip(&b[i]).map(|(a, b)| (a - b) * (a - b)).sum();
        (sum / overlap as f64).sqrt()
    });
    let within = rms.iter().zip(LIMITS).all(|(value, limit)| *value <= limit);
    Ok(ExtendedComfort { score: super::unless(!within), rms })
}

fn series(states: &[VehicleState]) -> [Vec<f64>; 4] {
    let n = states.len();
    let filtered = |smoother: Smoother, series: &[f64]| {
        let mut out = vec![0.0; n];
        smoother.filter(series, &mut out);
        round(&mut out);
        out
    };
    let magnitude: Vec<f64> = states.iter().map(|state| state.ax_mps2.hypot(state.ay_mps2)).collect();
    let acceleration = filtered(Smoother::new(ACCELERATION_WINDOW.min(n), 2, 0, DT_S), &magnitude);
    let jerk = filtered(Smoother::new(JERK_WINDOW.min(n), 2, 1, DT_S), &acceleration);
    let mut headings: Vec<f64> = states.iter().map(|state| state.heading_rad).collect();
    unwrap(&mut headings);
    let yaw_rate = filtered(Smoother::new(HEADING_WINDOW.min(n), 2, 1, DT_S), &headings);
    let yaw_acceleration = filtered(Smoother::new(HEADING_WINDOW.min(n), 2, 2, DT_S), &headings);
    [acceleration, jerk, yaw_rate, yaw_acceleration]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn states(acceleration_mps2: f64, turn_radps: f64) -> Vec<VehicleState> {
        let state = |step: usize| VehicleState {
            ax_mps2: acceleration_mps2,
            heading_rad: turn_radps * DT_S * step as f64,
            ..VehicleState::default()
        };
        (0..41).map(state).collect()
    }

    #[test]
    fn constant_differences_are_their_own_mean() {
        for (acceleration_mps2, turn_radps, score) in
            [(0.0, 0.0, 1.0), (0.69, 0.0, 1.0), (-0.71, 0.0, 0.0), (0.0, 0.09, 1.0), (0.0, 0.11, 0.0)]
        {
            let got = extended_comfort(&states(0.0, 0.0), &states(acceleration_mps2, turn_radps), 0.5).expect("sound");
            assert_eq!(got.score, score, "{acceleration_mps2} m/s2, {turn_radps} rad/s");
            let expected = [acceleration_mps2.abs(), 0.0, turn_radps, 0.0];
            assert!(got.rms.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-7), "{:?}", got.rms);
        }
    }

    #[test]
    fn a_shifted_drive_equals_itself() {
        let state = |step: usize| {
            let time_s = DT_S * step as f64;
            VehicleState { ax_mps2: (2.0 * time_s).sin(), heading_rad: 0.3 * time_s.cos(), ..VehicleState::default() }
        };
        let drive: Vec<VehicleState> = (0..46).map(state).collect();
        let got = extended_comfort(&drive[5..46], &drive[..41], 0.5).expect("sound");
        // The overlap is cut out before it is filtered, so that even the edges agree.
        assert_eq!((got.score, got.rms), (1.0, [0.0; 4]));
    }

    #[test]
    fn frames_that_do_not_follow_are_refused() {
        for shift_s in [0.0, -0.1, 0.55, 0.04, f64::NAN] {
            assert!(extended_comfort(&states(0.0, 0.0), &states(0.0, 0.0), shift_s).is_err(), "{shift_s}");
        }
        let short = extended_comfort(&states(0.0, 0.0)[..5], &states(0.0, 0.0)[..5], 0.5);
        assert_eq!(short, Err(ScoreError::TooFewStates { what: "overlap", found: 0, needed: 3 }));
    }
}
