//! Cases made by the nominal simulator itself, with any effects switched on and sensor noise added: for tests.
//!
//! Same equations as the diagnosis, so they say whether an effect can be told from the others at all, not whether the
//! diagnosis stands up to a world it does not know.

use std::fmt::Write as _;
use std::path::Path;

use ds_effect::Plant;
use ds_space::Draws;
use ds_vehicle::{Lead, Saturation};

use crate::ego::{FINE_SECS, Inputs, Start, actuate, instant_at, rollout};
use crate::following::Driver;
use crate::windows::sense;
use ds_diagnosis::CaseError;
use ds_diagnosis::meta::{DriveEntry, Idm, Nominal, SINGLE_TRACK, Split, VehicleMeta};

/// Rows of a drive, 35 s at 20 Hz.
const ROWS: usize = 700;
/// Desired speed of the followers in each drive, m/s.
const DESIRED: [f64; 4] = [14.0, 28.0, 18.0, 24.0];

/// Writes a case of four drives whose reference is the nominal simulator edited by `edit`.
///
/// # Errors
/// If the folder cannot be written.
pub fn write_case(folder: &Path, seed: u64, edit: &dyn Fn(&mut Plant)) -> Result<(), CaseError> {
    let failed = |source| CaseError::Write { path: folder.to_path_buf(), source };
    let meta = meta();
    meta.write(folder)?;
    for (drive, desired) in DESIRED.into_iter().enumerate() {
        let mut plant = usual(&meta.nominal);
        edit(&mut plant);
        let noise =
            Noise { draws: Draws::from_seed(seed * 10 + drive as u64, "synthetic"), next: std::cell::Cell::new(0) };
        let (ego, speeds) = ego_log(drive, &plant, &noise);
        std::fs::write(folder.join(format!("drive_{drive}.csv")), ego).map_err(failed)?;
        let agents = agents_log(desired, &plant, &speeds, &noise);
        std::fs::write(folder.join(format!("agents_{drive}.csv")), agents).map_err(failed)?;
    }
    Ok(())
}

/// Returns the nominal simulator of these cases.
#[must_use]
pub fn ordinary() -> Plant {
    nominal().plant()
}

/// Returns its description.
#[must_use]
pub fn nominal() -> Nominal {
    meta().nominal
}

fn meta() -> VehicleMeta {
    let drive = |(k, desired): (usize, f64)| DriveEntry {
        file: format!("drive_{k}.csv"),
        agents: Some(format!("agents_{k}.csv")),
        agents_desired_speed: Some(desired),
        ..DriveEntry::default()
    };
    VehicleMeta {
        case: "synthetic".to_owned(),
        suggested_split: Some(Split { fit: vec![0, 1, 2], held_out: vec![3] }),
        ..VehicleMeta::new(
            DESIRED.into_iter().enumerate().map(drive).collect(),
            Nominal {
                model: SINGLE_TRACK.to_owned(),
                mass: 1500.0,
                yaw_inertia: 2500.0,
                lf: 1.3,
                lr: 1.45,
                cornering_stiffness_front: 85_000.0,
                cornering_stiffness_rear: 98_000.0,
                steer_lag: 0.07,
                accel_lag: 0.12,
                rolling_decel: 0.1,
                drag_decel_per_v2: 0.00025,
                friction: 1.0,
                idm: Idm::default(),
            },
        )
    }
}

/// Returns the nominal simulator with the mismatch that every vehicle has.
#[must_use]
pub fn usual(nominal: &Nominal) -> Plant {
    let mut plant = nominal.plant();
    for effect in ds_effect::library() {
        let values: Vec<f64> = effect
            .parameters
            .iter()
            .map(|p| p.reported(p.nuisance.map_or(p.neutral, |n| n.mean), nominal.mass))
            .collect();
        (effect.apply)(&values, &mut plant);
    }
    plant
}

struct Noise {
    draws: Draws,
    next: std::cell::Cell<u64>,
}

