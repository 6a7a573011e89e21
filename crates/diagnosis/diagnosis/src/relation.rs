//! How two series go with each other: slope and correlation, over half seconds or sample by sample.

use crate::table::STEP_SECS;

/// How one series goes with another.
#[derive(Debug, Clone, Copy)]
pub struct Relation {
    /// Units of the second per unit of the first.
    pub slope: f64,
    /// Correlation.
    pub correlation: f64,
}

/// Relates two series by their means over half a second, each less its own mean; `None` where the first hardly varies.
#[must_use]
pub fn relate(first: &[f64], second: &[f64], least_spread: f64) -> Option<Relation> {
    let block = (0.5 / STEP_SECS) as usize;
    let means =
        |c: &[f64]| -> Vec<f64> { c.chunks_exact(block).map(|b| b.iter().sum::<f64>() / block as f64).collect() };
    let (a, b) = (means(first), means(second));
    let count = a.len().min(b.len());
    if count < 8 {
        return None;
    }
    let mean = |c: &[f64]| c[..count].iter().sum::<f64>() / count as f64;
    let (ma, mb) = (mean(&a), mean(&b));
    let (mut cross, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (x, y) in a.iter().zip(&b) {
        cross += (x - ma) * (y - mb);
        aa += (x - ma).powi(2);
        bb += (y - mb).powi(2);
    }
    if (aa / count as f64).sqrt() < least_spread || bb <= 0.0 {
        return None;
    }
    Some(Relation { slope: cross / aa, correlation: cross / (aa * bb).sqrt() })
}

/// Tells whether a positive ratio lies within a factor of `times` of another.
#[must_use]
pub fn near(ratio: f64, other: f64, times: f64) -> bool {
    ratio > 0.0 && (ratio / other).ln().abs() < times.ln()
}

/// Relates two series sample by sample (unlike block means this keeps the timing); `None` where the second hardly varies.
#[must_use]
pub fn relate_at(first: &[f64], second: &[f64], least_spread: f64) -> Option<Relation> {
    let count = first.len() as f64;
    let (ma, mb) = (first.iter().sum::<f64>() / count, second.iter().sum::<f64>() / count);
    let (mut cross, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (x, y) in first.iter().zip(second) {
        cross += (x - ma) * (y - mb);
        aa += (x - ma).powi(2);
        bb += (y - mb).powi(2);
    }
    if (bb / count).sqrt() < least_spread || aa <= 0.0 {
        return None;
    }
    Some(Relation { slope: cross / aa, correlation: cross / (aa * bb).sqrt() })
}
