//! Plots of the page as inline SVG: dots with whiskers, stacked bars, differences around zero.
//!
//! Colours are classes, so that light and dark need no second plot; every mark has a title that says it in words.

use super::markup::Markup;
use super::markup::svg::{self, dot, line, px, text};
use crate::aggregate::{Estimate, Group};
use crate::bootstrap::Interval;
use crate::term;
use crate::write::{number, points, range, signed};

/// Most rows of a plot; the tables hold the others.
pub(crate) const MAX_ROWS: usize = 60;
/// Terms with a colour of their own; the smaller ones are shown together.
const TERM_COLOURS: usize = 7;
const WIDTH: f64 = 960.0;
const LABELS: f64 = 300.0;
const VALUES: f64 = 190.0;
const ROW: f64 = 30.0;
const TOP: f64 = 26.0;
const LABEL_CHARS: usize = 40;

/// A row of a dot plot.
pub(crate) struct Dot {
    /// What the row is.
    pub(crate) label: String,
    /// Rows of one kind have one colour.
    pub(crate) colour: usize,
    /// The filled dot with its whiskers.
    pub(crate) headline: Estimate,
    /// The ring, where it is somewhere else.
    pub(crate) finished: Estimate,
}

/// A row of a plot of differences.
pub(crate) struct Change {
    /// What the row is.
    pub(crate) label: String,
    /// The mean.
    pub(crate) difference: Option<f64>,
    /// Its interval.
    pub(crate) interval: Option<Interval>,
    /// Whether it is told apart from zero.
    pub(crate) certain: bool,
}

fn frame(m: &mut Markup, title: &str, rows: usize, content: impl FnOnce(&mut Markup, f64)) {
    let height = TOP + ROW * rows as f64 + 10.0;
    svg::wide(m, title, (WIDTH, height), |m| {
        m.leaf("title", &[], title);
        content(m, height);
    });
}

fn label(m: &mut Markup, row: usize, words: &str) {
    let y = TOP + ROW * row as f64 + ROW / 2.0;
    let short = svg::short(words, LABEL_CHARS);
    m.inside("text", &[("class", &"label"), ("x", &px(LABELS - 14.0)), ("y", &px(y + 4.5))], |m| {
        m.leaf("title", &[], words);
        m.text(short);
    });
}

fn axis(m: &mut Markup, ticks: &[f64], x: &dyn Fn(f64) -> f64, height: f64) {
    for tick in ticks {
        let class = if *tick == 0.0 { "grid zero" } else { "grid" };
        line(m, class, (x(*tick), TOP), (x(*tick), height - 6.0));
        text(m, "tick", (x(*tick), TOP - 9.0), &number(100.0 * tick, 0));
    }
}

/// Draws one dot with whiskers per row, on an axis from 0 to 100.
pub(crate) fn dots(m: &mut Markup, title: &str, rows: &[Dot]) {
    let x = |value: f64| LABELS + (WIDTH - LABELS - VALUES) * value.clamp(0.0, 1.0);
    frame(m, title, rows.len(), |m, height| {
        axis(m, &[0.0, 0.2, 0.4, 0.6, 0.8, 1.0], &x, height);
        for (index, row) in rows.iter().enumerate() {
            let y = TOP + ROW * index as f64 + ROW / 2.0;
            label(m, index, &row.label);
            let class = format!("mark p{}", row.colour % 6);
            let words = format!("{}: {} [{}]", row.label, points(row.headline.mean), range(row.headline.interval));
            m.inside("g", &[("class", &class)], |m| {
                m.leaf("title", &[], words);
                if let Some(interval) = row.headline.interval {
                    line(m, "whisker", (x(interval.low), y), (x(interval.high), y));
                    for end in [interval.low, interval.high] {
                        line(m, "whisker", (x(end), y - 5.0), (x(end), y + 5.0));
                    }
                }
                let finished =
                    row.finished.mean.filter(|finished| row.headline.mean.is_some_and(|h| (h - finished).abs() > 5e-4));
                if let Some(finished) = finished {
                    dot(m, "ring", (x(finished), y), 4.5);
                }
                if let Some(mean) = row.headline.mean {
                    dot(m, "dot", (x(mean), y), 5.5);
                }
            });
            text(m, "value strong", (WIDTH - VALUES + 62.0, y + 4.5), &points(row.headline.mean));
            text(m, "value", (WIDTH - 2.0, y + 4.5), &range(row.headline.interval));
        }
    });
}

/// Returns the terms with a colour of their own, the largest loss first.
pub(crate) fn coloured_terms(groups: &[&Group]) -> Vec<String> {
    let mut totals: std::collections::BTreeMap<&String, f64> = std::collections::BTreeMap::new();
    for (term, lost) in groups.iter().filter_map(|group| group.lost.as_ref()).flat_map(|lost| &lost.by_term) {
        *totals.entry(term).or_default() += lost;
    }
    let mut terms: Vec<(&String, f64)> = totals.into_iter().filter(|(_, lost)| *lost > 5e-4).collect();
    terms.sort_by(|a, b| b.1.total_cmp(&a.1).then_with(|| a.0.cmp(b.0)));
    terms.into_iter().take(TERM_COLOURS).map(|(term, _)| term.clone()).collect()
}

