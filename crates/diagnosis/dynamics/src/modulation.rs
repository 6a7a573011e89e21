//! When does an accepted effect act: always, from an instant on, until one, or more and more?
//!
//! The effect's part of each residual is multiplied by a pattern in time, the fitted coordinates give way under their
//! priors (one linear step). With g and h of a pattern after that projection, its log evidence is
//! g² / 2(h + τ⁻²) − ½ ln(1 + τ² h), uniform over the instants of a kind; kinds then compete by their robust losses.

use ds_diagnosis::modulation::{CONSTANT, OFFSET, ONSET, RAMP, Session};
use ds_effect::Insertion;
use nalgebra::{DMatrix, DVector};

use crate::case::PartModel;
use crate::fit::{Fit, Model, data_loss};
use crate::settings::{KAPPA, LOOSER, MODULATION_GAIN, MODULATION_SD, NU};

/// Time between the instants tried, s.
const GRID_SECS: f64 = 0.5;
/// Most instants tried in a drive.
const MOST_INSTANTS: f64 = 160.0;
/// Least time at either end of a drive that an instant keeps from it, s: what happens there does not show.
const EDGE_SECS: f64 = 2.0;
/// Rounds of robust weights.
const ROUNDS: usize = 3;

/// How the drives beside the one of the instant go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// Those after it stay changed.
    Later,
    /// The effect acts in this drive alone.
    Own,
    /// The same at the same time since the start of each.
    Each,
}

impl Scope {
    const ALL: [Self; 3] = [Self::Later, Self::Own, Self::Each];

    /// Returns the word of the file.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Later => "later",
            Self::Own => "drive",
            Self::Each => "each",
        }
    }
}

/// A course of an effect in time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pattern {
    /// constant, onset, offset or ramp.
    pub kind: &'static str,
    /// The drive of the instant.
    pub drive: usize,
    /// The instant, s since the first window of that drive.
    pub secs: f64,
    /// What the other drives do.
    pub scope: Scope,
}

/// What was found of one effect.
#[derive(Debug, Clone)]
pub struct Timing {
    /// Its place in the space.
    pub effect: usize,
    /// Its course; of kind constant unless another one is telling.
    pub pattern: Pattern,
    /// Log evidence of the best other kind over a constant effect.
    pub gain: f64,
    /// Size while it acts, as a share of the estimate over all.
    pub size: f64,
    /// The instant and the ends of its 90 % set, s by the stamps of its drive.
    pub instant: [f64; 3],
    /// Size by drive.
    pub sessions: Vec<Session>,
    /// What the fit leaves once the effect has this course.
    pub residuals: Vec<f64>,
}

impl Timing {
    /// Tells whether the effect is anything but constant.
    #[must_use]
    pub fn is_telling(&self) -> bool {
        self.pattern.kind != CONSTANT
    }
}

/// One block of a window: what the sums over its residuals are made of.
struct Cell {
    drive: usize,
    /// Start of its rollout, start and end of the block, s since the first window of the drive.
    from: f64,
    block: [f64; 2],
    members: Vec<usize>,
}

/// One effect of a fit with all others linearised.
struct Linear<'a> {
    cells: Vec<Cell>,
    drives: Vec<(usize, f64, f64)>,
    instantly: bool,
    /// What the effect adds to a residual that is explained, and the residual without the effect.
    signature: Vec<f64>,
    bare: Vec<f64>,
    columns: Vec<&'a [f64]>,
    precision: Vec<f64>,
    pull: Vec<f64>,
}

/// The sums of one set of weights.
struct Sums {
    own: Vec<[f64; 2]>,
    cross: Vec<DVector<f64>>,
    inverse: DMatrix<f64>,
    slope: DVector<f64>,
}

/// The best course of one kind.
struct Best {
    pattern: Pattern,
    evidence: f64,
    interval: [f64; 2],
    size: f64,
    residuals: Vec<f64>,
}

/// Returns the course of the effect of a fit that is furthest from constant, if the fit has effects.
#[must_use]
pub fn course(model: &PartModel<'_>, fit: &Fit, effects: &[usize]) -> Option<Timing> {
    let found = effects.iter().filter_map(|effect| timing(model, fit, effects, *effect));
    found.max_by(|a, b| a.gain.total_cmp(&b.gain))
}

