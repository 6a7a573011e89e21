//! A diagnosis with another simulator as the nominal one, in at most 2,000 rollouts.
//!
//! The simulator is run on all windows at the usual mismatch, and on a few for each parameter of vehicle and road: gain
//! and shift of each channel against the built-in car's own response then speak for the other windows, or those are run
//! too where they do not predict. The search works on that; at the fits that matter the simulator is run again and the
//! search repeated until its answer stands. At the end it is run at the three states whose gap is reported, on the drives that
//! it is reported of.

use std::sync::Arc;

use ds_diagnosis::Diagnosis;
use ds_diagnosis::schema::Shrink;
use ds_dynamics::Options;
use ds_dynamics::baseline::Baseline;
use ds_dynamics::case::{Case, PartModel};
use ds_dynamics::choice::Outcome;
use ds_dynamics::ego::{Actuated, Instant, actuate};
use ds_dynamics::motion::{StandIn, Window, takes};
use ds_dynamics::search::Effort;
use ds_dynamics::settings::Thresholds;
use ds_dynamics::space::{Part, Space};
use ds_dynamics::windows::Regime;
use ds_effect::{Insertion, Plant, Port};

use crate::error::SimulatorError;
use crate::fields::{differing, entry};
use crate::foreign::{Foreign, all};
use crate::message::{DRIVE, FRONT, Hello, REAR};
use crate::process::Process;

/// Most windows that are fitted.
const WINDOWS: usize = 96;
/// Most windows of each drive that is not.
const HELD_WINDOWS: usize = 24;
/// Windows on which both are differenced.
const COMPARED: usize = 8;
/// Share of the squared response on those windows that gain and shift must predict.
const PREDICTED: f64 = 0.9;
/// Shifts that are tried, in steps of the built-in car.
const SHIFTS: [i32; 7] = [-6, -4, -2, 0, 2, 4, 6];
/// Rollouts beyond which no parameter is differenced on all windows: the rest is kept for the fits.
const DIFFERENCES: usize = 900;
/// Rollouts beyond which the search is not repeated: the rest is kept for what is reported.
const REPEATS: usize = 1500;
/// Share of its range by which a parameter is moved.
const MOVED: f64 = 0.2;
/// Most repetitions of the search.
const ROUNDS: usize = 3;
/// Single effects at whose fits the simulator is run.
const SINGLES: usize = 3;
/// Stiffness that no force at a port stands for, as a factor.
const STIFFEST: f64 = 5.0;

/// What a simulator was asked for a case, and what it cannot be given.
pub struct Explored {
    foreign: Arc<Foreign>,
    untestable: Vec<String>,
}

impl Explored {
    /// Drives a case by a command that speaks the protocol as its nominal simulator, and runs that where a diagnosis needs it.
    ///
    /// # Errors
    /// If the simulator cannot be used.
    pub fn new(
        case: Case,
        command: &str,
        baseline: Option<Arc<Baseline>>,
        options: &Options,
    ) -> Result<(Case, Self), SimulatorError> {
        let (fit, _) = case.meta.split();
        let (mut case, foreign) = driven(thin(case), command)?;
        if let Some(baseline) = baseline {
            case = case.against(baseline)?;
        }
        let explored = Self { untestable: case.lacks().to_vec(), foreign };
        explore(&case, &fit, &explored.foreign, &explored.able(options))?;
        Ok((case, explored))
    }

    /// Returns how to diagnose its case: without what the simulator cannot be given.
    #[must_use]
    pub fn able(&self, options: &Options) -> Options {
        let without = options.without.iter().chain(&self.untestable).cloned().collect();
        Options { without, ..options.clone() }
    }

    /// Writes into the diagnosis of its case what was asked of the simulator, what went wrong and what could not be tested.
    pub fn tell(self, diagnosis: &mut Diagnosis) {
        let tally = self.foreign.tally();
        diagnosis.rollouts = Some(tally.rollouts);
        diagnosis.warnings.extend(tally.said());
        if !self.untestable.is_empty() {
            let names = self.untestable.join(", ");
            let text = format!("this simulator has neither a parameter nor a port for {names}: not testable");
            diagnosis.warnings.push(text);
        }
        diagnosis.not_testable.extend(self.untestable);
    }
}

