//! The search space: every parameter of every effect of one part of the loop, as one vector of search values.
//!
//! Turns a vector into a simulator with those effects switched on, and knows each parameter's priors.

use ds_effect::{Effect, Insertion, Nuisance, Parameter, Plant, Scale, library};

use ds_diagnosis::meta::Nominal;

/// Effects of the scatter of samples, which no mean shows; see `scatter`.
pub const SCATTER: [&str; 2] = ["timestamp_jitter", "dropped_frames"];

/// Effects on what the drive command does, which a drive computed from the speed that came of it agrees with whatever they are.
const OF_DRIVE: [&str; 11] = [
    "accel_delay",
    "accel_jerk_limit",
    "accel_lag",
    "brake_fade",
    "brake_gain",
    "deadzone_accel",
    "drag_add",
    "drive_gain",
    "grade",
    "power_limit",
    "roll_add",
];

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
    /// The parameter, of a vehicle of this size.
    pub parameter: Parameter,
    /// The mismatch that every vehicle has: the library's, or that which healthy drives showed.
    pub nuisance: Option<Nuisance>,
    /// How far what is usual of healthy drives lies from the library's usual value; `None` where no drives say so.
    pub shift: Option<f64>,
}

impl Coordinate {
    /// Takes for usual what healthy drives have.
    pub(crate) fn settle(&mut self, usual: Nuisance) {
        self.shift = Some(self.nuisance.map_or(0.0, |library| usual.mean - library.mean));
        self.nuisance = Some(usual);
    }

    /// Returns the range that is searched where the effect is suspected: the library's, and the same about what is usual of
    /// healthy drives, on both sides of it for friction: theirs may be the slippery road.
    #[must_use]
    pub fn slab(&self) -> (f64, f64) {
        let (low, high) = self.parameter.slab;
        let Some(shift) = self.shift.filter(|_| high > low) else { return (low, high) };
        let beyond = if self.parameter.starts_late() { high - low } else { 0.0 };
        (low.min(low + shift), high.max(high + beyond + shift))
    }

    /// Returns the width of that range.
    #[must_use]
    pub fn width(&self) -> f64 {
        let (low, high) = self.slab();
        high - low
    }

    /// Returns the range of values that make sense: what may be suspected, and six of the library's spreads about its usual
    /// value and about that of healthy drives.
    #[must_use]
    pub fn within(&self) -> (f64, f64) {
        let (low, high) = self.slab();
        let Some(Nuisance { mean, sd }) = self.parameter.nuisance else { return (low, high) };
        let shift = self.shift.unwrap_or(0.0);
        (low.min(mean + shift.min(0.0) - 6.0 * sd), high.max(mean + shift.max(0.0) + 6.0 * sd))
    }
}

/// Returns the parameters of an effect on a vehicle of the size of a nominal one; from a nominal friction that no road has the
/// range of factors on it goes as far as from that of a dry road.
pub(crate) fn sized(effect: &Effect, nominal: &Nominal) -> impl Iterator<Item = Parameter> {
    let wheelbase_m = nominal.lf + nominal.lr;
    let beyond_dry = nominal.friction.max(1.0).ln();
    effect.parameters.iter().map(move |parameter| {
        let mut sized = parameter.sized(wheelbase_m);
        sized.slab.0 -= if sized.starts_late() { beyond_dry } else { 0.0 };
        sized
    })
}

/// The parameters of one part.
#[derive(Clone)]
pub struct Space {
    /// The effects, in the library's order.
    pub effects: Vec<&'static Effect>,
    /// One per parameter, the parameters of an effect side by side.
    pub coordinates: Vec<Coordinate>,
    nominal: Nominal,
    /// Effects that act on what the logs do not hold: they fit as nuisances only.
    muted: Vec<&'static str>,
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
            .flat_map(|(effect, e)| sized(e, nominal).map(move |parameter| (effect, parameter)))
            .map(|(effect, parameter)| Coordinate { effect, parameter, nuisance: parameter.nuisance, shift: None })
            .collect();
        Self { effects, coordinates, nominal: nominal.clone(), muted: Vec::new() }
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

    /// Takes the drive command for computed from the speed: what acts between both cannot be told, and fits only as a nuisance.
    pub fn drive_is_derived(&mut self) {
        self.muted.extend(OF_DRIVE);
    }

    /// Takes the logs for those of a car that nobody follows: no effect of other drivers can be told.
    pub fn nobody_follows(&mut self) {
        self.muted.extend(self.effects.iter().map(|effect| effect.id));
    }

    /// Tells whether an effect may be suspected.
    #[must_use]
    pub fn suspects(&self, effect: usize) -> bool {
        self.effects[effect].suspect && !self.is_mute(effect)
    }

