//! A law that no effect of the library is: a signal, made of what the car is asked for and how it moves, that is added at one
//! point of the loop. u = Σ c · product of declared primitives, written as text: `0.02*delta*abs(ay) - 0.4*slack(delta,0.01)`.
//!
//! Text is parsed and never run. What a law reads is clamped to the range on which it was found. SI units, x forward, y left;
//! the grammar stands in `docs/gap-discover.md`.

use std::collections::BTreeMap;

mod expression;
mod port;
mod push;
mod reading;

pub use expression::Expression;
pub use port::Port;
pub use push::Push;
pub use reading::{Felt, Sources};

/// Why a text is no law.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LawError {
    /// No point of the loop has this name.
    Port(String),
    /// A part of an expression that is not declared.
    Word(String),
    /// A number that is none, or out of range.
    Number(String),
    /// A domain whose ends are not in order.
    Domain(String),
    /// Too many terms.
    Terms(usize),
}

impl std::fmt::Display for LawError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Port(name) => write!(f, "no law can act at {name:?}; ports are {}", port::names().join(", ")),
            Self::Word(word) => write!(f, "no law knows {word:?}; signals are {}", expression::words().join(", ")),
            Self::Number(text) => write!(f, "{text:?} is no number that a law can have"),
            Self::Domain(name) => write!(f, "the domain of {name:?} has no two finite ends in order"),
            Self::Terms(count) => write!(f, "a law has one to {MOST_TERMS} terms, not {count}"),
        }
    }
}

impl std::error::Error for LawError {}

/// Most terms of one law.
pub const MOST_TERMS: usize = 24;

/// One term: a coefficient on an expression.
#[derive(Debug, Clone, PartialEq)]
pub struct Term {
    /// In the port's unit over that of the expression.
    pub coefficient: f64,
    /// What it multiplies.
    pub expression: Expression,
}

/// A signal added at one point of the loop.
#[derive(Debug, Clone, PartialEq)]
pub struct Law {
    port: Port,
    terms: Vec<Term>,
}

impl Law {
    /// Makes a law of terms.
    ///
    /// # Errors
    /// If there are none or too many, or a coefficient is not finite.
    pub fn new(port: Port, terms: Vec<Term>) -> Result<Self, LawError> {
        if terms.is_empty() || terms.len() > MOST_TERMS {
            return Err(LawError::Terms(terms.len()));
        }
        match terms.iter().find(|term| !term.coefficient.is_finite()) {
            Some(bad) => Err(LawError::Number(bad.coefficient.to_string())),
            None => Ok(Self { port, terms }),
        }
    }

    /// Tells whether a text may be a law, which no id of an effect is.
    #[must_use]
    pub fn is_text(text: &str) -> bool {
        text.contains(':')
    }

    /// Reads a law, `port: c*expression + …`.
    ///
    /// # Errors
    /// [`LawError`] names what is not declared.
    pub fn parse(text: &str) -> Result<Self, LawError> {
        let (port, rest) = text.split_once(':').ok_or_else(|| LawError::Port(text.to_owned()))?;
        let port = Port::parse(port.trim())?;
        let terms = expression::summands(rest).into_iter().map(|summand| {
            let (coefficient, expression) = expression::summand(&summand)?;
            Ok(Term { coefficient, expression })
        });
        Self::new(port, terms.collect::<Result<_, _>>()?)
    }

    /// Returns where it acts.
    #[must_use]
    pub fn port(&self) -> Port {
        self.port
    }

    /// Returns its terms.
    #[must_use]
    pub fn terms(&self) -> &[Term] {
        &self.terms
    }

    /// Returns the signals that it reads within a range, with the widest range of all terms.
    #[must_use]
    pub fn ranges(&self) -> BTreeMap<&'static str, [f64; 2]> {
        let mut ranges = BTreeMap::new();
        let named = self.terms.iter().flat_map(|term| term.expression.domains());
        for (name, [low, high]) in named.filter_map(|(name, range)| Some((name, range?))) {
            let known = ranges.entry(name).or_insert([low, high]);
            *known = [known[0].min(low), known[1].max(high)];
        }
        ranges
    }

    /// Returns the law with other coefficients, one per term.
    #[must_use]
    pub fn with(&self, coefficients: &[f64]) -> Self {
        let mut law = self.clone();
        law.terms.iter_mut().zip(coefficients).for_each(|(term, c)| term.coefficient = *c);
        law
    }

    /// Returns for each term its part that is known before the car moves, along the grid of the sources; empty where that is 1.
    #[must_use]
    pub fn known(&self, sources: &Sources<'_>) -> Vec<Vec<f64>> {
        self.terms.iter().map(|term| term.expression.known(sources)).collect()
    }

    /// Returns the signal where the terms' known parts are those of `known` and the car feels what it feels.
    #[must_use]
    pub fn at(&self, known: impl Fn(usize) -> f64, felt: &Felt) -> f64 {
        let term = |(k, term): (usize, &Term)| term.coefficient * known(k) * term.expression.felt(felt);
        self.terms.iter().enumerate().map(term).sum()
    }
}

