//! What a baseline read from a file must be like to be used.

use ds_effect::Channel;

use super::nulls::Null;
use super::windows::Sensors;
use super::{Baseline, Usual};
use crate::following;
use crate::windows::{BLOCKS, EGO};

/// Largest statistic of any log: logarithms and roots of evidence.
const LARGEST: f64 = 1e6;

/// Says what is wrong with a baseline, if anything is.
pub(super) fn unsound(found: &Baseline) -> Option<String> {
    noise(found).or_else(|| spread(found)).or_else(|| statistics(found)).or_else(|| rest(found))
}

fn noise(found: &Baseline) -> Option<String> {
    found.noise.iter().find_map(|(name, table)| {
        let Some(channel) = Channel::ALL.into_iter().find(|channel| channel.name() == name) else {
            return Some(format!("noise of {name:?} is of no channel"));
        };
        if !table.iter().all(|factor| *factor > 0.0 && factor.is_finite()) {
            return Some(format!("noise of {name:?} is not positive"));
        }
        let blocks = if channel.index() < EGO { BLOCKS } else { following::BLOCKS };
        (table.len() != blocks).then(|| format!("noise of {name:?} has {} blocks, not {blocks}", table.len()))
    })
}

fn spread(found: &Baseline) -> Option<String> {
    let sound = |usual: &Usual| usual.mean.is_finite() && usual.sd > 0.0 && usual.sd.is_finite();
    let wrong = found.spread.iter().find_map(|(id, all)| {
        let Some(effect) = ds_effect::find(id) else { return Some(format!("spread of {id:?} is of no effect")) };
        if !all.iter().flatten().all(sound) {
            return Some(format!("spread of {id:?} is none"));
        }
        let (own, asked) = (all.len(), effect.parameters.len());
        (own != asked).then(|| format!("spread of {id:?} has {own} parameters, not {asked}"))
    });
    let sampling = [found.sampling.jitter_secs, found.sampling.repeated_share];
    let possible = |usual: &Usual| usual.mean >= 0.0 && usual.sd >= 0.0 && usual.mean + usual.sd < LARGEST;
    wrong.or_else(|| (!sampling.iter().all(possible)).then(|| "sampling is none of a log".to_owned()))
}

fn statistics(found: &Baseline) -> Option<String> {
    let wrong = |null: &&Null| !null.z.iter().all(|z| z.abs() < LARGEST);
    let null = found.nulls.iter().chain(&found.cells).find(wrong)?;
    Some(format!("the null of {:?} holds what no log reaches", null.statistic))
}

fn rest(found: &Baseline) -> Option<String> {
    if !found.discrepancy.is_sound() {
        return Some("discrepancy has another number of coefficients than features".to_owned());
    }
    if !found.correlation.is_sound() {
        return Some("correlation is none of the rows that it names".to_owned());
    }
    let range = |[low, high]: &[f64; 2]| low.is_finite() && low <= high;
    if let Some((name, _)) = found.domain.iter().find(|(_, ends)| !range(ends)) {
        return Some(format!("domain of {name:?} is no range"));
    }
    let Sensors { noise, jitter_secs } = &found.windows.as_ref()?.sensors;
    let possible = noise.iter().all(|factor| *factor > 0.0 && factor.is_finite()) && (0.0..1.0).contains(jitter_secs);
    (!possible).then(|| "windows.sensors has noise that is not positive".to_owned())
}
