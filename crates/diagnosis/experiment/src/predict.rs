//! What each explanation predicts of a manoeuvre's log, as the diagnosis would see it: residuals of its windows in floor
//! units, with the noise, the uncertain shape of effects, and what the fit left open of the ordinary mismatch.
//!
//! The likeliest explanation drives the manoeuvre; all are compared in the windows of its log, with the floors that the
//! case's baseline has there, which grow where healthy drives have never been. The fit's covariance is reduced to the few
//! directions that move the sensors most, learned on some manoeuvres of the library; what they leave out counts as noise.

use ds_dynamics::case::{Case, PartModel};
use ds_dynamics::ego::Instant;
use ds_dynamics::fit::{Model, column};
use ds_dynamics::motion::BuiltIn;
use ds_dynamics::settings::{KAPPA, SHAPE_SHARE, Thresholds};
use ds_dynamics::space::{Part, Space};
use ds_dynamics::standing::Standing;
use ds_dynamics::windows::EGO;
use ds_effect::{Channel, Insertion};
use nalgebra::{DMatrix, DVector};

use crate::bound::{Normal, distance, information};
use crate::design::{Design, LIBRARY};
use crate::drive::World;
use crate::envelope::{Envelope, tightest};
use crate::error::ExperimentError;

/// Manoeuvres of the library on which the directions are learned: a sweep, a hard braking, a braking in a bend.
const STUDIED: [usize; 3] = [1, 4, 11];
/// Directions that are kept.
const DIRECTIONS: usize = 4;
/// Largest share of an effect's size that its own uncertainty counts as.
const LARGEST_SHARE: f64 = 0.5;
/// Share of a limit that the likeliest explanation leaves, below which a design counts less.
const SPARE: f64 = 0.06;
/// What a limit passed by its own size costs, nat.
const COST: f64 = 10.0;

/// What is known before any manoeuvre is designed.
pub(crate) struct Predictor<'a> {
    pub(crate) case: &'a Case,
    pub(crate) standings: &'a [Standing],
    pub(crate) space: Space,
    envelope: Envelope,
    /// Place of the ordinary mismatch among the explanations.
    bare: usize,
    /// Moves of the vector by one standard deviation each.
    directions: Vec<Vec<f64>>,
    /// Variance by channel that those leave out.
    rest: [f64; EGO],
    /// Simulated drives so far.
    pub(crate) rollouts: usize,
}

/// What is expected of a manoeuvre.
#[derive(Debug, Clone)]
pub(crate) struct Expected {
    pub(crate) design: Design,
    /// Bound of the information, nat.
    pub(crate) nats: f64,
    /// The same less what its nearness to the envelope costs.
    pub(crate) worth: f64,
    /// Distances of the explanations from each other.
    pub(crate) distances: Vec<Vec<f64>>,
}

impl<'a> Predictor<'a> {
    /// Learns the directions of what is unknown of the ordinary mismatch.
    ///
    /// # Errors
    /// If a drive comes to nothing.
    pub(crate) fn new(case: &'a Case, standings: &'a [Standing], envelope: &Envelope) -> Result<Self, ExperimentError> {
        let space = PartModel::new(case, Part::Ego, &[], &[]).space;
        let rest = [0.0; EGO];
        let bare = standings.iter().position(|s| s.effects.is_empty()).unwrap_or(0);
        let envelope = *envelope;
        let mut made = Self { case, standings, space, envelope, bare, directions: Vec::new(), rest, rollouts: 0 };
        made.study()?;
        Ok(made)
    }

