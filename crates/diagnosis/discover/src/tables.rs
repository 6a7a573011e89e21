//! Tables: what multiplies one signal, or nothing, as a curve over another one, for what no short sum of products tells. A curve runs
//! straight between even knots over the range of the drives and falls to 0 within half a step beyond it.
//!
//! One column per knot; coarse knots are sums of fine ones, so that both cost the same rollouts.

use ds_effect::law::Expression;
use ds_effect::{Channel, Port};
use nalgebra::{Cholesky, DMatrix};
use rayon::prelude::*;

use crate::linear::{Fitted, Rows};
use crate::port::{Base, Searched};
use crate::settings::ALIKE;
use crate::terms::{Candidate, rounded, usual};

/// Steps of a table, and of one over the phase of a line; half of them and, of the best, twice as many are tried too.
const STEPS: usize = 10;
const PHASES: usize = 8;
/// Steps over which neighbouring knots are believed to go together beforehand, and the share of a knot's variance that is its own.
const LENGTH: f64 = 1.5;
const OWN: f64 = 0.05;

// what the curve multiplies, and the signal that it runs over
const STEERING: &[(&str, &str)] =
    &[("delta", "v"), ("1", "delta"), ("1", "v"), ("1", "accel"), ("1", "ay"), ("1", "delta_rate"), ("delta", "accel")];
const DRIVE: &[(&str, &str)] = &[("1", "v"), ("1", "accel"), ("accel", "v"), ("1", "ay"), ("1", "delta")];
const FRONT: &[(&str, &str)] = &[("1", "slip_front"), ("slip_front", "v"), ("slip_front", "ax")];
const REAR: &[(&str, &str)] = &[("1", "slip_rear"), ("slip_rear", "v"), ("slip_rear", "ax")];
const BODY: &[(&str, &str)] = &[("1", "v"), ("1", "yaw_rate"), ("1", "ay"), ("yaw_rate", "v")];
const SENSOR: &[(&str, &str)] =
    &[("1", "v"), ("1", "yaw_rate"), ("1", "ay"), ("1", "ax"), ("1", "delta"), ("yaw_rate", "v")];
const FOLLOWER: &[(&str, &str)] = &[("1", "gap"), ("1", "dv"), ("1", "v"), ("dv", "gap")];
/// What a curve over the phase of a line multiplies.
const BEATS: &[&str] = &["1"];
const BEATS_OF_DRIVE: &[&str] = &["1", "pos(accel)", "neg(accel)"];
const BEATS_OF_STEERING: &[&str] = &["1", "delta"];

/// What a table is taken of.
#[derive(Clone)]
struct Table {
    carrier: Expression,
    scale: f64,
    over: Over,
}

/// What a table runs over.
#[derive(Clone)]
enum Over {
    /// A signal in a range.
    Signal(&'static str, [f64; 2]),
    /// The phase of a period, s.
    Phase(f64),
}

/// A table that explains most at its port, and of how many it is one; its columns and numbers are those that the knots are mixed of.
pub(crate) struct Best<'b> {
    pub(crate) searched: Searched<'b>,
    pub(crate) mixing: DMatrix<f64>,
    pub(crate) of: usize,
}

