//! Tables of figures with their intervals.

use ds_page::Markup;

use crate::estimate::Estimate;

/// A figure as people read it: value and interval.
pub(crate) fn shown(estimate: Option<Estimate>, digits: usize) -> String {
    estimate.map_or_else(
        || "–".to_owned(),
        |e| format!("{:.digits$} ({:.digits$}\u{a0}to\u{a0}{:.digits$})", e.value, e.low, e.high),
    )
}

/// Writes a table that scrolls where it is too wide.
pub(crate) fn table(m: &mut Markup, head: &[&str], rows: &[Vec<String>]) {
    m.inside("div", &[("class", &"scroll")], |m| {
        m.inside("table", &[], |m| {
            m.inside("thead", &[], |m| m.inside("tr", &[], |m| head.iter().for_each(|cell| m.leaf("th", &[], cell))));
            m.inside("tbody", &[], |m| {
                for row in rows {
                    m.inside("tr", &[], |m| row.iter().for_each(|cell| m.leaf("td", &[], cell)));
                }
            });
        });
    });
}
