//! What healthy logs reach of each statistic by which something is called missing, and the chance of a further log to reach
//! more: by Student's distribution with spreads borrowed from one another (Smyth 2004), because few logs have no ranks to
//! go by.

use std::collections::BTreeMap;

use ds_stats::{Pooled, holm};
use serde::{Deserialize, Serialize};

/// What the statistic of evidence scatters on effect-free drives of the library's own vehicles, as a sample worth so many
/// degrees of freedom.
const USUAL_GAIN: Pooled = Pooled { freedom: 4.0, variance: 0.36 };
/// Name of the statistic of evidence, for a part of the loop.
pub const GAIN: [&str; 2] = ["gain:ego", "gain:followers"];

/// What healthy logs reach of one statistic.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Null {
    /// Its name.
    pub statistic: String,
    /// Its value on each healthy log, judged by a baseline of the others.
    pub z: Vec<f64>,
    /// By which rule chances are told from them.
    pub control: String,
}

/// Values of statistics by name.
pub type Statistics = BTreeMap<String, f64>;

/// Returns the statistic of a log evidence gain, which grows with the size of an effect.
#[must_use]
pub fn of_gain(gain: f64) -> f64 {
    (2.0 * gain.max(0.0)).sqrt()
}

/// Gathers what healthy logs reached; a statistic that some of them lack counts for those that have it.
#[must_use]
pub fn gather(logs: &[Statistics]) -> Vec<Null> {
    let mut all: BTreeMap<&String, Vec<f64>> = BTreeMap::new();
    for (name, value) in logs.iter().flatten() {
        all.entry(name).or_default().push(*value);
    }
    let of = |(name, z): (&String, Vec<f64>)| Null { statistic: name.clone(), z, control: "parametric".to_owned() };
    all.into_iter().map(of).collect()
}

/// What healthy logs reach of several statistics, with what their spreads say of one another.
#[derive(Debug)]
pub struct Ordinary<'n> {
    own: BTreeMap<&'n str, &'n [f64]>,
    pooled: Pooled,
}

impl<'n> Ordinary<'n> {
    /// Puts statistics together; those that one log alone has say nothing.
    #[must_use]
    pub fn new(nulls: &'n [Null]) -> Self {
        let own: BTreeMap<&str, &[f64]> =
            nulls.iter().filter(|n| n.z.len() > 1).map(|n| (n.statistic.as_str(), n.z.as_slice())).collect();
        let variance = |z: &&[f64]| {
            let mean = z.iter().sum::<f64>() / z.len() as f64;
            z.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (z.len() as f64 - 1.0)
        };
        let count = own.values().map(|z| z.len()).max().unwrap_or(0);
        Self { pooled: Pooled::of(&own.values().map(variance).collect::<Vec<f64>>(), count), own }
    }

    /// Returns the chance of a healthy log to reach more than a value of a statistic; 1 of one that healthy logs lack.
    #[must_use]
    pub fn chance(&self, statistic: &str, value: f64) -> f64 {
        self.own.get(statistic).map_or(1.0, |z| self.pooled.exceeds(z, value))
    }
}

/// Returns the chance of a healthy log to reach more than a value, by name of the statistic; gains of evidence apart.
#[must_use]
pub fn chances(nulls: &[Null], reached: &Statistics) -> BTreeMap<String, f64> {
    let judged: Vec<Null> = nulls.iter().filter(|n| !GAIN.contains(&n.statistic.as_str())).cloned().collect();
    let ordinary = Ordinary::new(&judged);
    let known = reached.iter().filter(|(name, _)| ordinary.own.contains_key(name.as_str()));
    known.map(|(name, value)| (name.clone(), ordinary.chance(name, *value))).collect()
}

/// Returns the chance that any statistic of a healthy log reaches what was reached: the smallest after Holm.
#[must_use]
pub fn chance(nulls: &[Null], reached: &Statistics) -> f64 {
    let all: Vec<f64> = chances(nulls, reached).into_values().collect();
    holm(&all).into_iter().fold(1.0, f64::min)
}

/// Returns the log evidence gain of the best effect that a healthy log of a part exceeds with some chance.
#[must_use]
pub fn gain_at(nulls: &[Null], part: usize, chance: f64) -> Option<f64> {
    let null = nulls.iter().find(|n| n.statistic == GAIN[part] && n.z.len() > 1)?;
    let (mut low, mut high) = (0.0, 1e3);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if USUAL_GAIN.exceeds(&null.z, middle) > chance { low = middle } else { high = middle }
    }
    Some(0.5 * high * high)
}