    /// Returns the effects that could be suspected if the logs held what they act on.
    #[must_use]
    pub fn mute(&self) -> Vec<&'static str> {
        let mute = |e: &usize| self.effects[*e].suspect && self.is_mute(*e);
        (0..self.effects.len()).filter(mute).map(|e| self.effects[e].id).collect()
    }

    fn is_mute(&self, effect: usize) -> bool {
        self.muted.contains(&self.effects[effect].id)
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
        let c = self.coordinates[coordinate];
        let (p, (low, high)) = (c.parameter, c.slab());
        let at = |u: f64| low + u * (high - low);
        if high <= low {
            return vec![low];
        }
        match p.scale {
            Scale::Limit => (0..10).map(|k| at(f64::from(k) / 9.0)).collect(),
            Scale::Threshold => vec![at(0.06), at(0.12), at(0.25), at(0.4), at(0.6), at(0.85)],
            // friction: nothing happens until the tyres slide
            _ if p.starts_late() => {
                let usual = c.nuisance.filter(|_| c.shift.is_some()).map_or(high, |n| n.mean.clamp(low, high));
                let less = [0.15, 0.3, 0.45, 0.6, 0.8].map(|u| low + u * (usual - low));
                let more = [0.2, 0.5].map(|u| usual + u * (high - usual));
                less.into_iter().chain(more.into_iter().filter(|more| *more > usual)).collect()
            }
            _ if low < p.neutral && high > p.neutral => vec![at(0.25), at(0.4), at(0.6), at(0.75)],
            _ => vec![at(0.15), at(0.5)],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn coordinate(arm_m: f64, id: &str) -> Coordinate {
        let space = Space::new(Part::Ego, &Nominal { lf: arm_m, lr: arm_m, ..crate::synthetic::nominal() }, &[]);
        space.coordinates[space.of(space.find(id).expect("an effect of a log"))[0]]
    }

    #[test]
    fn lengths_are_those_of_cars_and_go_with_the_wheelbase_beyond() {
        let lengths = [
            ("cg_shift", (-0.3, 0.3), (0.0, 0.018)),
            ("lever_arm", (-3.0, 3.0), (0.0, 0.05)),
            ("load_transfer", (0.0, 1.5), (0.34, 0.10)),
            ("tyre_relaxation", (0.05, 1.2), (0.25, 0.1)),
        ];
        for (id, slab, (mean, sd)) in lengths {
            let of = |arm_m: f64| {
                let c = coordinate(arm_m, id);
                let usual = c.nuisance.expect("every vehicle has some of it");
                [c.slab().0, c.slab().1, usual.mean, usual.sd]
            };
            let car = [slab.0, slab.1, mean, sd];
            assert_eq!([1.2, 1.4, 1.6].map(of), [car; 3], "{id}");
            for (arm_m, size) in [(0.1, 0.2 / 2.4), (3.2, 2.0)] {
                let apart =
                    of(arm_m).iter().zip(car).map(|(value, car)| (value - size * car).abs()).fold(0.0, f64::max);
                assert!(apart < 1e-12, "{id} of {arm_m} m: {:?}", of(arm_m));
            }
        }
        let toy = coordinate(0.0868, "cg_shift");
        assert!(toy.within().1 < 0.0868 / 2.0, "a centre of gravity lies between the axles: {:?}", toy.within());
        assert_eq!(coordinate(0.1, "drag_add").slab(), coordinate(1.4, "drag_add").slab());
    }

    #[test]
    fn ranges_go_on_beyond_what_is_usual_of_healthy_drives() {
        let settled = |id: &str, mean: f64| {
            let mut c = coordinate(1.4, id);
            c.settle(Nuisance { mean, sd: 0.01 });
            c
        };
        let soft = settled("front_grip", -0.7);
        assert!((soft.slab().0 + 1.2).abs() < 1e-12 && soft.slab().1 == 0.5, "{:?}", soft.slab());
        let strong = settled("brake_gain", 0.3);
        assert!((strong.within().1 - 0.395).abs() < 1e-12, "{:?}", strong.within());
        // less friction than that of the nominal simulator, down to a fifth of a dry road's where it never slides
        let rigid = Space::new(Part::Ego, &Nominal { friction: 4.0, ..crate::synthetic::nominal() }, &[]);
        let friction = rigid.coordinates[rigid.of(rigid.find("mu").expect("an effect of a log"))[0]];
        assert!((friction.slab().0 + 1.61 + 4.0_f64.ln()).abs() < 1e-12, "{:?}", friction.slab());
        // and more than that of a slippery road
        assert_eq!(coordinate(1.4, "mu").slab(), (-1.61, 0.0));
        for usual in [-0.8, 0.0, 0.1] {
            let (low, high) = settled("mu", usual).slab();
            assert!((low - (usual.min(0.0) - 1.61)).abs() < 1e-12 && (high - (usual + 1.61)).abs() < 1e-12, "{usual}");
        }
    }
}
