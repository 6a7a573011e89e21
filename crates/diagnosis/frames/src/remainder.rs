//! What remains after the best model, and whether the library can be blamed for it.
//!
//! Two tests: the loss that remains against that of effect-free cases and against what was explained; and the residual of
//! flat places, which white noise of a known size and no structure must leave. The larger ratio decides.

use std::collections::BTreeMap;

use ds_diagnosis::schema::Remainder;

use crate::grain::Texture;
use crate::search::Search;
use crate::settings;

const BANDS: [&str; 4] = ["fine", "medium", "coarse", "colour"];

/// Effects that act by depth, which is known roughly.
const ROUGH: [&str; 2] = ["mount_position", "rolling_shutter"];

/// Returns how far the remainder is beyond what a library model leaves, 1 at the threshold.
#[must_use]
pub fn excess(found: &Search, texture: &Texture, fringe_px: f64) -> f64 {
    left_over(found).max(grainy(found, texture)).max(fringe_px / settings::STRANGE_FRINGE_PX)
}

/// Loss that remains, in units of what may remain.
fn left_over(found: &Search) -> f64 {
    let mut worst = 0.0f64;
    let (mut before, mut after) = (0.0, 0.0);
    for band in 0..BANDS.len() {
        let clean = settings::CLEAN[band];
        let (b, a) = (found.null_loss.band(band).max(clean), found.loss.band(band).max(clean));
        before += b - clean;
        after += a - clean;
        if found.chosen.is_empty() {
            worst = worst.max(a / clean / settings::CLEAN_RATIO);
        }
    }
    if !found.chosen.is_empty() {
        let before = before.max(found.rounds.first().map_or(0.0, |r| r.before - r.trials[0].loss));
        // what remains may be a share of what there was, or the level of clean cases once more
        let rough = |id: &str| crate::search::fate(id).is_some() || ROUGH.contains(&id);
        let objects = found.chosen.iter().any(|id| rough(id));
        let share = if objects { settings::ROUGH_SHARE } else { settings::EXPLAINED_SHARE };
        let allowed = ((1.0 - share) * before).max(0.5 * settings::CLEAN.iter().sum::<f64>());
        worst = after / allowed;
    }
    worst
}

/// Structure in flat places that no chosen effect accounts for.
fn grainy(found: &Search, texture: &Texture) -> f64 {
    let noisy = ["sensor_noise", "rain_streaks"].iter().any(|id| found.model.values(id).is_some());
    let strange = texture.middle / settings::STRANGE_NOISE;
    if noisy { 0.0 } else { strange.max((texture.read + texture.shot) / settings::STRANGE_WHITE) }
}

/// Describes the remainder.
#[must_use]
pub fn describe(found: &Search, texture: &Texture) -> Remainder {
    let mut channels = BTreeMap::new();
    for (band, name) in BANDS.iter().enumerate() {
        let ratio = found.loss.band(band) / settings::CLEAN[band];
        if ratio > 1.2 {
            channels.insert(format!("camera:{name}"), ratio);
        }
    }
    let per_frame: Vec<f64> =
        found.loss.cells[2].iter().map(|cells| cells.iter().map(|c| c.excess().max(0.0)).sum()).collect();
    let mean = per_frame.iter().sum::<f64>() / per_frame.len().max(1) as f64;
    let most = per_frame.iter().copied().fold(0.0, f64::max);
    let time_pattern = if most > 3.0 * mean + 5.0 { "burst" } else { "constant" };
    let nearest: Vec<String> =
        found.rounds.first().map(|r| r.trials.iter().take(3).map(|t| t.id.to_owned()).collect()).unwrap_or_default();
    let direction = if texture.across > texture.down + 0.1 {
        "running across"
    } else if texture.down > texture.across + 0.1 {
        "running down"
    } else {
        "without direction"
    };
    let strongest = channels.iter().max_by(|a, b| a.1.total_cmp(b.1)).map_or("camera:fine", |(name, _)| name.as_str());
    let text = format!(
        "the residual is strongest in {strongest}, {time_pattern} in time; flat places keep {:.1} levels² of variance, {direction}; \
         nearest known effects: {}",
        texture.middle,
        nearest.join(", "),
    );
    Remainder { channels, time_pattern: time_pattern.to_owned(), nearest, text, ..Remainder::default() }
}