fn timing(model: &PartModel<'_>, fit: &Fit, effects: &[usize], effect: usize) -> Option<Timing> {
    let linear = Linear::new(model, fit, effects, effect);
    let constant = linear.best(CONSTANT, &fit.residuals)?;
    let kinds = [ONSET, OFFSET, RAMP].iter().filter_map(|kind| linear.best(kind, &fit.residuals));
    let other = kinds.max_by(|a, b| a.evidence.total_cmp(&b.evidence));
    let sessions = linear.sessions(&fit.residuals);
    let gain = other.as_ref().map_or(f64::NEG_INFINITY, |other| other.evidence - constant.evidence);
    let best = other.filter(|_| gain > MODULATION_GAIN).unwrap_or(constant);
    let start = linear.drives.iter().find(|d| d.0 == best.pattern.drive).map_or(0.0, |d| d.1);
    let instant = [best.pattern.secs, best.interval[0], best.interval[1]].map(|secs| secs + start);
    Some(Timing { effect, pattern: best.pattern, gain, size: best.size, instant, sessions, residuals: best.residuals })
}

impl<'a> Linear<'a> {
    fn new(model: &PartModel<'_>, fit: &'a Fit, effects: &[usize], effect: usize) -> Self {
        let own = model.space.of(effect);
        let usual = model.space.usual();
        let mut absent = fit.vector.clone();
        own.iter().for_each(|k| absent[*k] = usual[*k]);
        let bare = model.residuals(&absent);
        let signature = bare.iter().zip(&fit.residuals).map(|(without, with)| without - with).collect();
        let suspected: Vec<usize> = effects.iter().flat_map(|e| model.space.of(*e)).collect();
        let (mut columns, mut precision, mut pull) = (Vec::new(), Vec::new(), Vec::new());
        for k in fit.free.iter().filter(|k| !own.contains(k)) {
            let Some(column) = &fit.columns[*k] else { continue };
            let nuisance = model.space.coordinates[*k].nuisance.filter(|_| !suspected.contains(k));
            // what the data alone say: a nuisance that its prior holds back must not be let go by way of a course
            let weight = nuisance.map_or(1e-9, |n| 1.0 / (LOOSER * n.sd).powi(2));
            columns.push(column.as_slice());
            precision.push(weight);
            pull.push(nuisance.map_or(0.0, |n| weight * (fit.vector[*k] - n.mean)));
        }
        let instantly = matches!(model.space.effects[effect].insertion, Insertion::Sensor | Insertion::Clock);
        let (cells, drives) = cells(model);
        Self { cells, drives, instantly, signature, bare, columns, precision, pull }
    }

    /// Returns how much of the effect acts in a block, from 0 to 1.
    fn share(&self, pattern: &Pattern, cell: &Cell) -> f64 {
        let since = |from: f64, to: f64| ((to - pattern.secs) / (to - from).max(1e-9)).clamp(0.0, 1.0);
        let here = cell.drive == pattern.drive || pattern.scope == Scope::Each;
        let on = if here {
            match (pattern.kind, self.instantly) {
                (RAMP, _) => {
                    let end = self.drives.iter().find(|d| d.0 == cell.drive).map_or(1.0, |d| d.2 - d.1);
                    ((cell.block[1] - pattern.secs) / (end - pattern.secs).max(1.0)).clamp(0.0, 1.0)
                }
                (_, true) => since(cell.block[0], cell.block[1]),
                (_, false) => since(cell.from, cell.block[1]),
            }
        } else {
            f64::from(pattern.scope == Scope::Later && cell.drive > pattern.drive)
        };
        match pattern.kind {
            CONSTANT => 1.0,
            OFFSET if here || pattern.scope == Scope::Later => 1.0 - on,
            OFFSET => 0.0,
            _ => on,
        }
    }

