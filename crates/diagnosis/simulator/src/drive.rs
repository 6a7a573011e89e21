//! One rollout: a window driven by whatever speaks the protocol, as instants like those of the built-in car.
//!
//! What the simulator cannot be told by parameters is pushed through its ports ([`Twins`]), as is what a law adds inside the
//! car; what a law adds to the steering goes with the angle of the wheels. A simulator cannot be given another speed at the anchor without losing its tyres' state: it starts with
//! the speed that the built-in car needs to be right there, and what is left is shifted.

use std::collections::BTreeMap;

use ds_diagnosis::meta::Nominal;
use ds_dynamics::ego::{Actuated, Car, Instant, Push, ROLL_SECS, Start};
use ds_dynamics::motion::is_outside;
use ds_effect::Plant;
use ds_vehicle::Saturation;

use crate::error::SimulatorError;
use crate::fields::{declared, differing, entry};
use crate::message::{DRIVE, FRONT, Hello, NEEDED, Out, REAR, Reply, Request, Reset, Row, Step};
use crate::process::Process;
use crate::serve::Served;
use crate::twins::Twins;

/// Who answers requests.
pub(crate) trait Subject {
    /// Answers one.
    ///
    /// # Errors
    /// If there is no answer, or it is a refusal.
    fn ask(&mut self, request: &Request) -> Result<Reply, SimulatorError>;
}

impl Subject for Process {
    fn ask(&mut self, request: &Request) -> Result<Reply, SimulatorError> {
        Self::ask(self, request)
    }
}

impl Subject for Served {
    fn ask(&mut self, request: &Request) -> Result<Reply, SimulatorError> {
        match self.answer(request) {
            Reply::Error(failure) => Err(SimulatorError::Refused { request: request.name(), text: failure.text }),
            reply => Ok(reply),
        }
    }
}

/// A rollout to be made.
pub(crate) struct Rollout<'a> {
    /// Where and how long.
    pub(crate) start: &'a Start,
    /// The inputs.
    pub(crate) actuated: &'a Actuated,
    /// The car that is meant.
    pub(crate) plant: &'a Plant,
    /// The car that the simulator stands for as it is.
    pub(crate) reference: &'a Plant,
    /// The nominal simulator of the case.
    pub(crate) nominal: &'a Nominal,
    /// Seed of whatever the simulator draws.
    pub(crate) seed: u64,
}

/// Copies vehicle and road of a plant.
#[must_use]
pub(crate) fn car_of(plant: &Plant, nominal: &Nominal) -> Plant {
    Plant { vehicle: plant.vehicle, road: plant.road, ..nominal.plant() }
}

/// Tells whether a law acts inside a car.
#[must_use]
pub(crate) fn is_lawful(plant: &Plant) -> bool {
    plant.laws.iter().any(|law| !is_outside(law.port()))
}