/// Returns a healthy case for a baseline, driven by a command, all its drives explored.
///
/// # Errors
/// If the simulator cannot be used.
pub fn healthy(case: Case, command: &str) -> Result<Case, SimulatorError> {
    let (case, foreign) = driven(thin(case), command)?;
    let drives: Vec<usize> = (0..case.drives.len()).collect();
    explore(&case, &drives, &foreign, &Options::default())?;
    Ok(case)
}

/// Runs the simulator on the windows of some drives: at what is usual, for each parameter, and at the fits that matter.
fn explore(case: &Case, drives: &[usize], foreign: &Foreign, options: &Options) -> Result<(), SimulatorError> {
    let space = case.space(Part::Ego, &options.without, case.baseline.as_deref());
    let usual = space.usual();
    learn(case, drives, foreign, &space.plant(&usual));
    let tally = foreign.tally();
    if tally.masked >= tally.rollouts {
        return Err(SimulatorError::NoWindow { windows: tally.masked, why: tally.why });
    }
    for (k, coordinate) in space.coordinates.iter().enumerate() {
        if of_car(space.effects[coordinate.effect].insertion) {
            compare(case, drives, foreign, &space, &usual, k);
        }
    }
    settle(case, drives, foreign, options);
    Ok(())
}

/// Measures how far a diagnosis shrinks the gap of a simulator on some drives of a case (all of them if none are named), by
/// runs of it; also returns what went wrong with some of them.
///
/// # Errors
/// If the simulator cannot be used, or the diagnosis names an effect that it has neither a parameter nor a port for.
pub fn evaluate(
    diagnosis: &Diagnosis,
    case: Case,
    command: &str,
    drives: &[usize],
) -> Result<(Vec<Shrink>, Vec<String>), SimulatorError> {
    let (case, foreign) = driven(case, command)?;
    let untestable = case.lacks();
    let model = &diagnosis.corrected_model;
    let named = model.mismatch().into_iter().chain(model.added()).map(|(id, _)| id);
    let laws =
        model.obeyed().into_iter().filter(|law| !takes(case.stand_in.as_ref(), law.port())).map(|law| law.to_string());
    let beyond: Vec<String> = named.filter(|id| untestable.contains(id)).chain(laws).collect();
    if !beyond.is_empty() {
        return Err(SimulatorError::Beyond { effects: beyond.join(", ") });
    }
    let shrinks = ds_dynamics::evaluate(diagnosis, &case, drives);
    let tally = foreign.tally();
    if tally.masked >= tally.rollouts {
        return Err(SimulatorError::NoWindow { windows: tally.masked, why: tally.why });
    }
    Ok((shrinks, tally.said()))
}

/// Returns a case that a command drives.
fn driven(case: Case, command: &str) -> Result<(Case, Arc<Foreign>), SimulatorError> {
    let process = Process::start(command)?;
    let space = Space::new(Part::Ego, &case.meta.nominal, &[]);
    let reference = reference(&space, &process.hello)?;
    let hello = &process.hello;
    let open = Port::all().into_iter().filter(|port| hello.takes(*port)).collect();
    let stand_in = StandIn { kind: hello.kind(), lacks: untestable(&space, hello), takes: open };
    let foreign = Arc::new(Foreign::new(process, &case.meta.nominal, &reference));
    let motion: Arc<dyn ds_dynamics::motion::Motion> = foreign.clone();
    Ok((case.moved_by(&motion, stand_in), foreign))
}

