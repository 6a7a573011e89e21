//! Lines in the spectrum of what a fit leaves: frequencies at which a law may oscillate, in phase over all drives from their
//! starts. Channel by channel the power of a sine and a cosine over the variance (Lomb 1976), summed.

use std::collections::BTreeMap;

use ds_dynamics::case::PartModel;
use ds_effect::Channel;

/// Frequencies looked at, Hz.
const SLOWEST_HZ: f64 = 0.1;
const FASTEST_HZ: f64 = 1.9;
const STEP_HZ: f64 = 0.005;
/// Blocks of a window are a quarter of a second, those of followers half of one, long.
const BLOCK_SECS: [f64; 2] = [0.25, 0.5];
/// Lines returned, their least power over the mean of all, and the least distance between two, Hz.
const LINES: usize = 2;
const TELLING: f64 = 4.0;
const APART_HZ: f64 = 0.05;

/// Returns the strongest lines, strongest first.
pub(crate) fn lines_hz(model: &PartModel<'_>, residuals: &[f64]) -> Vec<f64> {
    let mut series: BTreeMap<Channel, Vec<(f64, f64)>> = BTreeMap::new();
    for (tag, z) in model.tags.iter().zip(residuals) {
        // displacements pile up over a window, rates do not
        if *z == 0.0 || matches!(tag.channel, Channel::Dx | Channel::Dy | Channel::Dyaw) {
            continue;
        }
        let block = BLOCK_SECS[usize::from(tag.channel.of_follower())];
        let secs = tag.secs + (tag.block as f64 + 0.5) * block - model.start_secs(tag.drive);
        series.entry(tag.channel).or_default().push((secs, z.clamp(-20.0, 20.0)));
    }
    let count = ((FASTEST_HZ - SLOWEST_HZ) / STEP_HZ) as usize;
    let mut powers: Vec<(f64, f64)> = (0..=count)
        .map(|k| SLOWEST_HZ + STEP_HZ * k as f64)
        .map(|hz| (hz, series.values().map(|points| power(points, hz)).sum()))
        .collect();
    let mean = powers.iter().map(|p| p.1).sum::<f64>() / powers.len() as f64;
    powers.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut found: Vec<f64> = Vec::new();
    for (hz, power) in powers {
        if found.len() < LINES && power > TELLING * mean && found.iter().all(|other| (other - hz).abs() > APART_HZ) {
            found.push(refined(hz, &|hz| series.values().map(|points| self::power(points, hz)).sum()));
        }
    }
    found
}

/// Returns the strongest frequency within a step of one, to a thousandth of 1 Hz.
fn refined(hz: f64, power: &dyn Fn(f64) -> f64) -> f64 {
    let near = (-5..=5).map(|k| ((hz * 1000.0).round() + f64::from(k)) / 1000.0);
    near.max_by(|a, b| power(*a).total_cmp(&power(*b))).unwrap_or(hz)
}

/// Returns the share of a series' variance that a sine of a frequency takes, times its length.
fn power(points: &[(f64, f64)], hz: f64) -> f64 {
    let mean = points.iter().map(|p| p.1).sum::<f64>() / points.len() as f64;
    let (mut sine, mut cosine, mut variance) = (0.0, 0.0, 1e-9);
    for (secs, z) in points {
        let (s, c) = (std::f64::consts::TAU * hz * secs).sin_cos();
        sine += s * (z - mean);
        cosine += c * (z - mean);
        variance += (z - mean).powi(2);
    }
    2.0 * (sine * sine + cosine * cosine) / variance
}
