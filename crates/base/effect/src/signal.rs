//! Operators on evenly sampled signals: delay, lag, rate limit, play, saturation, hold, dead zone.
//!
//! A signal is a whole drive on a fine grid, so that history (buffers, play) is exact. Every operator maps a signal to
//! one of the same length; the first sample is taken as steady state before the drive began.

/// Where along a chain an operator acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Place {
    /// On the command, before the actuator's lag.
    Command,
    /// On the actuator's output, seen by its own sensor.
    Actuator,
    /// Behind the actuator's sensor.
    Linkage,
}

/// What an operator may know besides the signal itself: evenly sampled companions of the drive.
#[derive(Debug, Clone, Copy)]
pub struct Context<'a> {
    /// Step of the grid, s.
    pub step_secs: f64,
    /// Measured speed on the grid, m/s.
    pub speed_mps: &'a [f64],
    /// Brake work done since the drive began, MJ, on the grid.
    pub brake_work_mj: &'a [f64],
}

/// An operator on a signal.
pub type Operator = Box<dyn Fn(&mut [f64], &Context<'_>) + Send + Sync>;

/// Shifts a signal by `delay_secs` (negative: earlier), with linear interpolation between samples.
pub fn delay(signal: &mut [f64], step_secs: f64, delay_secs: f64) {
    let input = signal.to_vec();
    let last = input.len().saturating_sub(1);
    for (k, out) in signal.iter_mut().enumerate() {
        let at = (k as f64 - delay_secs / step_secs).clamp(0.0, last as f64);
        let low = at.floor() as usize;
        let high = (low + 1).min(last);
        *out = input[low] + (at - low as f64) * (input[high] - input[low]);
    }
}

/// Passes a signal through a first-order lag, exact for input that is linear between samples.
pub fn lag(signal: &mut [f64], step_secs: f64, lag_secs: f64) {
    if lag_secs <= 1e-6 || signal.is_empty() {
        return;
    }
    let decay = (-step_secs / lag_secs).exp();
    let mut before = signal[0];
    let mut state = before;
    for sample in signal.iter_mut() {
        let slope = (*sample - before) / step_secs;
        state = *sample - slope * lag_secs + (state - before + slope * lag_secs) * decay;
        before = *sample;
        *sample = state;
    }
}

/// Passes a signal through a first-order lag where it is above what comes out, or with `rises` false below it; the other way it is
/// followed at once.
pub fn lag_one_way(signal: &mut [f64], step_secs: f64, lag_secs: f64, rises: bool) {
    let Some(&first) = signal.first() else { return };
    let share = 1.0 - (-step_secs / lag_secs.max(1e-6)).exp();
    let mut state = first;
    for sample in signal.iter_mut() {
        let behind = (*sample > state) == rises;
        state += (*sample - state) * if behind { share } else { 1.0 };
        *sample = state;
    }
}

/// Passes a signal through 1 / (1 + lag s + inertia s²) by the trapezoidal rule, inertia in s².
pub fn second_order(signal: &mut [f64], step_secs: f64, lag_secs: f64, inertia: f64) {
    let Some(&first) = signal.first() else { return };
    let (mut value, mut rate, mut before) = (first, 0.0, first);
    let damping = 0.5 * step_secs * lag_secs / inertia + 0.25 * step_secs * step_secs / inertia;
    for sample in signal.iter_mut() {
        let pull = step_secs / inertia * (0.5 * (before + *sample) - value);
        let next = (rate * (1.0 - damping) + pull) / (1.0 + damping);
        value += 0.5 * step_secs * (rate + next);
        rate = next;
        before = *sample;
        *sample = value;
    }
}

/// Limits the rate of change of a signal to `rate` per second.
pub fn slew(signal: &mut [f64], step_secs: f64, rate: f64) {
    let Some(&first) = signal.first() else { return };
    let mut state = first;
    for sample in signal.iter_mut() {
        state += (*sample - state).clamp(-rate * step_secs, rate * step_secs);
        *sample = state;
    }
}

/// Passes a signal through play of total width `width`.
pub fn play(signal: &mut [f64], width: f64) {
    let Some(&first) = signal.first() else { return };
    let mut state = first;
    for sample in signal.iter_mut() {
        state = state.clamp(*sample - 0.5 * width, *sample + 0.5 * width);
        *sample = state;
    }
}

/// Holds a signal until it is farther off than `width`, then lets it jump; before the first jump it is as near to 0 as that allows.
pub fn stick(signal: &mut [f64], width: f64) {
    let Some(&first) = signal.first() else { return };
    let mut state = 0.0_f64.clamp(first - width, first + width);
    for sample in signal.iter_mut() {
        state = if (*sample - state).abs() > width { *sample } else { state };
        *sample = state;
    }
}

/// Clips a signal to `limit` on both sides.
pub fn saturate(signal: &mut [f64], limit: f64) {
    for sample in signal.iter_mut() {
        *sample = sample.clamp(-limit, limit);
    }
}

/// Holds a signal between refreshes at `rate_hz`, the first at the start of the drive.
pub fn hold(signal: &mut [f64], step_secs: f64, rate_hz: f64) {
    let mut held = 0.0;
    let mut slot = -1.0;
    for (k, sample) in signal.iter_mut().enumerate() {
        let now = (k as f64 * step_secs * rate_hz + 1e-9).floor();
        if now > slot {
            slot = now;
            held = *sample;
        }
        *sample = held;
    }
}

/// Replaces a signal by its mean over the last `secs`: a hold of that period averaged over its unknown phase.
pub fn moving_mean(signal: &mut [f64], step_secs: f64, secs: f64) {
    let Some(&first) = signal.first() else { return };
    let mut sums = Vec::with_capacity(signal.len() + 1);
    let mut sum = 0.0;
    sums.push(sum);
    for sample in signal.iter() {
        sum += sample;
        sums.push(sum);
    }
    let width = (secs / step_secs).max(1.0);
    // integral of the signal up to a fractional sample, steady before the drive
    let integral = |at: f64| {
        if at <= 0.0 {
            return at * first;
        }
        let low = (at as usize).min(signal.len() - 1);
        sums[low] + (at - low as f64) * (sums[low + 1] - sums[low])
    };
    let means: Vec<f64> =
        (0..signal.len()).map(|k| (integral(k as f64 + 1.0) - integral(k as f64 + 1.0 - width)) / width).collect();
    signal.copy_from_slice(&means);
}

/// Takes `width` off the magnitude of a signal, down to zero.
pub fn dead_zone(signal: &mut [f64], width: f64) {
    for sample in signal.iter_mut() {
        *sample = sample.signum() * (sample.abs() - width).max(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Vec<f64> {
        (0..100).map(|k| f64::from(k) * 0.01).collect()
    }

    #[test]
    fn a_ramp_is_shifted_by_delay_and_by_lag_alike() {
        let (mut late, mut lagged) = (ramp(), ramp());
        delay(&mut late, 0.01, 0.055);
        lag(&mut lagged, 0.01, 0.055);
        let mut second = ramp();
        second_order(&mut second, 0.01, 0.055, 0.0012);
        assert!((second[99] - 0.935).abs() < 1e-4);
        assert!((late[99] - 0.935).abs() < 1e-12);
        assert!((lagged[99] - 0.935).abs() < 1e-6);
        let (mut rising, mut falling) = (ramp(), ramp());
        lag_one_way(&mut rising, 0.01, 0.055, true);
        lag_one_way(&mut falling, 0.01, 0.055, false);
        assert!((rising[99] - 0.94).abs() < 1e-3, "{}", rising[99]);
        assert_eq!(falling, ramp());
    }

    #[test]
    fn nonlinear_operators_act_beyond_their_threshold_only() {
        let mut limited = vec![0.0, 1.0, 1.0, 1.0];
        slew(&mut limited, 0.1, 5.0);
        assert_eq!(limited, vec![0.0, 0.5, 1.0, 1.0]);
        let mut played = vec![0.0, 0.05, 0.3, 0.25, 0.0];
        play(&mut played, 0.2);
        assert_eq!(played[1], 0.0);
        assert!((played[2] - 0.2).abs() < 1e-12 && (played[3] - 0.2).abs() < 1e-12);
        assert!((played[4] - 0.1).abs() < 1e-12);
        let mut held = vec![1.0, 2.0, 3.0, 4.0, 5.0];
        hold(&mut held, 0.1, 5.0);
        assert_eq!(held, vec![1.0, 1.0, 3.0, 3.0, 5.0]);
        let mut stuck = vec![0.1, -0.1, 0.3, 0.4, 0.0];
        stick(&mut stuck, 0.2);
        assert_eq!(stuck, vec![0.0, 0.0, 0.3, 0.3, 0.0]);
        let mut mean = vec![0.0, 0.0, 1.0, 1.0, 1.0];
        moving_mean(&mut mean, 0.1, 0.2);
        assert_eq!(mean, vec![0.0, 0.0, 0.5, 1.0, 1.0]);
        let mut dead = vec![-0.5, 0.1, 0.5];
        dead_zone(&mut dead, 0.2);
        assert_eq!(dead, vec![-0.3, 0.0, 0.3]);
    }
}
