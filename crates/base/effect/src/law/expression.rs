//! Products of declared primitives, their text and their values. Knots of a table are primitives as well: the sum of hats, each times
//! its own coefficient, is a curve that runs straight from one to the next.
//!
//! Some signals are known before the car moves (what it is asked for, the time): they have a past, so that delays and play can
//! be taken of them along the whole drive. The others are what the car feels at the moment.

use super::LawError;
use super::reading::{Felt, Reading, SHAPES, SOURCES, Shape, Sources, hat, knots, name_of, number_of, reading};

/// Highest frequency, Hz.
const FASTEST_HZ: f64 = 50.0;

/// One primitive.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Factor {
    /// A signal in some shape, clamped to a range.
    Of(Reading),
    /// A line of the spectrum, by its frequency in Hz.
    Sin(f64),
    /// The same a quarter of a period earlier.
    Cos(f64),
    /// Triangular pulses: the instant of the first, the time between two, half the width of one; s.
    Pulses([f64; 3]),
    /// A period, s, and three shares of it as of a hat, the first from −1 on: one knot of a table over the phase.
    Beat(f64, [f64; 3]),
}

impl Factor {
    fn known(&self, sources: &Sources<'_>) -> Option<Vec<f64>> {
        let wave = |hz: f64, of: fn(f64) -> f64| {
            let at = |k: usize| of(std::f64::consts::TAU * hz * k as f64 * sources.step_secs);
            Some((0..sources.delta.len()).map(at).collect())
        };
        match self {
            Self::Of(reading) => reading.source.is_known().then(|| reading.along(sources)),
            Self::Sin(hz) => wave(*hz, f64::sin),
            Self::Cos(hz) => wave(*hz, f64::cos),
            Self::Pulses([first, every, half]) => {
                let pulse = |k: usize| {
                    let secs = k as f64 * sources.step_secs - first;
                    (1.0 - (secs - (secs / every).round().max(0.0) * every).abs() / half).max(0.0)
                };
                Some((0..sources.delta.len()).map(pulse).collect())
            }
            Self::Beat(period, shares) => {
                let beat = |k: usize| {
                    let phase = (k as f64 * sources.step_secs / period).fract();
                    hat(phase, *shares).max(hat(phase - 1.0, *shares))
                };
                Some((0..sources.delta.len()).map(beat).collect())
            }
        }
    }

    fn felt(&self, felt: &Felt) -> f64 {
        match self {
            Self::Of(r) if !r.source.is_known() => r.shape.of(r.clamp(felt.of(r.source)), r.source),
            _ => 1.0,
        }
    }
}

/// A product of primitives; 1 where there are none.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Expression {
    factors: Vec<Factor>,
}

impl Expression {
    /// Returns triangular pulses: the instant of the first, the time between two, half the width of one; s.
    #[must_use]
    pub fn pulses(first_secs: f64, every_secs: f64, half_secs: f64) -> Self {
        Self { factors: vec![Factor::Pulses([first_secs, every_secs, half_secs])] }
    }

    /// Returns the expression times another one.
    #[must_use]
    pub fn times(&self, other: &Self) -> Self {
        Self { factors: [self.factors.as_slice(), &other.factors].concat() }
    }

    /// Reads a product, `delta*abs(ay)`.
    ///
    /// # Errors
    /// [`LawError`] names what is not declared.
    pub fn parse(text: &str) -> Result<Self, LawError> {
        let words = text.split('*').map(str::trim).filter(|word| *word != "1");
        Ok(Self { factors: words.map(factor).collect::<Result<_, _>>()? })
    }

    /// Returns the expression with every signal clamped to the range that `domain` gives for its name.
    #[must_use]
    pub fn within(&self, domain: impl Fn(&str) -> Option<[f64; 2]>) -> Self {
        let mut factors = self.factors.clone();
        for factor in &mut factors {
            if let Factor::Of(reading) = factor
                && !matches!(reading.shape, Shape::Hat(_))
            {
                reading.domain = domain(name_of(reading.source)).or(reading.domain);
            }
        }
        Self { factors }
    }

