//! How far the motion of adversaries is from that of logged vehicles, beside how far logged vehicles are from each other.

use ds_space::Draws;
use ds_stats::{jensen_shannon, quantile, sorted_quantile};

use super::motion::{Motion, QUANTITIES, Quantity};

/// Random parts of the logged vehicles that make the floor.
const PARTS: u64 = 200;
/// The floor is this quantile of the divergences of those parts from the rest.
const FLOOR: f64 = 0.95;
/// Beyond this share of the logged values at either end nothing is ordinary.
const RARE: f64 = 0.001;
/// Quantiles at which two distributions are compared in units.
const LEVELS: u32 = 200;

/// A quantity of motion, compared in both phases.
#[derive(Debug, Clone, PartialEq)]
pub struct Resemblance {
    /// Name with unit.
    pub quantity: &'static str,
    /// Until one second before the attack.
    pub before: Option<Apart>,
    /// From then to the contact.
    pub attack: Option<Apart>,
}

/// How far adversaries are from logged vehicles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Apart {
    /// Values of adversaries.
    pub values: usize,
    /// Jensen–Shannon divergence, in nats.
    pub divergence_nats: f64,
    /// 95th percentile of the divergences of random parts of the logged vehicles, as large as the adversaries' (half of all at
    /// most), from the rest.
    pub floor_nats: f64,
    /// Mean distance of the quantiles (Wasserstein), in the quantity's unit.
    pub shift: f64,
    /// Share of values beyond the logged 0.1 and 99.9 %.
    pub outside: f64,
}

/// Compares adversaries before and in the attack with logged vehicles.
pub(super) fn all(logged: &[Motion], [before, attack]: [&[Motion]; 2], draws: &Draws) -> Vec<Resemblance> {
    let compared = |(index, quantity): (usize, &Quantity)| Resemblance {
        quantity: quantity.name,
        before: apart(logged, before, index, quantity, draws),
        attack: apart(logged, attack, index, quantity, draws),
    };
    QUANTITIES.iter().enumerate().map(compared).collect()
}

fn apart(logged: &[Motion], found: &[Motion], index: usize, quantity: &Quantity, draws: &Draws) -> Option<Apart> {
    let of = |motions: &[Motion]| -> Vec<f64> {
        let mut values: Vec<f64> = motions.iter().flat_map(|motion| motion.values[index].iter().copied()).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let (usual, theirs) = (of(logged), of(found));
    let [low, high] = [sorted_quantile(&usual, RARE)?, sorted_quantile(&usual, 1.0 - RARE)?];
    let outside = theirs.iter().filter(|value| !(low..=high).contains(value)).count();
    let level = |k: u32| (f64::from(k) + 0.5) / f64::from(LEVELS);
    let gap = |k: u32| Some((sorted_quantile(&theirs, level(k))? - sorted_quantile(&usual, level(k))?).abs());
    let gaps: Option<Vec<f64>> = (0..LEVELS).map(gap).collect();
    Some(Apart {
        values: theirs.len(),
        divergence_nats: jensen_shannon(&quantity.histogram(theirs.iter()), &quantity.histogram(usual.iter()))?,
        floor_nats: floor(logged, theirs.len(), index, quantity, draws),
        shift: ds_stats::mean(gaps?)?,
        outside: outside as f64 / theirs.len() as f64,
    })
}

/// Returns how far a random part of the logged vehicles, of so many values, is from the rest.
fn floor(logged: &[Motion], values: usize, index: usize, quantity: &Quantity, draws: &Draws) -> f64 {
    let all: usize = logged.iter().map(|motion| motion.values[index].len()).sum();
    let wanted = values.min(all / 2);
    let part = |part: u64| {
        let mut order: Vec<(u64, usize)> =
            (0..logged.len()).map(|k| (draws.below(part * logged.len() as u64 + k as u64, u64::MAX), k)).collect();
        order.sort_unstable();
        let mut taken = 0;
        let mut sides = [Vec::new(), Vec::new()];
        for (_, k) in order {
            let values = &logged[k].values[index];
            sides[usize::from(taken >= wanted)].extend(values.iter().copied());
            taken += values.len();
        }
        let [a, b] = sides.map(|side| quantity.histogram(side.iter()));
        jensen_shannon(&a, &b)
    };
    quantile(&mut (0..PARTS).filter_map(part).collect::<Vec<f64>>(), FLOOR)
}
