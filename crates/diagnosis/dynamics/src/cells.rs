//! Where the gap lies: channel by drive by regime, with block-bootstrap p-values and false-discovery control.
//!
//! Three statistics of the Student-t loss of the simulator without the accepted effects but with the fitted nuisances: its
//! mean over the cell and its largest window, both against what the healthy logs of a baseline leave in cells of that
//! channel and regime, and what the accepted effects save of it (a likelihood ratio exceeds c by chance with a probability
//! of at most 1 / c). An effect that acts all the time shows in the first, one that acts in a few windows in the second, a
//! weak one in the third. Benjamini and Hochberg (1995) over all cells. Without a baseline cells are chosen by what
//! effect-free worlds of the library's passenger cars leave, and have no q-value.

use std::collections::BTreeMap;

use ds_effect::Channel;
use ds_stats::normal_tail;

use crate::baseline::nulls::{Ordinary, Statistics};
use crate::bootstrap::weights;
use crate::case::{Case, PartModel};
use crate::fit::{Model, point_loss};
use crate::settings::{CELL_SIZE, DISCOVERY_RATE, KAPPA};
use crate::windows;
use ds_diagnosis::schema::{Cell, Regime, correct};

/// Mean loss of an effect-free world that the bootstrap is compared with.
const CLEAN_LEVEL: f64 = 0.55;

/// Residuals that a cell must have.
const LEAST_ROWS: f64 = 8.0;

/// Scale of the exponential tail of a window's mean loss: of 23 000 windows of effect-free worlds one reaches 5; with room.
const WINDOW_TAIL: f64 = 0.6;

/// What one channel says in one window, summed over its blocks.
#[derive(Debug, Clone, Copy, Default)]
struct Row {
    loss: f64,
    saved: f64,
    squared_change: f64,
    count: f64,
}

impl Row {
    fn mean(&self) -> f64 {
        if self.count > 0.0 { self.loss / self.count } else { 0.0 }
    }
}

/// Windows of a part: drive, stamp and regime bins.
struct Window {
    drive: usize,
    secs: f64,
    bins: [&'static str; 4],
}

/// A cell, as far as it is no matter of chance.
struct Measured<'t> {
    channel: Channel,
    regime: &'t Regime,
    members: &'t [usize],
    rows: &'t [Row],
    count: f64,
    /// Mean loss.
    mean: f64,
    /// Mean loss of its largest window.
    largest: f64,
}

/// What each channel says in each window, without and with the effects.
struct Table {
    windows: Vec<Window>,
    regimes: Vec<(Regime, Vec<usize>)>,
    channels: BTreeMap<Channel, Vec<Row>>,
}

impl Table {
    fn new(model: &PartModel<'_>, before: &[f64], after: &[f64]) -> Self {
        let windows = window_list(model);
        let (bare, full) = (model.residuals(before), model.residuals(after));
        let changed = before != after;
        let mut channels: BTreeMap<Channel, Vec<Row>> = BTreeMap::new();
        for ((tag, z), z1) in model.tags.iter().zip(&bare).zip(&full) {
            if *z == 0.0 {
                continue;
            }
            let rows = channels.entry(tag.channel).or_insert_with(|| vec![Row::default(); windows.len()]);
            let size = if changed { z - z1 } else { z.abs().min(30.0) - 1.0_f64.min(z.abs()) };
            let row = &mut rows[tag.window];
            row.loss += point_loss(*z);
            row.saved += point_loss(*z) - point_loss(*z1);
            row.squared_change += size * size;
            row.count += 1.0;
        }
        Self { regimes: groups(&windows), windows, channels }
    }

