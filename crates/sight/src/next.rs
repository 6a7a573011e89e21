//! What to record next to tell the two best hypotheses apart; ranked by the loss that separates them now.

use ds_gap::report::Manoeuvre;

use crate::search::Search;

/// Recordings and the effects that each of them brings out.
const RECORDINGS: [(&str, &[&str], f64); 7] = [
    (
        "checkerboard filling the picture",
        &["mount_roll", "focal_error", "radial_distortion", "mount_pitch", "mount_yaw", "defocus"],
        5.0,
    ),
    (
        "straight road at two distances",
        &["mount_pitch", "mount_yaw", "mount_position", "fog_haze", "night_illumination"],
        20.0,
    ),
    ("grey card under even light", &["vignetting", "lens_dirt", "gamma", "white_balance", "sensor_noise"], 5.0),
    ("tunnel entry and exit", &["exposure_lag", "temporal_flicker", "gamma"], 20.0),
    (
        "slalom at constant speed",
        &["rolling_shutter", "motion_blur", "condition_delay", "obs_latency", "dropped_frames"],
        20.0,
    ),
    (
        "standing still before fine texture",
        &["motion_blur", "defocus", "texture_washing", "jpeg_loss", "rain_streaks", "temporal_flicker"],
        10.0,
    ),
    ("long rollout without re-anchoring", &["rollout_drift", "texture_washing", "object_dropout", "gamma"], 30.0),
];

/// Returns recordings for the two best hypotheses of the last decided round.
#[must_use]
pub fn manoeuvres(found: &Search) -> Vec<Manoeuvre> {
    let Some(round) = found.rounds.get(found.chosen.len().saturating_sub(1)) else { return Vec::new() };
    let [Some(first), second] = [round.trials.first(), round.trials.get(1)] else { return Vec::new() };
    let second_id = second.map_or("none", |t| t.id);
    let apart = second.map_or(round.gain(first), |s| round.gain(first) - round.gain(s)).abs().max(1.0);
    RECORDINGS
        .iter()
        .filter(|(_, shows, _)| shows.contains(&first.id) || shows.contains(&second_id))
        .take(2)
        .map(|(name, _, secs)| Manoeuvre {
            name: (*name).to_owned(),
            separates: [first.id.to_owned(), second_id.to_owned()],
            expected_log_bayes_factor: apart,
            secs_needed: secs * (5.0 / apart).min(1.0),
        })
        .collect()
}
