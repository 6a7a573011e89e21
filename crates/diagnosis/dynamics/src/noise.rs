//! How noisy the sensors of a log are, from its high frequencies: third differences keep white noise and lose motion.
//!
//! The floor of `floor` was measured with sensors of known noise; other sensors scale it. Across the path only, because
//! errors of the stamps move positions along it.

use crate::baseline::windows::Sensors;
use crate::drive::Drive;
use crate::scatter::across_noise;
use crate::settings::{FAMILIAR_NOISE, SENSOR_NOISE};
use crate::windows::EGO;

/// Share of lost samples from which they tell in the floor.
const NOTABLE_LOSS: f64 = 0.02;

/// Noise of a log's channels relative to the sensors with which the floor was measured; 1 where they are alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Per ego channel.
    pub ego: [f64; EGO],
    /// Followers' speed and gap.
    pub follower: [f64; 2],
    /// Standard deviation of the sampling instants, s.
    pub jitter_secs: f64,
}

impl From<&Sensors> for Noise {
    fn from(sensors: &Sensors) -> Self {
        let of = |k: usize| sensors.noise.get(k).copied().unwrap_or(1.0);
        let follower = [of(EGO), of(EGO + 1)];
        Self { ego: std::array::from_fn(of), follower, jitter_secs: sensors.jitter_secs }
    }
}

impl Noise {
    /// Returns the sensors of the middle one of several logs, channel by channel.
    #[must_use]
    pub(crate) fn middle(of: &[&Self]) -> Sensors {
        let middle = |value: &dyn Fn(&Self) -> f64| median(of.iter().map(|noise| value(noise)).collect());
        let ego = (0..EGO).map(|k| middle(&|noise| noise.ego[k]));
        let noise = ego.chain((0..2).map(|k| middle(&|noise| noise.follower[k]))).map(|n| n.unwrap_or(1.0));
        Sensors { noise: noise.collect(), jitter_secs: middle(&|noise| noise.jitter_secs).unwrap_or(0.0) }
    }

    /// Measures the noise of some drives whose sampling instants scatter by `jitter_secs`. Samples that were lost and
    /// bridged leave fewer to start a window from.
    #[must_use]
    pub fn of(drives: &[&Drive], jitter_secs: f64) -> Self {
        let repeated = drives.iter().map(|d| d.repeated_share).sum::<f64>() / drives.len().max(1) as f64;
        let lost = if repeated > NOTABLE_LOSS { repeated } else { 0.0 };
        let column = |pick: &dyn Fn(&Drive) -> Option<&Vec<f64>>| -> Option<f64> {
            median(drives.iter().filter_map(|d| pick(d).map(|c| white(c))).collect())
        };
        let followers = |pick: &dyn Fn(&crate::drive::FollowerLog) -> f64| {
            median(drives.iter().flat_map(|d| d.followers.iter().map(pick)).collect())
        };
        let position = median(drives.iter().filter_map(|d| across_noise(&[d])).collect());
        let found = [
            position,
            position,
            column(&|d| d.yaw.as_ref()),
            column(&|d| d.v.as_ref()),
            column(&|d| d.yaw_rate.as_ref()),
            column(&|d| d.ax.as_ref()),
            column(&|d| d.ay.as_ref()),
            column(&|d| d.steer_meas.as_ref()),
            column(&|d| d.v_wheel.as_ref()),
            followers(&|f| white(&f.v)),
            followers(&|f| white(&f.gap)),
        ];
        let relative = |k: usize| found[k].map_or(1.0, |noise| familiar(noise / SENSOR_NOISE[k]));
        let ego = std::array::from_fn(|k| relative(k) * (1.0 + 1.5 * lost));
        Self { ego, follower: [relative(EGO), relative(EGO + 1)], jitter_secs }
    }

    /// Tells whether the floor measured elsewhere holds here as it is.
    #[must_use]
    pub fn is_familiar(&self) -> bool {
        self.ego.iter().chain(&self.follower).all(|s| *s == 1.0)
    }
}

fn familiar(ratio: f64) -> f64 {
    let (low, high) = FAMILIAR_NOISE;
    // quieter sensors leave the model's own share of the floor
    if (low..=high).contains(&ratio) { 1.0 } else { ratio.clamp(low, 30.0) }
}

/// Returns the standard deviation of the white noise of an even signal, by the median of its third differences.
#[must_use]
pub fn white(signal: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = signal.windows(4).map(|s| (s[3] - 3.0 * s[2] + 3.0 * s[1] - s[0]).abs()).collect();
    ds_stats::quantile(&mut sizes, 0.5) / 0.6745 / 20.0_f64.sqrt()
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    (!values.is_empty()).then(|| ds_stats::quantile(&mut values, 0.5))
}