    /// Returns the expression with its inner numbers (delays, widths, frequencies) times a factor, to four digits; `None` where
    /// it has none.
    #[must_use]
    pub fn stretched(&self, factor: f64) -> Option<Self> {
        let mut changed = self.clone();
        let mut any = false;
        for part in &mut changed.factors {
            let number = match part {
                Factor::Sin(hz) | Factor::Cos(hz) => Some(hz),
                Factor::Pulses(_) | Factor::Beat(..) => None,
                Factor::Of(reading) => match &mut reading.shape {
                    Shape::Plain | Shape::Abs | Shape::Sign | Shape::Hat(_) => None,
                    Shape::Above(w) | Shape::Below(w) => (*w != 0.0).then_some(w),
                    Shape::Delay(n) | Shape::Late(n) | Shape::Slow(n) | Shape::Rise(n) | Shape::Fall(n) => Some(n),
                    Shape::Ring(n) | Shape::Play(n) | Shape::Slack(n) | Shape::Stick(n) => Some(n),
                },
            };
            number.into_iter().for_each(|n| (*n, any) = (written(*n * factor), true));
        }
        any.then_some(changed)
    }

    /// Returns the signal that the table runs over of which it is a knot: `t` of one over a phase; none if it is no knot.
    #[must_use]
    pub fn knot_of(&self) -> Option<&'static str> {
        self.factors.iter().find_map(|factor| match factor {
            Factor::Of(reading) => matches!(reading.shape, Shape::Hat(_)).then(|| name_of(reading.source)),
            Factor::Beat(..) => Some("t"),
            Factor::Sin(_) | Factor::Cos(_) | Factor::Pulses(_) => None,
        })
    }

    /// Returns the names of the signals that it reads and the ranges to which they are clamped, or beyond which a knot is nil.
    pub(super) fn domains(&self) -> Vec<(&'static str, Option<[f64; 2]>)> {
        let named = |factor: &Factor| match factor {
            Factor::Of(reading) => Some((name_of(reading.source), reading.shape.within().or(reading.domain))),
            Factor::Sin(_) | Factor::Cos(_) | Factor::Pulses(_) | Factor::Beat(..) => None,
        };
        self.factors.iter().filter_map(named).collect()
    }

    /// Tells whether it is a matter of time by itself.
    #[must_use]
    pub fn oscillates(&self) -> bool {
        self.factors.iter().any(|factor| !matches!(factor, Factor::Of(_)))
    }

    /// Returns the text without the ranges.
    #[must_use]
    pub fn bare(&self) -> String {
        let mut bare = self.clone();
        for factor in &mut bare.factors {
            if let Factor::Of(reading) = factor {
                reading.domain = None;
            }
        }
        bare.to_string()
    }

    /// Returns the part that is known before the car moves; empty where that is 1.
    #[must_use]
    pub fn known(&self, sources: &Sources<'_>) -> Vec<f64> {
        let mut all = self.factors.iter().filter_map(|factor| factor.known(sources));
        let Some(mut product) = all.next() else { return Vec::new() };
        for signal in all {
            product.iter_mut().zip(signal).for_each(|(p, s)| *p *= s);
        }
        product
    }

    /// Returns the part that depends on what the car feels.
    #[must_use]
    pub fn felt(&self, felt: &Felt) -> f64 {
        self.factors.iter().map(|factor| factor.felt(felt)).product()
    }
}

