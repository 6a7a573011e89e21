//! The scale of plots; marks are those of `ds_page::svg`, colours of effect sizes, in floor units, those of `ds_page::level`.

pub(crate) use ds_page::level::{LEVELS, legend as level_legend, level};
pub(crate) use ds_page::svg::{area, dot, joined, line, path, picture, px, round_above, short, text};

use super::markup::Markup;
use ds_page::svg;

/// Width of a full plot, px.
pub(crate) const WIDTH: f64 = 1100.0;

/// Writes a plot that fills the width and scrolls where the screen is narrow.
pub(crate) fn wide(m: &mut Markup, title: &str, height: f64, content: impl FnOnce(&mut Markup)) {
    svg::wide(m, title, (WIDTH, height), content);
}
