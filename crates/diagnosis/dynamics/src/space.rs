//! The search space: every parameter of every effect of one part of the loop, as one vector of search values.
//!
//! Turns a vector into a simulator with those effects switched on, and knows each parameter's priors.

use ds_effect::{Effect, Insertion, Nuisance, Parameter, Plant, Scale, library};

use ds_diagnosis::meta::Nominal;

/// Effects of the scatter of samples, which no mean shows; see `scatter`.
pub const SCATTER: [&str; 2] = ["timestamp_jitter", "dropped_frames"];

/// The two parts of a log that share no parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// The ego vehicle.
    Ego,
    /// Its followers.
    Following,
}

impl Part {
    /// Returns the part an effect belongs to.
    #[must_use]
    pub fn of(effect: &Effect) -> Self {
        if effect.insertion == Insertion::Agent { Self::Following } else { Self::Ego }
    }
}

/// One coordinate of the search vector.
#[derive(Clone, Copy)]
pub struct Coordinate {
    /// Index of the effect in the space.
    pub effect: usize,
    /// The parameter.
    pub parameter: &'static Parameter,
    /// The mismatch that every vehicle has: the library's, or that which healthy drives showed.
    pub nuisance: Option<Nuisance>,
}

impl Coordinate {
    /// Returns the range of values that make sense: what the library suspects, and six of its usual spreads.
    #[must_use]
    pub fn within(&self) -> (f64, f64) {
        let (low, high) = self.parameter.slab;
        let usual = self.parameter.nuisance.map_or((low, high), |n| (n.mean - 6.0 * n.sd, n.mean + 6.0 * n.sd));
        (low.min(usual.0), high.max(usual.1))
    }
}

/// The parameters of one part.
#[derive(Clone)]
pub struct Space {
    /// The effects, in the library's order.
    pub effects: Vec<&'static Effect>,
    /// One per parameter, the parameters of an effect side by side.
    pub coordinates: Vec<Coordinate>,
    nominal: Nominal,
}

impl Space {
    /// Collects the effects of a part that can show in a log, less those named in `without`.
    #[must_use]
    pub fn new(part: Part, nominal: &Nominal, without: &[String]) -> Self {
        let effects: Vec<&'static Effect> = library()
            .iter()
            .copied()
            .filter(|e| {
                Part::of(e) == part
                    && !e.channels.is_empty()
                    && !e.needs_scene()
                    && !SCATTER.contains(&e.id)
                    && !without.iter().any(|id| id == e.id)
            })
            .collect();
        let coordinates = effects
            .iter()
            .enumerate()
            .flat_map(|(effect, e)| e.parameters.iter().map(move |parameter| (effect, parameter)))
            .map(|(effect, parameter)| Coordinate { effect, parameter, nuisance: parameter.nuisance })
            .collect();
        Self { effects, coordinates, nominal: nominal.clone() }
    }

    /// Returns the vector at which every effect is absent.
    #[must_use]
    pub fn neutral(&self) -> Vec<f64> {
        self.coordinates.iter().map(|c| c.parameter.neutral).collect()
    }

    /// Returns the vector of usual values: the means of the nuisance priors.
    #[must_use]
    pub fn usual(&self) -> Vec<f64> {
        self.coordinates.iter().map(|c| c.nuisance.map_or(c.parameter.neutral, |n| n.mean)).collect()
    }

    /// Takes for usual what is neutral, as of a world that has the effects that it was given and no others.
    pub fn expect_nothing(&mut self) {
        for coordinate in &mut self.coordinates {
            let neutral = coordinate.parameter.neutral;
            coordinate.nuisance.iter_mut().filter(|_| neutral.is_finite()).for_each(|n| n.mean = neutral);
        }
    }

    /// Returns the coordinates of an effect.
    #[must_use]
    pub fn of(&self, effect: usize) -> Vec<usize> {
        (0..self.coordinates.len()).filter(|&k| self.coordinates[k].effect == effect).collect()
    }

    /// Returns the place of an effect in this space.
    #[must_use]
    pub fn find(&self, id: &str) -> Option<usize> {
        self.effects.iter().position(|e| e.id == id)
    }

    /// Returns the simulator with all effects at the vector's values.
    #[must_use]
    pub fn plant(&self, vector: &[f64]) -> Plant {
        let mut plant = self.nominal.plant();
        let mut at = 0;
        for effect in &self.effects {
            let count = effect.parameters.len();
            let values: Vec<f64> = effect
                .parameters
                .iter()
                .zip(&vector[at..at + count])
                .map(|(p, value)| p.reported(*value, self.nominal.mass))
                .collect();
            (effect.apply)(&values, &mut plant);
            at += count;
        }
        plant
    }

    /// Returns the reported value of a coordinate.
    #[must_use]
    pub fn reported(&self, coordinate: usize, value: f64) -> f64 {
        self.coordinates[coordinate].parameter.reported(value, self.nominal.mass)
    }

    /// Returns a step for a difference quotient: a fifth of the nuisance, else a hundredth of the slab.
    #[must_use]
    pub fn step(&self, coordinate: usize) -> f64 {
        let Coordinate { parameter: p, nuisance, .. } = self.coordinates[coordinate];
        nuisance.map_or(0.01 * p.width().max(1.0), |n| (0.5 * n.sd).min(0.02 * p.width().max(n.sd)))
    }

    /// Returns values of a coordinate from which a search may start, all within the slab.
    #[must_use]
    pub fn grid(&self, coordinate: usize) -> Vec<f64> {
        let p = self.coordinates[coordinate].parameter;
        let at = |u: f64| p.slab.0 + u * p.width();
        if p.width() <= 0.0 {
            return vec![p.slab.0];
        }
        match p.scale {
            Scale::Limit => (0..10).map(|k| at(f64::from(k) / 9.0)).collect(),
            Scale::Threshold => vec![at(0.06), at(0.12), at(0.25), at(0.4), at(0.6), at(0.85)],
            // friction: nothing happens until the tyres slide
            _ if p.starts_late() => [0.15, 0.3, 0.45, 0.6, 0.8].map(at).to_vec(),
            _ if p.slab.0 < p.neutral && p.slab.1 > p.neutral => vec![at(0.25), at(0.4), at(0.6), at(0.75)],
            _ => vec![at(0.15), at(0.5)],
        }
    }
}
