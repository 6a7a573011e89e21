//! Marks of inline SVG and scales. Colours are classes, so that light and dark need no second plot.
//!
//! Coordinates are pixels of the view box, origin top left; one that is not finite becomes 0, so that no number from
//! outside can spoil a picture.

use super::markup::Markup;

/// Width of a full plot, px.
pub(crate) const WIDTH: f64 = 1100.0;

/// Lower ends of the colour levels of effect sizes, in floor units.
pub(crate) const LEVELS: [f64; 7] = [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0];

/// Returns the colour class of an effect size; below the first level it is `h`.
pub(crate) fn level(size: f64) -> &'static str {
    const CLASSES: [&str; 8] = ["h", "h h0", "h h1", "h h2", "h h3", "h h4", "h h5", "h h6"];
    CLASSES[LEVELS.iter().filter(|low| size >= **low).count()]
}

/// Returns a coordinate as text.
pub(crate) fn px(value: f64) -> String {
    let value = if value.is_finite() { value } else { 0.0 };
    let text = format!("{value:.1}");
    text.strip_suffix(".0").unwrap_or(&text).to_owned()
}

/// Writes a plot that fills the width and scrolls where the screen is narrow.
pub(crate) fn wide(m: &mut Markup, title: &str, height: f64, content: impl FnOnce(&mut Markup)) {
    m.inside("div", &[("class", &"scroll plot"), ("tabindex", &0), ("role", &"region"), ("aria-label", &title)], |m| {
        picture(m, "wide", title, (WIDTH, height), content);
    });
}

/// Writes a picture of a given size.
pub(crate) fn picture(
    m: &mut Markup,
    class: &'static str,
    title: &str,
    (width, height): (f64, f64),
    content: impl FnOnce(&mut Markup),
) {
    let view = format!("0 0 {} {}", px(width), px(height));
    let size = [px(width), px(height)];
    let attributes: [(&'static str, &dyn std::fmt::Display); 6] = [
        ("class", &class),
        ("viewBox", &view),
        ("width", &size[0]),
        ("height", &size[1]),
        ("role", &"img"),
        ("aria-label", &title),
    ];
    m.inside("svg", &attributes, content);
}

/// Draws a line.
pub(crate) fn line(m: &mut Markup, class: &'static str, from: (f64, f64), to: (f64, f64)) {
    let [x1, y1, x2, y2] = [from.0, from.1, to.0, to.1].map(px);
    m.void("line", &[("class", &class), ("x1", &x1), ("y1", &y1), ("x2", &x2), ("y2", &y2)]);
}

/// Draws a dot.
pub(crate) fn dot(m: &mut Markup, class: &'static str, at: (f64, f64), radius: f64) {
    m.void("circle", &[("class", &class), ("cx", &px(at.0)), ("cy", &px(at.1)), ("r", &px(radius))]);
}

/// Draws a rectangle with rounded corners and, if not empty, words for the pointer.
pub(crate) fn area(m: &mut Markup, class: &str, at: (f64, f64), size: (f64, f64), words: &str) {
    let [x, y, width, height] = [at.0, at.1, size.0.max(0.0), size.1.max(0.0)].map(px);
    let attributes: [(&'static str, &dyn std::fmt::Display); 6] =
        [("class", &class), ("x", &x), ("y", &y), ("width", &width), ("height", &height), ("rx", &2)];
    if words.is_empty() {
        m.void("rect", &attributes);
    } else {
        m.inside("rect", &attributes, |m| m.leaf("title", &[], words));
    }
}

/// Writes words at a place.
pub(crate) fn text(m: &mut Markup, class: &str, at: (f64, f64), words: &str) {
    m.leaf("text", &[("class", &class), ("x", &px(at.0)), ("y", &px(at.1))], words);
}

/// Draws a line through points.
pub(crate) fn path(m: &mut Markup, class: &'static str, points: &[(f64, f64)]) {
    m.void("polyline", &[("class", &class), ("points", &joined(points))]);
}

/// Returns points as SVG writes them.
pub(crate) fn joined(points: &[(f64, f64)]) -> String {
    points.iter().map(|(x, y)| format!("{},{}", px(*x), px(*y))).collect::<Vec<_>>().join(" ")
}

/// Shortens a text to some characters.
pub(crate) fn short(words: &str, most: usize) -> String {
    match words.char_indices().nth(most) {
        Some((end, _)) => format!("{}…", &words[..end]),
        None => words.to_owned(),
    }
}

/// Returns the round number (1, 2 or 5 times a power of ten) at or above a positive number.
pub(crate) fn round_above(value: f64) -> f64 {
    if !value.is_finite() || value <= 0.0 {
        return 1.0;
    }
    let power = 10.0_f64.powf(value.log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|k| k * power).into_iter().find(|k| *k >= value * (1.0 - 1e-9)).unwrap_or(10.0 * power)
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

    #[test]
    fn numbers_are_numbers() {
        assert_eq!([f64::NAN, f64::INFINITY, 2.0, -1.26].map(px), ["0", "0", "2", "-1.3"]);
        assert_eq!([0.03, 0.7, 5.0, 12.0, 0.0].map(round_above), [0.05, 1.0, 5.0, 20.0, 1.0]);
        assert_eq!(short("äöü", 2), "äö…");
    }
}
