//! What the name of a column says: the channel by its words, and the unit by its end or by what stands in brackets.

use super::candidates::{SPEED, by_words, words};
use crate::channel::{Quantity, find, seconds};

/// Signs for units in headers, and the unit that a mapping calls so; one sign may stand for several.
const SIGNS: &[(&str, &str)] = &[
    ("°", "deg"),
    ("degree", "deg"),
    ("degrees", "deg"),
    ("radians", "rad"),
    ("mrad", "mrad"),
    ("rads", "rad/s"),
    ("radps", "rad/s"),
    ("rad/sec", "rad/s"),
    ("1/s", "rad/s"),
    ("degs", "deg/s"),
    ("degps", "deg/s"),
    ("dps", "deg/s"),
    ("°/s", "deg/s"),
    ("deg/sec", "deg/s"),
    ("rpm", "rpm"),
    ("metres", "m"),
    ("meters", "m"),
    ("kmh", "km/h"),
    ("kph", "km/h"),
    ("kmph", "km/h"),
    ("km/hr", "km/h"),
    ("mps", "m/s"),
    ("ms", "ms"),
    ("ms", "m/s"),
    ("m/sec", "m/s"),
    ("mph", "mph"),
    ("mps2", "m/s2"),
    ("ms2", "m/s2"),
    ("m/s²", "m/s2"),
    ("m/s/s", "m/s2"),
    ("m/s**2", "m/s2"),
    ("sec", "s"),
    ("secs", "s"),
    ("seconds", "s"),
    ("msec", "ms"),
    ("millis", "ms"),
    ("µs", "us"),
    ("usec", "us"),
    ("micros", "us"),
    ("nanos", "ns"),
    ("nm", "N m"),
];
/// Units that are written as a mapping calls them.
const PLAIN: &[&str] = &[
    "rad", "deg", "mrad", "rad/s", "deg/s", "mrad/s", "rpm", "m", "cm", "mm", "km", "m/s", "km/h", "mph", "mm/s",
    "m/s2", "m/s^2", "g", "mg", "N", "kN", "N m", "s", "ms", "us", "ns", "%",
];
/// Words of columns that tell of a measurement and are none.
const BESIDE: &[&str] = &[
    "std",
    "stddev",
    "sigma",
    "cov",
    "covariance",
    "error",
    "err",
    "status",
    "valid",
    "flag",
    "quality",
    "accuracy",
    "torque",
    "current",
    "temperature",
    "temp",
    "voltage",
    "count",
    "counter",
    "age",
    "limit",
    "ref",
    "reference",
];

/// What a column may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Meaning {
    /// Stamps.
    Time,
    /// A channel.
    Channel(&'static str),
    /// Degrees north.
    Latitude,
    /// Degrees east.
    Longitude,
    /// What a pedal does, which cannot be read.
    Pedal,
}

/// What the name of a column says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Told {
    /// What it may be.
    pub meaning: Meaning,
    /// Its unit as a mapping calls it, where the header says one that the meaning can have.
    pub unit: Option<&'static str>,
    /// The unit of the header where the meaning cannot have it.
    pub strange: Option<String>,
    /// Its words without the unit.
    pub words: Vec<String>,
    /// Further entries of the mapping.
    pub more: &'static str,
}

/// Reads the name of a column, and the cell below it where a line of units follows the names; `None` where it says nothing.
pub(super) fn told(name: &str, below: &str) -> Option<Told> {
    let (bare, bracketed) = bracketed(name);
    let said = [bracketed.as_str(), below.trim_matches(|c| "[]() ".contains(c))];
    let said = said.into_iter().find(|text| !text.is_empty() && is_unit(text)).map(str::to_owned);
    let mut words = words(&bare);
    // the longest end that is a unit, but never all of a name
    let end = (1..words.len().min(4)).rev().find(|count| is_unit(&words[words.len() - count..].concat()));
    let end = end.map(|count| words.split_off(words.len() - count).concat());
    if said.is_none() {
        words.extend(self::words(&bracketed));
    }
    let sign = said.or(end);
    let meaning = meaning(&words)?;
    let more = by_words(&words).filter(|(channel, _)| meaning == Meaning::Channel(channel)).map_or("", |said| said.1);
    let unit = sign.as_deref().and_then(|sign| known(sign, meaning, more));
    Some(Told { meaning, unit, strange: sign.filter(|_| unit.is_none()), words, more })
}

/// Splits `name [unit]` and `name (unit)`.
fn bracketed(name: &str) -> (String, String) {
    let open = name.find(['[', '(']);
    let close = open.and_then(|open| Some((open, open + name[open..].find([']', ')'])?)));
    close.map_or((name.to_owned(), String::new()), |(open, close)| {
        (format!("{}{}", &name[..open], &name[close + 1..]), name[open + 1..close].trim().to_owned())
    })
}

fn same(sign: &str, unit: &str) -> bool {
    sign.replace([' ', '·'], "").eq_ignore_ascii_case(&unit.replace(' ', ""))
}

/// Tells whether a text is a sign for a unit.
pub(super) fn is_unit(text: &str) -> bool {
    SIGNS.iter().map(|(sign, _)| sign).chain(PLAIN).any(|sign| same(text, sign))
}

