//! What a baseline read from a file must be like to be used: every part of it is there, of the size that goes with the others,
//! and nothing that no healthy logs can leave. What files of earlier versions lack may be absent.

use ds_diagnosis::table::STEP_SECS;
use ds_effect::Channel;

use super::features::{LARGEST as FARTHEST, NAMES};
use super::nulls::{GAIN, Null};
use super::{Baseline, Usual};
use crate::drive::MEASURED;
use crate::following;
use crate::windows::{BLOCKS, EGO};

/// Largest statistic of any log: logarithms and roots of evidence.
const LARGEST: f64 = 1e6;

/// Says what is missing in a baseline or wrong with it, if anything is.
pub(super) fn unsound(found: &Baseline) -> Option<String> {
    let parts = [origin, noise, spread, sampling, nulls, cells, told, residuals, domain, windows];
    parts.into_iter().find_map(|part| part(found))
}

fn origin(found: &Baseline) -> Option<String> {
    let empty = [
        ("nominal_hash", found.nominal_hash.is_empty()),
        ("channels", found.channels.is_empty()),
        ("units.drive", found.units.drive.is_empty()),
    ];
    if let Some((name, _)) = empty.into_iter().find(|(_, empty)| *empty) {
        return Some(format!("{name} is empty"));
    }
    let rate = 1.0 / STEP_SECS;
    if (found.rate_hz - rate).abs() > 1e-6 {
        return Some(format!("rate_hz is {:?}, this version's is {rate:?}", found.rate_hz));
    }
    let sizes = [("wheelbase_m", found.wheelbase_m.map(|w| [w; 2])), ("mass_kg", found.mass_kg)];
    let possible = |[low, high]: [f64; 2]| low > 0.0 && low <= high && high < LARGEST;
    let wrong = sizes.into_iter().find(|(_, ends)| ends.is_some_and(|ends| !possible(ends)));
    wrong.map(|(name, _)| format!("{name} is none of a vehicle"))
}

fn noise(found: &Baseline) -> Option<String> {
    let wrong = found.noise.iter().find_map(|(name, table)| {
        let Some(channel) = Channel::ALL.into_iter().find(|channel| channel.name() == name) else {
            return Some(format!("noise of {name:?} is of no channel"));
        };
        if !table.iter().all(|factor| *factor > 0.0 && *factor < LARGEST) {
            return Some(format!("noise of {name:?} is not positive"));
        }
        let blocks = if channel.index() < EGO { BLOCKS } else { following::BLOCKS };
        (table.len() != blocks).then(|| format!("noise of {name:?} has {} blocks, not {blocks}", table.len()))
    });
    let recorded = |name: &&str| found.channels.iter().any(|own| own == name);
    let seen = |channel: usize| match channel {
        0 | 1 => MEASURED[..3].iter().all(recorded),
        _ => recorded(&MEASURED[channel]),
    };
    let names = (0..EGO).filter(|channel| seen(*channel)).map(|channel| Channel::ALL[channel].name());
    wrong.or_else(|| missing("noise", names, |name| found.noise.contains_key(name)))
}

/// Names the first key that a part lacks.
fn missing<'n>(part: &str, mut names: impl Iterator<Item = &'n str>, has: impl Fn(&str) -> bool) -> Option<String> {
    names.find(|name| !has(name)).map(|name| format!("{part} of {name:?} is missing"))
}

fn spread(found: &Baseline) -> Option<String> {
    if found.spread.is_empty() {
        return Some("spread is empty".to_owned());
    }
    let sound = |usual: &Usual| usual.mean.abs() < LARGEST && usual.sd > 0.0 && usual.sd < LARGEST;
    found.spread.iter().find_map(|(id, all)| {
        let Some(effect) = ds_effect::find(id) else { return Some(format!("spread of {id:?} is of no effect")) };
        if !all.iter().flatten().all(sound) {
            return Some(format!("spread of {id:?} is none"));
        }
        let (own, asked) = (all.len(), effect.parameters.len());
        (own != asked).then(|| format!("spread of {id:?} has {own} parameters, not {asked}"))
    })
}

