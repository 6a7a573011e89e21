//! Another simulator's motion of windows, with few rollouts of it: the built-in car's motion and what the other one adds.
//!
//! What it adds is known exactly where it was run, for the parameters and inputs of that run, and is taken to change
//! linearly between such points: the least change that agrees with all of them (Broyden 1965), in a metric of typical
//! sizes. With one point it is constant.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::{Mutex, MutexGuard, PoisonError};

use ds_diagnosis::meta::Nominal;
use ds_dynamics::ego::{Actuated, Instant, ROLL_SECS};
use ds_dynamics::motion::{BuiltIn, Motion, Window};
use ds_effect::Plant;
use ds_effect::plant::{Road, Vehicle};
use nalgebra::{DMatrix, DVector};

use crate::drive::{Rollout, Subject, car_of, is_lawful};
use crate::error::SimulatorError;
use crate::fields::FIELDS;
use crate::message::Hello;
use crate::process::Process;
use crate::serve::Served;

/// Most rollouts of a case.
pub(crate) const BUDGET: usize = 2000;
/// A rollout is a window of at most so many seconds; a longer one counts for several.
const ROLLOUT_SECS: f64 = 3.0;
/// Spacing at which inputs are compared, s.
const SPACING_SECS: f64 = 0.1;
/// Typical changes of the inputs, rad and m/s².
const INPUT_SCALES: (f64, f64) = (0.02, 0.6);
/// Weights of points beyond which nothing is extrapolated.
const FARTHEST: f64 = 1.5;
/// Most windows of a drive in which it is run for what is reported, each at three states.
const MEASURED: usize = 16;
/// Share of the diagonal that keeps points that nearly coincide from fighting.
const RIDGE: f64 = 1e-6;
/// Seeds over which a simulator that draws is averaged.
const SEEDS: u64 = 2;

/// What one window is told apart by: drive, sample, length in half seconds.
type Key = (usize, usize, u32);

/// A run of a window: what it was run with, and what the simulator added.
struct Point {
    features: Vec<f64>,
    added: Vec<Instant>,
}

impl Point {
    /// Returns how it differs from another.
    fn less(&self, other: &Point) -> Point {
        let features = self.features.iter().zip(&other.features).map(|(a, b)| a - b).collect();
        let added = self.added.iter().zip(&other.added).map(|(a, b)| all(a, b, |a, b| a - b)).collect();
        Point { features, added }
    }

    /// Returns whether the simulator failed there.
    fn failed(&self) -> bool {
        self.added.iter().any(|instant| instant.x.is_nan())
    }
}

/// What is known of a window.
struct Known {
    first: Point,
    /// The other points less the first.
    others: Vec<Point>,
    /// Weights of the others by features less those of the first.
    weights: DMatrix<f64>,
}

/// A simulator of somebody else, as a motion of windows.
pub(crate) struct Foreign {
    /// What it said of itself.
    pub(crate) hello: Hello,
    nominal: Nominal,
    reference: (Vehicle, Road),
    inner: Mutex<Inner>,
}

struct Inner {
    process: Process,
    known: BTreeMap<Key, Known>,
    tally: Tally,
}

/// What was asked of a simulator.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tally {
    /// Rollouts made.
    pub(crate) rollouts: usize,
    /// Windows in which it failed or was not run any more.
    pub(crate) masked: usize,
    /// Whether it was started anew.
    pub(crate) restarted: bool,
    /// The last failure.
    pub(crate) why: String,
}

impl Tally {
    /// Says what went wrong.
    pub(crate) fn said(&self) -> Vec<String> {
        let Self { masked, why, .. } = self;
        let left_out = (*masked > 0).then(|| {
            format!("the simulator did not answer in {masked} windows, which are left out; the last reason: {why}")
        });
        let anew = self.restarted.then(|| "the simulator ended or kept silent and was started anew".to_owned());
        left_out.into_iter().chain(anew).collect()
    }
}

impl Inner {
    /// Remembers what the simulator adds at a point of a window, unless either failed.
    fn remember(&mut self, window: &Window, point: Point) {
        match self.known.entry(key(window)) {
            Entry::Vacant(place) => _ = place.insert(Known::new(point)),
            // a window that once failed is not looked at any more; a later failure says nothing
            Entry::Occupied(known) if known.get().first.failed() || point.failed() => {}
            Entry::Occupied(known) => known.into_mut().add(&point),
        }
    }
}

