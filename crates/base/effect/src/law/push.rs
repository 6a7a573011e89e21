//! What laws push a car with, beside its tyres, its drive and the air.

use super::Port;

/// Forces from outside.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Push {
    /// Forward at the centre of gravity, over nominal mass, m/s².
    pub drive_mps2: f64,
    /// To the left at the front axle, across the wheels, N.
    pub front_n: f64,
    /// To the left at the rear axle, N.
    pub rear_n: f64,
}

impl Push {
    /// Gathers what `added` says of each port; moment and side force on the body are put on the axles, which lie so far before
    /// and behind the centre of gravity, m.
    #[must_use]
    pub fn of([front_arm_m, rear_arm_m]: [f64; 2], added: impl Fn(Port) -> f64) -> Self {
        let (turn, side) = (added(Port::Yaw), added(Port::Side));
        let base_m = front_arm_m + rear_arm_m;
        Self {
            drive_mps2: added(Port::Drive),
            front_n: added(Port::Front) + (rear_arm_m * side + turn) / base_m,
            rear_n: added(Port::Rear) + (front_arm_m * side - turn) / base_m,
        }
    }
}