impl Rollout<'_> {
    /// Makes it.
    ///
    /// # Errors
    /// If the simulator fails, refuses or answers what is not finite or not complete.
    pub(crate) fn run(&self, subject: &mut dyn Subject, hello: &Hello) -> Result<Vec<Instant>, SimulatorError> {
        let mut told = car_of(self.reference, self.nominal);
        let mut params = BTreeMap::new();
        for field in differing(self.plant, self.reference) {
            if let Some(entry) = entry(hello, field) {
                params.insert(field.name.to_owned(), declared(entry, field, self.plant, self.reference));
                (field.set)(&mut told, (field.get)(self.plant));
            }
        }
        let first = self.first();
        let vy = Car::steady(&told.vehicle, first[3], first[4], first[2]).state.vy;
        let names = NEEDED.into_iter().zip(first).chain([("vy", vy)]);
        let state = names.filter(|(name, _)| hello.reset_state.iter().any(|known| known == name));
        let state = state.map(|(name, value)| (name.to_owned(), value)).collect();
        match subject.ask(&Request::Reset(Reset { id: 0, state, params, seed: self.seed }))? {
            Reply::Ok(_) => {}
            other => return Err(unreadable("reset", &format!("{other:?}"))),
        }
        let count = ((self.start.warm_secs + self.start.horizon_secs) / hello.dt).ceil() as usize + 2;
        let mut rows = vec![first];
        if is_lawful(self.plant) || differing(self.plant, &told).next().is_some() {
            self.pushed(subject, hello, &told, count, &mut rows)?;
        } else {
            let step = self.step(0, count, hello.dt);
            collect(subject.ask(&Request::Step(step))?, count, &mut rows)?;
        }
        // accelerations are of the steps: the first has none before it
        (rows[0][5], rows[0][6]) = (rows[1][5], rows[1][6]);
        Ok(self.instants(&rows, hello.dt))
    }

    /// Returns the row to start with: the speed such that the car that is meant has the anchor's speed at the anchor.
    fn first(&self) -> Row {
        let (start, meant) = (self.start, car_of(self.plant, self.nominal));
        let mut car = Car::steady(&meant.vehicle, start.speed_mps, start.yaw_rate, start.heading_rad);
        let saturation = Saturation::new(meant.vehicle.tyre_knee);
        let mut force = (0.0, start.speed_mps * start.yaw_rate);
        for k in 0..(start.warm_secs / ROLL_SECS).round() as usize {
            let middle = start.secs + (k as f64 + 0.5) * ROLL_SECS;
            let ((steer, accel), push) = self.actuated.pushed(middle, &car.felt(force.0, force.1), self.plant);
            let instant = car.step(steer, accel, &push, &meant, &saturation);
            force = (instant.ax, instant.ay);
        }
        let speed = (start.speed_mps + start.anchor_speed_mps - car.state.vx).max(0.0);
        [0.0, 0.0, start.heading_rad, speed, start.yaw_rate, 0.0, 0.0]
    }

    fn step(&self, from: usize, n: usize, dt: f64) -> Step {
        let middle = |k: usize| self.actuated.asked(self.start.secs + (k as f64 + 0.5) * dt);
        let (steer, accel) = (from..from + n).map(middle).unzip();
        Step { id: 0, n, steer, accel, ports: BTreeMap::new() }
    }

    /// Drives step by step with what the parameters do not say, and what laws add, at the ports.
    fn pushed(
        &self,
        subject: &mut dyn Subject,
        hello: &Hello,
        told: &Plant,
        count: usize,
        rows: &mut Vec<Row>,
    ) -> Result<(), SimulatorError> {
        let mut twins = Twins::new(told, self.plant, &rows[0]);
        let each = ((ROLL_SECS / hello.dt).round() as usize).max(1);
        let fine = ((each as f64 * hello.dt / ROLL_SECS).round() as usize).max(1);
        let mut at = 0;
        while at < count {
            let mut step = self.step(at, each, hello.dt);
            let (mut push, mut unfelt, mut turned) = (Push::default(), [0.0; 2], 0.0);
            let felt = twins.meet(&rows[rows.len() - 1], at == 0);
            for k in 0..fine {
                let share = 1.0 / fine as f64;
                let middle = self.start.secs + at as f64 * hello.dt + (k as f64 + 0.5) * ROLL_SECS;
                let asked = self.actuated.pushed(middle, &felt, self.plant);
                let (needed, felt) = twins.step(&asked, |port| hello.port(port));
                turned += share * (asked.0.0 - self.actuated.asked(middle).0);
                push.drive_mps2 += share * needed.drive_mps2;
                push.front_n += share * needed.front_n;
                push.rear_n += share * needed.rear_n;
                unfelt[0] += share * felt[0];
                unfelt[1] += share * felt[1];
            }
            step.steer.iter_mut().for_each(|angle| *angle += turned);
            let inputs = [(DRIVE, push.drive_mps2), (FRONT, push.front_n), (REAR, push.rear_n)];
            let inputs = inputs.into_iter().filter(|(name, _)| hello.port(name));
            step.ports = inputs.map(|(name, value)| (name.to_owned(), vec![value; each])).collect();
            let reply = subject.ask(&Request::Step(step))?;
            let from = rows.len();
            collect(reply, each, rows)?;
            for row in &mut rows[from..] {
                row[5] += unfelt[0];
                row[6] += unfelt[1];
            }
            at += each;
        }
        Ok(())
    }

    /// Puts rows, one every `dt`, on the built-in car's grid, poses relative to the anchor.
    fn instants(&self, rows: &[Row], dt: f64) -> Vec<Instant> {
        let start = self.start;
        let at = |secs: f64, of: usize| {
            let place = (secs / dt).clamp(0.0, (rows.len() - 1) as f64);
            let low = (place as usize).min(rows.len() - 2);
            rows[low][of] + (place - low as f64) * (rows[low + 1][of] - rows[low][of])
        };
        let [x0, y0, yaw0, v0] = [0, 1, 2, 3].map(|of| at(start.warm_secs, of));
        let (sin, cos) = yaw0.sin_cos();
        let short = start.anchor_speed_mps - v0;
        let warm = (start.warm_secs / ROLL_SECS).round() as usize;
        let steps = warm + (start.horizon_secs / ROLL_SECS).ceil() as usize;
        let mut shift = (0.0, 0.0);
        let grid = (0..=steps).map(|k| {
            let secs = k as f64 * ROLL_SECS;
            let (dx, dy, yaw) = (at(secs, 0) - x0, at(secs, 1) - y0, at(secs, 2) - yaw0);
            // the accelerations of the built-in car are those of the step that begins here
            let during = secs + 0.5 * (ROLL_SECS + dt);
            let instant = Instant {
                x: dx * cos + dy * sin + shift.0,
                y: dy * cos - dx * sin + shift.1,
                yaw,
                v: at(secs, 3) + short,
                yaw_rate: at(secs, 4),
                ax: at(during, 5),
                ay: at(during, 6),
            };
            if k >= warm {
                shift = (shift.0 + short * ROLL_SECS * yaw.cos(), shift.1 + short * ROLL_SECS * yaw.sin());
            }
            instant
        });
        grid.collect()
    }
}

fn unreadable(request: &'static str, line: &str) -> SimulatorError {
    let why = "not what was asked for".to_owned();
    SimulatorError::Unreadable { request, line: line.chars().take(200).collect(), why }
}

/// Takes the rows of a reply; headings go on without jumps.
fn collect(reply: Reply, count: usize, rows: &mut Vec<Row>) -> Result<(), SimulatorError> {
    let Reply::Out(Out { channels, .. }) = reply else { return Err(unreadable("step", &format!("{reply:?}"))) };
    let mut columns = Vec::with_capacity(NEEDED.len());
    for name in NEEDED {
        let values = channels.get(name).filter(|values| values.len() == count && values.iter().all(|v| v.is_finite()));
        let values = values.ok_or_else(|| {
            let found = channels.get(name).map_or(0, Vec::len);
            let why = format!("channel {name:?} has {found} values, {count} finite ones expected");
            SimulatorError::Unreadable { request: "step", line: "out".to_owned(), why }
        })?;
        columns.push(values);
    }
    let row_at = |k: usize| -> Row { std::array::from_fn(|c| columns[c][k]) };
    for mut row in (0..count).map(row_at) {
        let turns = ((rows[rows.len() - 1][2] - row[2]) / std::f64::consts::TAU).round();
        row[2] += turns * std::f64::consts::TAU;
        rows.push(row);
    }
    Ok(())
}
