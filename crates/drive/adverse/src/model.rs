//! How vehicles usually move, forwards and backwards in time: counts of transitions between states half a second apart.
//!
//! A state is (v, a, ω): speed at the end of half a second, mean acceleration and mean yaw rate in it. One table of
//! counts (v, a, ω) → (a′, ω′) is normalised over successors for the forward chance and over predecessors for the
//! backward one; both are smoothed by a Dirichlet prior. A second, smaller one counts what yaw rate beyond that of the
//! lane follows an offset and a heading error. SI units; the same tracks give the same table.

use std::fmt::Write as _;

use ds_space::angle::turn;
use ds_world::{AgentClass, Scene};

use crate::road::Road;

/// Ticks of half a second.
pub(crate) const STEP_TICKS: usize = 5;
const SPEEDS: usize = 8;
const RATES: usize = 9;
const STATES: usize = SPEEDS * RATES * RATES;
const MOVES: usize = RATES * RATES;
const OFFSETS: usize = 5;
/// Upper edges of the bins, the last one open.
const SPEED_MPS: [f64; SPEEDS - 1] = [0.3, 2.5, 5.0, 7.5, 10.0, 13.0, 17.0];
const ACCELERATION_MPS2: [f64; RATES - 1] = [-4.5, -2.5, -1.2, -0.3, 0.3, 0.8, 1.5, 2.5];
const YAW_RATE_RADPS: [f64; RATES - 1] = [-0.45, -0.2, -0.08, -0.02, 0.02, 0.08, 0.2, 0.45];
const OFFSET_M: [f64; OFFSETS - 1] = [-0.8, -0.25, 0.25, 0.8];
const ERROR_RAD: [f64; OFFSETS - 1] = [-0.08, -0.02, 0.02, 0.08];
/// Accelerations that stand for the bins, in metres per second squared.
pub(crate) const ACCELERATIONS_MPS2: [f64; RATES] = [-5.5, -3.4, -1.8, -0.7, 0.0, 0.55, 1.1, 1.9, 2.8];
/// Yaw rates that stand for the bins, in radians per second.
const YAW_RATES_RADPS: [f64; RATES] = [-0.6, -0.3, -0.13, -0.045, 0.0, 0.045, 0.13, 0.3, 0.6];
/// The prior: so many transitions, spread over all moves.
const PRIOR: f64 = 8.0;
const FORMAT: &str = "dreamstream-motion-model 1";

fn bin(edges: &[f64], value: f64) -> usize {
    edges.partition_point(|edge| *edge < value)
}

/// A state of motion over half a second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Speed at its end, in metres per second.
    pub speed_mps: f64,
    /// Mean acceleration, in metres per second squared.
    pub acceleration_mps2: f64,
    /// Mean yaw rate, in radians per second.
    pub yaw_rate_radps: f64,
}

impl Step {
    fn moves(&self) -> usize {
        bin(&ACCELERATION_MPS2, self.acceleration_mps2) * RATES + bin(&YAW_RATE_RADPS, self.yaw_rate_radps)
    }

    fn state(&self) -> usize {
        bin(&SPEED_MPS, self.speed_mps) * MOVES + self.moves()
    }
}

/// Where a vehicle is in its lane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Keeping {
    pub left_m: f64,
    pub error_rad: f64,
}

impl Keeping {
    fn cell(self) -> usize {
        bin(&OFFSET_M, self.left_m) * OFFSETS + bin(&ERROR_RAD, self.error_rad)
    }
}

/// Says why the text of a motion model is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// It does not begin as one.
    #[error("line 1 is {found:?}, not {FORMAT:?}")]
    Format {
        /// The first line.
        found: String,
    },
    /// A line is no table, cell and count.
    #[error("line {line} is {found:?}, not a table (m or l), a cell and a count within the model's bounds")]
    Line {
        /// Which line, from 1.
        line: usize,
        /// Its text.
        found: String,
    },
}

/// Chances of motions, forwards and backwards.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionModel {
    /// Transitions by state before and move after.
    counts: Vec<u32>,
    /// Sums over moves after, by state before.
    after: Vec<u32>,
    /// Sums over accelerations and yaw rates before, by speed before and move after.
    before: Vec<u32>,
    /// Yaw rates beyond the lane's by place in the lane.
    keeping: Vec<u32>,
}

impl Default for MotionModel {
    fn default() -> Self {
        Self {
            counts: vec![0; STATES * MOVES],
            after: vec![0; STATES],
            before: vec![0; SPEEDS * MOVES],
            keeping: vec![0; OFFSETS * OFFSETS * RATES],
        }
    }
}

impl MotionModel {
    /// Returns the shipped model, fitted on generated traffic: 25 seeds from 5000 on of each family.
    ///
    /// # Panics
    /// Never: the shipped file is read by a test.
    #[must_use]
    pub fn town() -> Self {
        Self::from_text(include_str!("../models/town.motion")).expect("the shipped model is read by a test")
    }