    fn cells(&self) -> Vec<Measured<'_>> {
        let mut found = Vec::new();
        for (channel, rows) in &self.channels {
            for (regime, members) in &self.regimes {
                let sum = |of: fn(&Row) -> f64| members.iter().map(|&w| of(&rows[w])).sum::<f64>();
                let (count, loss) = (sum(|row| row.count), sum(|row| row.loss));
                if count >= LEAST_ROWS {
                    let largest = members.iter().map(|&w| rows[w].mean()).fold(0.0, f64::max);
                    let mean = loss / count;
                    found.push(Measured { channel: *channel, regime, members, rows, count, mean, largest });
                }
            }
        }
        found
    }
}

impl Measured<'_> {
    /// Returns the statistics by which healthy logs say what is ordinary here: logarithms of the mean loss and of that of
    /// the largest window.
    fn statistics(&self) -> [(String, f64); 2] {
        let Regime { speed, lateral, pedal, steering, .. } = self.regime;
        let bin = [speed, lateral, pedal, steering].into_iter().flatten().next().map_or("all", String::as_str);
        [("mean", self.mean), ("largest", self.largest)]
            .map(|(of, loss)| (format!("{of}:{}:{bin}", self.channel.name()), loss.max(1e-3).ln()))
    }

    /// Returns the chances of the mean and of the largest window among effect-free worlds of the library's cars.
    fn by_library(&self, draws: &[Vec<f64>]) -> [f64; 2] {
        let mean = |draw: &Vec<f64>| {
            let (mut loss, mut n) = (0.0, 0.0);
            for &w in self.members {
                loss += draw[w] * self.rows[w].loss;
                n += draw[w] * self.rows[w].count;
            }
            if n > 0.0 { loss / n } else { 0.0 }
        };
        // the bootstrap gives the spread of the mean; its normal tail reaches below the resolution of the draws
        let variance = draws.iter().map(|d| (mean(d) - self.mean).powi(2)).sum::<f64>() / draws.len() as f64;
        let steady = normal_tail((self.mean - CLEAN_LEVEL) / variance.sqrt().max(0.02));
        let sudden = self.members.len() as f64 * (-(self.largest - CLEAN_LEVEL).max(0.0) / WINDOW_TAIL).exp();
        [steady, sudden]
    }

    fn cell(&self, ordinary: [f64; 2], windows: &[Window]) -> Cell {
        let sum = |of: fn(&Row) -> f64| self.members.iter().map(|&w| of(&self.rows[w])).sum::<f64>();
        let explained = (-KAPPA * sum(|row| row.saved)).exp();
        // the smallest of three is looked at
        let p = (3.0 * ordinary[0].min(ordinary[1]).min(explained)).clamp(1e-12, 1.0);
        let mut t: Vec<[f64; 2]> = Vec::new();
        for &w in self.members.iter().filter(|&&w| self.rows[w].mean() > 2.0 * CLEAN_LEVEL) {
            let end = windows[w].secs + if self.channel.of_follower() { 5.0 } else { 2.0 };
            match t.last_mut() {
                Some(span) if span[1] >= windows[w].secs && span[0] <= windows[w].secs => span[1] = end,
                _ => t.push([windows[w].secs, end]),
            }
        }
        Cell {
            channel: self.channel.name().to_owned(),
            regime: self.regime.clone(),
            effect_size: (sum(|row| row.squared_change) / self.count).sqrt(),
            q_value: Some(p),
            t,
        }
    }
}

/// Returns the significant cells of a part, largest first; `model` spans all drives, `before` is the vector without
/// the effects and `after` the one with them.
#[must_use]
pub fn cells(case: &Case, model: &PartModel<'_>, before: &[f64], after: &[f64]) -> Vec<Cell> {
    let table = Table::new(model, before, after);
    let drives: Vec<usize> = table.windows.iter().map(|w| w.drive).collect();
    let draws = weights(&drives, "cells");
    let learned = case.baseline.as_ref().map(|baseline| baseline.cells.as_slice()).filter(|cells| !cells.is_empty());
    let nulls = learned.map(Ordinary::new);
    let one = |measured: Measured<'_>| {
        let ordinary = match &nulls {
            Some(nulls) => measured.statistics().map(|(name, value)| nulls.chance(&name, value)),
            None => measured.by_library(&draws),
        };
        measured.cell(ordinary, &table.windows)
    };
    let mut found = discover(table.cells().into_iter().map(one).collect());
    if nulls.is_none() {
        found.iter_mut().for_each(|cell| cell.q_value = None);
    }
    found
}

