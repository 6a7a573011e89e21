//! Reports and results as files: JSON, CSV, Arrow, Markdown and the page. Scores stay 0 to 1 except in what people
//! read (Markdown and the page), which shows points of 100.

use crate::report::Report;

pub mod arrow;
pub mod columns;
pub mod csv;
pub mod folder;
pub mod html;
pub mod markdown;

/// Returns the report as JSON.
///
/// # Errors
/// If a value cannot be written; no value that passed loading can cause this.
pub fn json(report: &Report) -> serde_json::Result<String> {
    serde_json::to_string_pretty(report).map(|text| text + "\n")
}

/// Points of 100 with one digit, as people read scores.
#[must_use]
pub fn points(value: Option<f64>) -> String {
    value.map_or_else(|| "n/a".to_owned(), |value| number(100.0 * value, 1))
}

/// Points with their sign, for differences.
#[must_use]
pub fn signed(value: Option<f64>) -> String {
    let text = points(value);
    let unsigned = value.is_none() || text.starts_with('−') || text.chars().all(|c| matches!(c, '0' | '.'));
    if unsigned { text } else { format!("+{text}") }
}

/// The ends of an interval in points.
pub(crate) fn range(interval: Option<crate::bootstrap::Interval>) -> String {
    interval.map_or_else(String::new, |i| format!("{} … {}", number(100.0 * i.low, 1), number(100.0 * i.high, 1)))
}

/// A p-value as far as it can be told.
#[must_use]
pub fn chance(p: Option<f64>) -> String {
    match p {
        None => "—".to_owned(),
        Some(p) if p < 0.001 => "< 0.001".to_owned(),
        Some(p) => number(p, 3),
    }
}

/// A number with a fixed count of digits and a real minus sign; never "-0".
#[must_use]
pub fn number(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().all(|c| matches!(c, '0' | '.')) => rest.to_owned(),
        Some(rest) => format!("−{rest}"),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    #[test]
    fn numbers_read_well() {
        for (value, expected) in [(-0.04, "0.0"), (-1.26, "−1.3"), (3.0, "3.0")] {
            assert_eq!(number(value, 1), expected);
        }
        for (value, expected) in [(Some(0.0), "0.0"), (Some(0.1234), "+12.3"), (Some(-0.5), "−50.0"), (None, "n/a")] {
            assert_eq!(signed(value), expected);
        }
        for (p, expected) in [(Some(0.0004), "< 0.001"), (Some(0.25), "0.250"), (None, "—")] {
            assert_eq!(chance(p), expected);
        }
    }

    #[test]
    fn the_report_is_json_with_all_its_parts() {
        let text = json(&sample::report()).expect("plain values");
        let value: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        for part in ["title", "runs", "headline", "scenarios", "comparisons", "bias", "unfinished"] {
            assert!(!value[part].is_null(), "{part} is missing");
        }
        assert_eq!(value["headline"]["by"][0], "policy");
    }
}
