//! Judges the age of the content: a constant age is a delay, whose stamps tell which one; repeated frames are losses.

use ds_effect::FrameEffect;
use ds_stats::{percentiles, wilson};

use crate::align::Ages;
use crate::scene::{Scene, known};
use crate::settings;

/// What was found.
pub struct Late {
    /// Age of the content of every frame.
    pub ages: Vec<usize>,
    /// The effect with its value, if any.
    pub effect: Option<(&'static FrameEffect, f64)>,
    /// 90 % interval of the value: a constant age by the curvature of its evidence, the age that stamps tell by their
    /// scatter, a rate by counting.
    pub interval90: [f64; 2],
    /// How much the age explains, as a loss.
    pub evidence: f64,
    /// First frames whose content is older than the stream.
    pub blind: usize,
}

/// Judges.
#[must_use]
pub fn judge(scene: &Scene<'_>, ages: &Ages) -> Late {
    let n = scene.frames.len();
    let nothing = || Late { ages: vec![0; n], effect: None, interval90: [0.0; 2], evidence: 0.0, blind: 0 };
    let scale = settings::COUNTED_FRAMES / n as f64 * settings::AGE_WEIGHT;
    let told: Vec<f64> = scene.frames.iter().filter_map(|f| f.stamp_lead_secs).collect();
    let lead = told.iter().sum::<f64>() / told.len().max(1) as f64 * scene.case.rate_hz;
    // a constant age: evidence summed over all frames old enough to show it
    let constant =
        |age: usize| -> f64 { ages.gain.iter().filter_map(|row| row.get(age)).map(|g| g.clamp(-2.0, 2.0)).sum() };
    let age = (1..=crate::lag::OLDEST).max_by(|a, b| constant(*a).total_cmp(&constant(*b))).unwrap_or(1);
    let all = constant(age);
    // each frame on its own: repeats
    let singly: f64 = (0..n).filter(|k| ages.best[*k] > 0).map(|k| ages.gain[k][ages.best[k]].clamp(0.0, 2.0)).sum();
    let stale = ages.best.iter().filter(|a| **a > 0).count();
    let shifted = (0..n).map(|k| age.min(k)).collect::<Vec<_>>();
    let stamped = lead.abs() > 0.4;
    if all > 3.0 * settings::AGE_GAIN && all > 0.8 * singly {
        let id = if stamped { "obs_latency" } else { "condition_delay" };
        let beside = |age: usize| if age <= crate::lag::OLDEST { constant(age) } else { constant(age - 2) };
        let bend = scale * (2.0 * all - beside(age - 1) - beside(age + 1));
        let half = 1.645 / bend.max(1e-6).sqrt();
        return Late {
            ages: shifted,
            effect: Some((known(id), age as f64)),
            interval90: [(age as f64 - half).max(0.0), (age as f64 + half).min(crate::lag::OLDEST as f64)],
            evidence: all * scale,
            blind: age,
        };
    }
    if stamped {
        // standing still: the stamps alone tell
        let age = lead.abs().round().max(1.0);
        let ages = (0..n).map(|k| (age as usize).min(k)).collect();
        let effect = Some((known("obs_latency"), age));
        let leads = told.iter().map(|lead_secs| (lead_secs * scene.case.rate_hz).abs()).collect();
        let interval90 = percentiles(leads, 0.05).unwrap_or([age; 2]);
        return Late { ages, effect, interval90, evidence: 4.0 * settings::FIRST_GAIN, blind: age as usize };
    }
    if stale > 0 && singly > 2.0 * settings::AGE_GAIN {
        let rate = stale as f64 / (n as f64 - 1.0);
        return Late {
            ages: ages.best.clone(),
            effect: Some((known("dropped_frames"), rate)),
            interval90: wilson(stale, n - 1, 1.645),
            evidence: singly * scale,
            blind: 0,
        };
    }
    nothing()
}
