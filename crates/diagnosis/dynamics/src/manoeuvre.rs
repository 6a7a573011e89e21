//! What to drive next: a library of manoeuvres ranked by how well one run would separate two hypotheses.
//!
//! Both hypotheses drive the manoeuvre in the simulator; the expected log Bayes factor of one run is half the squared
//! difference of what the sensors would report, in floor units, times the effective-sample factor κ.

use ds_effect::Plant;
use ds_vehicle::Saturation;

use crate::ego::{FINE_SECS, Inputs, Start, actuate, rollout};
use crate::floor::EGO_FLOOR;
use crate::settings::KAPPA;
use crate::windows::{EGO, sense};
use ds_diagnosis::schema::Manoeuvre;

/// Seconds between compared samples.
const SAMPLE_SECS: f64 = 0.25;
/// Log Bayes factor that settles a question.
const WANTED: f64 = 5.0;

/// Name, entry speed in m/s, duration in s, steering in rad and acceleration in m/s² at a time.
type Script = (&'static str, f64, f64, fn(f64) -> f64, fn(f64) -> f64);

const HOLD: fn(f64) -> f64 = |_| 0.25;

const SCRIPTS: &[Script] = &[
    ("step steer small", 15.0, 6.0, |t| if t > 1.0 { 0.015 } else { 0.0 }, HOLD),
    ("step steer large", 12.0, 6.0, |t| if t > 1.0 { 0.06 } else { 0.0 }, HOLD),
    ("sine sweep 0.2 to 2 Hz", 15.0, 15.0, |t| 0.015 * (std::f64::consts::TAU * (0.2 + 0.06 * t) * t).sin(), HOLD),
    ("slalom", 12.0, 12.0, |t| 0.05 * (std::f64::consts::TAU * 0.4 * t).sin(), HOLD),
    ("coast down from speed", 28.0, 20.0, |_| 0.0, |_| 0.0),
    ("brake step gentle", 20.0, 6.0, |_| 0.0, |t| if t > 1.0 { -1.5 } else { 0.2 }),
    ("brake step hard", 25.0, 6.0, |_| 0.0, |t| if t > 1.0 { -4.0 } else { 0.2 }),
    ("pedal steps", 10.0, 12.0, |_| 0.0, |t| if (t / 2.0) as i64 % 2 == 0 { 1.5 } else { -1.0 }),
    ("full throttle", 8.0, 10.0, |_| 0.0, |_| 3.0),
    ("low-speed full lock", 3.0, 10.0, |t| (0.2 * t).min(0.5), HOLD),
    ("circle at rising speed", 8.0, 15.0, |_| 0.05, |_| 0.8),
    ("straight ahead", 20.0, 15.0, |_| 0.0, HOLD),
    ("straight ahead, opposite direction", -20.0, 15.0, |_| 0.0, HOLD),
];

/// Returns the best manoeuvres for telling two simulators apart, best first, by sensors of which each has some factor on the
/// library's floor: infinity where it is absent.
#[must_use]
pub fn rank(names: [&str; 2], plants: [&Plant; 2], factors: &[f64; EGO]) -> Vec<Manoeuvre> {
    let mut list: Vec<Manoeuvre> = SCRIPTS
        .iter()
        .map(|script| {
            let factor = separation(script, plants, factors);
            Manoeuvre {
                name: script.0.to_owned(),
                separates: names.map(str::to_owned),
                expected_log_bayes_factor: factor,
                secs_needed: (script.2 * WANTED / factor.max(1e-6)).clamp(script.2, 36_000.0),
            }
        })
        .collect();
    list.sort_by(|a, b| b.expected_log_bayes_factor.total_cmp(&a.expected_log_bayes_factor));
    list.truncate(3);
    list
}

/// Returns what the sensors report of a simulator driven through the whole library, sample by sample.
#[must_use]
pub fn everything(plant: &Plant) -> Vec<[f64; EGO]> {
    SCRIPTS.iter().flat_map(|script| report(script, plant)).collect()
}

fn separation(script: &Script, plants: [&Plant; 2], factors: &[f64; EGO]) -> f64 {
    let [a, b] = plants.map(|plant| report(script, plant));
    let mut total = 0.0;
    for (one, other) in a.iter().zip(&b) {
        for channel in 0..EGO {
            let floor = factors[channel] * EGO_FLOOR[channel][0].hypot(2.0 * EGO_FLOOR[channel][1]);
            // displacement grows without end in an open rollout; differences beyond twenty floors tell no more
            total += ((one[channel] - other[channel]) / floor).clamp(-20.0, 20.0).powi(2);
        }
    }
    0.5 * KAPPA * total
}

fn report(&(_, speed, secs, steer, accel): &Script, plant: &Plant) -> Vec<[f64; EGO]> {
    let count = ((secs + 1.0) / FINE_SECS) as usize;
    let at = |k: usize| (k as f64 * FINE_SECS - 1.0).max(0.0);
    let inputs = Inputs {
        start_secs: 0.0,
        steer: (0..count).map(|k| steer(at(k))).collect(),
        accel: (0..count).map(|k| accel(at(k))).collect(),
        speed: vec![speed.abs(); count],
        brake_work: vec![0.0; count],
    };
    let actuated = actuate(&inputs, plant);
    let start = Start {
        secs: 0.5,
        speed_mps: speed.abs(),
        yaw_rate: 0.0,
        heading_rad: if speed < 0.0 { std::f64::consts::PI } else { 0.0 },
        warm_secs: 0.5,
        anchor_speed_mps: speed.abs(),
        horizon_secs: secs,
    };
    let buffer = rollout(&start, &actuated, plant, &Saturation::new(plant.vehicle.tyre_knee));
    let samples = (secs / SAMPLE_SECS) as usize;
    (1..samples)
        .map(|k| {
            let now = 1.0 + k as f64 * SAMPLE_SECS;
            let age = plant.clock.pose_latency_secs + plant.clock.pose_drift * now;
            sense(now, start.secs, age, &buffer, &actuated, plant)
        })
        .collect()
}
