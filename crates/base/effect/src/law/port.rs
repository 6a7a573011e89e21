//! Points of the loop at which a law may act.

use super::LawError;
use crate::Channel;

/// A point of the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Port {
    /// Road-wheel angle at the actuator, which its position sensor sees, rad.
    Steering,
    /// Road-wheel angle behind the position sensor, rad.
    Linkage,
    /// Force along the car over nominal mass, m/s².
    Drive,
    /// Side force of the front axle, to the left, N.
    Front,
    /// Side force of the rear axle, to the left, N.
    Rear,
    /// Yaw moment on the body, counter-clockwise, N m.
    Yaw,
    /// Side force on the body at its centre of gravity, to the left, N.
    Side,
    /// The reading of a channel, in its unit; of a position east and north, m.
    Sensor(Channel),
    /// Acceleration of following vehicles, m/s².
    Follower,
}

/// Channels whose readings a law may change.
const SENSORS: [Channel; 9] = [
    Channel::Dx,
    Channel::Dy,
    Channel::Dyaw,
    Channel::Speed,
    Channel::YawRate,
    Channel::Ax,
    Channel::Ay,
    Channel::SteerMeas,
    Channel::WheelSpeed,
];

impl Port {
    /// Returns every port.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let mut all = vec![Self::Steering, Self::Linkage, Self::Drive, Self::Front, Self::Rear, Self::Yaw, Self::Side];
        all.extend(SENSORS.map(Self::Sensor));
        all.push(Self::Follower);
        all
    }

    /// Returns its name in laws.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Steering => "steering".to_owned(),
            Self::Linkage => "steering.linkage".to_owned(),
            Self::Drive => "drive".to_owned(),
            Self::Front => "lateral.front".to_owned(),
            Self::Rear => "lateral.rear".to_owned(),
            Self::Yaw => "lateral.body.yaw".to_owned(),
            Self::Side => "lateral.body.side".to_owned(),
            Self::Sensor(channel) => format!("sensor.{}", sensor(channel)),
            Self::Follower => "follower".to_owned(),
        }
    }

    /// Returns the name of the point of the loop in a diagnosis: one for the steering, one for both forces on the body.
    #[must_use]
    pub fn insertion(self) -> String {
        match self {
            Self::Linkage => Self::Steering.name(),
            Self::Yaw | Self::Side => "lateral.body".to_owned(),
            other => other.name(),
        }
    }

    /// Returns the unit of what is added.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Self::Steering | Self::Linkage | Self::Sensor(Channel::Dyaw | Channel::SteerMeas) => "rad",
            Self::Front | Self::Rear | Self::Side => "N",
            Self::Yaw => "N m",
            Self::Sensor(Channel::YawRate) => "rad/s",
            Self::Sensor(Channel::Dx | Channel::Dy) => "m",
            Self::Sensor(Channel::Ax | Channel::Ay) | Self::Drive | Self::Follower => "m/s²",
            Self::Sensor(_) => "m/s",
        }
    }

    /// Reads a name.
    ///
    /// # Errors
    /// If no port has it.
    pub fn parse(name: &str) -> Result<Self, LawError> {
        Self::all().into_iter().find(|port| port.name() == name).ok_or_else(|| LawError::Port(name.to_owned()))
    }
}

/// Returns the name of a sensor's column in a log.
fn sensor(channel: Channel) -> &'static str {
    match channel {
        Channel::Dx => "x",
        Channel::Dy => "y",
        Channel::Dyaw => "yaw",
        other => other.name(),
    }
}

/// Returns the names of all ports.
pub(super) fn names() -> Vec<String> {
    Port::all().into_iter().map(Port::name).collect()
}
