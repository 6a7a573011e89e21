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
