//! Where the gap lies: channels by drives and driving regimes, image tiles, as coloured cells.
//!
//! Colour is the size of the effect in units of the noise floor, in doubling levels; a full square is significant, a
//! small one is not. Numbers stand in the cells of whole drives.

use std::collections::BTreeSet;

use ds_diagnosis::schema::{Cell, Diagnosis, Regime};
use ds_effect::Channel;

use super::markup::Markup;
use super::material::Material;
use super::plot::{self, WIDTH};
use super::tiles::{TILES, size, tiles};
use super::words;

/// False-discovery rate up to which a cell is significant.
const SIGNIFICANT: f64 = 0.05;
/// Channel of what a camera sees.
const IMAGE: &str = "camera";
const LABELS: f64 = 150.0;
const TOP: f64 = 46.0;
const ROW: f64 = 26.0;
const GAP: f64 = 10.0;
/// Widest cell of a drive as a whole and of a regime, px.
const CELL: (f64, f64) = (46.0, 14.0);

type ValueOf = fn(&Regime) -> Option<&str>;
type Axis = (&'static str, [&'static str; 3], ValueOf);

/// The regimes, with their bins in order.
const AXES: [Axis; 4] = [
    ("speed", ["low", "mid", "high"], |r| r.speed.as_deref()),
    ("lateral", ["straight", "curve", "hard"], |r| r.lateral.as_deref()),
    ("pedals", ["brake", "coast", "traction"], |r| r.pedal.as_deref()),
    ("steering", ["still", "slow", "fast"], |r| r.steering.as_deref()),
];

/// Writes what there is of both maps.
pub(crate) fn section(m: &mut Markup, diagnosis: &Diagnosis, material: &Material) {
    let (in_image, in_drives): (Vec<&Cell>, Vec<&Cell>) =
        diagnosis.cells.iter().partition(|cell| cell.regime.tile.is_some() || cell.channel == IMAGE);
    if diagnosis.cells.is_empty() {
        m.leaf("p", &[], "No cell lies significantly beyond the noise floor.");
        return;
    }
    m.leaf(
        "p",
        &[("class", &"lead")],
        "Size of the gap in units of the noise floor. Coloured squares are significant (false discovery rate 5 %), small \
         ones are not; grey is at the floor.",
    );
    plot::level_legend(m, "times the floor", 0);
    if !in_drives.is_empty() {
        map(m, &in_drives, material);
    }
    if !in_image.is_empty() {
        tile_map(m, diagnosis);
    }
}

