//! One signal that a law reads, in some shape and clamped to a range: where its value comes from, along a drive or at a moment.

use super::LawError;
use crate::signal;

/// A signal that a law may read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Source {
    Delta,
    DeltaRate,
    Accel,
    Time,
    Path,
    Speed,
    Forward,
    Left,
    YawRate,
    SlipFront,
    SlipRear,
    Gap,
    Closing,
    LeadSpeed,
}

pub(super) const SOURCES: [(Source, &str); 14] = [
    (Source::Delta, "delta"),
    (Source::DeltaRate, "delta_rate"),
    (Source::Accel, "accel"),
    (Source::Time, "t"),
    (Source::Path, "s"),
    (Source::Speed, "v"),
    (Source::Forward, "ax"),
    (Source::Left, "ay"),
    (Source::YawRate, "yaw_rate"),
    (Source::SlipFront, "slip_front"),
    (Source::SlipRear, "slip_rear"),
    (Source::Gap, "gap"),
    (Source::Closing, "dv"),
    (Source::LeadSpeed, "v_lead"),
];

/// Time over which the rate of the steering angle is taken, s.
const RATE_SECS: f64 = 0.05;
/// Longest delay or lag, s, and largest width or threshold.
const LONGEST_SECS: f64 = 5.0;
const WIDEST: f64 = 1e4;

impl Source {
    /// Tells whether it is known along the whole drive before the car moves.
    pub(super) fn is_known(self) -> bool {
        matches!(self, Self::Delta | Self::DeltaRate | Self::Accel | Self::Time | Self::Path)
    }

    /// Returns the size below which its sign fades, in its unit.
    pub(super) fn least(self) -> f64 {
        match self {
            Self::Delta | Self::SlipFront | Self::SlipRear => 1e-3,
            Self::DeltaRate | Self::YawRate => 0.01,
            _ => 0.1,
        }
    }
}

/// What is done to a signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Shape {
    Plain,
    Abs,
    /// x / sqrt(x² + ε²), ε a size below which the sign tells nothing.
    Sign,
    /// max(x - w, 0) and min(x + w, 0).
    Above(f64),
    Below(f64),
    /// x(t - T), and what it is more than x(t).
    Delay(f64),
    Late(f64),
    /// x behind a first-order lag, less x(t).
    Slow(f64),
    /// x behind play of total width w, and what it is more than x.
    Play(f64),
    Slack(f64),
}

pub(super) const SHAPES: [&str; 9] = ["abs", "sign", "pos", "neg", "delay", "late", "slow", "play", "slack"];

impl Shape {
    pub(super) fn named(name: &str, number: Option<f64>) -> Option<Self> {
        Some(match (name, number) {
            ("abs", None) => Self::Abs,
            ("sign", None) => Self::Sign,
            ("pos", w) => Self::Above(w.unwrap_or(0.0)),
            ("neg", w) => Self::Below(w.unwrap_or(0.0)),
            ("delay", Some(secs)) => Self::Delay(secs),
            ("late", Some(secs)) => Self::Late(secs),
            ("slow", Some(secs)) => Self::Slow(secs),
            ("play", Some(width)) => Self::Play(width),
            ("slack", Some(width)) => Self::Slack(width),
            _ => return None,
        })
    }

    pub(super) fn text(self) -> Option<(&'static str, Option<f64>)> {
        match self {
            Self::Plain => None,
            Self::Abs => Some(("abs", None)),
            Self::Sign => Some(("sign", None)),
            Self::Above(w) => Some(("pos", (w != 0.0).then_some(w))),
            Self::Below(w) => Some(("neg", (w != 0.0).then_some(w))),
            Self::Delay(secs) => Some(("delay", Some(secs))),
            Self::Late(secs) => Some(("late", Some(secs))),
            Self::Slow(secs) => Some(("slow", Some(secs))),
            Self::Play(width) => Some(("play", Some(width))),
            Self::Slack(width) => Some(("slack", Some(width))),
        }
    }

    /// Tells whether it needs the past of its signal.
    pub(super) fn remembers(self) -> bool {
        matches!(self, Self::Delay(_) | Self::Late(_) | Self::Slow(_) | Self::Play(_) | Self::Slack(_))
    }

    pub(super) fn longest(self) -> f64 {
        if matches!(self, Self::Delay(_) | Self::Late(_) | Self::Slow(_)) { LONGEST_SECS } else { WIDEST }
    }

    /// Returns the value of a shape without memory.
    pub(super) fn of(self, value: f64, source: Source) -> f64 {
        match self {
            Self::Abs => value.abs(),
            Self::Sign => value / value.hypot(source.least()),
            Self::Above(w) => (value - w).max(0.0),
            Self::Below(w) => (value + w).min(0.0),
            _ => value,
        }
    }

