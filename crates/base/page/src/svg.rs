//! Marks of inline SVG. Colours are classes, so that light and dark need no second plot.
//!
//! Coordinates are pixels of the view box, origin top left; one that is not finite becomes 0, so that no number from
//! outside can spoil a picture.

use std::fmt::Display;

use crate::Markup;

/// Returns a coordinate as text.
#[must_use]
pub fn px(value: f64) -> String {
    let value = if value.is_finite() { value } else { 0.0 };
    let text = format!("{value:.1}");
    text.strip_suffix(".0").unwrap_or(&text).to_owned()
}

/// Writes a plot that fills the width and scrolls where the screen is narrow.
pub fn wide(m: &mut Markup, title: &str, size: (f64, f64), content: impl FnOnce(&mut Markup)) {
    m.inside("div", &[("class", &"scroll plot"), ("tabindex", &0), ("role", &"region"), ("aria-label", &title)], |m| {
        picture(m, "wide", title, size, content);
    });
}

/// Writes a picture of a given size.
pub fn picture(
    m: &mut Markup,
    class: &str,
    title: &str,
    (width, height): (f64, f64),
    content: impl FnOnce(&mut Markup),
) {
    let view = format!("0 0 {} {}", px(width), px(height));
    let size = [px(width), px(height)];
    let attributes: [(&'static str, &dyn Display); 6] = [
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
pub fn line(m: &mut Markup, class: &str, from: (f64, f64), to: (f64, f64)) {
    let [x1, y1, x2, y2] = [from.0, from.1, to.0, to.1].map(px);
    m.void("line", &[("class", &class), ("x1", &x1), ("y1", &y1), ("x2", &x2), ("y2", &y2)]);
}

/// Draws a dot.
pub fn dot(m: &mut Markup, class: &str, at: (f64, f64), radius: f64) {
    m.void("circle", &[("class", &class), ("cx", &px(at.0)), ("cy", &px(at.1)), ("r", &px(radius))]);
}

/// Draws a rectangle with rounded corners and, if not empty, words for the pointer.
pub fn area(m: &mut Markup, class: &str, at: (f64, f64), size: (f64, f64), words: &str) {
    let [x, y, width, height] = [at.0, at.1, size.0.max(0.0), size.1.max(0.0)].map(px);
    let attributes: [(&'static str, &dyn Display); 6] =
        [("class", &class), ("x", &x), ("y", &y), ("width", &width), ("height", &height), ("rx", &2)];
    if words.is_empty() {
        m.void("rect", &attributes);
    } else {
        m.inside("rect", &attributes, |m| m.leaf("title", &[], words));
    }
}

/// Writes words at a place.
pub fn text(m: &mut Markup, class: &str, at: (f64, f64), words: &str) {
    m.leaf("text", &[("class", &class), ("x", &px(at.0)), ("y", &px(at.1))], words);
}

/// Draws a line through points.
pub fn path(m: &mut Markup, class: &str, points: &[(f64, f64)]) {
    m.void("polyline", &[("class", &class), ("points", &joined(points))]);
}

/// Returns points as SVG writes them.
#[must_use]
pub fn joined(points: &[(f64, f64)]) -> String {
    points.iter().map(|(x, y)| format!("{},{}", px(*x), px(*y))).collect::<Vec<_>>().join(" ")
}

/// Shortens a text to some characters.
#[must_use]
pub fn short(words: &str, most: usize) -> String {
    match words.char_indices().nth(most) {
        Some((end, _)) => format!("{}…", &words[..end]),
        None => words.to_owned(),
    }
}

/// Returns the round number (1, 2 or 5 times a power of ten) at or above a positive number.
#[must_use]
pub fn round_above(value: f64) -> f64 {
    if !value.is_finite() || value <= 0.0 {
        return 1.0;
    }
    let power = 10.0_f64.powf(value.log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|k| k * power).into_iter().find(|k| *k >= value * (1.0 - 1e-9)).unwrap_or(10.0 * power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_numbers() {
        assert_eq!([f64::NAN, f64::INFINITY, 2.0, -1.26].map(px), ["0", "0", "2", "-1.3"]);
        assert_eq!([0.03, 0.7, 5.0, 12.0, 0.0].map(round_above), [0.05, 1.0, 5.0, 20.0, 1.0]);
        assert_eq!(short("äöü", 2), "äö…");
    }
}