fn sampling(found: &Baseline) -> Option<String> {
    let sampling = [found.sampling.jitter_secs, found.sampling.repeated_share];
    let possible = |usual: &Usual| usual.mean >= 0.0 && usual.sd >= 0.0 && usual.mean + usual.sd < LARGEST;
    (!sampling.iter().all(possible)).then(|| "sampling is none of a log".to_owned())
}

/// What several healthy logs reach of each statistic: the best effect's evidence is among them and known of every log.
fn nulls(found: &Baseline) -> Option<String> {
    let logs = found.units.drive.len();
    if logs < 2 {
        return reached(found, &found.nulls, "null");
    }
    if found.nulls.is_empty() {
        return Some(format!("nulls are missing: {logs} healthy logs leave some"));
    }
    let of_all = |name: &str| found.nulls.iter().any(|null| null.statistic == name && null.z.len() == logs);
    reached(found, &found.nulls, "null").or_else(|| missing("the null of all logs", GAIN.into_iter(), of_all))
}

fn cells(found: &Baseline) -> Option<String> {
    reached(found, &found.cells, "cells")
}

fn reached(found: &Baseline, nulls: &[Null], part: &str) -> Option<String> {
    let logs = found.units.drive.len();
    nulls.iter().find_map(|Null { statistic, z, .. }| {
        if !z.iter().all(|z| z.abs() < LARGEST) {
            return Some(format!("the {part} of {statistic:?} holds what no log reaches"));
        }
        let count = z.len();
        (count == 0 || count > logs).then(|| format!("the {part} of {statistic:?} is of {count} logs, not 1 to {logs}"))
    })
}

/// What a reader is told of the baseline.
fn told(found: &Baseline) -> Option<String> {
    let limits = &found.detection_limits;
    let evidence = |name: &str| limits.get(name).is_some_and(|gain| *gain > 0.0 && *gain < LARGEST);
    let lacking = missing("detection_limits", GAIN.into_iter(), evidence);
    let wrong = || found.influence.iter().find(|influence| !(0.0..=1.0).contains(&influence.chance));
    lacking.or_else(|| wrong().map(|influence| format!("influence of {:?} is no chance", influence.unit)))
}

fn residuals(found: &Baseline) -> Option<String> {
    let correlation =
        (!found.correlation.is_sound()).then(|| "correlation is none of the rows that it names".to_owned());
    found.discrepancy.unsound().map(|why| format!("discrepancy.{why}")).or(correlation)
}

fn domain(found: &Baseline) -> Option<String> {
    let range = |[low, high]: &[f64; 2]| -FARTHEST <= *low && low <= high && *high <= FARTHEST;
    let wrong = found.domain.iter().find_map(|(name, ends)| {
        if !NAMES.contains(&name.as_str()) {
            return Some(format!("domain of {name:?} is of no quantity"));
        }
        (!range(ends)).then(|| format!("domain of {name:?} is no range"))
    });
    wrong.or_else(|| missing("domain", NAMES.into_iter(), |name| found.domain.contains_key(name)))
}

fn windows(found: &Baseline) -> Option<String> {
    let windows = found.windows.as_ref()?;
    let (sensors, logs) = (&windows.sensors, found.units.drive.len());
    let possible = |factor: &f64| *factor > 0.0 && *factor < LARGEST;
    if !sensors.noise.iter().all(possible) || !(0.0..1.0).contains(&sensors.jitter_secs) {
        return Some("windows.sensors has noise that is not positive".to_owned());
    }
    let sizes = [
        ("windows.sensors.noise", "channels", sensors.noise.len(), EGO + 2),
        ("windows.logs", "logs", windows.logs.len(), logs),
    ];
    if let Some((name, what, own, asked)) = sizes.into_iter().find(|(_, _, own, asked)| own != asked) {
        return Some(format!("{name} has {own} {what}, not {asked}"));
    }
    let finite = |of: &Option<[f64; 2]>| of.is_none_or(|both| both.iter().all(|value| value.abs() < LARGEST));
    let sound = windows.logs.iter().flatten().all(|w| w.channels.len() == EGO && w.channels.iter().all(finite));
    (!sound).then(|| "windows.logs holds what no window leaves".to_owned())
}
