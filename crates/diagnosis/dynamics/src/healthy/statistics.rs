//! The statistics by which a log is called healthy or not: what a model leaves by channel, and what the best effect gains.

use std::collections::BTreeMap;

use crate::baseline::ALARM;
use crate::baseline::nulls::{GAIN, Null, Statistics, chance, of_gain};
use crate::choice::Outcome;
use crate::remainder::{PartRemainder, left};

/// How fast the probability of something unknown rises as the chance falls below the alarm's.
const STEEPNESS: f64 = 1.0;

/// Returns the statistics of a remainder: the logarithm of loss over clean level by channel, of its worst drive and of its
/// worst window.
#[must_use]
pub(crate) fn of_remainder(lefts: &[PartRemainder]) -> Statistics {
    let mut found = Statistics::new();
    for left in lefts {
        let mut drives: BTreeMap<&str, f64> = BTreeMap::new();
        for ((channel, _), ratio) in &left.drives {
            let worst = drives.entry(channel).or_default();
            *worst = worst.max(*ratio);
        }
        found.extend(drives.iter().map(|(channel, ratio)| (format!("drive:{channel}"), ratio.max(1e-3).ln())));
        found.extend(left.windows.iter().map(|(channel, ratio)| (format!("window:{channel}"), ratio.max(1e-3).ln())));
    }
    found
}

/// Returns all statistics of a healthy log.
#[must_use]
pub(crate) fn of_healthy(outcomes: &[Outcome<'_, '_>]) -> Statistics {
    let lefts: Vec<PartRemainder> =
        outcomes.iter().map(|o| left(o.search.model, &o.search.null, &o.search.null, false)).collect();
    let mut found = of_remainder(&lefts);
    for (name, outcome) in GAIN.iter().zip(outcomes) {
        let best = outcome.search.singles.first().map_or(0.0, |h| h.gain);
        found.insert((*name).to_owned(), of_gain(best));
    }
    found
}

/// Returns the probability that something is at work that no library effect explains, from what an accepted model or the
/// ordinary mismatch leaves.
#[must_use]
pub(crate) fn unknown(nulls: &[Null], lefts: &[PartRemainder]) -> f64 {
    let trend = lefts.iter().map(PartRemainder::inconstant).fold(0.0, f64::max);
    probability(chance(nulls, &of_remainder(lefts))).max(trend)
}

/// Returns the probability that what a healthy log reaches with some chance is none of one.
#[must_use]
pub(crate) fn probability(chance: f64) -> f64 {
    1.0 / (1.0 + (chance.max(1e-12) / ALARM).powf(STEEPNESS))
}
