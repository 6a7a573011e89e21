//! Is there something left that no effect of the library explains, and what does it look like?
//!
//! Compares the residuals of the best model with what effect-free worlds leave: per channel and drive the mean loss,
//! per channel the worst window (bursts), the share of the excess that the best model explains, and whether an accepted
//! effect is of one size in every regime.

use std::collections::BTreeMap;

use ds_effect::Channel;

use crate::case::{Case, PartModel};
use crate::constancy::Trend;
use crate::fit::{Fit, point_loss};
use crate::settings::{
    ACCEPTED_SLACK, CLEAN_DRIVE_LOSS, CLEAN_GAP_LOSS, CLEAN_WINDOW_LOSS, EXPLAINED_SHARE, TREND_GAIN, TREND_WIDTH,
    UNKNOWN_WIDTH,
};
use ds_diagnosis::schema::Remainder;
use ds_diagnosis::table::STEP_SECS;
use ds_stats::{pearson, quantile};

/// The remainder of one part.
#[derive(Debug, Clone, Default)]
pub struct PartRemainder {
    /// Largest ratio of a statistic to its clean level.
    pub ratio: f64,
    /// Ratio by channel.
    pub channels: BTreeMap<&'static str, f64>,
    /// Ratio by channel and drive.
    pub drives: BTreeMap<(&'static str, usize), f64>,
    /// Ratio by channel of its worst window.
    pub windows: BTreeMap<&'static str, f64>,
    /// Whether the largest ratio is that of a single window.
    pub burst: bool,
    /// How an accepted effect changes over a regime in which the library has it constant.
    pub trend: Option<Trend>,
    /// Loss before and after the best model and what an effect-free world would leave.
    pub losses: (f64, f64, f64),
}

/// Returns the clean level of a channel's mean loss over one drive.
fn clean(channel: Channel) -> f64 {
    if channel == Channel::FollowerGap { CLEAN_GAP_LOSS } else { CLEAN_DRIVE_LOSS }
}

/// Compares what a fit leaves with what effect-free worlds leave; `before` are the residuals of the nuisance fit.
#[must_use]
pub fn left(model: &PartModel<'_>, fit: &Fit, null: &Fit, accepted: bool) -> PartRemainder {
    let sliding = model.sliding(&fit.vector);
    let mut drives: BTreeMap<(Channel, usize), (f64, f64)> = BTreeMap::new();
    let mut windows: BTreeMap<(Channel, usize), (f64, f64)> = BTreeMap::new();
    let mut found = PartRemainder::default();
    for ((tag, z), z0) in model.tags.iter().zip(&fit.residuals).zip(&null.residuals) {
        // past the limit of the tyres small errors grow without bound
        if *z == 0.0 || sliding.get(tag.window) == Some(&true) {
            continue;
        }
        let loss = point_loss(*z);
        for sums in [drives.entry((tag.channel, tag.drive)), windows.entry((tag.channel, tag.window))] {
            let sums = sums.or_default();
            sums.0 += loss;
            sums.1 += 1.0;
        }
        found.losses.0 += point_loss(*z0);
        found.losses.1 += loss;
        found.losses.2 += 0.4;
    }
    let slack = if accepted { ACCEPTED_SLACK } else { 1.0 };
    for ((channel, drive), (sum, count)) in drives {
        let ratio = sum / count / clean(channel) / slack;
        found.drives.insert((channel.name(), drive), ratio);
        let entry = found.channels.entry(channel.name()).or_default();
        *entry = entry.max(ratio);
        found.ratio = found.ratio.max(ratio);
    }
    for ((channel, _), (sum, count)) in windows {
        let ratio = sum / count / CLEAN_WINDOW_LOSS / slack;
        let worst = found.windows.entry(channel.name()).or_default();
        *worst = worst.max(ratio);
        let entry = found.channels.entry(channel.name()).or_default();
        *entry = entry.max(ratio);
        if ratio > found.ratio {
            found.ratio = ratio;
            found.burst = true;
        }
    }
    found
}

impl PartRemainder {
    /// Returns the probability that something outside the library is at work.
    #[must_use]
    pub fn probability(&self) -> f64 {
        let mut score = self.ratio.max(1e-6).ln() / UNKNOWN_WIDTH;
        let (before, after, clean) = self.losses;
        let excess = before - clean;
        // a real excess of which the best model explains less than half speaks for the unknown too
        if excess > 0.3 * clean {
            let explained = ((before - after) / excess).clamp(0.0, 1.0);
            score = score.max((EXPLAINED_SHARE - explained) * 12.0);
        }
        (1.0 / (1.0 + (-score).exp())).max(self.inconstant())
    }