impl std::fmt::Display for Law {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: ", self.port.name())?;
        for (k, term) in self.terms.iter().enumerate() {
            match (k, term.coefficient < 0.0) {
                (0, _) => write!(f, "{}*{}", term.coefficient, term.expression)?,
                (_, true) => write!(f, " - {}*{}", -term.coefficient, term.expression)?,
                (_, false) => write!(f, " + {}*{}", term.coefficient, term.expression)?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_law_is_read_as_it_is_written() {
        for text in [
            "steering: 0.02*delta*abs(ay) - 0.4*slack(delta,0.01)",
            "drive: -0.3*1 + 0.1*neg(accel)*sin(1.7)",
            "lateral.front: 1200*slip_front*slip_front*slip_front",
            "sensor.yaw_rate: 0.01*t[0;30]",
            "lateral.body.side: 40*v*yaw_rate",
            "follower: 0.2*pos(dv)",
            "steering: 1*stick(delta[-0.1;0.1],0.008)",
            "drive: -0.3*rise(accel,0.4) + 0.1*fall(accel,0.4) + 0.2*ring(accel,1.6)",
            "steering: 0.1*delta*hat(v;-1;4;9.5) - 0.2*delta*hat(v;4;9.5;15)",
            "drive: -0.6*pos(accel)*beat(4.3;-0.1;0;0.1)",
        ] {
            let law = Law::parse(text).expect(text);
            assert_eq!(law.to_string(), text);
        }
        assert!(matches!(Law::parse("wheels: 1*v"), Err(LawError::Port(_))));
        assert!(matches!(Law::parse("drive: 1*speed"), Err(LawError::Word(_))));
        assert!(matches!(Law::parse("drive: 1*late(v,0.1)"), Err(LawError::Word(_))), "the motion has no past");
        assert!(matches!(Law::parse("drive: 1*late(delta,99)"), Err(LawError::Number(_))));
        assert!(matches!(Law::parse("drive: nan*v"), Err(LawError::Number(_))));
        assert!(matches!(Law::parse("drive: 1*v[3;1]"), Err(LawError::Domain(_))));
        assert!(matches!(Law::parse("drive: 1*hat(v;3;2;5)"), Err(LawError::Number(_))));
        assert!(matches!(Law::parse("drive: 1*hat(v;2;5)"), Err(LawError::Number(_))));
        assert!(matches!(Law::parse("drive: 1*hat(speed;2;5;7)"), Err(LawError::Word(_))));
        assert!(matches!(Law::parse("drive: 1*beat(0;0;0.5;1)"), Err(LawError::Number(_))));
        assert!(matches!(Law::parse("drive: 1*beat(2;0;0.5;1.5)"), Err(LawError::Number(_))));
    }

    #[test]
    fn a_law_is_the_sum_of_its_terms() {
        let law = Law::parse("steering: 2*delta*v[0;8] + 0.5*slack(delta,0.2)").expect("a law");
        let delta: Vec<f64> = (0..50).map(|k| f64::from(k) * 0.01).collect();
        let sources = Sources { step_secs: 0.01, delta: &delta, accel: &delta, speed: &delta };
        let known = law.known(&sources);
        let felt = Felt { v: 10.0, ..Felt::default() };
        // clamped to 8 m/s; play of 0.2 lies 0.1 behind a ramp
        let u = law.at(|term| known[term][40], &felt);
        assert!((u - (2.0 * 0.4 * 8.0 - 0.5 * 0.1)).abs() < 1e-12, "{u}");
    }

    #[test]
    fn knots_make_a_table() {
        let table = Law::parse("drive: 2*hat(v;0;10;20) + 6*hat(v;10;20;25)").expect("a law");
        let at = |v: f64| table.at(|_| 1.0, &Felt { v, ..Felt::default() });
        assert_eq!([0.0, 5.0, 10.0, 15.0, 20.0, 22.5, 30.0].map(at), [0.0, 1.0, 2.0, 4.0, 6.0, 3.0, 0.0]);
        // over the phase the last knot reaches across the end of a period
        let beat = Law::parse("drive: 1*beat(0.4;-0.25;0;0.25)").expect("a law");
        let zeros = [0.0; 90];
        let known = beat.known(&Sources { step_secs: 0.01, delta: &zeros, accel: &zeros, speed: &zeros });
        let heights: Vec<f64> = [0, 5, 20, 35, 40, 80].iter().map(|k| known[0][*k]).collect();
        for (height, expected) in heights.iter().zip([1.0, 0.5, 0.0, 0.5, 1.0, 1.0]) {
            assert!((height - expected).abs() < 1e-9, "{heights:?}");
        }
        // what swings overshoots a step once and comes to rest on it
        let mut steps = vec![0.0; 10];
        steps.resize(2000, 1.0);
        let swing = Law::parse("drive: 1*ring(accel,1)").expect("a law");
        let known = swing.known(&Sources { step_secs: 0.01, delta: &steps, accel: &steps, speed: &steps });
        assert!((known[0][60] - 0.62).abs() < 0.03 && known[0][1999].abs() < 1e-3, "{}", known[0][60]);
    }
}
