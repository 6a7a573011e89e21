//! A case in memory: its drives, cut into windows, and the two models whose residuals the search explains.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use ds_effect::plant::{Road, Vehicle};
use ds_effect::{Channel, Insertion, Law, Plant};

use crate::baseline::Baseline;
use crate::baseline::correlation::Whitening;
use crate::drive::Drive;
use crate::ego::{Actuated, Inputs, Instant, actuate};
use crate::fit::{Columns, Model, Prior};
use crate::floor;
use crate::following::{self, FollowerRecord};
use crate::motion::{Motion, StandIn};
use crate::noise::Noise;
use crate::scatter::{Scatter, Tolerated, scatter};
use crate::settings::{HELD, HELD_SHARE, SHAPE_SHARE, SLIDING_SHARE};
use crate::space::{Part, Space};
use crate::windows::{BLOCKS, EGO, EgoRecord, backwards};
use ds_diagnosis::CaseError;
use ds_diagnosis::meta::{DriveEntry, Split, VehicleMeta};

/// A case, read and checked.
#[derive(Clone)]
pub struct Case {
    /// Its description.
    pub meta: VehicleMeta,
    /// Its drives.
    pub drives: Vec<Drive>,
    /// Ego windows per drive.
    pub ego: Vec<EgoRecord>,
    /// Followers over all drives.
    pub following: Vec<FollowerRecord>,
    /// Scatter of the samples of the drives to fit.
    pub scatter: Scatter,
    /// Noise of the sensors in the drives to fit.
    pub noise: Noise,
    /// What looked odd but could be used.
    pub warnings: Vec<String>,
    /// What healthy drives of the vehicle say, if that is known.
    pub baseline: Option<Arc<Baseline>>,
    /// The simulator in the place of the built-in car, if there is one.
    pub stand_in: Option<StandIn>,
}

impl Case {
    /// Reads a case folder.
    ///
    /// # Errors
    /// If a file is unreadable or makes no sense.
    pub fn read(folder: &Path) -> Result<Self, CaseError> {
        let meta = VehicleMeta::read(folder)?;
        let drives: Vec<Drive> =
            meta.drives.iter().map(|entry| Drive::read(folder, entry)).collect::<Result<_, _>>()?;
        Self::new(meta, drives)
    }

    /// Makes a case of drives in memory; `meta` has an entry for each.
    ///
    /// # Errors
    /// If a log cannot be what its columns say.
    pub fn new(meta: VehicleMeta, drives: Vec<Drive>) -> Result<Self, CaseError> {
        let mut warnings = crate::check::check(&drives, &meta)?;
        let mut ego = Vec::new();
        let mut following = Vec::new();
        for (index, drive) in drives.iter().enumerate() {
            ego.extend(EgoRecord::new(index, drive, meta.nominal.mass));
            for log in &drive.followers {
                following.push(FollowerRecord::new(index, log, drive.desired_speed_mps));
            }
        }
        warnings.extend(backwards(&ego));
        let fit = fitted(&meta, &drives);
        let scatter = scatter(&fit, Tolerated::default());
        let noise = Noise::of(&fit, scatter.jitter_secs);
        Ok(Self { meta, drives, ego, following, scatter, noise, warnings, baseline: None, stand_in: None })
    }

    /// Returns the case to be diagnosed against a baseline.
    ///
    /// # Errors
    /// If the baseline is not one for this case.
    pub fn against(self, baseline: Arc<Baseline>) -> Result<Self, CaseError> {
        baseline.check(&self.meta, &self.drives, self.stand_in.as_ref())?;
        Ok(self.beside(baseline))
    }

    fn beside(self, baseline: Arc<Baseline>) -> Self {
        let scatter = scatter(&fitted(&self.meta, &self.drives), baseline.sampling.tolerated());
        Self { scatter, baseline: Some(baseline), ..self }
    }

    /// Returns a case of one drive of the same car, with the sensors and the baseline of this one; the drive is not checked.
    #[must_use]
    pub fn driving(&self, drive: Drive) -> Self {
        let ego = EgoRecord::new(0, &drive, self.meta.nominal.mass).into_iter().collect();
        let meta = VehicleMeta { drives: self.meta.drives[..1].to_vec(), suggested_split: None, ..self.meta.clone() };
        let (scatter, noise, baseline) = (self.scatter, self.noise, self.baseline.clone());
        let (following, warnings) = (Vec::new(), Vec::new());
        Self { meta, drives: vec![drive], ego, following, scatter, noise, warnings, baseline, stand_in: None }
    }