/// Searches the tables of a port that has been searched for sums; `None` where none could be seen.
pub(crate) fn best<'b>(base: &'b Base<'_, '_>, sums: &Searched<'b>) -> Option<Best<'b>> {
    let columns =
        |knots: &[Candidate]| -> Vec<Vec<f64>> { knots.par_iter().map(|knot| base.column(sums.port, knot)).collect() };
    let mut tried: Vec<(Fit<'b>, Table)> = Vec::new();
    for table in tables(base, sums.port) {
        let Some(fine) = table.knots(table.steps()) else { continue };
        let of_fine = columns(&fine);
        let half = matches!(table.over, Over::Signal(..)).then(|| table.knots(table.steps() / 2)).flatten();
        let coarse = half.and_then(|coarse| fitted(sums, &table, &coarse, &halved(&of_fine)));
        let both = [fitted(sums, &table, &fine, &of_fine), coarse];
        tried.extend(both.into_iter().flatten().map(|fit| (fit, table.clone())));
    }
    let of = tried.len() + 1;
    let gain = |fit: &Fit<'_>| fit.0.sets[0].gain;
    let (fit, table) = tried.into_iter().max_by(|a, b| gain(&a.0).total_cmp(&gain(&b.0)))?;
    let finest = table.knots(2 * table.steps()).and_then(|knots| fitted(sums, &table, &knots, &columns(&knots)));
    let (searched, mixing) = finest.filter(|finest| gain(finest) > gain(&fit)).unwrap_or(fit);
    Some(Best { searched, mixing, of })
}

/// Returns the share of refits without one drive whose curve is much the same.
pub(crate) fn stability(table: &Searched<'_>) -> f64 {
    let (rows, whole) = (&table.rows, &table.sets[0]);
    let n = rows.nuisances.len();
    let alike = (0..rows.drives.len()).filter(|drive| {
        let refit = rows.settle(&whole.set, &whole.residuals, Some(*drive));
        let [a, b] = [whole, &refit].map(|fit| fit.moves.rows(n, whole.set.len()));
        a.dot(&b) >= ALIKE * a.norm() * b.norm()
    });
    alike.count() as f64 / rows.drives.len().max(1) as f64
}

fn tables(base: &Base<'_, '_>, port: Port) -> Vec<Table> {
    let (curves, beats) = match port {
        Port::Steering | Port::Linkage => (STEERING, BEATS_OF_STEERING),
        Port::Drive => (DRIVE, BEATS_OF_DRIVE),
        Port::Front => (FRONT, BEATS),
        Port::Rear => (REAR, BEATS),
        Port::Yaw | Port::Side => (BODY, BEATS),
        Port::Sensor(Channel::Dx | Channel::Dy) => (&[][..], BEATS),
        Port::Sensor(_) => (SENSOR, BEATS),
        Port::Follower => (FOLLOWER, BEATS),
    };
    let signal = |name: &'static str| base.signals.domain(name).map(|range| Over::Signal(name, range));
    let curves = curves.iter().filter_map(|(carrier, name)| Some((*carrier, signal(name)?)));
    let phases = base
        .lines_hz
        .iter()
        .flat_map(|&hz| beats.iter().map(move |carrier| (*carrier, Over::Phase(rounded(1.0 / hz)))));
    let own = usual(port, &base.model.space.plant(&base.null.vector).vehicle);
    let table = |(carrier, over)| {
        let carrier = Expression::parse(carrier).ok()?.within(|name| base.signals.domain(name));
        let sized = base.signals.sized(carrier, own)?;
        Some(Table { carrier: sized.expression, scale: sized.scale, over })
    };
    curves.chain(phases).filter_map(table).collect()
}

impl Table {
    fn steps(&self) -> usize {
        if matches!(self.over, Over::Phase(_)) { PHASES } else { STEPS }
    }

    /// Returns what independent normal numbers make of some of its knots, so that neighbours go together: a root of their covariance.
    fn mixing(&self, places: &[usize], count: usize) -> Option<DMatrix<f64>> {
        let apart = |a: usize, b: usize| match self.over {
            Over::Signal(..) => a.abs_diff(b),
            Over::Phase(_) => a.abs_diff(b).min(count - a.abs_diff(b)),
        };
        let together = |i: usize, j: usize| {
            let steps = apart(places[i], places[j]) as f64 / LENGTH;
            (1.0 - OWN) * (-0.5 * steps * steps).exp() + if i == j { OWN } else { 0.0 }
        };
        Cholesky::new(DMatrix::from_fn(places.len(), places.len(), together)).map(|root| root.l())
    }

    /// Returns its knots at so many steps.
    fn knots(&self, steps: usize) -> Option<Vec<Candidate>> {
        let text = |k: usize| match self.over {
            Over::Signal(name, [from, to]) => {
                let step = (to - from) / steps as f64;
                let middle = from + step * k as f64;
                let fall = |end: usize| if k == end { 0.5 * step } else { step };
                let [low, middle, high] = [middle - fall(0), middle, middle + fall(steps)].map(rounded);
                format!("hat({name};{low};{middle};{high})")
            }
            Over::Phase(period_secs) => {
                let [low, middle, high] = [-1.0, 0.0, 1.0].map(|side| (k as f64 + side) / steps as f64);
                format!("beat({period_secs};{low};{middle};{high})")
            }
        };
        let knot = |k: usize| {
            let expression = self.carrier.times(&Expression::parse(&text(k)).ok()?);
            Some(Candidate { expression, scale: self.scale, group: k.to_string() })
        };
        // the knot at the end of a period is the one at its start
        let count = if matches!(self.over, Over::Signal(..)) { steps + 1 } else { steps };
        (0..count).map(knot).collect()
    }
}

/// Returns the columns of knots twice as far apart: every second one with half of its neighbours.
fn halved(columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let wide = |k: usize| {
        let mut column = columns[k].clone();
        for other in [k.checked_sub(1), Some(k + 1)].into_iter().flatten().filter_map(|at| columns.get(at)) {
            column.iter_mut().zip(other).for_each(|(sum, value)| *sum += 0.5 * value);
        }
        column
    };
    (0..columns.len()).step_by(2).map(wide).collect()
}

/// A table and what its knots are mixed of.
type Fit<'b> = (Searched<'b>, DMatrix<f64>);

/// Fits all knots that were met in the drives.
fn fitted<'b>(sums: &Searched<'b>, table: &Table, candidates: &[Candidate], columns: &[Vec<f64>]) -> Option<Fit<'b>> {
    let count = candidates.len();
    let met: Vec<usize> = (0..count).filter(|k| columns[*k].iter().any(|v| *v != 0.0)).collect();
    if met.len() < 3 {
        return None;
    }
    let candidates: Vec<Candidate> = met.iter().map(|k| candidates[*k].clone()).collect();
    let mixing = table.mixing(&met, count)?;
    let mixed = |k: usize| {
        let mut sum = vec![0.0; columns[0].len()];
        for (place, share) in met.iter().zip(mixing.column(k).iter()) {
            sum.iter_mut().zip(&columns[*place]).for_each(|(sum, value)| *sum += share * value);
        }
        sum
    };
    let terms: Vec<Vec<f64>> = (0..candidates.len()).map(mixed).collect();
    let groups = candidates.iter().map(|c| c.group.clone()).collect();
    let rows = Rows { terms, groups, ..sums.rows.without_terms() };
    let empty = rows.settle(&[], &sums.empty.residuals, None);
    let all: Vec<usize> = (0..candidates.len()).collect();
    let whole = rows.settle(&all, &sums.sets[0].residuals, None);
    let sets = vec![Fitted { gain: whole.gain - empty.gain, ..whole }];
    Some((Searched { port: sums.port, candidates, rows, empty, sets }, mixing))
}
