//! Where in a document a value stands, and checks that name the place, the value and the bound.

use std::fmt;

use ds_space::DVec2;

use crate::document::Point;

/// A path into a document, built on the stack while descending; printed only when something is wrong.
#[derive(Clone, Copy)]
pub(crate) enum Place<'a> {
    /// The whole document.
    Root,
    /// A field of an object.
    Field(&'a Place<'a>, &'static str),
    /// An item of a list.
    Item(&'a Place<'a>, usize),
}

impl fmt::Display for Place<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Root => Ok(()),
            Self::Field(Self::Root, name) => f.write_str(name),
            Self::Field(parent, name) => write!(f, "{parent}.{name}"),
            Self::Item(parent, index) => write!(f, "{parent}[{index}]"),
        }
    }
}

/// What is wrong with a document, and where.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// The path inside the document.
    pub at: String,
    /// What is wrong, with the value.
    pub problem: String,
}

/// The farthest that a coordinate may lie from the origin, in metres.
pub(crate) const FAR_M: f64 = 1e6;

impl<'a> Place<'a> {
    pub(crate) fn field(&'a self, name: &'static str) -> Self {
        Self::Field(self, name)
    }

    pub(crate) fn item(&'a self, index: usize) -> Self {
        Self::Item(self, index)
    }

    pub(crate) fn fault(&self, problem: impl Into<String>) -> Fault {
        Fault { at: self.to_string(), problem: problem.into() }
    }

    /// Checks that a number lies in low..=high (and so is finite).
    pub(crate) fn within(&self, value: f64, low: f64, high: f64) -> Result<f64, Fault> {
        if value >= low && value <= high {
            Ok(value)
        } else {
            Err(self.fault(format!("is {value}, not within {low} to {high}")))
        }
    }

    /// Checks that a length is more than 0 and at most `high` metres.
    pub(crate) fn size(&self, value: f64, high: f64) -> Result<f64, Fault> {
        if value > 0.0 && value <= high {
            Ok(value)
        } else {
            Err(self.fault(format!("is {value}, not above 0 and up to {high}")))
        }
    }

    /// Checks the points of a line or outline.
    pub(crate) fn points(&self, points: &[Point], least: usize) -> Result<Vec<DVec2>, Fault> {
        if points.len() < least {
            return Err(self.fault(format!("has {} points, at least {least} are needed", points.len())));
        }
        points.iter().enumerate().map(|(i, point)| self.item(i).point(*point)).collect()
    }

    /// Checks the coordinates of a point.
    pub(crate) fn point(&self, point: Point) -> Result<DVec2, Fault> {
        self.item(0).within(point[0], -FAR_M, FAR_M)?;
        self.item(1).within(point[1], -FAR_M, FAR_M)?;
        Ok(DVec2::from_array(point))
    }

    /// Checks a text that names something: not empty, at most 160 bytes, without control characters.
    pub(crate) fn name(&self, text: &str) -> Result<(), Fault> {
        if text.is_empty() || text.len() > 160 || text.chars().any(char::is_control) {
            return Err(self.fault(format!("is {text:?}; a name has 1 to 160 bytes and no control characters")));
        }
        Ok(())
    }

    /// Checks a series over ticks: `count` values or one, each within bounds.
    pub(crate) fn series(&self, values: &[f64], count: usize, bound: f64) -> Result<(), Fault> {
        if values.len() != count && (values.len() != 1 || count == 0) {
            return Err(self.fault(format!("has {} values, {count} (or 1 for a constant) are needed", values.len())));
        }
        values.iter().enumerate().try_for_each(|(i, value)| self.item(i).within(*value, -bound, bound).map(|_| ()))
    }
}
