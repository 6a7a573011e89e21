//! Chooses pieces of a log that is longer than a diagnosis takes: as many of each kind of driving as there are, evenly over the log.
//!
//! The kind is the third in which a piece lies by typical speed, side acceleration and change of speed, among all pieces.

use std::collections::BTreeMap;

use ds_diagnosis::table::STEP_SECS;

use crate::record::Record;
use crate::resample::slope;

/// Most windows of a case and how far apart they begin, s.
const MOST_WINDOWS: f64 = 2_000.0;
const WINDOW_SECS: f64 = 1.25;

/// Most seconds of a case.
pub(crate) const MOST_SECS: f64 = MOST_WINDOWS * WINDOW_SECS;

/// Returns which pieces are kept, in their order.
pub(crate) fn chosen(pieces: &[&Record]) -> Vec<usize> {
    let total: f64 = pieces.iter().map(|piece| piece.secs()).sum();
    if total <= MOST_SECS {
        return (0..pieces.len()).collect();
    }
    let features: Vec<[f64; 3]> = pieces.iter().map(|piece| features(piece)).collect();
    let thirds: [[f64; 2]; 3] = std::array::from_fn(|which| {
        let mut column: Vec<f64> = features.iter().map(|f| f[which]).collect();
        [ds_stats::quantile(&mut column, 1.0 / 3.0), ds_stats::quantile(&mut column, 2.0 / 3.0)]
    });
    let mut strata: BTreeMap<[usize; 3], Vec<usize>> = BTreeMap::new();
    for (place, feature) in features.iter().enumerate() {
        let kind = std::array::from_fn(|which| thirds[which].iter().filter(|third| feature[which] > **third).count());
        strata.entry(kind).or_default().push(place);
    }
    let mut left = (MOST_SECS / total * pieces.len() as f64) as usize;
    let mut counts = vec![0; strata.len()];
    while left > 0 {
        for (count, _) in counts.iter_mut().zip(strata.values()).filter(|(count, all)| **count < all.len()) {
            *count += usize::from(left > 0);
            left = left.saturating_sub(1);
        }
    }
    let spread =
        |(count, all): (usize, &Vec<usize>)| (0..count).map(|k| all[(2 * k + 1) * all.len() / (2 * count)]).collect();
    let mut kept: Vec<usize> = counts.into_iter().zip(strata.values()).flat_map::<Vec<usize>, _>(spread).collect();
    kept.sort_unstable();
    kept
}

/// Typical speed, side acceleration and change of speed of a piece: their ninth deciles.
fn features(piece: &Record) -> [f64; 3] {
    let speed = piece.speed().unwrap_or_default();
    let rate = match (piece.channel("yaw_rate"), piece.channel("yaw")) {
        (Some(rate), _) => rate.to_vec(),
        (None, Some(yaw)) => slope(yaw, STEP_SECS),
        (None, None) => piece.channel("cmd_steer").unwrap_or_default().to_vec(),
    };
    let typical = |values: Vec<f64>| {
        let mut sizes: Vec<f64> = values.into_iter().map(f64::abs).collect();
        if sizes.is_empty() { 0.0 } else { ds_stats::quantile(&mut sizes, 0.9) }
    };
    let sideways = speed.iter().zip(&rate).map(|(v, r)| v * r).collect();
    [typical(speed.clone()), typical(sideways), typical(slope(&speed, STEP_SECS))]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn piece(speed: f64) -> Record {
        let channels = BTreeMap::from([("v", vec![speed; 1201]), ("yaw_rate", vec![0.1; 1201])]);
        Record { file: String::new(), start_secs: 0.0, channels, derived: Vec::new() }
    }

    #[test]
    fn a_short_log_is_kept_and_a_long_one_keeps_what_is_rare() {
        let short: Vec<Record> = (0..40).map(|k| piece(f64::from(k))).collect();
        assert_eq!(chosen(&short.iter().collect::<Vec<_>>()).len(), 40);
        // two thirds at one speed, the rest at two others
        let speed = |k: usize| if k < 120 { 20.0 } else { [5.0, 30.0][k % 2] };
        let long: Vec<Record> = (0..180).map(|k| piece(speed(k))).collect();
        let kept = chosen(&long.iter().collect::<Vec<_>>());
        assert_eq!(kept.len(), 41, "2500 s of minutes");
        let rare = kept.iter().filter(|k| **k >= 120).count();
        assert!(rare > 15, "{rare} of {} are of the rare speeds", kept.len());
        assert!(kept.windows(2).all(|pair| pair[0] < pair[1]));
    }
}