/// Returns what a case reaches of the statistics of cells without effects: of each channel and regime the worst drive.
#[must_use]
pub(crate) fn reached(models: &[(&PartModel<'_>, &[f64])]) -> Statistics {
    let mut found = Statistics::new();
    for (model, vector) in models {
        let table = Table::new(model, vector, vector);
        for (name, value) in table.cells().iter().flat_map(Measured::statistics) {
            let worst = found.entry(name).or_insert(f64::NEG_INFINITY);
            *worst = worst.max(value);
        }
    }
    found
}

/// Turns the p-values of cells into q-values, keeps those that are significant and large enough to matter, and puts the
/// largest first.
#[must_use]
pub fn discover(mut cells: Vec<Cell>) -> Vec<Cell> {
    let tested = cells.len();
    correct(&mut cells, tested);
    cells.retain(|c| c.q_value.is_some_and(|q| q <= DISCOVERY_RATE) && c.effect_size >= CELL_SIZE);
    cells.sort_by(|a, b| b.effect_size.total_cmp(&a.effect_size));
    cells
}

/// Returns the bins: every drive as a whole and by each regime.
fn groups(windows: &[Window]) -> Vec<(Regime, Vec<usize>)> {
    let mut groups: BTreeMap<(usize, usize, &str), Vec<usize>> = BTreeMap::new();
    for (k, window) in windows.iter().enumerate() {
        groups.entry((window.drive, 0, "")).or_default().push(k);
        for (axis, bin) in window.bins.iter().enumerate().filter(|(_, bin)| !bin.is_empty()) {
            groups.entry((window.drive, axis + 1, bin)).or_default().push(k);
        }
    }
    groups
        .into_iter()
        .map(|((drive, axis, bin), members)| {
            let mut regime = Regime { drive, ..Regime::default() };
            let slot = match axis {
                1 => &mut regime.speed,
                2 => &mut regime.lateral,
                3 => &mut regime.pedal,
                _ => &mut regime.steering,
            };
            if axis > 0 {
                *slot = Some(bin.to_owned());
            }
            (regime, members)
        })
        .collect()
}

fn window_list(model: &PartModel<'_>) -> Vec<Window> {
    let mut list: Vec<Window> = Vec::new();
    for tag in &model.tags {
        if tag.window == list.len() {
            list.push(Window { drive: tag.drive, secs: tag.secs, bins: [""; 4] });
        }
    }
    let regimes = model.regimes();
    if !regimes.is_empty() {
        let mut speeds: Vec<f64> = regimes.iter().map(|r| r.speed_mps).collect();
        let thirds = [1.0 / 3.0, 2.0 / 3.0].map(|share| ds_stats::quantile(&mut speeds, share));
        for (window, regime) in list.iter_mut().zip(&regimes) {
            window.bins = bins(regime, thirds);
        }
    }
    list
}

fn bins(regime: &windows::Regime, thirds: [f64; 2]) -> [&'static str; 4] {
    let pick = |value: f64, low: f64, high: f64, names: [&'static str; 3]| {
        if value < low {
            names[0]
        } else if value < high {
            names[1]
        } else {
            names[2]
        }
    };
    [
        pick(regime.speed_mps, thirds[0], thirds[1], ["low", "mid", "high"]),
        pick(regime.lateral_mps2, 0.5, 2.0, ["straight", "curve", "hard"]),
        pick(regime.accel_mps2, -0.3, 0.3, ["brake", "coast", "traction"]),
        pick(regime.steer_rate, 0.01, 0.05, ["still", "slow", "fast"]),
    ]
}
