//! Drive commands of other kinds than an acceleration: what they are in, what they need, and what they ask for per mass.
//!
//! A force is divided by the mass of the nominal vehicle, a motor's torque goes over ratio and wheel radius to a force, an asked
//! speed becomes the acceleration that follows it. A pedal is refused: its map over speed and gear would have to be fitted.

use serde::Deserialize;

use crate::channel::Quantity;

/// What the drive command asks for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CommandKind {
    /// An acceleration, drive force over mass.
    #[default]
    Accel,
    /// A force at the wheels.
    Force,
    /// A torque of the motor; needs `ratio` and `radius_m`.
    Torque,
    /// The way of a pedal: refused.
    Pedal,
    /// A speed, or with `radius_m` the turning of the wheels.
    WheelSpeed,
}

/// What was declared beside a kind.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Declared {
    pub kind: CommandKind,
    pub ratio: Option<f64>,
    pub radius_m: Option<f64>,
}

impl Declared {
    /// Refuses what is lacking or does not belong.
    pub(crate) fn check(self, channel: &str) -> Result<(), String> {
        let positive = |value: Option<f64>| value.is_some_and(|v| v.is_finite() && v > 0.0);
        let absent = |value: Option<f64>| value.is_none() || positive(value);
        if channel != "cmd_accel"
            && (self.kind != CommandKind::Accel || self.ratio.is_some() || self.radius_m.is_some())
        {
            return Err("kind, ratio and radius_m belong to cmd_accel".to_owned());
        }
        match self.kind {
            CommandKind::Torque if !(positive(self.ratio) && positive(self.radius_m)) => {
                Err("of kind torque needs a ratio and a radius_m above 0".to_owned())
            }
            CommandKind::WheelSpeed if self.ratio.is_some() || !absent(self.radius_m) => {
                Err("of kind wheel_speed takes a radius_m above 0 and no ratio".to_owned())
            }
            CommandKind::Accel | CommandKind::Force if self.ratio.is_some() || self.radius_m.is_some() => {
                Err("takes ratio and radius_m for a torque or the turning of wheels alone".to_owned())
            }
            CommandKind::Pedal => {
                Err("of kind pedal is not read: what a pedal does depends on speed and gear and would have \
                 to be fitted; map a force, torque or asked acceleration, or derive it from v"
                    .to_owned())
            }
            _ => Ok(()),
        }
    }

    /// Returns what the command is in, given what its channel is in.
    pub(crate) fn quantity(self, channel: Quantity) -> Quantity {
        match self.kind {
            CommandKind::Accel | CommandKind::Pedal => channel,
            CommandKind::Force => Quantity::Force,
            CommandKind::Torque => Quantity::Torque,
            CommandKind::WheelSpeed if self.radius_m.is_some() => Quantity::AngleRate,
            CommandKind::WheelSpeed => Quantity::Speed,
        }
    }

    /// Returns the factor from SI to what is asked of each kilogram, or to the speed that is asked for.
    pub(crate) fn factor(self, mass: f64) -> f64 {
        match self.kind {
            CommandKind::Accel | CommandKind::Pedal => 1.0,
            CommandKind::Force => 1.0 / mass,
            CommandKind::Torque => self.ratio.unwrap_or(1.0) / (self.radius_m.unwrap_or(1.0) * mass),
            CommandKind::WheelSpeed => self.radius_m.unwrap_or(1.0),
        }
    }
}