/// Where columns stand: one block for whole drives, one per bin, one cell per drive in each.
struct Columns {
    drives: Vec<usize>,
    whole: f64,
    part: f64,
    bins: Vec<(usize, &'static str)>,
}

impl Columns {
    fn new(cells: &[&Cell], known: Option<usize>) -> Self {
        let mut drives: BTreeSet<usize> = cells.iter().map(|cell| cell.regime.drive).collect();
        drives.extend(0..known.unwrap_or(0).min(64));
        let binned = cells.iter().any(|cell| AXES.iter().any(|axis| axis.2(&cell.regime).is_some()));
        let axes = AXES.iter().enumerate().filter(|_| binned);
        let bins: Vec<(usize, &'static str)> = axes.flat_map(|(k, axis)| axis.1.map(|bin| (k, bin))).collect();
        let count = drives.len().max(1) as f64;
        let free = WIDTH - LABELS - GAP * (bins.len() as f64 + 4.0);
        let whole = (free * 0.22 / count).clamp(12.0, CELL.0);
        let part = ((free - whole * count) / (count * bins.len().max(1) as f64)).clamp(3.0, CELL.1);
        Self { drives: drives.into_iter().collect(), whole, part, bins }
    }

    fn width(&self, block: usize) -> f64 {
        self.drives.len() as f64 * if block == 0 { self.whole } else { self.part }
    }

    /// Left end of a block; 0 is the whole drives, then the bins.
    fn left(&self, block: usize) -> f64 {
        let axes = |block: usize| if block == 0 { 0 } else { self.bins[block - 1].0 + 1 };
        let before: f64 =
            (0..block).map(|k| self.width(k) + if axes(k + 1) == axes(k) { GAP * 0.7 } else { GAP * 2.2 }).sum();
        LABELS + before
    }
}

fn map(m: &mut Markup, cells: &[&Cell], material: &Material) {
    let columns = Columns::new(cells, material.drives);
    let channels = channels(cells);
    let height = TOP + ROW * channels.len() as f64 + 4.0;
    plot::wide(m, "Gap by channel, drive and regime", height, |m| {
        heads(m, &columns);
        for (row, channel) in channels.iter().enumerate() {
            let y = TOP + ROW * row as f64;
            plot::text(m, "label", (LABELS - 12.0, y + 17.0), &plot::short(&words::channel(channel), 22));
            let own: Vec<&&Cell> = cells.iter().filter(|cell| cell.channel == *channel).collect();
            if own.is_empty() && material.recorded.as_ref().is_some_and(|names| !names.contains(channel)) {
                plot::text(m, "tick begin", (LABELS + 4.0, y + 17.0), "not recorded");
                continue;
            }
            for block in 0..=columns.bins.len() {
                for (place, drive) in columns.drives.iter().enumerate() {
                    let cell = own.iter().filter(|c| c.regime.drive == *drive && is_in(&c.regime, &columns, block));
                    let cell = cell.max_by(|a, b| a.effect_size.total_cmp(&b.effect_size));
                    let width = columns.width(block) / columns.drives.len() as f64;
                    square(
                        m,
                        cell.copied().copied(),
                        columns.left(block) + width * place as f64,
                        y + 2.0,
                        width,
                        block == 0,
                    );
                }
            }
        }
    });
    m.leaf(
        "p",
        &[("class", &"note")],
        format_args!(
            "In each column group one cell per drive: {}. Point at a cell for its figures.",
            words::list(&columns.drives.iter().map(ToString::to_string).collect::<Vec<_>>())
        ),
    );
}

fn heads(m: &mut Markup, columns: &Columns) {
    let centre = |block: usize| columns.left(block) + columns.width(block) / 2.0;
    plot::text(m, "head", (centre(0), 14.0), "whole drive");
    for (place, drive) in columns.drives.iter().enumerate() {
        let x = columns.left(0) + columns.whole * (place as f64 + 0.5);
        plot::text(m, "tick", (x, TOP - 8.0), &drive.to_string());
    }
    for (k, (_, bin)) in columns.bins.iter().enumerate() {
        plot::text(m, "tick", (centre(k + 1), TOP - 8.0), bin);
    }
    for (k, (name, ..)) in AXES.iter().enumerate() {
        let own: Vec<usize> = (0..columns.bins.len()).filter(|b| columns.bins[*b].0 == k).collect();
        let (Some(first), Some(last)) = (own.first(), own.last()) else { continue };
        let (from, to) = (columns.left(first + 1), columns.left(last + 1) + columns.width(last + 1));
        plot::text(m, "head", ((from + to) / 2.0, 14.0), name);
        plot::line(m, "bracket", (from, 21.0), (to, 21.0));
    }
    plot::line(m, "bracket", (columns.left(0), 21.0), (columns.left(0) + columns.width(0), 21.0));
}

fn is_in(regime: &Regime, columns: &Columns, block: usize) -> bool {
    let wanted = block.checked_sub(1).map(|k| columns.bins[k]);
    AXES.iter().enumerate().all(|(k, axis)| axis.2(regime) == wanted.filter(|w| w.0 == k).map(|w| w.1))
}

fn square(m: &mut Markup, cell: Option<&Cell>, x: f64, y: f64, width: f64, numbered: bool) {
    let inner = (width - 1.5, ROW - 4.0);
    let Some(cell) = cell else {
        plot::area(m, "h", (x, y), inner, "");
        return;
    };
    let words = told(cell);
    let class = plot::level(cell.effect_size);
    if cell.q_value.is_none_or(|q| q <= SIGNIFICANT) {
        plot::area(m, class, (x, y), inner, &words);
    } else {
        plot::area(m, "h", (x, y), inner, "");
        plot::area(m, class, (x + inner.0 / 4.0, y + inner.1 / 4.0), (inner.0 / 2.0, inner.1 / 2.0), &words);
    }
    if numbered && width > 24.0 {
        let class = format!("{} in", class.replace("h h", "on o"));
        plot::text(m, &class, (x + inner.0 / 2.0, y + 15.0), &size(cell.effect_size));
    }
}

/// Returns a cell in words.
pub(crate) fn told(cell: &Cell) -> String {
    let mut place: Vec<String> =
        AXES.iter().filter_map(|axis| axis.2(&cell.regime).map(|bin| format!("{} {bin}", axis.0))).collect();
    if let Some([row, column]) = cell.regime.tile {
        place.insert(0, format!("tile in row {row}, column {column}"));
    } else {
        place.insert(0, format!("drive {}", cell.regime.drive));
    }
    place.extend(cell.regime.agent.iter().cloned());
    place.extend(cell.regime.place.map(|[east, north]| format!("50 m tile {east} east, {north} north")));
    let q = match cell.q_value {
        None => String::new(),
        Some(q) if q < 1e-4 => ", q < 0.0001".to_owned(),
        Some(q) => format!(", q = {}", words::fixed(q, 4)),
    };
    format!("{}, {}: {} × floor{q}", words::channel(&cell.channel), place.join(", "), size(cell.effect_size))
}

/// Returns the channels of the map: the ego's, the followers' if any is meant, then what no library knows.
fn channels(cells: &[&Cell]) -> Vec<String> {
    let names: BTreeSet<&str> = cells.iter().map(|cell| cell.channel.as_str()).collect();
    let known = |follower: bool| Channel::ALL.iter().filter(move |c| c.of_follower() == follower).map(|c| c.name());
    let mut rows: Vec<String> = Vec::new();
    for follower in [false, true] {
        if known(follower).any(|name| names.contains(name)) {
            rows.extend(known(follower).map(str::to_owned));
        }
    }
    let others = names.iter().filter(|name| !rows.iter().any(|row| row == *name)).map(|name| (*name).to_owned());
    let others: Vec<String> = others.collect();
    rows.extend(others);
    rows
}

fn tile_map(m: &mut Markup, diagnosis: &Diagnosis) {
    let found = tiles(diagnosis);
    if found.is_empty() {
        return;
    }
    let (width, height) = (84.0, 56.0);
    let view = (TILES.1 as f64 * width + 30.0, TILES.0 as f64 * height + 24.0);
    m.leaf("h3", &[], "In the image");
    plot::picture(m, "plot tilemap", "Gap by image tile", view, |m| {
        for column in 0..TILES.1 {
            plot::text(m, "tick", (28.0 + width * (column as f64 + 0.5), 14.0), &column.to_string());
        }
        for row in 0..TILES.0 {
            let y = 22.0 + height * row as f64;
            plot::text(m, "tick", (14.0, y + height / 2.0 + 4.0), &row.to_string());
            for column in 0..TILES.1 {
                let x = 28.0 + width * column as f64;
                let inner = (width - 3.0, height - 3.0);
                let Some((value, q)) = found.get(&[row, column]) else {
                    plot::area(m, "h", (x, y), inner, "");
                    continue;
                };
                let class = plot::level(*value);
                let told = q.map(|q| format!(", q = {}", words::fixed(q, 4))).unwrap_or_default();
                let words = format!("row {row}, column {column}: {} × floor{told}", size(*value));
                if q.is_none_or(|q| q <= SIGNIFICANT) {
                    plot::area(m, class, (x, y), inner, &words);
                } else {
                    plot::area(m, "h", (x, y), inner, "");
                    plot::area(
                        m,
                        class,
                        (x + inner.0 / 4.0, y + inner.1 / 4.0),
                        (inner.0 / 2.0, inner.1 / 2.0),
                        &words,
                    );
                }
                let class = format!("{} in", class.replace("h h", "on o"));
                plot::text(m, &class, (x + inner.0 / 2.0, y + inner.1 / 2.0 + 4.5), &size(*value));
            }
        }
    });
}
