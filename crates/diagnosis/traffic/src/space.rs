//! The search space: every parameter of every effect on agents and on the map, as one vector of search values.

use ds_diagnosis::schema::Lines;
use ds_dynamics::fit::Prior;
use ds_effect::{Effect, Insertion, Parameter, Plant, library};
use ds_sim::{IdmParameters, nominal};
use ds_world::VehicleParameters;

/// The parameters of all effects on agents and on the map.
pub struct Space {
    /// The effects, in the library's order.
    pub effects: Vec<&'static Effect>,
    /// One per parameter: its effect and itself.
    pub coordinates: Vec<(usize, &'static Parameter)>,
    idm: IdmParameters,
}

impl Space {
    /// Collects the effects, less those named.
    #[must_use]
    pub fn new(idm: IdmParameters, without: &[String]) -> Self {
        let wanted = |effect: &&Effect| {
            matches!(effect.insertion, Insertion::Agent | Insertion::Map) && !without.iter().any(|id| id == effect.id)
        };
        let effects: Vec<&'static Effect> = library().iter().copied().filter(wanted).collect();
        let each = |(index, effect): (usize, &&'static Effect)| {
            effect.parameters.iter().map(|parameter| (index, parameter)).collect::<Vec<_>>()
        };
        let coordinates = effects.iter().enumerate().flat_map(each).collect();
        Self { effects, coordinates, idm }
    }

    /// Returns the vector at which every effect is absent.
    #[must_use]
    pub fn neutral(&self) -> Vec<f64> {
        self.coordinates.iter().map(|(_, parameter)| parameter.neutral).collect()
    }

    /// Returns the vector of some effects with their values, in reported units; what is not named is neutral.
    #[must_use]
    pub fn vector(&self, lines: &Lines) -> Vec<f64> {
        let mut vector = self.neutral();
        for (id, values) in lines {
            let own = self.find(id).map_or(Vec::new(), |effect| self.of(effect));
            own.into_iter().zip(values).for_each(|(k, value)| vector[k] = self.coordinates[k].1.searched(*value, 1.0));
        }
        vector
    }

    /// Returns the coordinates of an effect.
    #[must_use]
    pub fn of(&self, effect: usize) -> Vec<usize> {
        (0..self.coordinates.len()).filter(|&k| self.coordinates[k].0 == effect).collect()
    }

    /// Returns the place of an effect.
    #[must_use]
    pub fn find(&self, id: &str) -> Option<usize> {
        self.effects.iter().position(|effect| effect.id == id)
    }

    /// Returns the value of an effect's first parameter in a vector, in reported units; its neutral one if it is left out.
    #[must_use]
    pub fn value(&self, id: &str, vector: &[f64]) -> Option<f64> {
        let k = *self.of(self.find(id)?).first()?;
        Some(self.reported(k, vector[k]))
    }

    /// Returns the reported value of a coordinate.
    #[must_use]
    pub fn reported(&self, k: usize, value: f64) -> f64 {
        self.coordinates[k].1.reported(value, 1.0)
    }

    /// Returns the values of an effect, in reported units.
    #[must_use]
    pub fn values(&self, effect: usize, vector: &[f64]) -> Vec<f64> {
        self.of(effect).into_iter().map(|k| self.reported(k, vector[k])).collect()
    }

    /// Returns the simulator with all effects at a vector's values.
    #[must_use]
    pub fn plant(&self, vector: &[f64]) -> Plant {
        let mut plant = nominal(&VehicleParameters::ZOE, &self.idm);
        plant.agents.yields = true;
        plant.agents.walks = true;
        for (index, effect) in self.effects.iter().enumerate() {
            (effect.apply)(&self.values(index, vector), &mut plant);
        }
        plant
    }

    /// Returns the priors with some effects present: slabs for those, nuisances for the others.
    #[must_use]
    pub fn priors(&self, present: &[usize]) -> Vec<Prior> {
        self.coordinates
            .iter()
            .map(|(effect, parameter)| {
                let (low, high) = parameter.slab;
                match parameter.nuisance {
                    _ if present.contains(effect) && high <= low => Prior::Fixed(high),
                    _ if present.contains(effect) => Prior::Slab { low, high },
                    Some(nuisance) => {
                        let within = (f64::NEG_INFINITY, f64::INFINITY);
                        Prior::Normal { mean: parameter.neutral, sd: nuisance.sd, within }
                    }
                    None => Prior::Fixed(parameter.neutral),
                }
            })
            .collect()
    }

    /// Returns a step for a difference quotient.
    #[must_use]
    pub fn step(&self, k: usize) -> f64 {
        let parameter = self.coordinates[k].1;
        match self.effects[self.coordinates[k].0].id {
            "tr_delay" | "tr_lag" => 0.05,
            "pedestrian_behaviour" if parameter.unit == "s" => 0.3,
            "stop_line_shift" => 0.4,
            _ => 0.02 * parameter.width().max(0.5),
        }
    }

    /// Returns values of an effect from which a search may start.
    #[must_use]
    pub fn starts(&self, effect: usize) -> Vec<Vec<f64>> {
        let own = self.of(effect);
        let at = |k: usize, share: f64| {
            let (low, high) = self.coordinates[k].1.slab;
            low + share * (high - low)
        };
        match own.as_slice() {
            [k] if self.coordinates[*k].1.width() <= 0.0 => vec![vec![self.coordinates[*k].1.slab.0]],
            [k] => [0.1, 0.3, 0.5, 0.7, 0.9].map(|share| vec![at(*k, share)]).to_vec(),
            [a, b] => {
                let grid = [0.3, 0.5, 0.7].into_iter();
                grid.flat_map(|u| [0.15, 0.35, 0.6, 0.85].map(|v| vec![at(*a, u), at(*b, v)])).collect()
            }
            _ => Vec::new(),
        }
    }

    /// Tells whether an estimate lies beyond what every recording has.
    #[must_use]
    pub fn outside(&self, effect: usize, vector: &[f64], sds: f64) -> bool {
        self.of(effect).into_iter().any(|k| {
            let parameter = self.coordinates[k].1;
            let off = (vector[k] - parameter.neutral).abs();
            off > parameter.nuisance.map_or(0.05 * parameter.width(), |nuisance| sds * nuisance.sd)
        })
    }
}