    fn sums(&self, weights: &[f64]) -> Option<Sums> {
        let count = self.columns.len();
        let roots: Vec<f64> = weights.iter().map(|w| w.sqrt()).collect();
        let mut rows = DMatrix::zeros(self.bare.len(), count);
        for (mut row, column) in rows.column_iter_mut().zip(&self.columns) {
            row.iter_mut().zip(*column).zip(&roots).for_each(|((r, c), root)| *r = c * root);
        }
        let pull = DVector::from_iterator(self.bare.len(), self.bare.iter().zip(&roots).map(|(r, root)| r * root));
        let slope = rows.tr_mul(&pull) + DVector::from_column_slice(&self.pull);
        let mut hessian = rows.transpose() * &rows;
        self.precision.iter().enumerate().for_each(|(i, p)| hessian[(i, i)] += p);
        let inverse = hessian.cholesky()?.inverse();
        let (mut own, mut cross) = (Vec::new(), Vec::new());
        for cell in &self.cells {
            let (mut sums, mut with) = ([0.0; 2], DVector::zeros(count));
            for &i in &cell.members {
                let s = self.signature[i] * weights[i];
                sums[0] += s * self.bare[i];
                sums[1] += s * self.signature[i];
                with.iter_mut().zip(&self.columns).for_each(|(sum, column)| *sum += s * column[i]);
            }
            own.push(sums);
            cross.push(with);
        }
        Some(Sums { own, cross, inverse, slope })
    }

    /// Returns log evidence, size and standard error of a course.
    fn evidence(&self, sums: &Sums, share: &dyn Fn(&Cell) -> f64) -> [f64; 3] {
        let (mut pull, mut own) = (0.0, 0.0);
        let mut cross = DVector::zeros(self.columns.len());
        for ((cell, of), with) in self.cells.iter().zip(&sums.own).zip(&sums.cross) {
            let m = share(cell);
            if m > 0.0 {
                pull += m * of[0];
                own += m * m * of[1];
                cross.axpy(m, with, 1.0);
            }
        }
        let through = &sums.inverse * &cross;
        let (pull, own) = (pull - through.dot(&sums.slope), (own - through.dot(&cross)).max(0.0));
        let width = own + 1.0 / (MODULATION_SD * MODULATION_SD);
        let gain = 0.5 * pull * pull / width - 0.5 * (1.0 + MODULATION_SD * MODULATION_SD * own).ln();
        [gain, pull / width, width.sqrt().recip()]
    }

    /// Returns what is left once the effect has a course of some size, and what the coordinates pay for giving way.
    fn left(&self, sums: &Sums, pattern: &Pattern, size: f64) -> (Vec<f64>, f64) {
        let mut shares = vec![0.0; self.bare.len()];
        let mut cross = DVector::zeros(self.columns.len());
        for (cell, with) in self.cells.iter().zip(&sums.cross) {
            let m = self.share(pattern, cell);
            cell.members.iter().for_each(|i| shares[*i] = m);
            cross.axpy(m * size, with, 1.0);
        }
        let step = &sums.inverse * (cross - &sums.slope);
        let mut left: Vec<f64> =
            self.bare.iter().zip(&self.signature).zip(&shares).map(|((r, s), m)| r - size * m * s).collect();
        for (column, by) in self.columns.iter().zip(step.iter()) {
            left.iter_mut().zip(*column).for_each(|(r, c)| *r += c * by);
        }
        let paid = step.iter().zip(&self.precision).zip(&self.pull).map(|((d, p), g)| 0.5 * p * d * d + g * d).sum();
        (left, paid)
    }

    fn patterns(&self, kind: &'static str) -> Vec<Pattern> {
        if kind == CONSTANT {
            return vec![Pattern { kind, drive: 0, secs: 0.0, scope: Scope::Later }];
        }
        let mut all = Vec::new();
        for (place, (drive, start, end)) in self.drives.iter().enumerate() {
            let secs = end - start - 2.0 * EDGE_SECS;
            let step = GRID_SECS.max(secs / MOST_INSTANTS);
            let last = place + 1 == self.drives.len();
            for scope in Scope::ALL {
                let same = (scope == Scope::Own && last && kind != OFFSET)
                    || (scope != Scope::Later && self.drives.len() == 1);
                if same || (scope == Scope::Each && place > 0) || secs <= 0.0 {
                    continue;
                }
                let instants = 0..(secs / step) as usize + 1;
                all.extend(instants.map(|k| Pattern { kind, drive: *drive, secs: EDGE_SECS + k as f64 * step, scope }));
            }
        }
        all
    }