    /// Returns the case with a further drive to fit.
    ///
    /// # Errors
    /// If the drive cannot be what its columns say.
    pub fn joined(&self, entry: DriveEntry, drive: Drive) -> Result<Self, CaseError> {
        let (mut fit, held_out) = self.meta.split();
        fit.push(self.drives.len());
        let mut meta = VehicleMeta { suggested_split: Some(Split { fit, held_out }), ..self.meta.clone() };
        meta.drives.push(entry);
        let made = Self::new(meta, self.drives.iter().cloned().chain([drive]).collect())?;
        Ok(if let Some(baseline) = &self.baseline { made.beside(baseline.clone()) } else { made })
    }

    /// Returns the car of the case in windows that share no sample, measured with sensors of some noise.
    #[must_use]
    pub(crate) fn apart(&self, noise: Noise) -> Self {
        let ego = self.ego.iter().map(EgoRecord::apart).collect();
        Self { ego, following: Vec::new(), noise, ..self.clone() }
    }

    /// Returns the case with its car driven by another simulator than the built-in one.
    #[must_use]
    pub fn moved_by(mut self, motion: &Arc<dyn Motion>, stand_in: StandIn) -> Self {
        self.ego.iter_mut().for_each(|record| record.move_by(motion.clone()));
        self.stand_in = Some(stand_in);
        self
    }

    /// Returns the effects on vehicle and road that the simulator of the case cannot have.
    #[must_use]
    pub fn lacks(&self) -> &[String] {
        self.stand_in.as_ref().map_or(&[], |stand_in| &stand_in.lacks)
    }

    /// Returns the parameters of a part with what is usual of them, by a baseline if there is one.
    #[must_use]
    pub fn space(&self, part: Part, without: &[String], baseline: Option<&Baseline>) -> Space {
        let without: Vec<String> = without.iter().chain(self.lacks()).cloned().collect();
        let mut space = Space::new(part, &self.meta.nominal, &without);
        if self.meta.simulated {
            space.expect_nothing();
        }
        if self.meta.channels_derived.iter().any(|name| name == "cmd_accel") {
            space.drive_is_derived();
        }
        if part == Part::Following && self.drives.iter().all(|drive| drive.followers.is_empty()) {
            space.nobody_follows();
        }
        if let Some(baseline) = baseline {
            baseline.settle(&mut space);
        }
        space
    }
}

/// Returns the drives to fit, by single rows.
fn fitted<'d>(meta: &VehicleMeta, drives: &'d [Drive]) -> Vec<&'d Drive> {
    meta.split().0.iter().map(|&d| drives[d].by_rows()).collect()
}

/// Where one residual belongs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tag {
    /// Drive.
    pub drive: usize,
    /// Window, counted over the model.
    pub window: usize,
    /// Channel.
    pub channel: Channel,
    /// Block within the window.
    pub block: usize,
    /// Stamp of the window's anchor, s.
    pub secs: f64,
}

/// One part of a case as a model of residuals in floor units.
pub struct PartModel<'a> {
    /// Its parameters.
    pub space: Space,
    /// Where each residual belongs.
    pub tags: Vec<Tag>,
    part: Part,
    ego: Vec<&'a EgoRecord>,
    following: Vec<&'a FollowerRecord>,
    inverse_floor: Vec<f64>,
    /// What healthy drives have at each residual, in units of the floor; empty without a baseline.
    expected: Vec<f64>,
    /// What takes out how the residuals of a window of healthy drives go together; none without a baseline.
    whitening: Option<Arc<Whitening>>,
    memory: Mutex<Memory>,
}

/// Command paths and actuators of all drives, by the bits of the values they depend on.
type Chains = (Vec<u64>, Arc<Vec<Actuated>>);
/// Rollouts of all windows, by everything they depend on.
type Rolled = (Vec<u64>, Vehicle, Road, [f64; 2], Arc<Vec<Vec<Instant>>>);

/// The last simulations: most steps of a difference quotient change only a part of the loop.
#[derive(Default)]
struct Memory {
    chains: VecDeque<Chains>,
    motions: VecDeque<Rolled>,
}

/// Simulations kept: the base point of a derivative and its last neighbours.
const KEPT_SIMULATIONS: usize = 3;

