//! A column of a table: numbers or texts, of bounded length.

use ds_scenario::MAX_STATES;

/// The most rows of a table.
pub(super) const MAX_ROWS: usize = MAX_STATES;

/// The cells of a column.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Column {
    Numbers(Vec<f64>),
    Texts(Vec<String>),
}