/// Returns the car that a simulator stands for as it is: nominal, with the mismatch that it has physics of its own for at
/// its usual size.
fn reference(space: &Space, hello: &Hello) -> Result<Plant, SimulatorError> {
    let (mut vector, usual) = (space.neutral(), space.usual());
    for id in &hello.includes {
        let known = space.find(id).filter(|e| of_car(space.effects[*e].insertion));
        let effect = known.ok_or_else(|| SimulatorError::Hello {
            field: "includes".to_owned(),
            value: format!("{id:?}"),
            expected: "ids of effects on vehicle and road, see gap effects",
        })?;
        space.of(effect).into_iter().for_each(|k| vector[k] = usual[k]);
    }
    Ok(space.plant(&vector))
}

fn of_car(insertion: Insertion) -> bool {
    matches!(insertion, Insertion::Vehicle | Insertion::Road)
}

/// Returns the effects on vehicle and road that a simulator has neither parameters nor ports for.
fn untestable(space: &Space, hello: &Hello) -> Vec<String> {
    let neutral = space.neutral();
    let usual = space.plant(&neutral);
    let testable = |effect: usize| {
        let mut vector = neutral.clone();
        for k in space.of(effect) {
            let (low, high) = space.coordinates[k].parameter.slab;
            vector[k] = if (high - neutral[k]).abs() > 1e-9 { high } else { low };
        }
        let plant = space.plant(&vector);
        let stiff = plant.vehicle.front_stiffness_n > STIFFEST * usual.vehicle.front_stiffness_n;
        let lateral = hello.port(FRONT) && hello.port(REAR);
        differing(&plant, &usual).all(|field| {
            let pushed = !stiff && (!field.along || hello.port(DRIVE)) && (!field.across || lateral);
            entry(hello, field).is_some() || pushed
        })
    };
    let effects = (0..space.effects.len()).filter(|e| of_car(space.effects[*e].insertion) && !testable(*e));
    effects.map(|e| space.effects[e].id.to_owned()).collect()
}

/// Leaves at most as many windows as may be run: those that differ most from each other.
fn thin(mut case: Case) -> Case {
    let (fit, _) = case.meta.split();
    let mut sets = vec![(fit.clone(), WINDOWS)];
    sets.extend((0..case.drives.len()).filter(|d| !fit.contains(d)).map(|drive| (vec![drive], HELD_WINDOWS)));
    for (drives, most) in sets {
        let chosen = |drive: usize| drives.contains(&drive);
        let regimes: Vec<Regime> = case
            .ego
            .iter()
            .filter(|record| chosen(record.drive))
            .flat_map(|record| record.anchors.iter().map(|anchor| anchor.regime))
            .collect();
        let kept = apart(&regimes, most);
        let mut place = 0;
        for record in case.ego.iter_mut().filter(|record| chosen(record.drive)) {
            record.anchors.retain(|_| {
                place += 1;
                kept[place - 1]
            });
        }
    }
    case
}

/// Marks the regimes that lie farthest from each other, the first one to begin with.
fn apart(regimes: &[Regime], most: usize) -> Vec<bool> {
    let mut kept = vec![regimes.len() <= most; regimes.len()];
    if regimes.len() <= most {
        return kept;
    }
    let row = |r: &Regime| [r.speed_mps / 8.0, r.accel_mps2, r.lateral_mps2, 0.5 * r.demand_mps2, 20.0 * r.steer_rate];
    let rows: Vec<[f64; 5]> = regimes.iter().map(row).collect();
    let mut distance = vec![f64::INFINITY; rows.len()];
    for _ in 0..most {
        let next = (0..rows.len()).fold(0, |best, k| if distance[k] > distance[best] { k } else { best });
        kept[next] = true;
        for (k, row) in rows.iter().enumerate() {
            let squares: f64 = row.iter().zip(&rows[next]).map(|(a, b)| (a - b) * (a - b)).sum();
            distance[k] = if kept[k] { -1.0 } else { distance[k].min(squares) };
        }
    }
    kept
}