    /// Returns the best course of a kind, robust weights settled at it.
    fn best(&self, kind: &'static str, fitted: &[f64]) -> Option<Best> {
        let patterns = self.patterns(kind);
        let closer = |(a, b): (&f64, &f64)| if a.abs() < b.abs() { *a } else { *b };
        let mut residuals: Vec<f64> = self.bare.iter().zip(fitted).map(closer).collect();
        let mut found = None;
        for _ in 0..ROUNDS {
            let sums = self.sums(&residuals.iter().map(|z| KAPPA * (NU + 1.0) / (NU + z * z)).collect::<Vec<_>>())?;
            let gains: Vec<[f64; 3]> =
                patterns.iter().map(|p| self.evidence(&sums, &|cell| self.share(p, cell))).collect();
            let at = (0..patterns.len()).max_by(|a, b| gains[*a][0].total_cmp(&gains[*b][0]))?;
            let size = gains[at][1];
            let (left, paid) = self.left(&sums, &patterns[at], size);
            let spread: f64 = gains.iter().map(|g| (g[0] - gains[at][0]).exp()).sum();
            let occam = (gains[at][2] / MODULATION_SD).ln() - 0.5 * (size / MODULATION_SD).powi(2);
            let evidence = occam - data_loss(&left) - paid + (spread / patterns.len() as f64).ln();
            let interval = credible(&patterns, &gains, at);
            residuals.clone_from(&left);
            found = Some(Best { pattern: patterns[at], evidence, interval, size, residuals: left });
        }
        found
    }

    fn sessions(&self, fitted: &[f64]) -> Vec<Session> {
        let weights: Vec<f64> = fitted.iter().map(|z| KAPPA * (NU + 1.0) / (NU + z * z)).collect();
        let Some(sums) = self.sums(&weights) else { return Vec::new() };
        let of = |&(drive, ..): &(usize, f64, f64)| {
            let [_, size, error] = self.evidence(&sums, &|cell| f64::from(cell.drive == drive));
            Session { drive, size, error }
        };
        self.drives.iter().map(of).collect()
    }
}

/// Returns the ends of the smallest set of instants that holds 90 %, in the drive and scope of the best one.
fn credible(patterns: &[Pattern], gains: &[[f64; 3]], at: usize) -> [f64; 2] {
    let best = patterns[at];
    let mut inside: Vec<(f64, f64)> = patterns
        .iter()
        .zip(gains)
        .filter(|(p, _)| p.drive == best.drive && p.scope == best.scope)
        .map(|(p, g)| ((g[0] - gains[at][0]).exp(), p.secs))
        .collect();
    inside.sort_by(|a, b| b.0.total_cmp(&a.0));
    let total: f64 = inside.iter().map(|i| i.0).sum();
    let (mut held, mut ends) = (0.0, [best.secs; 2]);
    for (weight, secs) in inside {
        if held >= 0.9 * total {
            break;
        }
        held += weight;
        ends = [ends[0].min(secs), ends[1].max(secs)];
    }
    // an instant is known no better than it was tried
    [ends[0] - 0.5 * GRID_SECS, ends[1] + 0.5 * GRID_SECS]
}

/// Returns the blocks of all windows, and of each drive its number with the stamps of its first and last window.
fn cells(model: &PartModel<'_>) -> (Vec<Cell>, Vec<(usize, f64, f64)>) {
    let mut drives: Vec<(usize, f64, f64)> = Vec::new();
    for tag in &model.tags {
        match drives.iter_mut().find(|d| d.0 == tag.drive) {
            Some(drive) => *drive = (drive.0, drive.1.min(tag.secs), drive.2.max(tag.secs)),
            None => drives.push((tag.drive, tag.secs, tag.secs)),
        }
    }
    drives.sort_by_key(|d| d.0);
    let mut places = std::collections::BTreeMap::new();
    let mut cells: Vec<Cell> = Vec::new();
    for (i, tag) in model.tags.iter().enumerate() {
        let place = *places.entry((tag.window, tag.block)).or_insert_with(|| {
            let start = drives.iter().find(|d| d.0 == tag.drive).map_or(0.0, |d| d.1);
            let step = if tag.channel.of_follower() { 0.5 } else { 0.25 };
            let from = tag.secs - start;
            let block = [from + step * tag.block as f64, from + step * (tag.block as f64 + 1.0)];
            cells.push(Cell { drive: tag.drive, from, block, members: Vec::new() });
            cells.len() - 1
        });
        cells[place].members.push(i);
    }
    (cells, drives)
}