/// Returns what a mapping calls a unit, if what is meant can have it.
fn known(sign: &str, meaning: Meaning, more: &str) -> Option<&'static str> {
    let fits = |unit: &&str| match meaning {
        Meaning::Time => seconds(unit).is_some(),
        Meaning::Channel("cmd_accel") if more.contains("force") => Quantity::Force.factor(unit).is_some(),
        Meaning::Channel("cmd_accel") if more == SPEED => Quantity::Speed.factor(unit).is_some(),
        Meaning::Channel(name) => find(name).is_some_and(|channel| channel.quantity.factor(unit).is_some()),
        Meaning::Latitude | Meaning::Longitude => *unit == "deg",
        Meaning::Pedal => true,
    };
    let plain = PLAIN.iter().filter(|unit| same(sign, unit)).copied();
    let signs = SIGNS.iter().filter(|(known, _)| same(sign, known)).map(|(_, unit)| *unit);
    plain.chain(signs).find(fits)
}

fn meaning(words: &[String]) -> Option<Meaning> {
    let any = |sought: &[&str]| words.iter().any(|word| sought.contains(&word.as_str()));
    let only = |sought: &[&str]| words.len() == 1 && any(sought);
    let joined = words.concat();
    let is = |sought: &[&str]| sought.contains(&joined.as_str());
    let acceleration = any(&["acc", "accel", "acceleration"]) || words.first().is_some_and(|word| word == "a");
    if any(BESIDE) {
        return None;
    }
    if any(&["time", "timestamp", "stamp", "utime", "elapsed"]) || only(&["t", "ts"]) {
        return Some(Meaning::Time);
    }
    if any(&["pedal", "throttle", "brake", "gas"]) {
        return Some(Meaning::Pedal);
    }
    if !acceleration && any(&["lat", "latitude"]) {
        return Some(Meaning::Latitude);
    }
    if !acceleration && any(&["lon", "lng", "longitude"]) {
        return Some(Meaning::Longitude);
    }
    let turning = any(&["rate", "velocity", "speed", "vel"]);
    let of_commands = by_words(words).map(|(channel, _)| channel).filter(|channel| channel.starts_with("cmd_"));
    let channel = of_commands.or_else(|| {
        Some(match () {
            () if any(&["cmd", "command", "target", "desired", "request", "setpoint"]) => return None,
            () if is(&["yawrate", "psidot", "gyroz", "omegaz", "wz"]) => "yaw_rate",
            () if is(&["ax"]) || acceleration && any(&["x", "long", "lon", "longitudinal", "forward"]) => "ax",
            () if is(&["ay"]) || acceleration && any(&["y", "lat", "lateral", "left"]) => "ay",
            () if acceleration => return None,
            () if any(&["yaw", "heading", "psi", "course", "azimuth", "bearing"]) && !turning => "yaw",
            () if any(&["easting", "east"]) && !turning || is(&["x", "xpos", "posx", "positionx"]) => "x",
            () if any(&["northing", "north"]) && !turning || is(&["y", "ypos", "posy", "positiony"]) => "y",
            () if is(&["v", "vx", "velx", "speedx"]) => "v",
            () if is(&["delta", "swa", "steer"]) => "steer_meas",
            () if any(&["wheelspeed", "wheelspeeds"]) || is(&["vwheel", "wheelv"]) => "v_wheel",
            () => by_words(words)?.0,
        })
    });
    channel.map(Meaning::Channel)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_says_channel_and_unit() {
        for (name, below, channel, unit) in [
            ("speed_kmh", "", "v", Some("km/h")),
            ("Speed [m/s]", "", "v", Some("m/s")),
            ("v_ms", "", "v", Some("m/s")),
            ("VehicleSpeed", "km/h", "v", Some("km/h")),
            ("steering_wheel_deg", "", "steer_meas", Some("deg")),
            ("steering_wheel_angle (°)", "", "steer_meas", Some("deg")),
            ("cmd_steer_rad", "", "cmd_steer", Some("rad")),
            ("steering_command", "", "cmd_steer", None),
            ("requested_acceleration_mps2", "", "cmd_accel", Some("m/s2")),
            ("ax_g", "", "ax", Some("g")),
            ("a_y [m/s²]", "", "ay", Some("m/s2")),
            ("acc_lat", "[g]", "ay", Some("g")),
            ("longitudinal_acceleration", "", "ax", None),
            ("yaw_rate_deg_s", "", "yaw_rate", Some("deg/s")),
            ("GyroZ", "rad/s", "yaw_rate", Some("rad/s")),
            ("heading_deg", "", "yaw", Some("deg")),
            ("x", "", "x", None),
            ("pos_y_m", "", "y", Some("m")),
            ("wheel_speed_fl_kmh", "", "v_wheel", Some("km/h")),
            ("v_wheel", "", "v_wheel", None),
        ] {
            let told = told(name, below).unwrap_or_else(|| panic!("{name} says nothing"));
            assert_eq!((told.meaning, told.unit), (Meaning::Channel(channel), unit), "{name}: {told:?}");
        }
        let meant = |name: &str| told(name, "").map(|told| (told.meaning, told.unit));
        assert_eq!(meant("time_ms"), Some((Meaning::Time, Some("ms"))));
        assert_eq!(meant("t"), Some((Meaning::Time, None)));
        assert_eq!(meant("lat"), Some((Meaning::Latitude, None)));
        assert_eq!(meant("gps_longitude [deg]"), Some((Meaning::Longitude, Some("deg"))));
        assert_eq!(meant("throttle_pct").map(|m| m.0), Some(Meaning::Pedal));
        for name in ["battery", "steering_torque", "speed_std", "heading_error", "", "acc_z", "gear", "steering_rate"] {
            assert_eq!(meant(name), None, "{name}");
        }
        assert_eq!(told("speed_deg", "").expect("a speed").strange.as_deref(), Some("deg"));
    }
}
