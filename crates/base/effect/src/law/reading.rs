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
/// Share of critical damping with which what hangs in the car swings.
const RING_DAMPING: f64 = 0.15;

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
    /// x behind a lag that it has on its way up alone, or down alone, less x(t).
    Rise(f64),
    Fall(f64),
    /// What swings with a period of so many seconds and is pulled along by x, less x(t).
    Ring(f64),
    /// x behind play of total width w, and what it is more than x.
    Play(f64),
    Slack(f64),
    /// What stays where it is until x is farther off than w and then jumps there, less x.
    Stick(f64),
    /// 1 at the middle of three values, 0 beyond the outer two and even between: one knot of a table.
    Hat([f64; 3]),
}

pub(super) const SHAPES: [&str; 14] =
    ["abs", "sign", "pos", "neg", "delay", "late", "slow", "rise", "fall", "ring", "play", "slack", "stick", "hat"];

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
            ("rise", Some(secs)) => Self::Rise(secs),
            ("fall", Some(secs)) => Self::Fall(secs),
            ("ring", Some(secs)) => Self::Ring(secs),
            ("play", Some(width)) => Self::Play(width),
            ("slack", Some(width)) => Self::Slack(width),
            ("stick", Some(width)) => Self::Stick(width),
            _ => return None,
        })
    }

    /// Returns what stands before and behind the signal's name.
    pub(super) fn text(self) -> [String; 2] {
        let (name, number) = match self {
            Self::Plain => return Default::default(),
            Self::Hat([low, middle, high]) => return ["hat(".to_owned(), format!(";{low};{middle};{high})")],
            Self::Abs => ("abs", None),
            Self::Sign => ("sign", None),
            Self::Above(w) => ("pos", (w != 0.0).then_some(w)),
            Self::Below(w) => ("neg", (w != 0.0).then_some(w)),
            Self::Delay(secs) => ("delay", Some(secs)),
            Self::Late(secs) => ("late", Some(secs)),
            Self::Slow(secs) => ("slow", Some(secs)),
            Self::Rise(secs) => ("rise", Some(secs)),
            Self::Fall(secs) => ("fall", Some(secs)),
            Self::Ring(secs) => ("ring", Some(secs)),
            Self::Play(width) => ("play", Some(width)),
            Self::Slack(width) => ("slack", Some(width)),
            Self::Stick(width) => ("stick", Some(width)),
        };
        [format!("{name}("), number.map_or_else(|| ")".to_owned(), |number| format!(",{number})"))]
    }

    /// Returns the range beyond which it is nil whatever the signal.
    pub(super) fn within(self) -> Option<[f64; 2]> {
        if let Self::Hat([low, _, high]) = self { Some([low, high]) } else { None }
    }

    /// Tells whether it needs the past of its signal.
    pub(super) fn remembers(self) -> bool {
        !matches!(self, Self::Plain | Self::Abs | Self::Sign | Self::Above(_) | Self::Below(_) | Self::Hat(_))
    }

    pub(super) fn longest(self) -> f64 {
        let lasts = self.remembers() && !matches!(self, Self::Play(_) | Self::Slack(_) | Self::Stick(_));
        if lasts { LONGEST_SECS } else { WIDEST }
    }

    /// Returns the value of a shape without memory.
    pub(super) fn of(self, value: f64, source: Source) -> f64 {
        match self {
            Self::Abs => value.abs(),
            Self::Sign => value / value.hypot(source.least()),
            Self::Above(w) => (value - w).max(0.0),
            Self::Below(w) => (value + w).min(0.0),
            Self::Hat(knots) => hat(value, knots),
            _ => value,
        }
    }

    /// Changes a whole signal.
    pub(super) fn along(self, signal: &mut [f64], source: Source, step_secs: f64) {
        let plain = (self.remembers() && !matches!(self, Self::Delay(_) | Self::Play(_))).then(|| signal.to_vec());
        match self {
            Self::Delay(secs) | Self::Late(secs) => signal::delay(signal, step_secs, secs),
            Self::Slow(secs) => signal::lag(signal, step_secs, secs),
            Self::Rise(secs) | Self::Fall(secs) => {
                signal::lag_one_way(signal, step_secs, secs, matches!(self, Self::Rise(_)));
            }
            Self::Stick(width) => signal::stick(signal, width),
            Self::Ring(secs) => {
                let radian_secs = (secs / std::f64::consts::TAU).max(step_secs);
                signal::second_order(signal, step_secs, 2.0 * RING_DAMPING * radian_secs, radian_secs * radian_secs);
            }
            Self::Play(width) | Self::Slack(width) => signal::play(signal, width),
            _ => signal.iter_mut().for_each(|value| *value = self.of(*value, source)),
        }
        if let Some(plain) = plain {
            signal.iter_mut().zip(plain).for_each(|(value, x)| *value -= x);
        }
    }
}

/// Returns the height at a value of what is 1 at the middle of three and falls evenly to 0 at the outer two.
pub(super) fn hat(value: f64, [low, middle, high]: [f64; 3]) -> f64 {
    ((value - low) / (middle - low)).min((high - value) / (high - middle)).max(0.0)
}

/// Reads three values in order.
pub(super) fn knots(texts: &[&str]) -> Result<[f64; 3], LawError> {
    let numbers = texts.iter().map(|text| number_of(text)).collect::<Result<Vec<f64>, _>>()?;
    let refused = || LawError::Number(texts.join(";"));
    let knots: [f64; 3] = numbers.try_into().map_err(|_| refused())?;
    if knots[0] < knots[1] && knots[1] < knots[2] { Ok(knots) } else { Err(refused()) }
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
