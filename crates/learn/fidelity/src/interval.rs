//! Intervals of distances from resamples.
//!
//! A resample holds scenarios twice, which adds bias; so intervals are re-centred (basic bootstrap, Davison and Hinkley
//! 1997, section 5.2): from 2v - q97.5 to 2v - q2.5. Ratios are treated the same way on the scale of logarithms, correlations on that of Fisher's z.

use ds_stats::percentiles;

/// The share that an interval holds.
pub const CONFIDENCE: f64 = 0.95;

/// Correlations beyond this have the z of this one.
const MOST_R: f64 = 0.999_999;

/// A value with the ends of its interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// The value of all scenarios.
    pub value: f64,
    /// Lower end; may lie below zero.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Returns a value with its re-centred interval; that of no resamples is the value. Resamples that are no number do not
/// count.
#[must_use]
pub fn recentred(value: f64, mut drawn: Vec<f64>) -> Interval {
    drawn.retain(|value| !value.is_nan());
    let [low, high] = percentiles(drawn, 0.5 * (1.0 - CONFIDENCE)).unwrap_or([value; 2]);
    Interval { value, low: 2.0 * value - high, high: 2.0 * value - low }
}

/// Returns the ratio of two values with its interval; `drawn` of both come from the same draws. None unless all are
/// above zero.
#[must_use]
pub fn ratio(above: f64, below: f64, drawn: (&[f64], &[f64])) -> Option<Interval> {
    let log = |a: f64, b: f64| (a > 0.0 && b > 0.0).then(|| (a / b).ln());
    let value = log(above, below)?;
    let numbers = drawn.0.iter().zip(drawn.1).filter(|(a, b)| !a.is_nan() && !b.is_nan());
    let drawn: Option<Vec<f64>> = numbers.map(|(a, b)| log(*a, *b)).collect();
    let found = recentred(value, drawn?);
    Some(Interval { value: found.value.exp(), low: found.low.exp(), high: found.high.exp() })
}

/// Returns a correlation with its interval, which lies within −1 and 1.
#[must_use]
pub fn correlation(r: f64, drawn: &[f64]) -> Interval {
    let z = |r: f64| r.clamp(-MOST_R, MOST_R).atanh();
    let found = recentred(z(r), drawn.iter().map(|r| z(*r)).collect());
    Interval { value: r, low: found.low.tanh(), high: found.high.tanh() }
}

/// Returns the mean of several columns, draw by draw.
#[must_use]
pub fn mean_of(columns: &[&[f64]]) -> Vec<f64> {
    let draws = columns.iter().map(|column| column.len()).min().unwrap_or(0);
    (0..draws).map(|k| columns.iter().map(|column| column[k]).sum::<f64>() / columns.len() as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_turned_round_the_value() {
        let drawn: Vec<f64> = (0..=1000).map(|k| f64::from(k) / 1000.0).collect();
        let found = recentred(0.4, drawn.clone());
        assert!((found.low - (0.8 - 0.975)).abs() < 1e-9 && (found.high - (0.8 - 0.025)).abs() < 1e-9, "{found:?}");
        assert_eq!(recentred(0.4, Vec::new()), Interval { value: 0.4, low: 0.4, high: 0.4 });
        let ten: Vec<f64> = drawn.iter().map(|v| 10.0 * (v + 1.0)).collect();
        let one: Vec<f64> = drawn.iter().map(|v| v + 1.0).collect();
        let found = ratio(20.0, 2.0, (&ten, &one)).expect("above zero");
        assert!((found.low - 10.0).abs() < 1e-9 && (found.high - 10.0).abs() < 1e-9, "{found:?}");
        assert_eq!(ratio(1.0, 0.0, (&one, &one)), None);
        // Without the scale of z from −1.38 to −0.79.
        let found = correlation(-0.9, &[-1.0, -0.9, -0.5, f64::NAN, -0.42]);
        assert!(found.value == -0.9 && found.low > -1.0 && found.low < -0.97 && found.high > -0.9, "{found:?}");
        assert!(correlation(1.0, &[1.0, 0.2]).high <= 1.0);
        assert_eq!(mean_of(&[&[1.0, 2.0], &[3.0, 6.0]]), [2.0, 4.0]);
    }
}
