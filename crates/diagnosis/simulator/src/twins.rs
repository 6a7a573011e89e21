//! What has to be pushed into a simulator so that it moves like a car that it cannot be told to be.
//!
//! Two built-in cars, the one that the simulator was told to be and the one that is meant, set out from the simulator's
//! own state. The push is what brings the first where the second gets within the step, tyres that resist it included;
//! accelerometers of the second may feel less than that, for the rest is gravity's.

use ds_dynamics::ego::{Car, Push, State};
use ds_effect::Plant;
use ds_effect::law::Felt;
use ds_vehicle::Saturation;
use nalgebra::{DMatrix, DVector};

use crate::message::{DRIVE, FRONT, REAR, Row};

/// Pushes by which responses are measured: m/s², N, N.
const PROBES: [f64; 3] = [0.1, 100.0, 100.0];
const PORTS: [&str; 3] = [DRIVE, FRONT, REAR];
/// Singular values below count as none.
const NONE: f64 = 1e-12;

/// The two cars.
pub(crate) struct Twins<'a> {
    told: (Car, &'a Plant, Saturation),
    meant: (Car, &'a Plant, Saturation),
}

impl<'a> Twins<'a> {
    /// Starts both from a row.
    pub(crate) fn new(told: &'a Plant, meant: &'a Plant, row: &Row) -> Self {
        let of = |plant: &'a Plant| {
            let car = Car::steady(&plant.vehicle, row[3], row[4], row[2]);
            (car, plant, Saturation::new(plant.vehicle.tyre_knee))
        };
        Self { told: of(told), meant: of(meant) }
    }

    /// Takes over speed and yaw rate of the simulator, and returns what it feels: nothing was felt before the first row but
    /// the turn; slip angles, which it does not tell, are those of the car that it was told to be.
    pub(crate) fn meet(&mut self, row: &Row, first: bool) -> Felt {
        (self.told.0.state.vx, self.told.0.state.yaw_rate) = (row[3], row[4]);
        let (ax, ay) = if first { (0.0, row[3] * row[4]) } else { (row[5], row[6]) };
        self.told.0.felt(ax, ay)
    }

    /// Moves both on by the same inputs, laws' pushes among them; returns the push through the ports that there are, and what
    /// accelerometers along and across feel beyond those of the pushed car.
    pub(crate) fn step(
        &mut self,
        &(inputs, lawful): &((f64, f64), Push),
        has: impl Fn(&str) -> bool,
    ) -> (Push, [f64; 2]) {
        let ((told, plant, knee), (meant, other, other_knee)) = (&mut self.told, &mut self.meant);
        meant.state = State { slip_front: meant.state.slip_front, slip_rear: meant.state.slip_rear, ..told.state };
        let wanted = meant.step(inputs.0, inputs.1, &lawful, other, other_knee);
        let base_m = plant.vehicle.front_arm_m + plant.vehicle.rear_arm_m;
        let ends = |push: &Push| {
            let mut car = *told;
            car.step(inputs.0, inputs.1, push, plant, knee);
            [car.state.vx, car.state.vy, car.state.yaw_rate * base_m]
        };
        let free = ends(&lawful);
        let goal = [meant.state.vx, meant.state.vy, meant.state.yaw_rate * base_m];
        let mut response = DMatrix::zeros(3, 3);
        for (column, probe) in PROBES.into_iter().enumerate().filter(|(column, _)| has(PORTS[*column])) {
            let end = ends(&pushed(lawful, column, probe));
            (0..3).for_each(|row| response[(row, column)] = end[row] - free[row]);
        }
        let missing = DVector::from_fn(3, |row, _| goal[row] - free[row]);
        let sizes = response.svd(true, true).solve(&missing, NONE).unwrap_or_else(|_| DVector::zeros(3));
        let push = (0..PROBES.len()).fold(lawful, |push, port| pushed(push, port, sizes[port] * PROBES[port]));
        let felt = told.step(inputs.0, inputs.1, &push, plant, knee);
        (push, [wanted.ax - felt.ax, wanted.ay - felt.ay])
    }
}

/// Returns a push with so much more through one port.
fn pushed(mut push: Push, port: usize, size: f64) -> Push {
    *[&mut push.drive_mps2, &mut push.front_n, &mut push.rear_n][port] += size;
    push
}