impl<'a> PartModel<'a> {
    /// Builds the model of a part over some drives, with the case's baseline if it has one.
    #[must_use]
    pub fn new(case: &'a Case, part: Part, drives: &[usize], without: &[String]) -> Self {
        Self::against(case, part, drives, without, case.baseline.as_deref())
    }

    /// Builds the model of a part over some drives with the priors, floors and expectations of a baseline.
    #[must_use]
    pub fn against(
        case: &'a Case,
        part: Part,
        drives: &[usize],
        without: &[String],
        baseline: Option<&Baseline>,
    ) -> Self {
        let space = case.space(part, without, baseline);
        let ego: Vec<_> = if part == Part::Ego {
            case.ego.iter().filter(|r| drives.contains(&r.drive)).collect()
        } else {
            Vec::new()
        };
        let following: Vec<_> = if part == Part::Following {
            case.following.iter().filter(|r| drives.contains(&r.drive)).collect()
        } else {
            Vec::new()
        };
        let mut model = Self {
            space,
            tags: Vec::new(),
            part,
            ego,
            following,
            inverse_floor: Vec::new(),
            expected: Vec::new(),
            whitening: None,
            memory: Mutex::default(),
        };
        model.label(&case.noise);
        let usual = model.space.usual();
        let spread = model.step_spread(&usual);
        let raw = model.raw(&usual, &[]);
        for ((inverse, residual), spread) in model.inverse_floor.iter_mut().zip(&raw).zip(spread) {
            *inverse = if residual.is_nan() { 0.0 } else { 1.0 / (1.0 / *inverse).hypot(spread) };
        }
        if let Some(baseline) = baseline {
            model.expect(baseline);
        }
        model
    }

    /// Takes the floors and the expected residuals of a baseline.
    fn expect(&mut self, baseline: &Baseline) {
        let windows = self.ego.iter().flat_map(|record| record.anchors.iter().map(move |anchor| (*record, anchor)));
        let mut found: Vec<(f64, f64)> =
            windows.flat_map(|(record, anchor)| baseline.expected(record, anchor)).collect();
        found.extend(self.tags[found.len()..].iter().map(|tag| (0.0, baseline.factor(tag.channel, tag.block))));
        self.expected = found.iter().map(|(expected, factor)| expected / factor).collect();
        self.inverse_floor.iter_mut().zip(&found).for_each(|(inverse, (_, factor))| *inverse /= factor);
        if self.part == Part::Ego && !baseline.correlation.is_none() {
            let present: Vec<bool> = self.inverse_floor.iter().map(|inverse| *inverse > 0.0).collect();
            self.whitening = Some(Arc::new(Whitening::new(&baseline.correlation, &present)));
        }
    }

    /// Returns the first stamp of a drive, s.
    #[must_use]
    pub fn start_secs(&self, drive: usize) -> f64 {
        let car = self.ego.iter().find(|record| record.drive == drive).map(|record| record.secs(0));
        let follower = || self.following.iter().find(|record| record.drive == drive).map(|record| record.secs(0));
        car.or_else(follower).unwrap_or_default()
    }

    /// Returns the followers.
    pub fn followers(&self) -> impl Iterator<Item = &'a FollowerRecord> + '_ {
        self.following.iter().copied()
    }

    /// Returns the ego's drives.
    pub fn records(&self) -> impl Iterator<Item = &'a EgoRecord> + '_ {
        self.ego.iter().copied()
    }

    /// Returns the standard deviation that the unknown instants of command steps give to every residual: a step may have
    /// happened anywhere within its sample interval, so that no timing can be read from one step alone.
    fn step_spread(&self, vector: &[f64]) -> Vec<f64> {
        let plant = self.space.plant(vector);
        let mut spread = Vec::with_capacity(self.tags.len());
        for record in &self.ego {
            let residuals = |inputs: &Inputs| record.windows(&record.anchors, inputs, &plant).concat();
            match (record.stepped(0.0), record.stepped(1.0)) {
                (Some(early), Some(late)) => spread.extend(
                    residuals(&early).iter().zip(residuals(&late)).map(|(a, b)| (b - a).abs() / 12.0_f64.sqrt()),
                ),
                _ => spread.extend(std::iter::repeat_n(0.0, record.anchors.len() * EGO * BLOCKS)),
            }
        }
        spread.resize(self.tags.len(), 0.0);
        spread.iter_mut().filter(|s| s.is_nan()).for_each(|s| *s = 0.0);
        spread
    }