/// Returns the windows of some drives and their inputs for a car.
fn windows(case: &Case, drives: &[usize], plant: &Plant) -> Vec<(Vec<Window>, Actuated)> {
    let records = case.ego.iter().filter(|record| drives.contains(&record.drive));
    let of = |record: &ds_dynamics::windows::EgoRecord| {
        let windows = record.anchors.iter().map(|anchor| record.window(anchor, plant)).collect();
        (windows, actuate(&record.inputs, plant))
    };
    records.map(of).collect()
}

/// Runs all windows of some drives for a car.
fn learn(case: &Case, drives: &[usize], foreign: &Foreign, plant: &Plant) {
    for (windows, actuated) in windows(case, drives, plant) {
        foreign.learn(&windows, &actuated, plant);
    }
}

/// Compares the responses of both to one parameter on a few windows and says what the others would have, or runs them.
fn compare(case: &Case, drives: &[usize], foreign: &Foreign, space: &Space, usual: &[f64], k: usize) {
    let (low, high) = space.coordinates[k].parameter.slab;
    let mut moved = usual.to_vec();
    let end = if high - usual[k] > usual[k] - low { high } else { low };
    moved[k] += MOVED * (end - usual[k]);
    let plants = [usual, &moved].map(|vector| space.plant(vector));
    let sets = windows(case, drives, &plants[0]);
    let mut all_windows = Vec::new();
    for (set, (windows, actuated)) in sets.iter().enumerate() {
        let [before, after] = plants.each_ref().map(|plant| foreign.built_in(windows, actuated, plant));
        let added = foreign.adds(windows, actuated, &plants[0]);
        for (window, ((before, after), added)) in windows.iter().zip(before.iter().zip(&after).zip(added)) {
            let change: Vec<Instant> = before.iter().zip(after).map(|(b, a)| all(a, b, |a, b| a - b)).collect();
            all_windows.push(Response { set, window: *window, change, added });
        }
    }
    all_windows.retain(|response| response.added.iter().all(|added| !added.x.is_nan()));
    all_windows.sort_by(|a, b| b.size().total_cmp(&a.size()));
    // half of them the strongest, the others from all over
    let count = all_windows.len();
    let mut chosen: Vec<usize> =
        (0..COMPARED).map(|c| if c < COMPARED / 2 { c } else { c * (count - 1) / (COMPARED - 1).max(1) }).collect();
    chosen.retain(|c| *c < count);
    chosen.dedup();
    let mut pairs = Vec::new();
    for &c in &chosen {
        let response = &all_windows[c];
        let (one, actuated) = ([response.window], &sets[response.set].1);
        foreign.learn(&one, actuated, &plants[1]);
        let Some(now) = foreign.adds(&one, actuated, &plants[1]).pop() else { continue };
        let theirs = now.iter().zip(&response.added).map(|(now, before)| all(now, before, |a, b| a - b));
        let theirs: Vec<Instant> =
            theirs.zip(&response.change).map(|(more, own)| all(&more, own, |a, b| a + b)).collect();
        pairs.push((response.change.clone(), theirs));
    }
    let (links, predicted) = link(&pairs);
    for (_, response) in all_windows.iter().enumerate().filter(|(c, _)| !chosen.contains(c)) {
        let actuated = &sets[response.set].1;
        if predicted >= PREDICTED || foreign.tally().rollouts > DIFFERENCES {
            let theirs = transfer(&response.change, &links);
            let more = theirs.iter().zip(&response.change).map(|(theirs, own)| all(theirs, own, |a, b| a - b));
            let added = more.zip(&response.added).map(|(more, added)| all(&more, added, |a, b| a + b)).collect();
            foreign.suppose(&response.window, actuated, &plants[1], added);
        } else {
            foreign.learn(&[response.window], actuated, &plants[1]);
        }
    }
}

/// The built-in car's response to a parameter in a window, and what the simulator adds without it.
struct Response {
    set: usize,
    window: Window,
    change: Vec<Instant>,
    added: Vec<Instant>,
}

impl Response {
    fn size(&self) -> f64 {
        self.change.iter().map(|i| values(i).iter().map(|v| v * v).sum::<f64>()).sum()
    }
}

