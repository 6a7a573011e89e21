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

/// Root mean square, in floor units, below which an effect of a third of its range does not show in a channel.
const VISIBLE: f64 = 0.1;

/// Returns groups of effects that share one signature in these channels whatever the data; an effect that differs from
/// all others is alone in its group, one that does not show in these channels is in none.
#[must_use]
pub fn isolability(channels: &[Channel]) -> Vec<Vec<&'static str>> {
    let nominal = response(&ordinary(), channels);
    let mut groups: Vec<(Shape, Vec<&'static str>)> = Vec::new();
    let shows = |e: &&&Effect| e.suspect && !e.needs_scene() && e.channels.iter().any(|c| channels.contains(c));
    for effect in library().iter().filter(shows) {
        if SCATTER.contains(&effect.id) {
            groups.push((Shape::new(), vec![effect.id]));
            continue;
        }
        let moved = response(&typical(effect), channels);
        let less = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| a - b).collect();
        let shape: Shape = moved.iter().zip(&nominal).map(less).collect();
        if shape.iter().all(|c| norm(c) < 1e-9) {
            continue;
        }
        match groups.iter_mut().find(|(other, _)| same(other, &shape)) {
            Some((_, members)) => members.push(effect.id),
            None => groups.push((shape, vec![effect.id])),
        }
    }
    groups.into_iter().map(|(_, members)| members).collect()
}

/// What an effect changes, channel by channel, in floor units.
type Shape = Vec<Vec<f64>>;

fn norm(signal: &[f64]) -> f64 {
    signal.iter().map(|s| s * s).sum::<f64>().sqrt()
}

/// Tells whether one shape is a multiple of another in every channel in which either shows: over all channels together
/// the integrated ones would drown the rest.
fn same(a: &Shape, b: &Shape) -> bool {
    let dot = |a: &Shape, b: &Shape| -> f64 { a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| a * b).sum() };
    let scale = dot(a, b) / dot(b, b).max(1e-12);
    let off = (1.0 - SAME_COSINE * SAME_COSINE).sqrt();
    a.len() == b.len()
        && a.iter().zip(b).all(|(a, b)| {
            let rest: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - scale * b).collect();
            let size = norm(a).max(scale.abs() * norm(b));
            size < VISIBLE * (a.len() as f64).sqrt() || norm(&rest) < off * size
        })
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

/// Everything that some channels report of a simulator, channel by channel, in floor units.
fn response(plant: &Plant, channels: &[Channel]) -> Shape {
    let rows = everything(plant);
    let windows = follower().residuals(plant);
    let of = |channel: &Channel| -> Vec<f64> {
        let c = channel.index();
        if c < EGO {
            let floor = EGO_FLOOR[c][0].hypot(2.0 * EGO_FLOOR[c][1]);
            return rows.iter().map(|row| row[c] / floor).collect();
        }
        let floor = FOLLOWER_FLOOR[c - EGO][0].hypot(2.0 * FOLLOWER_FLOOR[c - EGO][1]);
        let own = |window: &[f64]| window[(c - EGO) * BLOCKS..][..BLOCKS].to_vec();
        windows.chunks(2 * BLOCKS).flat_map(own).map(|r| r / floor).collect()
    };
    channels.iter().map(of).collect()
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
        // a slope and rolling resistance slow down alike; only the accelerometer tells that one of them is gravity
        assert!(together(&[Channel::Speed], "grade", "roll_add"));
        assert!(!together(&Channel::ALL, "grade", "roll_add"));
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
