//! What is usual of the sampling of some vehicles: jitter of the stamps and repeated samples.

use serde::{Deserialize, Serialize};

use super::Usual;
use crate::scatter::{Scatter, Tolerated};

/// Standard deviations from log to log beyond which a quirk of the sampling is none of the vehicle's.
const SURE: f64 = 2.5;
/// Least such deviation as a share of the mean, which few logs do not show.
const LEAST_SPREAD: f64 = 0.1;

/// What is usual of the sampling; nothing without healthy logs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Sampling {
    /// Standard deviation of the sampling instants, s.
    pub jitter_secs: Usual,
    /// Share of repeated samples.
    pub repeated_share: Usual,
}

impl Sampling {
    /// Returns what is usual of some healthy logs.
    #[must_use]
    pub(crate) fn of(logs: &[Scatter]) -> Self {
        let usual = |value: fn(&Scatter) -> f64| {
            let count = logs.len() as f64;
            let mean = logs.iter().map(value).sum::<f64>() / count.max(1.0);
            let squares: f64 = logs.iter().map(|log| (value(log) - mean).powi(2)).sum();
            let sd = (squares / (count - 1.0).max(1.0)).sqrt().max(LEAST_SPREAD * mean);
            Usual { mean, sd }
        };
        Self { jitter_secs: usual(|log| log.jitter_secs), repeated_share: usual(|log| log.repeated_share) }
    }

    /// Returns what is nothing of note in a further log: what any receiver has, or these vehicles.
    #[must_use]
    pub(crate) fn tolerated(&self) -> Tolerated {
        let most = |usual: Usual, any: f64| any.max(usual.mean + SURE * usual.sd);
        let any = Tolerated::default();
        Tolerated {
            jitter_secs: most(self.jitter_secs, any.jitter_secs),
            repeated_share: most(self.repeated_share, any.repeated_share).min(1.0),
        }
    }

    /// Returns what a jitter, s, is beyond the usual one: independent errors add in squares.
    #[must_use]
    pub(crate) fn jitter_beyond(&self, secs: f64) -> f64 {
        (secs.max(0.0).powi(2) - self.jitter_secs.mean.powi(2)).max(0.0).sqrt()
    }

    /// Returns what a share of repeated samples is beyond the usual one.
    #[must_use]
    pub(crate) fn repeats_beyond(&self, share: f64) -> f64 {
        (share - self.repeated_share.mean).max(0.0)
    }
}