fn values(instant: &Instant) -> [f64; 7] {
    let Instant { x, y, yaw, v, yaw_rate, ax, ay } = *instant;
    [x, y, yaw, v, yaw_rate, ax, ay]
}

/// How a channel of the simulator answers compared with the built-in car: gain and shift in steps.
type Link = (f64, i32);

/// Fits gain and shift of each channel and returns them with the share of the squared responses that they predict, each
/// channel counting alike.
fn link(pairs: &[(Vec<Instant>, Vec<Instant>)]) -> ([Link; 7], f64) {
    let mut links = [(1.0, 0); 7];
    let (mut left, mut total) = (0.0, 0.0);
    for (channel, link) in links.iter_mut().enumerate() {
        let of = |i: &Instant| values(i)[channel];
        let squares: f64 = pairs.iter().flat_map(|(_, theirs)| theirs).map(|i| of(i) * of(i)).sum();
        let own: f64 = pairs.iter().flat_map(|(own, _)| own).map(|i| of(i) * of(i)).sum();
        if squares.max(own) < 1e-12 {
            continue;
        }
        let mut best = squares + own;
        for shift in SHIFTS {
            let (mut cross, mut power) = (0.0, 0.0);
            for (own, theirs) in pairs {
                for (k, theirs) in theirs.iter().enumerate() {
                    let a = of(shifted(own, k, shift));
                    cross += a * of(theirs);
                    power += a * a;
                }
            }
            let gain = if power > 0.0 { cross / power } else { 0.0 };
            let rest = squares - gain * cross;
            if rest < best - 1e-9 * squares || (shift == 0 && rest <= best * (1.0 + 1e-9)) {
                (best, *link) = (rest, (gain, shift));
            }
        }
        left += best.max(0.0) / squares.max(own);
        total += 1.0;
    }
    (links, if total > 0.0 { 1.0 - left / total } else { 1.0 })
}

fn shifted(own: &[Instant], k: usize, shift: i32) -> &Instant {
    let place = (k as i64 - i64::from(shift)).clamp(0, own.len() as i64 - 1);
    &own[usize::try_from(place).unwrap_or(0)]
}

fn transfer(own: &[Instant], links: &[Link; 7]) -> Vec<Instant> {
    let at = |k: usize, channel: usize| links[channel].0 * values(shifted(own, k, links[channel].1))[channel];
    let of = |k: usize| Instant {
        x: at(k, 0),
        y: at(k, 1),
        yaw: at(k, 2),
        v: at(k, 3),
        yaw_rate: at(k, 4),
        ax: at(k, 5),
        ay: at(k, 6),
    };
    (0..own.len()).map(of).collect()
}

/// Searches, runs the simulator at the fits that matter, and repeats until the same effects are accepted.
fn settle(case: &Case, fit: &[usize], foreign: &Foreign, options: &Options) {
    let mut before: Option<Vec<usize>> = None;
    for _ in 0..ROUNDS {
        let model = PartModel::new(case, Part::Ego, fit, &options.without);
        let outcome = Outcome::run(&model, fit, Effort::Quick, &Thresholds::default());
        let accepted = outcome.accepted.as_ref();
        let now = accepted.map_or_else(Vec::new, |h| h.effects.clone());
        let mut vectors = vec![outcome.search.null.vector.clone()];
        vectors.extend(accepted.map(|h| h.fit.vector.clone()));
        let singles = outcome.search.singles.iter().filter(|h| h.gain > 0.0 && h.effects != now);
        vectors.extend(singles.take(SINGLES - usize::from(accepted.is_some())).map(|h| h.fit.vector.clone()));
        for vector in &vectors {
            if foreign.tally().rollouts > REPEATS {
                return;
            }
            learn(case, fit, foreign, &model.space.plant(vector));
        }
        if before.as_ref() == Some(&now) {
            return;
        }
        before = Some(now);
    }
}