/// Returns a number to four digits.
fn written(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

impl std::fmt::Display for Expression {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.factors.is_empty() {
            return f.write_str("1");
        }
        for (k, factor) in self.factors.iter().enumerate() {
            if k > 0 {
                f.write_str("*")?;
            }
            match factor {
                Factor::Sin(hz) => write!(f, "sin({hz})")?,
                Factor::Cos(hz) => write!(f, "cos({hz})")?,
                Factor::Pulses([first, every, half]) => write!(f, "pulses({first};{every};{half})")?,
                Factor::Beat(period, [low, middle, high]) => write!(f, "beat({period};{low};{middle};{high})")?,
                Factor::Of(reading) => {
                    let domain = reading.domain.map_or_else(String::new, |[low, high]| format!("[{low};{high}]"));
                    let [before, behind] = reading.shape.text();
                    write!(f, "{before}{}{domain}{behind}", name_of(reading.source))?;
                }
            }
        }
        Ok(())
    }
}

/// Returns every word of the grammar.
pub(super) fn words() -> Vec<&'static str> {
    SOURCES.iter().map(|s| s.1).chain(SHAPES).chain(["sin", "cos", "pulses", "beat"]).collect()
}

/// Splits a sum into summands with their signs.
pub(super) fn summands(text: &str) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    let mut depth = 0;
    let mut before = ' ';
    for c in text.chars().filter(|c| !c.is_whitespace()) {
        match c {
            '(' | '[' => depth += 1,
            ')' | ']' => depth -= 1,
            _ => {}
        }
        let starts = depth == 0 && (c == '+' || c == '-') && !matches!(before, 'e' | 'E' | '*');
        if starts || out.is_empty() {
            out.push(String::new());
        }
        if let Some(last) = out.last_mut() {
            last.push(c);
        }
        before = c;
    }
    out
}

/// Reads a coefficient and what it multiplies.
pub(super) fn summand(text: &str) -> Result<(f64, Expression), LawError> {
    let (number, rest) = text.split_once('*').unwrap_or((text, "1"));
    Ok((number_of(number)?, Expression::parse(rest)?))
}

fn factor(word: &str) -> Result<Factor, LawError> {
    let unknown = || LawError::Word(word.to_owned());
    let Some((name, inner)) = word.strip_suffix(')').and_then(|w| w.split_once('(')) else {
        return Ok(Factor::Of(reading(Shape::Plain, word)?));
    };
    if let "sin" | "cos" = name {
        let hz = number_of(inner)?;
        if !(0.0..=FASTEST_HZ).contains(&hz) {
            return Err(LawError::Number(inner.to_owned()));
        }
        return Ok(if name == "sin" { Factor::Sin(hz) } else { Factor::Cos(hz) });
    }
    if name == "pulses" {
        let numbers = inner.split(';').map(number_of).collect::<Result<Vec<f64>, _>>()?;
        let numbers: [f64; 3] = numbers.try_into().ok().ok_or_else(unknown)?;
        let sound = numbers[0] >= 0.0 && numbers[1] > 0.0 && numbers[2] > 0.0;
        return if sound { Ok(Factor::Pulses(numbers)) } else { Err(LawError::Number(inner.to_owned())) };
    }
    if let "hat" | "beat" = name {
        let parts: Vec<&str> = inner.split(';').collect();
        let [first, values @ ..] = parts.as_slice() else { return Err(unknown()) };
        let knots = knots(values)?;
        if name == "hat" {
            return Ok(Factor::Of(reading(Shape::Hat(knots), first)?));
        }
        let period = number_of(first)?;
        let sound = period >= 1.0 / FASTEST_HZ && knots[0] >= -1.0 && knots[2] <= 1.0;
        return if sound { Ok(Factor::Beat(period, knots)) } else { Err(LawError::Number(inner.to_owned())) };
    }
    let (signal, number) = match inner.rsplit_once(',') {
        Some((signal, number)) => (signal, Some(number_of(number)?)),
        None => (inner, None),
    };
    let shape = Shape::named(name, number).ok_or_else(unknown)?;
    if number.is_some_and(|n| !(0.0..=shape.longest()).contains(&n)) {
        return Err(LawError::Number(inner.to_owned()));
    }
    let reading = reading(shape, signal)?;
    if shape.remembers() && !reading.source.is_known() {
        return Err(unknown());
    }
    Ok(Factor::Of(reading))
}
