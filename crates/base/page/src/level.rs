//! Levels that double, by which places of a map are coloured, and their legend. Colours are the page's: classes `h0` to `h6` of
//! marks, `b0` to `b6` of steps of the legend.

use crate::Markup;

/// Lower ends of the levels.
pub const LEVELS: [f64; 7] = [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0];

/// Returns the classes of a size; below the first level, and of what is no number, it is `h` alone.
#[must_use]
pub fn level(size: f64) -> &'static str {
    const CLASSES: [&str; 8] = ["h", "h h0", "h h1", "h h2", "h h3", "h h4", "h h5", "h h6"];
    CLASSES[LEVELS.iter().filter(|low| size >= **low).count()]
}

/// Writes the legend of the levels from the `first` on.
pub fn legend(m: &mut Markup, before: &str, first: usize) {
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
