//! The scale of plots and the colours of effect sizes; marks are those of `ds_page::svg`.

pub(crate) use ds_page::svg::{area, dot, joined, line, path, picture, px, round_above, short, text};

use super::markup::Markup;
use ds_page::svg;

/// Width of a full plot, px.
pub(crate) const WIDTH: f64 = 1100.0;

/// Lower ends of the colour levels of effect sizes, in floor units.
pub(crate) const LEVELS: [f64; 7] = [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0];

/// Returns the colour class of an effect size; below the first level it is `h`.
pub(crate) fn level(size: f64) -> &'static str {
    const CLASSES: [&str; 8] = ["h", "h h0", "h h1", "h h2", "h h3", "h h4", "h h5", "h h6"];
    CLASSES[LEVELS.iter().filter(|low| size >= **low).count()]
}

/// Writes a plot that fills the width and scrolls where the screen is narrow.
pub(crate) fn wide(m: &mut Markup, title: &str, height: f64, content: impl FnOnce(&mut Markup)) {
    svg::wide(m, title, (WIDTH, height), content);
}

/// Writes the legend of the colour levels from the `first` on.
pub(crate) fn level_legend(m: &mut Markup, before: &str, first: usize) {
    m.inside("p", &[("class", &"scale")], |m| {
        m.leaf("span", &[], before);
        for (k, low) in LEVELS.iter().enumerate().skip(first) {
            let class = format!("step b{k}");
            let more = if k + 1 == LEVELS.len() { "+" } else { "" };
            m.leaf("span", &[("class", &class)], format_args!("{low}{more}"));
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_double() {
        for (size, class) in [(0.0, "h"), (0.5, "h h0"), (1.9, "h h1"), (900.0, "h h6"), (f64::NAN, "h")] {
            assert_eq!(level(size), class);
        }
    }
}