impl Foreign {
    /// Takes a running simulator for a case; `reference` is the car that it stands for as it is.
    #[must_use]
    pub(crate) fn new(process: Process, nominal: &Nominal, reference: &Plant) -> Self {
        let hello = process.hello.clone();
        let inner = Inner { process, known: BTreeMap::new(), tally: Tally::default() };
        let reference = (reference.vehicle, reference.road);
        Self { hello, nominal: nominal.clone(), reference, inner: Mutex::new(inner) }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns what was asked so far.
    #[must_use]
    pub(crate) fn tally(&self) -> Tally {
        let inner = self.lock();
        Tally { restarted: inner.process.restarted(), ..inner.tally.clone() }
    }

    /// Runs windows and remembers what the simulator adds there.
    pub(crate) fn learn(&self, windows: &[Window], actuated: &Actuated, plant: &Plant) {
        let mut inner = self.lock();
        for window in windows {
            let added = self.run(&mut inner, window, actuated, plant);
            inner.remember(window, Point { features: features(window, actuated, plant), added });
        }
    }

    /// Remembers what the simulator would add in a window, without a run.
    pub(crate) fn suppose(&self, window: &Window, actuated: &Actuated, plant: &Plant, added: Vec<Instant>) {
        self.lock().remember(window, Point { features: features(window, actuated, plant), added });
    }

    /// Returns what the simulator adds to the built-in car in a window; not a number where it fails.
    fn run(&self, inner: &mut Inner, window: &Window, actuated: &Actuated, plant: &Plant) -> Vec<Instant> {
        let start = &window.start;
        let nothing = || {
            let unknown = Instant { x: f64::NAN, ..Instant::default() };
            vec![all(&unknown, &unknown, |_, _| f64::NAN)]
        };
        let parts = ((start.horizon_secs + start.warm_secs) / ROLLOUT_SECS).ceil().max(1.0) as usize;
        let seeds = if self.hello.deterministic { 1 } else { SEEDS };
        if inner.tally.rollouts + parts * seeds as usize > BUDGET {
            inner.tally.masked += 1;
            inner.tally.why = format!("all {BUDGET} rollouts were made");
            return nothing();
        }
        inner.tally.rollouts += parts * seeds as usize;
        let reference = Plant { vehicle: self.reference.0, road: self.reference.1, ..self.nominal.plant() };
        let rollout = |reference, seed| Rollout { start, actuated, plant, reference, nominal: &self.nominal, seed };
        let mut twin = Served::new(&self.nominal, true);
        let own = self.nominal.plant();
        let built_in = rollout(&own, 0).run(&mut twin as &mut dyn Subject, &Served::new(&self.nominal, true).hello());
        let driven: Result<Vec<Vec<Instant>>, SimulatorError> =
            (1..=seeds).map(|seed| rollout(&reference, seed).run(&mut inner.process, &self.hello)).collect();
        match (driven, built_in) {
            (Ok(driven), Ok(built_in)) => {
                let share = 1.0 / driven.len() as f64;
                let mut added = vec![Instant::default(); built_in.len()];
                for one in &driven {
                    for ((sum, theirs), ours) in added.iter_mut().zip(one).zip(&built_in) {
                        let change = all(theirs, ours, |a, b| a - b);
                        *sum = all(sum, &change, |a, b| a + share * b);
                    }
                }
                added
            }
            (Err(error), _) | (_, Err(error)) => {
                inner.tally.masked += 1;
                inner.tally.why = error.to_string();
                nothing()
            }
        }
    }

    /// Returns what the simulator adds in a window by what is known; the window is run where nothing is. What a law does to it
    /// is taken to be what it does to the built-in car.
    fn added(&self, inner: &mut Inner, window: &Window, actuated: &Actuated, plant: &Plant) -> Vec<Instant> {
        if !inner.known.contains_key(&key(window)) {
            let lawless = car_of(plant, &self.nominal);
            let added = self.run(inner, window, actuated, &lawless);
            inner.remember(window, Point { features: features(window, actuated, plant), added });
        }
        let Some(known) = inner.known.get(&key(window)) else { return Vec::new() };
        if known.others.is_empty() {
            return known.first.added.clone();
        }
        known.added(&features(window, actuated, plant))
    }

    /// Returns what the simulator adds in a window by a run of just that; not a number where it fails.
    fn measured(&self, inner: &mut Inner, window: &Window, actuated: &Actuated, plant: &Plant) -> Vec<Instant> {
        if is_lawful(plant) {
            // what is known of other runs says nothing of a law
            return self.run(inner, window, actuated, plant);
        }
        let features = features(window, actuated, plant);
        if let Some(added) = inner.known.get(&key(window)).and_then(|known| known.at(&features)) {
            return added;
        }
        let added = self.run(inner, window, actuated, plant);
        inner.remember(window, Point { features, added: added.clone() });
        added
    }

    /// Returns what the simulator adds in windows by what is known.
    #[must_use]
    pub(crate) fn adds(&self, windows: &[Window], actuated: &Actuated, plant: &Plant) -> Vec<Vec<Instant>> {
        let mut inner = self.lock();
        windows.iter().map(|window| self.added(&mut inner, window, actuated, plant)).collect()
    }

    /// Returns the built-in car's part of a motion.
    #[must_use]
    pub(crate) fn built_in(&self, windows: &[Window], actuated: &Actuated, plant: &Plant) -> Vec<Vec<Instant>> {
        BuiltIn.roll(windows, actuated, &car_of(plant, &self.nominal))
    }
}

impl Motion for Foreign {
    fn roll(&self, windows: &[Window], actuated: &Actuated, plant: &Plant) -> Vec<Vec<Instant>> {
        joined(BuiltIn.roll(windows, actuated, plant), &self.adds(windows, actuated, plant))
    }