    fn study(&mut self) -> Result<(), ExperimentError> {
        // of the ordinary mismatch alone every parameter is open, also those that are another explanation's effect
        let standings = self.standings;
        let bare = &standings[self.bare];
        let free = bare.free.clone();
        let count = free.len();
        let root = bare.root();
        let (mut gram, mut columns, mut channels) = (DMatrix::zeros(count, count), Vec::new(), Vec::new());
        for place in STUDIED {
            let (seen, _) = self.seen(&LIBRARY[place].1)?;
            let model = self.model(&seen);
            let base = model.residuals(&bare.vector);
            let priors = model.null_priors();
            let mut rows = DMatrix::zeros(base.len(), count);
            for (i, &k) in free.iter().enumerate() {
                rows.set_column(i, &DVector::from_vec(column(&model, &bare.vector, &base, k, priors[k])));
                // a sensor reports the same drive otherwise
                let sensor = self.space.effects[self.space.coordinates[k].effect].insertion == Insertion::Sensor;
                self.rollouts += usize::from(!sensor);
            }
            self.rollouts += 1;
            let whitened = rows * &root;
            gram += whitened.tr_mul(&whitened);
            channels.extend(model.tags.iter().map(|tag| tag.channel));
            columns.push(whitened);
        }
        let strength = gram.symmetric_eigen();
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|a, b| strength.eigenvalues[*b].total_cmp(&strength.eigenvalues[*a]));
        let (kept, dropped) = order.split_at(DIRECTIONS.min(count));
        let direction = |of: usize| strength.eigenvectors.column(of).into_owned();
        let vector = |of: &usize| {
            let step: DVector<f64> = &root * direction(*of);
            let mut moved = vec![0.0; self.space.coordinates.len()];
            free.iter().zip(step.iter()).for_each(|(k, value)| moved[*k] = *value);
            moved
        };
        self.directions = kept.iter().map(vector).collect();
        self.rest = rest(&columns, &channels, &dropped.iter().map(|of| direction(*of)).collect::<Vec<_>>());
        Ok(())
    }

    /// Returns the case of one drive as the likeliest explanation has it, and its motion.
    fn seen(&mut self, design: &Design) -> Result<(Case, (Vec<Instant>, f64)), ExperimentError> {
        let plant = self.space.plant(&self.standings[0].vector);
        self.rollouts += 1;
        let world = World { motion: &BuiltIn, plant: &plant };
        let driven = world.drive(design, &self.case.meta.nominal, None).ok_or(ExperimentError::NotDriven)?;
        let log = driven.log("designed.csv", self.case, None);
        let log = log.map_err(|source| ExperimentError::Log { run: 0, source })?;
        Ok((self.case.driving(log), (driven.instants, plant.vehicle.friction)))
    }

    /// Returns the model of a drive, which simulates it once at the usual values.
    fn model<'c>(&mut self, case: &'c Case) -> PartModel<'c> {
        self.rollouts += 1;
        PartModel::new(case, Part::Ego, &[0], &[])
    }

    /// Returns the simulated drives that a design costs.
    pub(crate) fn cost(&self) -> usize {
        2 + self.standings.len() + self.directions.len()
    }

    /// Returns what is expected of a design.
    ///
    /// # Errors
    /// If the drive comes to nothing.
    pub(crate) fn expect(&mut self, design: &Design) -> Result<Expected, ExperimentError> {
        let (case, (instants, friction)) = self.seen(design)?;
        let model = self.model(&case);
        let means: Vec<Vec<f64>> = self.standings.iter().map(|s| model.residuals(&s.vector)).collect();
        let (bare, standings) = (self.bare, self.standings);
        let base = &standings[bare].vector;
        let along = |direction: &Vec<f64>| -> Vec<f64> {
            let moved: Vec<f64> = base.iter().zip(direction).map(|(a, b)| a + b).collect();
            model.residuals(&moved).iter().zip(&means[bare]).map(|(a, b)| a - b).collect()
        };
        let shared: Vec<Vec<f64>> = self.directions.iter().map(along).collect();
        self.rollouts += means.len() + shared.len();
        let floor = Thresholds::default().temperature / KAPPA;
        let normal = |(standing, mean): (&Standing, &Vec<f64>)| {
            let effect: Vec<f64> = mean.iter().zip(&means[bare]).map(|(a, b)| a - b).collect();
            let noise = |(tag, size): (&ds_dynamics::case::Tag, &f64)| {
                floor * (1.0 + self.rest[tag.channel.index()] + (SHAPE_SHARE * size).powi(2))
            };
            let share = self.share(standing);
            let own: Vec<f64> = effect.iter().map(|size| share * size).collect();
            let diagonal = model.tags.iter().zip(&effect).map(noise).collect();
            Normal { mean: mean.clone(), diagonal, columns: shared.iter().cloned().chain([own]).collect() }
        };
        let normals: Vec<Normal> = self.standings.iter().zip(&means).map(normal).collect();
        let row = |a: &Normal| normals.iter().map(|b| distance(a, b)).collect();
        let distances: Vec<Vec<f64>> = normals.iter().map(row).collect();
        let probabilities: Vec<f64> = self.standings.iter().map(|s| s.probability).collect();
        let nats = information(&probabilities, &distances);
        let margins = self.envelope.margins(std::iter::once((instants.as_slice(), friction)));
        let left = tightest(&margins).map_or(1.0, |margin| margin.left);
        Ok(Expected { design: *design, nats, worth: nats - COST * (SPARE - left).max(0.0), distances })
    }

    /// Returns the standard error of an explanation's effect as a share of its size.
    fn share(&self, standing: &Standing) -> f64 {
        let of = |id: &String| {
            let k = self.space.of(self.space.find(id)?)[0];
            let place = standing.free.iter().position(|free| *free == k)?;
            let sd = standing.covariance[(place, place)].max(0.0).sqrt();
            let coordinate = self.space.coordinates[k];
            let usual = coordinate.nuisance.map_or(coordinate.parameter.neutral, |n| n.mean);
            // a limit is searched by its logarithm
            Some(if usual.is_finite() { sd / (standing.vector[k] - usual).abs().max(1e-9) } else { sd })
        };
        standing.effects.iter().filter_map(of).fold(0.0, f64::max).min(LARGEST_SHARE)
    }
}

/// Returns the mean variance by channel of what some directions move.
fn rest(columns: &[DMatrix<f64>], channels: &[Channel], directions: &[DVector<f64>]) -> [f64; EGO] {
    let (mut sums, mut counts) = ([0.0; EGO], [0.0; EGO]);
    for direction in directions {
        let moved = columns.iter().flat_map(|rows| (rows * direction).iter().copied().collect::<Vec<f64>>());
        moved.zip(channels).for_each(|(value, channel)| sums[channel.index()] += value * value);
    }
    channels.iter().for_each(|channel| counts[channel.index()] += 1.0);
    std::array::from_fn(|k| if counts[k] > 0.0 { sums[k] / counts[k] } else { 0.0 })
}