    fn label(&mut self, noise: &Noise) {
        let mut window = 0;
        for record in &self.ego {
            for anchor in &record.anchors {
                for (channel, block) in (0..EGO).flat_map(|c| (0..BLOCKS).map(move |b| (c, b))) {
                    let channel = Channel::ALL[channel];
                    self.tags.push(Tag { drive: record.drive, window, channel, block, secs: anchor.secs });
                    self.inverse_floor.push(1.0 / floor::ego(channel.index(), block, &anchor.regime, noise));
                }
                window += 1;
            }
        }
        for record in &self.following {
            for &start in &record.starts {
                for (channel, block) in (0..2).flat_map(|c| (0..following::BLOCKS).map(move |b| (c, b))) {
                    let secs = record.secs(start);
                    self.tags.push(Tag {
                        drive: record.drive,
                        window,
                        channel: Channel::ALL[EGO + channel],
                        block,
                        secs,
                    });
                    self.inverse_floor.push(1.0 / floor::follower(channel, block, noise));
                }
                window += 1;
            }
        }
    }

    fn raw(&self, vector: &[f64], laws: &[Law]) -> Vec<f64> {
        let plant = Plant { laws: laws.to_vec(), ..self.space.plant(vector) };
        match self.part {
            Part::Ego if laws.is_empty() => self.ego_residuals(vector, &plant),
            Part::Ego => self.ego.iter().flat_map(|record| record.residuals(&plant)).collect(),
            Part::Following => self.following.iter().flat_map(|record| record.residuals(&plant)).collect(),
        }
    }

    fn ego_residuals(&self, vector: &[f64], plant: &Plant) -> Vec<f64> {
        let chain = |c: &crate::space::Coordinate| {
            let insertion = self.space.effects[c.effect].insertion;
            matches!(insertion, Insertion::CommandPath | Insertion::Actuator)
        };
        let pairs = self.space.coordinates.iter().zip(vector);
        let key: Vec<u64> = pairs.filter(|(c, _)| chain(c)).map(|(_, value)| value.to_bits()).collect();
        let mut memory = self.memory.lock().unwrap_or_else(PoisonError::into_inner);
        let known = memory.chains.iter().find(|c| c.0 == key).map(|c| c.1.clone());
        let actuated = known.unwrap_or_else(|| {
            let made = Arc::new(self.ego.iter().map(|record| actuate(&record.inputs, plant)).collect::<Vec<_>>());
            memory.chains.push_front((key.clone(), made.clone()));
            memory.chains.truncate(KEPT_SIMULATIONS);
            made
        });
        let clock = [plant.clock.pose_latency_secs, plant.clock.pose_drift];
        let same = |m: &&Rolled| m.0 == key && m.1 == plant.vehicle && m.2 == plant.road && m.3 == clock;
        let known = memory.motions.iter().find(same).map(|m| m.4.clone());
        let rolled = known.unwrap_or_else(|| {
            let pairs = self.ego.iter().zip(actuated.iter());
            let made = Arc::new(pairs.flat_map(|(r, a)| r.roll(&r.anchors, a, plant)).collect::<Vec<_>>());
            memory.motions.push_front((key, plant.vehicle, plant.road, clock, made.clone()));
            memory.motions.truncate(KEPT_SIMULATIONS);
            made
        });
        drop(memory);
        let mut rolled = rolled.iter();
        let mut residuals = Vec::with_capacity(self.tags.len());
        for (record, actuated) in self.ego.iter().zip(actuated.iter()) {
            for (anchor, rollout) in record.anchors.iter().zip(&mut rolled) {
                residuals.extend(record.residual(anchor, rollout, actuated, plant));
            }
        }
        residuals
    }