/// The parts of a bar in order: words, class, share.
fn parts(group: &Group, terms: &[String]) -> Vec<(String, String, f64)> {
    let Some(lost) = &group.lost else { return Vec::new() };
    let mut parts = vec![("kept".to_owned(), "kept".to_owned(), lost.kept)];
    for (index, name) in terms.iter().enumerate() {
        let share = lost.by_term.get(name).copied().unwrap_or_default();
        parts.push((term::title(name), format!("t{index}"), share));
    }
    let other: f64 = lost.by_term.iter().filter(|(name, _)| !terms.contains(name)).map(|(_, lost)| lost).sum();
    parts.push(("other terms".to_owned(), "other".to_owned(), other + lost.unexplained.max(0.0)));
    parts.push(("failed drives".to_owned(), "failures".to_owned(), lost.to_failures));
    parts
}

/// Draws one bar per group: the mean score that was kept, then what each term took, 100 points in all.
pub(crate) fn stacked(m: &mut Markup, title: &str, groups: &[(String, &Group)]) {
    let all: Vec<&Group> = groups.iter().map(|(_, group)| *group).collect();
    let terms = coloured_terms(&all);
    legend(m, &all, &terms);
    let x = |value: f64| LABELS + (WIDTH - LABELS - VALUES) * value.clamp(0.0, 1.0);
    frame(m, title, groups.len(), |m, height| {
        axis(m, &[0.0, 0.2, 0.4, 0.6, 0.8, 1.0], &x, height);
        for (index, (name, group)) in groups.iter().enumerate() {
            let y = TOP + ROW * index as f64 + 5.0;
            label(m, index, name);
            let mut from = 0.0;
            for (words, class, share) in parts(group, &terms) {
                let width = x(from + share) - x(from);
                if width > 0.05 {
                    let class = format!("bar-part {class}");
                    let (left, wide) = (px(x(from)), px(width));
                    m.inside(
                        "rect",
                        &[("class", &class), ("x", &left), ("y", &px(y)), ("width", &wide), ("height", &20)],
                        |m| {
                            m.leaf("title", &[], format_args!("{name}: {words} {}", points(Some(share))));
                        },
                    );
                }
                from += share;
            }
            let kept = group.lost.as_ref().map(|lost| lost.kept);
            text(m, "value strong", (WIDTH - VALUES + 62.0, y + 14.5), &points(kept));
            text(m, "value", (WIDTH - 2.0, y + 14.5), &format!("{} lost", points(kept.map(|kept| 1.0 - kept))));
        }
    });
}

fn legend(m: &mut Markup, groups: &[&Group], terms: &[String]) {
    let shown = |class: &str| {
        groups.iter().any(|group| parts(group, terms).iter().any(|(_, other, share)| other == class && *share > 5e-4))
    };
    m.inside("ul", &[("class", &"legend")], |m| {
        let Some(group) = groups.first() else { return };
        for (words, class, _) in parts(group, terms).iter().filter(|(_, class, _)| shown(class)) {
            m.inside("li", &[], |m| {
                m.leaf("span", &[("class", &format_args!("swatch {class}")), ("aria-hidden", &"true")], "");
                m.text(words);
            });
        }
    });
}

/// Draws differences around zero, on an axis that fits them.
pub(crate) fn changes(m: &mut Markup, title: &str, rows: &[Change]) {
    let ends = rows.iter().flat_map(|row| {
        let interval = row.interval.map_or([0.0; 2], |i| [i.low, i.high]);
        [row.difference.unwrap_or_default(), interval[0], interval[1]]
    });
    let widest = ends.fold(0.0f64, |widest, end| widest.max(end.abs()));
    let reach = [0.02, 0.05, 0.1, 0.2, 0.5].into_iter().find(|reach| *reach >= widest).unwrap_or(1.0);
    let x = |value: f64| LABELS + (WIDTH - LABELS - VALUES) * (0.5 + 0.5 * (value / reach).clamp(-1.0, 1.0));
    frame(m, title, rows.len(), |m, height| {
        axis(m, &[-reach, -reach / 2.0, 0.0, reach / 2.0, reach], &x, height);
        for (index, row) in rows.iter().enumerate() {
            let y = TOP + ROW * index as f64 + ROW / 2.0;
            label(m, index, &row.label);
            let class = if row.certain { "mark certain" } else { "mark unsure" };
            m.inside("g", &[("class", &class)], |m| {
                let words = format!("{}: {} [{}]", row.label, signed(row.difference), range(row.interval));
                m.leaf("title", &[], words);
                if let Some(interval) = row.interval {
                    line(m, "whisker", (x(interval.low), y), (x(interval.high), y));
                }
                if let Some(mean) = row.difference {
                    dot(m, "dot", (x(mean), y), 5.5);
                }
            });
            text(m, "value strong", (WIDTH - VALUES + 62.0, y + 4.5), &signed(row.difference));
            text(m, "value", (WIDTH - 2.0, y + 4.5), &range(row.interval));
        }
    });
}
