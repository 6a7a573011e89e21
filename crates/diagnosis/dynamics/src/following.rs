//! The nominal simulator of following vehicles: the intelligent driver model of `ds_vehicle` behind its recorded leader.
//!
//! A window starts from the smoothed measured speed and gap and lasts 5 s; the leader's recorded speed is given.
//! Reaction time looks back into the measured history before the window. Residuals are averaged over 0.5 s.

use ds_effect::law::{Felt, Port, Sources};
use ds_effect::plant::{Follower, Plant};
use ds_vehicle::{Above, Exponent, Form, IdmParameters, Lead, Shortest};

use crate::drive::FollowerLog;
use crate::smooth::{between, parabola};

/// Follower channels in the residual vector: speed, gap.
pub const FOLLOWING: usize = 2;
/// Blocks of a window.
pub const BLOCKS: usize = 10;
/// Samples per block.
const BLOCK: usize = 5;
/// Samples between window starts.
const STRIDE: usize = 25;
/// Samples of history before a window, for the reaction time.
const HISTORY: usize = 14;
/// Integration steps per sample.
const SUB: usize = 2;
/// Smallest gap the model is evaluated at, m.
const CLOSEST_M: f64 = 0.5;
/// Lowest desired speed, m/s.
const SLOWEST_DESIRED_MPS: f64 = 0.5;

/// A driver of a plant with the desired speed of its drive.
pub(crate) struct Driver {
    idm: IdmParameters,
    form: Form,
    desired_mps: f64,
}

impl Driver {
    pub(crate) fn new(follower: &Follower, desired_mps: f64) -> Self {
        let exponent = Exponent::Real(follower.exponent);
        Self {
            idm: IdmParameters::default().driven_by(follower),
            form: Form { exponent, above: Above::Original, shortest: Shortest::AtStand, closest_m: CLOSEST_M },
            desired_mps: (desired_mps * follower.desired_speed_factor).max(SLOWEST_DESIRED_MPS),
        }
    }

    /// Returns the acceleration that the driver wishes for, m/s².
    pub(crate) fn wish(&self, speed_mps: f64, lead: Lead) -> f64 {
        self.idm.acceleration_by(&self.form, speed_mps, self.desired_mps, Some(lead))
    }
}

/// One follower's log in one drive, smoothed once.
#[derive(Clone)]
pub struct FollowerRecord {
    /// Index of the drive in the case.
    pub drive: usize,
    /// Samples at which windows start.
    pub starts: Vec<usize>,
    log: FollowerLog,
    desired_mps: f64,
    speed: Vec<f64>,
    gap: Vec<f64>,
    lead: Vec<f64>,
}

impl FollowerRecord {
    /// Prepares a follower's log.
    #[must_use]
    pub fn new(drive: usize, log: &FollowerLog, desired_mps: f64) -> Self {
        let smooth =
            |signal: &[f64], half| -> Vec<f64> { (0..signal.len()).map(|k| parabola(signal, k, half)).collect() };
        let last = log.v.len().saturating_sub(BLOCK * BLOCKS + 1);
        Self {
            drive,
            starts: (HISTORY..last).step_by(STRIDE).collect(),
            desired_mps,
            speed: smooth(&log.v, 7),
            gap: smooth(&log.gap, 5),
            lead: smooth(&log.v_lead, 5),
            log: log.clone(),
        }
    }

    /// Returns the stamp of a sample, s.
    #[must_use]
    pub fn secs(&self, sample: usize) -> f64 {
        self.log.start_secs + sample as f64 * self.log.step_secs
    }

    /// Returns what the driver meets at a sample.
    #[must_use]
    pub fn felt(&self, sample: usize) -> Felt {
        let (v, gap, v_lead) = (self.speed[sample], self.gap[sample], self.lead[sample]);
        Felt { v, gap, dv: v_lead - v, v_lead, ..Felt::default() }
    }

    /// Returns measured minus simulated block means of all windows; per window speed, then gap.
    #[must_use]
    pub fn residuals(&self, plant: &Plant) -> Vec<f64> {
        self.starts.iter().flat_map(|&start| self.residual(start, plant)).collect()
    }

    fn residual(&self, start: usize, plant: &Plant) -> Vec<f64> {
        let driver = &plant.follower;
        let laws: Vec<_> = plant.laws.iter().filter(|law| law.port() == Port::Follower).collect();
        let still = vec![0.0; if laws.is_empty() { 0 } else { self.log.v.len() }];
        let sources = Sources { step_secs: self.log.step_secs, delta: &still, accel: &still, speed: &still };
        let laws: Vec<_> = laws.into_iter().map(|law| (law, law.known(&sources))).collect();
        let mut out = vec![0.0; FOLLOWING * BLOCKS];
        let share = 1.0 / BLOCK as f64;
        let step = self.log.step_secs / SUB as f64;
        let history = HISTORY * SUB;
        let past = |signal: &[f64], j: usize| between(signal, start as f64 + (j as f64 - history as f64) / SUB as f64);
        let total = history + BLOCK * BLOCKS * SUB;
        let mut speed: Vec<f64> = (0..=history).map(|j| past(&self.speed, j)).collect();
        let mut gap: Vec<f64> = (0..=history).map(|j| past(&self.gap, j)).collect();
        let lead: Vec<f64> = (0..=total).map(|j| past(&self.lead, j)).collect();
        let back = (driver.delay_secs / step).clamp(0.0, (history - 1) as f64);
        let driven = Driver::new(driver, self.desired_mps);
        let wish = |[speed, gap, lead]: [&[f64]; 3], at: f64| {
            driven.wish(between(speed, at), Lead { gap_m: between(gap, at), speed_mps: between(lead, at) })
        };
        let mut accel = wish([&speed, &gap, &lead], history as f64 - back);
        let decay = if driver.lag_secs > 1e-4 { (-step / driver.lag_secs).exp() } else { 0.0 };
        for j in history..total {
            let felt = Felt { v: speed[j], gap: gap[j], dv: lead[j] - speed[j], v_lead: lead[j], ..Felt::default() };
            let at = start as f64 + (j as f64 - history as f64) / SUB as f64;
            let term = |known: &Vec<f64>| if known.is_empty() { 1.0 } else { between(known, at) };
            let added: f64 = laws.iter().map(|(law, known)| law.at(|k| term(&known[k]), &felt)).sum();
            let wished = wish([&speed, &gap, &lead], j as f64 - back) + added;
            accel = wished + (accel - wished) * decay;
            let next = (speed[j] + step * accel).max(0.0);
            let closing = 0.5 * (lead[j] + lead[j + 1]) - 0.5 * (speed[j] + next);
            gap.push(gap[j] + step * closing);
            speed.push(next);
            let done = j + 1 - history;
            if done.is_multiple_of(SUB) {
                let sample = done / SUB;
                let block = (sample - 1) / BLOCK;
                out[block] += share * (self.log.v[start + sample] - next);
                out[BLOCKS + block] += share * (self.log.gap[start + sample] - gap[j + 1]);
            }
        }
        out
    }
}