    /// Changes a whole signal.
    pub(super) fn along(self, signal: &mut [f64], source: Source, step_secs: f64) {
        let plain = matches!(self, Self::Late(_) | Self::Slow(_) | Self::Slack(_)).then(|| signal.to_vec());
        match self {
            Self::Delay(secs) | Self::Late(secs) => signal::delay(signal, step_secs, secs),
            Self::Slow(secs) => signal::lag(signal, step_secs, secs),
            Self::Play(width) | Self::Slack(width) => signal::play(signal, width),
            _ => signal.iter_mut().for_each(|value| *value = self.of(*value, source)),
        }
        if let Some(plain) = plain {
            signal.iter_mut().zip(plain).for_each(|(value, x)| *value -= x);
        }
    }
}

/// A signal in some shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reading {
    pub(super) shape: Shape,
    pub(super) source: Source,
    pub(super) domain: Option<[f64; 2]>,
}

/// What is known before the car moves, along an even grid from the start of the drive.
#[derive(Debug, Clone, Copy)]
pub struct Sources<'a> {
    /// Step of the grid, s.
    pub step_secs: f64,
    /// Road-wheel angle that the actuator makes of the command, rad.
    pub delta: &'a [f64],
    /// Force over nominal mass that drive and brakes make of the request, m/s².
    pub accel: &'a [f64],
    /// Recorded speed, m/s.
    pub speed: &'a [f64],
}

/// What the car feels at a moment.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Felt {
    /// Speed, m/s.
    pub v: f64,
    /// Specific force forward, m/s².
    pub ax: f64,
    /// Specific force to the left, m/s².
    pub ay: f64,
    /// rad/s.
    pub yaw_rate: f64,
    /// Slip angles that the tyres have built up, rad.
    pub slip_front: f64,
    /// See `slip_front`.
    pub slip_rear: f64,
    /// Gap to the vehicle ahead, m; of followers alone.
    pub gap: f64,
    /// Its speed less the own, m/s.
    pub dv: f64,
    /// Its speed, m/s.
    pub v_lead: f64,
}

impl Felt {
    pub(super) fn of(&self, source: Source) -> f64 {
        match source {
            Source::Speed => self.v,
            Source::Forward => self.ax,
            Source::Left => self.ay,
            Source::YawRate => self.yaw_rate,
            Source::SlipFront => self.slip_front,
            Source::SlipRear => self.slip_rear,
            Source::Gap => self.gap,
            Source::Closing => self.dv,
            Source::LeadSpeed => self.v_lead,
            Source::Delta | Source::DeltaRate | Source::Accel | Source::Time | Source::Path => 1.0,
        }
    }
}

impl Reading {
    pub(super) fn clamp(&self, value: f64) -> f64 {
        self.domain.map_or(value, |[low, high]| value.clamp(low, high))
    }

    pub(super) fn along(&self, sources: &Sources<'_>) -> Vec<f64> {
        let step = sources.step_secs;
        let mut signal: Vec<f64> = match self.source {
            Source::Delta => sources.delta.to_vec(),
            Source::DeltaRate => rate(sources.delta, step),
            Source::Accel => sources.accel.to_vec(),
            Source::Time => (0..sources.delta.len()).map(|k| k as f64 * step).collect(),
            _ => sources
                .speed
                .iter()
                .scan(0.0, |path, v| {
                    let before = *path;
                    *path += v * step;
                    Some(before)
                })
                .collect(),
        };
        signal.iter_mut().for_each(|value| *value = self.clamp(*value));
        self.shape.along(&mut signal, self.source, step);
        signal
    }
}

fn rate(signal: &[f64], step_secs: f64) -> Vec<f64> {
    let back = ((RATE_SECS / step_secs).round() as usize).max(1);
    (0..signal.len()).map(|k| (signal[k] - signal[k.saturating_sub(back)]) / (back as f64 * step_secs)).collect()
}

pub(super) fn name_of(source: Source) -> &'static str {
    SOURCES.iter().find(|(s, _)| *s == source).map_or("", |found| found.1)
}

pub(super) fn number_of(text: &str) -> Result<f64, LawError> {
    let number = text.trim().parse().ok().filter(|value: &f64| value.is_finite());
    number.ok_or_else(|| LawError::Number(text.to_owned()))
}

pub(super) fn reading(shape: Shape, text: &str) -> Result<Reading, LawError> {
    let (name, domain) = match text.strip_suffix(']').and_then(|t| t.split_once('[')) {
        Some((name, ends)) => {
            let (low, high) = ends.split_once(';').ok_or_else(|| LawError::Domain(name.to_owned()))?;
            let (low, high) = (number_of(low)?, number_of(high)?);
            if low > high {
                return Err(LawError::Domain(name.to_owned()));
            }
            (name, Some([low, high]))
        }
        None => (text, None),
    };
    let found = SOURCES.iter().find(|(_, n)| *n == name.trim());
    let (source, _) = found.ok_or_else(|| LawError::Word(text.to_owned()))?;
    Ok(Reading { shape, source: *source, domain })
}