    /// Fits a model on the moving vehicles of scenes at 10 Hz.
    #[must_use]
    pub fn fit<'a>(scenes: impl IntoIterator<Item = &'a Scene>) -> Self {
        let mut model = Self::default();
        for scene in scenes {
            model.count(scene);
        }
        model
    }

    fn count(&mut self, scene: &Scene) {
        let road = Road::new(&scene.map);
        let dt_secs = scene.dt.secs();
        for track in scene.tracks.iter().filter(|track| track.class == AgentClass::Vehicle) {
            let mut last: Option<(Step, Option<(Keeping, f64)>)> = None;
            for ends in track.points.chunks(STEP_TICKS).collect::<Vec<_>>().windows(2) {
                let (Some(Some(from)), Some(Some(to))) = (ends[0].first(), ends[1].first()) else {
                    last = None;
                    continue;
                };
                let secs = STEP_TICKS as f64 * dt_secs;
                let (v0, v1) = (from.velocity_mps.length(), to.velocity_mps.length());
                let step = Step {
                    speed_mps: v1,
                    acceleration_mps2: (v1 - v0) / secs,
                    yaw_rate_radps: turn(from.pose.heading_rad, to.pose.heading_rad) / secs,
                };
                let place = road.lane_at(&to.pose).map(|lane| {
                    let keeping =
                        Keeping { left_m: lane.left_m, error_rad: turn(lane.heading_rad, to.pose.heading_rad) };
                    (keeping, lane.heading_rad)
                });
                if let Some((before, was)) = last
                    && v0.max(v1) > 0.3
                {
                    self.add(&before, &step);
                    if let (Some((keeping, was_rad)), Some((_, is_rad))) = (was, place) {
                        let extra = step.yaw_rate_radps - turn(was_rad, is_rad) / secs;
                        self.keeping[keeping.cell() * RATES + bin(&YAW_RATE_RADPS, extra)] += 1;
                    }
                }
                last = Some((step, place));
            }
        }
    }

    fn add(&mut self, before: &Step, after: &Step) {
        self.put(before.state() * MOVES + after.moves(), 1);
    }

    fn put(&mut self, cell: usize, count: u32) {
        let (state, moves) = (cell / MOVES, cell % MOVES);
        self.counts[cell] += count;
        self.after[state] += count;
        self.before[state / MOVES * MOVES + moves] += count;
    }

    /// Returns the number of transitions that were counted.
    #[must_use]
    pub fn transitions(&self) -> u64 {
        self.after.iter().map(|count| u64::from(*count)).sum()
    }

    /// Returns −ln of the chance of a step after another.
    #[must_use]
    pub fn forwards(&self, before: &Step, after: &Step) -> f64 {
        let state = before.state();
        let count = f64::from(self.counts[state * MOVES + after.moves()]);
        -((count + PRIOR / MOVES as f64) / (f64::from(self.after[state]) + PRIOR)).ln()
    }

    /// Returns −ln of the chance of a step before another, the speed between them given.
    #[must_use]
    pub fn backwards(&self, before: &Step, after: &Step) -> f64 {
        let (state, moves) = (before.state(), after.moves());
        let count = f64::from(self.counts[state * MOVES + moves]);
        let sum = f64::from(self.before[state / MOVES * MOVES + moves]);
        -((count + PRIOR / MOVES as f64) / (sum + PRIOR)).ln()
    }

    /// Returns a step before another by its backward chance and a number between 0 and 1, the speed between them given.
    pub(crate) fn drawn_before(&self, speed_mps: f64, after: &Step, uniform: f64) -> Step {
        let mut step = Step { speed_mps, acceleration_mps2: 0.0, yaw_rate_radps: 0.0 };
        let mut left = uniform;
        for acceleration_mps2 in ACCELERATIONS_MPS2 {
            for yaw_rate_radps in YAW_RATES_RADPS {
                step = Step { speed_mps, acceleration_mps2, yaw_rate_radps };
                left -= (-self.backwards(&step, after)).exp();
                if left < 0.0 {
                    return step;
                }
            }
        }
        step
    }

    /// Returns −ln of the chance of a yaw rate beyond that of the lane, at a place in the lane.
    pub(crate) fn keeping(&self, place: Keeping, extra_radps: f64) -> f64 {
        let row = &self.keeping[place.cell() * RATES..(place.cell() + 1) * RATES];
        let sum: f64 = row.iter().map(|count| f64::from(*count)).sum();
        -((f64::from(row[bin(&YAW_RATE_RADPS, extra_radps)]) + 0.1 * PRIOR) / (sum + 0.9 * PRIOR)).ln()
    }

    /// Returns the model's file: a line that names the format, then table, cell and count of all cells that are not 0.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut text = format!("{FORMAT}\n");
        for (name, table) in [('m', &self.counts), ('l', &self.keeping)] {
            for (cell, count) in table.iter().enumerate().filter(|(_, count)| **count > 0) {
                writeln!(text, "{name} {cell} {count}").expect("writing to a string succeeds");
            }
        }
        text
    }

    /// Reads a model's file.
    ///
    /// # Errors
    /// [`ModelError`] names the first bad line.
    pub fn from_text(text: &str) -> Result<Self, ModelError> {
        let mut lines = text.lines();
        let first = lines.next().unwrap_or_default();
        if first != FORMAT {
            return Err(ModelError::Format { found: first.chars().take(80).collect() });
        }
        let mut model = Self::default();
        for (line, text) in (2..).zip(lines) {
            model.read(text).ok_or_else(|| ModelError::Line { line, found: text.chars().take(80).collect() })?;
        }
        Ok(model)
    }

    fn read(&mut self, line: &str) -> Option<()> {
        let mut words = line.split(' ');
        let (table, cell, count) = (words.next()?, words.next()?, words.next()?);
        let (cell, count): (usize, u32) = (cell.parse().ok()?, count.parse().ok()?);
        // Sums over a table stay far below the limit of their type.
        if count == 0 || count > 1_000_000 || words.next().is_some() {
            return None;
        }
        match table {
            "m" if cell < self.counts.len() && self.counts[cell] == 0 && self.after[cell / MOVES] < 1 << 30 => {
                self.put(cell, count);
            }
            "l" if cell < self.keeping.len() && self.keeping[cell] == 0 => self.keeping[cell] = count,
            _ => return None,
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_scenario::{Family, generate};

    fn step(speed_mps: f64, acceleration_mps2: f64, yaw_rate_radps: f64) -> Step {
        Step { speed_mps, acceleration_mps2, yaw_rate_radps }
    }

    #[test]
    fn chances_sum_to_one_in_both_directions() {
        let scenes = [generate(Family::CutIn, 3), generate(Family::Roundabout, 3)];
        let model = MotionModel::fit(&scenes);
        assert!(model.transitions() > 100, "{}", model.transitions());
        let rates = [-0.6, -0.3, -0.1, -0.05, 0.0, 0.05, 0.1, 0.3, 0.6];
        let all = || ACCELERATIONS_MPS2.into_iter().flat_map(move |a| rates.into_iter().map(move |w| step(8.0, a, w)));
        let given = step(8.0, 0.0, 0.0);
        let forwards: f64 = all().map(|after| (-model.forwards(&given, &after)).exp()).sum();
        let backwards: f64 = all().map(|before| (-model.backwards(&before, &given)).exp()).sum();
        assert!((forwards - 1.0).abs() < 1e-9 && (backwards - 1.0).abs() < 1e-9, "{forwards} {backwards}");
        let place = Keeping { left_m: 0.0, error_rad: 0.0 };
        let keeping: f64 = rates.into_iter().map(|extra| (-model.keeping(place, extra)).exp()).sum();
        assert!((keeping - 1.0).abs() < 1e-9, "{keeping}");
    }

    #[test]
    fn directions_of_time_differ() {
        // Three times braking follows cruising, never the other way round.
        let mut model = MotionModel::default();
        let (cruise, brake) = (step(9.0, 0.0, 0.0), step(8.0, -3.0, 0.0));
        (0..3).for_each(|_| model.add(&cruise, &brake));
        assert!((model.forwards(&cruise, &brake) + ((3.0 + 8.0 / 81.0) / 11.0f64).ln()).abs() < 1e-12);
        assert!((model.backwards(&cruise, &brake) + ((3.0 + 8.0 / 81.0) / 11.0f64).ln()).abs() < 1e-12);
        assert!(model.forwards(&brake, &cruise) > 4.0 && model.backwards(&brake, &cruise) > 4.0);
    }

    #[test]
    fn the_shipped_model_is_that_of_its_recipe() {
        let seeds = |family: &Family| (5000..5025).map(|seed| generate(*family, seed)).collect::<Vec<_>>();
        let scenes: Vec<Scene> = Family::ALL.iter().flat_map(seeds).collect();
        let model = MotionModel::fit(&scenes);
        if std::env::var_os("UPDATE_GOLDEN").is_some() {
            std::fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/models/town.motion"), model.to_text())
                .expect("the model can be written");
        }
        let shipped = include_str!("../models/town.motion");
        assert!(model.to_text() == shipped, "run again with UPDATE_GOLDEN=1: the generator or the fit has changed");
        assert!(model == MotionModel::town());
    }

    #[test]
    fn a_file_holds_the_model_and_nonsense_is_refused_by_line() {
        let scene = generate(Family::FreeCurve, 5);
        let model = MotionModel::fit([&scene]);
        let text = model.to_text();
        assert!(text.len() < 1 << 20);
        assert_eq!(MotionModel::from_text(&text), Ok(model));
        for (bad, line) in [("m 1", 2), ("m 52488 1", 2), ("x 1 1", 2), ("m 1 -1", 2), ("m 1 1\nm 1 1", 3)] {
            let error = MotionModel::from_text(&format!("{FORMAT}\n{bad}\n")).expect_err(bad);
            assert!(matches!(error, ModelError::Line { line: at, .. } if at == line), "{bad}: {error}");
        }
        assert!(matches!(MotionModel::from_text("{}"), Err(ModelError::Format { .. })));
    }
}