impl Noise {
    fn normal(&self, sd: f64) -> f64 {
        let k = self.next.get();
        self.next.set(k + 2);
        let (u, v) = (self.draws.uniform(k).max(1e-12), self.draws.uniform(k + 1));
        sd * (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }
}

/// Desired speed and lateral acceleration at a time of a drive.
fn wish(drive: usize, t: f64) -> (f64, f64) {
    let wave = |period: f64, phase: f64| (std::f64::consts::TAU * (t / period + phase)).sin();
    match drive {
        0 => (9.0 + 4.5 * wave(17.0, 0.1), 2.4 * wave(9.0, 0.0) * wave(31.0, 0.2)),
        1 => (25.0 + 4.0 * wave(21.0, 0.0), 1.3 * wave(11.0, 0.0)),
        2 => (15.0 + 3.0 * wave(13.0, 0.3), 3.8 * wave(3.5 + 2.0 * (t / 35.0), 0.0) * (0.5 + 0.5 * wave(12.0, 0.0))),
        _ => (21.0 + 5.0 * wave(19.0, 0.4), 1.8 * wave(7.0, 0.2)),
    }
}

fn ego_log(drive: usize, plant: &Plant, noise: &Noise) -> (String, Vec<f64>) {
    let count = (ROWS as f64 * 0.05 / FINE_SECS) as usize + 200;
    let start_speed = wish(drive, 0.0).0;
    // an open-loop plan of speed gives acceleration; a closed loop on the nominal speed keeps the drive near it
    let mut speed = start_speed;
    let (mut steer, mut accel, mut speeds) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..count {
        let t = k as f64 * FINE_SECS;
        let (v, lateral) = wish(drive, t);
        let a = (1.2 * (v - speed)).clamp(-3.5, 2.2);
        let step = if (t * 0.4) as usize % 3 == 1 { 0.4 } else { 0.0 };
        speed += FINE_SECS * a;
        steer.push(lateral / speed.powi(2).max(9.0) * (2.75 + 0.0025 * speed * speed));
        accel.push(a + step + 0.1 + 0.00025 * speed * speed);
        speeds.push(speed);
    }
    let mut work = 0.0;
    let brake_work = accel
        .iter()
        .zip(&speeds)
        .map(|(a, v)| {
            work += (-a).max(0.0) * 1500.0 * v * FINE_SECS * 1e-6;
            work
        })
        .collect();
    let inputs = Inputs { start_secs: 0.0, steer, accel, speed: speeds, brake_work };
    let actuated = actuate(&inputs, plant);
    let horizon_secs = count as f64 * FINE_SECS - 0.3;
    let start = Start {
        secs: 0.0,
        speed_mps: start_speed,
        yaw_rate: 0.0,
        heading_rad: 0.0,
        warm_secs: 0.0,
        anchor_speed_mps: start_speed,
        horizon_secs,
    };
    let path = rollout(&start, &actuated, plant, &Saturation::new(plant.vehicle.tyre_knee));
    let mut text = String::from("t,cmd_steer,cmd_accel,x,y,yaw,v,yaw_rate,ax,ay,steer_meas,v_wheel\n");
    let mut truth = Vec::new();
    for row in 0..ROWS {
        let t = 0.5 + row as f64 * 0.05;
        let secs = t + noise.normal(plant.clock.jitter_secs);
        let age = plant.clock.pose_latency_secs + plant.clock.pose_drift * (t - 0.5);
        let s = sense(secs, 0.0, age, &path, &actuated, plant);
        let k = (t / FINE_SECS).round() as usize;
        truth.push(instant_at(&path, 0.0, t).v);
        let n = [0.012, 0.012, 0.0018, 0.025, 0.0028, 0.09, 0.09, 0.0006, 0.03].map(|sd| noise.normal(sd));
        let lever = plant.sensors.lever_arm_m;
        let _ = writeln!(
            text,
            "{t:.3},{:.5},{:.3},{:.3},{:.3},{:.4},{:.3},{:.4},{:.2},{:.2},{:.4},{:.3}",
            inputs.steer[k],
            inputs.accel[k],
            s[0] + lever + n[0],
            s[1] + n[1],
            s[2] + n[2],
            s[3] + n[3],
            s[4] + n[4],
            s[5] + n[5],
            s[6] + n[6],
            s[7] + n[7],
            s[8] + n[8]
        );
    }
    (text, truth)
}

fn agents_log(desired: f64, plant: &Plant, lead: &[f64], noise: &Noise) -> String {
    let mut text = String::from("t,id,x,y,yaw,v,gap,v_lead\n");
    let driver = &plant.follower;
    let driven = Driver::new(driver, desired);
    let step = 0.05;
    let mut leader = lead.to_vec();
    for id in 1..=2 {
        let mut speed = vec![leader[0]];
        let mut gap = vec![driver.min_gap_m + driver.headway_secs * leader[0] + 4.0];
        let mut accel = 0.0;
        let back = (driver.delay_secs / step).round() as usize;
        let decay = if driver.lag_secs > 0.0 { (-step / driver.lag_secs).exp() } else { 0.0 };
        for k in 0..leader.len() - 1 {
            let j = k.saturating_sub(back);
            let wish = driven.wish(speed[j], Lead { gap_m: gap[j], speed_mps: leader[j] });
            accel = wish + (accel - wish) * decay;
            let next = (speed[k] + step * (accel + noise.normal(0.06))).max(0.0);
            gap.push(gap[k] + step * (0.5 * (leader[k] + leader[k + 1]) - 0.5 * (speed[k] + next)));
            speed.push(next);
        }
        for k in (0..leader.len()).step_by(2) {
            let t = 0.5 + k as f64 * step;
            let (v, g, l) =
                (speed[k] + noise.normal(0.08), gap[k] + noise.normal(0.08), leader[k] + noise.normal(0.08));
            let _ = writeln!(text, "{t:.1},{id},0,0,0,{v:.2},{g:.2},{l:.2}");
        }
        leader = speed;
    }
    text
}
