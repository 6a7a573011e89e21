//! Which effects no data of some channels can tell apart: their signatures over the whole library of manoeuvres.
//!
//! Structural, for one ordinary vehicle driven through everything there is to drive; on a given log more effects may
//! look alike, which `signature` says. Followers go behind a leader that stops, starts and sways.

use ds_effect::{Channel, Effect, Plant, Scale, library};

use crate::drive::FollowerLog;
use crate::floor::{EGO_FLOOR, FOLLOWER_FLOOR};
use crate::following::{BLOCKS, FollowerRecord};
use crate::manoeuvre::everything;
use crate::settings::SAME_COSINE;
use crate::space::SCATTER;
use crate::synthetic::ordinary;
use crate::windows::EGO;

/// Returns groups of effects that share one signature in these channels whatever the data; an effect that differs from
/// all others is alone in its group, one that does not show in these channels is in none.
#[must_use]
pub fn isolability(channels: &[Channel]) -> Vec<Vec<&'static str>> {
    let nominal = response(&ordinary(), channels);
    let mut groups: Vec<(Vec<f64>, Vec<&'static str>)> = Vec::new();
    for effect in library().iter().filter(|e| e.suspect && e.channels.iter().any(|c| channels.contains(c))) {
        if SCATTER.contains(&effect.id) {
            groups.push((Vec::new(), vec![effect.id]));
            continue;
        }
        let shape: Vec<f64> = response(&typical(effect), channels).iter().zip(&nominal).map(|(a, b)| a - b).collect();
        let size = shape.iter().map(|s| s * s).sum::<f64>().sqrt();
        if size < 1e-9 {
            continue;
        }
        let shape: Vec<f64> = shape.iter().map(|s| s / size).collect();
        let alike = |other: &[f64]| other.iter().zip(&shape).map(|(a, b)| a * b).sum::<f64>().abs() > SAME_COSINE;
        match groups.iter_mut().find(|(other, _)| alike(other)) {
            Some((_, members)) => members.push(effect.id),
            None => groups.push((shape, vec![effect.id])),
        }
    }
    groups.into_iter().map(|(_, members)| members).collect()
}

/// The ordinary vehicle with an effect of a third of its range.
fn typical(effect: &Effect) -> Plant {
    let mut plant = ordinary();
    let mut values = effect.neutral();
    let p = &effect.parameters[0];
    let share = if p.slab.0 < p.neutral && p.scale != Scale::Limit { 0.7 } else { 0.3 };
    values[0] = p.reported(p.slab.0 + share * p.width(), plant.vehicle.nominal_mass_kg);
    (effect.apply)(&values, &mut plant);
    plant
}

/// Everything that some channels report of a simulator, in floor units.
fn response(plant: &Plant, channels: &[Channel]) -> Vec<f64> {
    let ego: Vec<usize> = channels.iter().map(|c| c.index()).filter(|&c| c < EGO).collect();
    let rows = everything(plant);
    let mut all: Vec<f64> =
        rows.iter().flat_map(|row| ego.iter().map(|&c| row[c] / EGO_FLOOR[c][0].hypot(2.0 * EGO_FLOOR[c][1]))).collect();
    let windows = follower().residuals(plant);
    for window in windows.chunks(2 * BLOCKS) {
        for channel in channels.iter().filter(|c| c.of_follower()).map(|c| c.index() - EGO) {
            let floor = FOLLOWER_FLOOR[channel][0].hypot(2.0 * FOLLOWER_FLOOR[channel][1]);
            all.extend(window[channel * BLOCKS..(channel + 1) * BLOCKS].iter().map(|r| r / floor));
        }
    }
    all
}

/// A follower near its steady gap behind a leader that stops, starts and sways.
fn follower() -> FollowerRecord {
    let speed = |t: f64| (8.0 + 8.0 * (0.25 * t).sin() + 6.0 * (0.06 * t).sin() + 1.5 * (1.1 * t).sin()).max(0.0);
    let v: Vec<f64> = (0..1200).map(|k| speed(f64::from(k) * 0.1)).collect();
    let driver = ordinary().follower;
    let gap = v.iter().map(|v| driver.min_gap_m + driver.headway_secs * v).collect();
    let log = FollowerLog { id: 1, start_secs: 0.0, step_secs: 0.1, v_lead: v.clone(), v, gap };
    FollowerRecord::new(0, &log, 20.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn together(channels: &[Channel], a: &str, b: &str) -> bool {
        isolability(channels).iter().any(|group| group.contains(&a) && group.contains(&b))
    }

    #[test]
    fn what_a_channel_cannot_tell_apart_another_one_can() {
        assert!(together(&[Channel::Ay], "ay_bias", "bank"));
        assert!(!together(&Channel::ALL, "ay_bias", "bank"));
        assert!(!together(&Channel::ALL, "steer_delay", "imu_latency"));
        let all = isolability(&Channel::ALL);
        assert!(all.iter().all(|group| group.len() < 4), "{all:?}");
    }

    #[test]
    fn an_effect_that_does_not_show_is_in_no_group() {
        let groups = isolability(&[Channel::WheelSpeed]);
        assert!(!groups.iter().flatten().any(|id| *id == "gyro_bias" || *id == "tr_headway"));
        assert!(groups.iter().flatten().any(|id| *id == "wheel_scale"));
    }
}