    /// Returns the probability that an accepted effect is not of one size in every regime.
    #[must_use]
    pub fn inconstant(&self) -> f64 {
        self.trend.map_or(0.0, |trend| 1.0 / (1.0 + (-(trend.gain - TREND_GAIN) / TREND_WIDTH).exp()))
    }
}

/// Describes a remainder in words and figures.
#[must_use]
pub fn describe(
    case: &Case,
    lefts: &[PartRemainder],
    models: &[(&PartModel<'_>, &Fit)],
    nearest: Vec<String>,
) -> Remainder {
    let mut out = Remainder { nearest, ..Remainder::default() };
    let mut worst = (0.0, "", 0);
    for left in lefts {
        for (channel, ratio) in &left.channels {
            if *ratio > 1.0 {
                out.channels.insert((*channel).to_owned(), *ratio);
            }
        }
        for ((channel, drive), ratio) in &left.drives {
            if *ratio > 1.0 && !out.drives.contains(drive) {
                out.drives.push(*drive);
            }
            if *ratio > worst.0 {
                worst = (*ratio, *channel, *drive);
            }
        }
    }
    out.drives.sort_unstable();
    let series = window_series(models, worst.1, worst.2);
    let sizes: Vec<f64> = series.iter().map(|(_, z)| z.abs()).collect();
    let (mut a, mut b) = (sizes.clone(), sizes.clone());
    let (median, top) = (quantile(&mut a, 0.5), quantile(&mut b, 0.98));
    let bursts = lefts.iter().any(|l| l.burst) || top > 6.0 * median.max(0.3);
    out.frequency_hz = line(&series);
    out.time_pattern = match (bursts, out.frequency_hz) {
        (_, Some(_)) => "periodic",
        (true, None) => "burst",
        (false, None) => "constant",
    }
    .to_owned();
    out.goes_with = companion(case, &series, worst.2);
    let with = out.goes_with.as_ref().map(|(name, r)| format!(", goes with {name} (r = {r:.2})")).unwrap_or_default();
    let trend = |t: &Trend| {
        let percent = 100.0 * t.change;
        format!("; {} changes by {percent:+.0} % of its size with {}, which no library effect does", t.effect, t.regime)
    };
    let trends: String = lefts.iter().filter_map(|l| l.trend.as_ref()).map(trend).collect();
    let level = if out.channels.is_empty() {
        "what is left is no more than the library's cars leave, but more than the healthy drives do".to_owned()
    } else {
        format!("{} of drive {} is still {:.1} times the clean level", worst.1, worst.2, worst.0)
    };
    out.text = format!("after the best library effects {level}; {} in time{with}{trends}", out.time_pattern);
    out
}

/// Returns (time, residual) of a channel over one drive, block by block, without the overlap of windows.
fn window_series(models: &[(&PartModel<'_>, &Fit)], channel: &str, drive: usize) -> Vec<(f64, f64)> {
    let mut series: Vec<(f64, f64)> = Vec::new();
    for (model, fit) in models {
        for (tag, z) in model.tags.iter().zip(&fit.residuals) {
            if tag.channel.name() == channel && tag.drive == drive && tag.block < 5 {
                let step = if tag.channel.of_follower() { 0.5 } else { 0.25 };
                series.push((tag.secs + (tag.block as f64 + 0.5) * step, *z));
            }
        }
    }
    series.sort_by(|a, b| a.0.total_cmp(&b.0));
    series
}

/// Returns the frequency of a line that holds more than a third of the power of a series, by a plain periodogram.
fn line(series: &[(f64, f64)]) -> Option<f64> {
    if series.len() < 40 {
        return None;
    }
    let mean = series.iter().map(|s| s.1).sum::<f64>() / series.len() as f64;
    let total: f64 = series.iter().map(|s| (s.1 - mean).powi(2)).sum();
    let mut best = (0.0, 0.0);
    for k in 0..180 {
        let f = 0.1 + 0.01 * f64::from(k);
        let (mut re, mut im) = (0.0, 0.0);
        for (t, z) in series {
            let (sin, cos) = (std::f64::consts::TAU * f * t).sin_cos();
            re += (z - mean) * cos;
            im += (z - mean) * sin;
        }
        let power = 2.0 * (re * re + im * im) / series.len() as f64;
        if power > best.0 {
            best = (power, f);
        }
    }
    (best.0 > 0.34 * total).then_some(best.1)
}

/// The size of a recorded quantity at a sample.
type Quantity<'a> = Box<dyn Fn(usize) -> f64 + 'a>;

/// Returns the quantity whose size goes best with the size of the residual, if the correlation exceeds 0.3.
fn companion(case: &Case, series: &[(f64, f64)], drive: usize) -> Option<(String, f64)> {
    let log = case.drives.get(drive)?;
    let mut best: Option<(String, f64)> = None;
    let speed = log.speed()?;
    let rate = |c: &[f64], k: usize| (c[(k + 3).min(c.len() - 1)] - c[k.saturating_sub(3)]).abs();
    let quantities: [(&str, Quantity<'_>); 5] = [
        ("speed", Box::new(|k| speed[k])),
        ("steering angle", Box::new(|k| log.cmd_steer[k].abs())),
        ("steering rate", Box::new(|k| rate(&log.cmd_steer, k))),
        ("acceleration request", Box::new(|k| log.cmd_accel[k].abs())),
        ("change of acceleration request", Box::new(|k| rate(&log.cmd_accel, k))),
    ];
    let left: Vec<f64> = series.iter().map(|(_, z)| z.abs().min(20.0)).collect();
    for (name, quantity) in &quantities {
        let sizes = series.iter().map(|(t, _)| {
            let k = ((t - log.start_secs) / STEP_SECS).max(0.0) as usize;
            quantity(k.min(log.samples - 1))
        });
        let r = pearson(&sizes.collect::<Vec<f64>>(), &left).unwrap_or(0.0);
        if r.abs() > best.as_ref().map_or(0.3, |b| b.1.abs()) {
            best = Some(((*name).to_owned(), r));
        }
    }
    best
}