    /// Returns the model with the floor widened by a share of what some effects do to each residual: the true shape of an
    /// effect is never quite the library's, and what is left of a strong one is no second effect. Also returns derivatives
    /// of this model in units of that floor.
    #[must_use]
    pub fn widened(&self, vector: &[f64], effects: &[usize], columns: &Columns) -> (Self, Columns) {
        let usual = self.space.usual();
        let held = effects.iter().any(|e| self.space.effects[*e].id == HELD);
        let share = if held { HELD_SHARE } else { SHAPE_SHARE };
        let mut bare = vector.to_vec();
        effects.iter().flat_map(|e| self.space.of(*e)).for_each(|k| bare[k] = usual[k]);
        let pairs = self.in_floor_units(vector, &[]).into_iter().zip(self.in_floor_units(&bare, &[]));
        let shares: Vec<f64> = pairs.map(|(with, without)| 1.0 / 1.0_f64.hypot(share * (with - without))).collect();
        let scaled = |column: &Arc<Vec<f64>>| {
            let mut moved = column.to_vec();
            self.whitening.iter().for_each(|w| w.back(&mut moved));
            moved.iter_mut().zip(&shares).for_each(|(c, s)| *c *= s);
            self.whitening.iter().for_each(|w| w.out(&mut moved));
            Arc::new(moved)
        };
        let columns = columns.iter().map(|column| column.as_ref().map(scaled)).collect();
        let shared = |all: &[f64]| all.iter().zip(&shares).map(|(value, s)| value * s).collect();
        let model = Self {
            space: self.space.clone(),
            tags: self.tags.clone(),
            part: self.part,
            ego: self.ego.clone(),
            following: self.following.clone(),
            inverse_floor: shared(&self.inverse_floor),
            expected: shared(&self.expected),
            whitening: self.whitening.clone(),
            memory: Mutex::default(),
        };
        (model, columns)
    }

    /// Returns the priors when no effect is suspected: nuisances free, all else absent.
    #[must_use]
    pub fn null_priors(&self) -> Vec<Prior> {
        let prior = |c: &crate::space::Coordinate| match c.nuisance {
            Some(n) => Prior::Normal { mean: n.mean, sd: n.sd, within: c.within() },
            None => Prior::Fixed(c.parameter.neutral),
        };
        self.space.coordinates.iter().map(prior).collect()
    }

    /// Returns the priors when some effects are suspected: slabs on their parameters.
    #[must_use]
    pub fn priors_with(&self, effects: &[usize]) -> Vec<Prior> {
        let mut priors = self.null_priors();
        for &effect in effects {
            for k in self.space.of(effect) {
                let (low, high) = self.space.coordinates[k].slab();
                priors[k] = if high > low { Prior::Slab { low, high } } else { Prior::Fixed(low) };
            }
        }
        priors
    }

    /// Returns what each ego window is like.
    #[must_use]
    pub fn regimes(&self) -> Vec<crate::windows::Regime> {
        self.ego.iter().flat_map(|record| record.anchors.iter().map(|anchor| anchor.regime)).collect()
    }

    /// Tells for each ego window whether it comes near the limit of the tyres at the friction of a vector.
    #[must_use]
    pub fn sliding(&self, vector: &[f64]) -> Vec<bool> {
        let limit = SLIDING_SHARE * 9.81 * self.space.plant(vector).vehicle.friction;
        self.ego.iter().flat_map(|record| record.anchors.iter().map(move |a| a.regime.demand_mps2 > limit)).collect()
    }

    /// Tells whether there is nothing to explain.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.tags.is_empty()
    }
}

impl PartModel<'_> {
    /// Returns the residuals of the simulator of a vector with laws added to it, in floor units; against a baseline without
    /// what goes together in healthy drives.
    #[must_use]
    pub fn residuals_under(&self, vector: &[f64], laws: &[Law]) -> Vec<f64> {
        let mut residuals = self.in_floor_units(vector, laws);
        self.whitening.iter().for_each(|whitening| whitening.out(&mut residuals));
        residuals
    }

    fn in_floor_units(&self, vector: &[f64], laws: &[Law]) -> Vec<f64> {
        let mut residuals = self.raw(vector, laws);
        let expected = self.expected.iter().chain(std::iter::repeat(&0.0));
        for ((z, inverse), expected) in residuals.iter_mut().zip(&self.inverse_floor).zip(expected) {
            *z = if *inverse == 0.0 { 0.0 } else { (*z * inverse - expected).clamp(-1e6, 1e6) };
            if z.is_nan() {
                *z = 1e6;
            }
        }
        residuals
    }
}

impl Model for PartModel<'_> {
    fn residuals(&self, vector: &[f64]) -> Vec<f64> {
        self.residuals_under(vector, &[])
    }

    fn step(&self, coordinate: usize) -> f64 {
        self.space.step(coordinate)
    }
}
