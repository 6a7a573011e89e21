//! Tables of the page: a caption, column headings with hints, cells that sort by their value.
//!
//! Names are isolated from the direction of writing around them; sorting itself is `markup::SORTING`.

use std::fmt::Display;

use super::markup::Markup;
use crate::aggregate::Estimate;
use crate::bootstrap::Interval;
use crate::compare::FEWEST_SCENARIOS;
use crate::write::{points, range};

/// Names up to this length are not broken into lines.
const SHORT_CHARS: usize = 32;

/// Whether clicking a heading sorts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Order {
    Fixed,
    Sortable,
}

/// A heading.
#[derive(Debug, Clone)]
pub(crate) struct Heading {
    title: String,
    hint: String,
    numeric: bool,
}

impl Heading {
    pub(crate) fn text(title: impl Display) -> Self {
        Self { title: title.to_string(), hint: String::new(), numeric: false }
    }

    pub(crate) fn number(title: impl Display) -> Self {
        Self { numeric: true, ..Self::text(title) }
    }

    pub(crate) fn hint(self, hint: impl Display) -> Self {
        Self { hint: hint.to_string(), ..self }
    }
}

/// One cell.
#[derive(Debug, Clone, Default)]
pub(crate) struct Cell {
    text: String,
    class: &'static str,
    sort: Option<f64>,
    bar: Option<f64>,
    hint: String,
}

impl Cell {
    /// A name from outside.
    pub(crate) fn name(text: impl Display) -> Self {
        let text = text.to_string();
        let class = match text.chars().count() {
            0 => "name none",
            1..=SHORT_CHARS => "name short",
            _ => "name",
        };
        Self { text: if text.is_empty() { "—".to_owned() } else { text }, class, ..Self::default() }
    }

    /// A whole number; 0 is shown faintly.
    pub(crate) fn count(count: usize) -> Self {
        let class = if count == 0 { "n none" } else { "n" };
        Self { text: count.to_string(), class, sort: Some(count as f64), ..Self::default() }
    }

    /// A count that a reader has to notice.
    pub(crate) fn alarm(count: usize) -> Self {
        Self { class: if count == 0 { "n none" } else { "n alarm" }, ..Self::count(count) }
    }

    /// A score in points, with a bar behind it.
    pub(crate) fn score(value: Option<f64>) -> Self {
        let class = if value.is_none() { "n none" } else { "n bar" };
        Self { text: points(value), class, sort: value, bar: value, ..Self::default() }
    }

    /// The ends of an interval; a hint where it is over few scenarios.
    pub(crate) fn interval(interval: Option<Interval>, scenarios: usize) -> Self {
        let text = range(interval);
        let few = interval.is_some() && scenarios < FEWEST_SCENARIOS;
        let hint = if few { "fewer than 5 scenarios: the true interval is wider" } else { "" };
        let text = if few { format!("{text} †") } else { text };
        Self {
            text: if text.is_empty() { "—".to_owned() } else { text },
            class: if interval.is_none() { "n none" } else { "n range" },
            sort: interval.map(|i| i.low),
            hint: hint.to_owned(),
            ..Self::default()
        }
    }

    /// Any number with its own text.
    pub(crate) fn number(text: impl Display, sort: Option<f64>) -> Self {
        Self { text: text.to_string(), class: if sort.is_none() { "n none" } else { "n" }, sort, ..Self::default() }
    }

    /// Mean and interval of an estimate as two cells.
    pub(crate) fn estimate(estimate: &Estimate) -> [Self; 2] {
        [Self::score(estimate.mean), Self::interval(estimate.interval, estimate.scenarios)]
    }

    pub(crate) fn hint(self, hint: impl Display) -> Self {
        Self { hint: hint.to_string(), ..self }
    }

    pub(crate) fn class(self, class: &'static str) -> Self {
        Self { class, ..self }
    }

    fn write(&self, m: &mut Markup, row_heading: bool) {
        let sort = self.sort.map(|sort| sort.to_string()).unwrap_or_default();
        let style = self.bar.map(|bar| format!("--v:{:.1}", 100.0 * bar)).unwrap_or_default();
        let mut attributes: Vec<(&'static str, &dyn Display)> = vec![("class", &self.class)];
        if self.class.split(' ').any(|class| class == "n") {
            attributes.push(("data-sort", &sort));
        }
        if self.bar.is_some() {
            attributes.push(("style", &style));
        }
        if !self.hint.is_empty() {
            attributes.push(("title", &self.hint));
        }
        if row_heading {
            attributes.push(("scope", &"row"));
        }
        let tag = if row_heading { "th" } else { "td" };
        if self.class.starts_with("name") {
            m.inside(tag, &attributes, |m| m.leaf("bdi", &[], &self.text));
        } else {
            m.leaf(tag, &attributes, &self.text);
        }
    }
}

/// Writes a table; the first cell of each row is its heading.
pub(crate) fn table(m: &mut Markup, caption: &str, order: Order, headings: &[Heading], rows: &[Vec<Cell>]) {
    m.inside("div", &[("class", &"scroll"), ("tabindex", &0), ("role", &"region"), ("aria-label", &caption)], |m| {
        let class = if order == Order::Sortable { "sortable" } else { "fixed" };
        m.inside("table", &[("class", &class)], |m| {
            m.leaf("caption", &[], caption);
            m.inside("thead", &[], |m| {
                m.inside("tr", &[], |m| {
                    for heading in headings {
                        write_heading(m, heading, order);
                    }
                });
            });
            m.inside("tbody", &[], |m| {
                for row in rows {
                    m.inside("tr", &[], |m| {
                        for (index, cell) in row.iter().enumerate() {
                            cell.write(m, index == 0);
                        }
                    });
                    m.raw("\n");
                }
            });
        });
    });
}

fn write_heading(m: &mut Markup, heading: &Heading, order: Order) {
    let class = if heading.numeric { "n" } else { "" };
    let mut attributes: Vec<(&'static str, &dyn Display)> = vec![("scope", &"col"), ("class", &class)];
    if !heading.hint.is_empty() {
        attributes.push(("title", &heading.hint));
    }
    m.inside("th", &attributes, |m| match order {
        Order::Sortable => m.leaf("button", &[("type", &"button")], &heading.title),
        Order::Fixed => m.text(&heading.title),
    });
}