    fn measure(&self, windows: &[Window], actuated: &Actuated, plant: &Plant) -> Vec<Vec<Instant>> {
        let mut inner = self.lock();
        let added: Vec<_> = windows.iter().map(|window| self.measured(&mut inner, window, actuated, plant)).collect();
        joined(BuiltIn.roll(windows, actuated, plant), &added)
    }

    fn measurable(&self) -> usize {
        MEASURED
    }
}

/// Adds to the motions of the built-in car what the simulator adds, its last to what is longer.
fn joined(mut rolled: Vec<Vec<Instant>>, added: &[Vec<Instant>]) -> Vec<Vec<Instant>> {
    for (motion, added) in rolled.iter_mut().zip(added) {
        let last = added.last().copied().unwrap_or_default();
        for (instant, added) in motion.iter_mut().zip(added.iter().chain(std::iter::repeat(&last))) {
            *instant = all(instant, added, |a, b| a + b);
        }
    }
    rolled
}

impl Known {
    fn new(first: Point) -> Self {
        Self { first, others: Vec::new(), weights: DMatrix::zeros(0, 0) }
    }

    /// Returns what the simulator added at these very features, if it was run there.
    fn at(&self, features: &[f64]) -> Option<Vec<Instant>> {
        let away: Vec<f64> = features.iter().zip(&self.first.features).map(|(a, b)| a - b).collect();
        if away.iter().all(|change| *change == 0.0) {
            return Some(self.first.added.clone());
        }
        let other = self.others.iter().find(|other| other.features == away)?;
        Some(self.first.added.iter().zip(&other.added).map(|(first, more)| all(first, more, |a, b| a + b)).collect())
    }

    fn add(&mut self, point: &Point) {
        self.others.push(point.less(&self.first));
        let count = self.others.len();
        let rows = DMatrix::from_fn(count, self.first.features.len(), |k, at| self.others[k].features[at]);
        let mut gram = &rows * rows.transpose();
        let ridge = RIDGE * (gram.trace() / count as f64).max(1e-12);
        (0..count).for_each(|k| gram[(k, k)] += ridge);
        self.weights = gram.try_inverse().unwrap_or_else(|| DMatrix::zeros(count, count)) * rows;
    }

    /// Returns what the simulator adds at some features.
    fn added(&self, features: &[f64]) -> Vec<Instant> {
        let away = features.iter().zip(&self.first.features).map(|(a, b)| a - b);
        let weights = &self.weights * DVector::from_iterator(self.first.features.len(), away);
        let mut sum = self.first.added.clone();
        for (weight, other) in weights.iter().zip(&self.others) {
            let weight = weight.clamp(-FARTHEST, FARTHEST);
            for (sum, change) in sum.iter_mut().zip(&other.added) {
                *sum = all(sum, change, |a, b| a + weight * b);
            }
        }
        sum
    }
}

/// Joins two instants value by value.
#[must_use]
pub(crate) fn all(a: &Instant, b: &Instant, join: impl Fn(f64, f64) -> f64) -> Instant {
    Instant {
        x: join(a.x, b.x),
        y: join(a.y, b.y),
        yaw: join(a.yaw, b.yaw),
        v: join(a.v, b.v),
        yaw_rate: join(a.yaw_rate, b.yaw_rate),
        ax: join(a.ax, b.ax),
        ay: join(a.ay, b.ay),
    }
}

fn key(window: &Window) -> Key {
    (window.drive, window.sample, (window.start.horizon_secs * 2.0) as u32)
}

/// Returns what a motion depends on in units of typical changes: parameters of vehicle and road, inputs of the window.
fn features(window: &Window, actuated: &Actuated, plant: &Plant) -> Vec<f64> {
    let start = &window.start;
    let count = ((f64::from(key(window).2) * 0.5 + start.warm_secs) / SPACING_SECS) as usize;
    let root = (count as f64).sqrt();
    let mut found: Vec<f64> = FIELDS.iter().map(|field| (field.get)(plant) / field.scale).collect();
    for k in 0..count {
        let (steer, accel) = actuated.asked(start.secs + k as f64 * SPACING_SECS + 0.5 * ROLL_SECS);
        found.push(steer / INPUT_SCALES.0 / root);
        found.push(accel / INPUT_SCALES.1 / root);
    }
    found
}
