//! The channels of the practice schema and the units in which logs write them.

/// What a channel measures; says which units are its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Quantity {
    /// Radians.
    Angle,
    /// Radians per second.
    AngleRate,
    /// Metres.
    Length,
    /// Metres per second.
    Speed,
    /// Metres per second squared.
    Acceleration,
    /// Newtons.
    Force,
    /// Newton metres.
    Torque,
}

/// A channel of the practice schema.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Channel {
    /// Name of its column.
    pub name: &'static str,
    /// What it measures.
    pub quantity: Quantity,
    /// Decimal places in a case folder, finer than any sensor of that kind.
    pub places: usize,
}

const fn channel(name: &'static str, quantity: Quantity, places: usize) -> Channel {
    Channel { name, quantity, places }
}

/// Every channel in the order of the practice files.
pub(crate) const CHANNELS: [Channel; 11] = [
    channel("cmd_steer", Quantity::Angle, 6),
    channel("cmd_accel", Quantity::Acceleration, 4),
    channel("x", Quantity::Length, 4),
    channel("y", Quantity::Length, 4),
    channel("yaw", Quantity::Angle, 5),
    channel("v", Quantity::Speed, 4),
    channel("yaw_rate", Quantity::AngleRate, 5),
    channel("ax", Quantity::Acceleration, 4),
    channel("ay", Quantity::Acceleration, 4),
    channel("steer_meas", Quantity::Angle, 6),
    channel("v_wheel", Quantity::Speed, 4),
];

/// Channels without which nothing can be simulated.
pub(crate) const COMMANDS: [&str; 2] = ["cmd_steer", "cmd_accel"];

/// Returns the channel of a name.
pub(crate) fn find(name: &str) -> Option<Channel> {
    CHANNELS.into_iter().find(|c| c.name == name)
}

impl Quantity {
    /// Returns the factor from a unit to SI; `None` if the quantity is not written in that unit.
    pub(crate) fn factor(self, unit: &str) -> Option<f64> {
        let degree = std::f64::consts::PI / 180.0;
        let own = match self {
            Self::Angle => [("rad", 1.0), ("deg", degree), ("mrad", 1e-3), ("turn", 360.0 * degree)],
            Self::AngleRate => [("rad/s", 1.0), ("deg/s", degree), ("mrad/s", 1e-3), ("rpm", 6.0 * degree)],
            Self::Length => [("m", 1.0), ("cm", 0.01), ("mm", 1e-3), ("km", 1e3)],
            Self::Speed => [("m/s", 1.0), ("km/h", 1.0 / 3.6), ("mph", 0.447_04), ("mm/s", 1e-3)],
            Self::Acceleration => [("m/s2", 1.0), ("m/s^2", 1.0), ("g", 9.806_65), ("mg", 9.806_65e-3)],
            Self::Force => [("N", 1.0), ("kN", 1e3), ("kgf", 9.806_65), ("lbf", 4.448_222)],
            Self::Torque => [("N m", 1.0), ("Nm", 1.0), ("kN m", 1e3), ("lbf ft", 1.355_818)],
        };
        // a plain number (normalised command, volts, counts) becomes SI by `scale` alone
        let plain = [("1", 1.0), ("%", 0.01)];
        own.into_iter().chain(plain).find(|(name, _)| *name == unit).map(|(_, factor)| factor)
    }

    /// Returns the SI unit.
    pub(crate) const fn unit(self) -> &'static str {
        match self {
            Self::Angle => "rad",
            Self::AngleRate => "rad/s",
            Self::Length => "m",
            Self::Speed => "m/s",
            Self::Acceleration => "m/s2",
            Self::Force => "N",
            Self::Torque => "N m",
        }
    }
}

/// Returns the length of a time unit in seconds.
pub(crate) fn seconds(unit: &str) -> Option<f64> {
    [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)].into_iter().find(|(name, _)| *name == unit).map(|(_, s)| s)
}
