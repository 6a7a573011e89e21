//! Results of runs → means with intervals, comparisons, bias of the scorer, tables and pages.
//!
//! Everything but reading and writing files is a pure function over plain values. The scenario is the unit: seeds
//! are averaged within a scenario first, then every scenario weighs the same. Failed drives count 0 and aborted ones
//! are counted beside; neither is ever dropped silently. All random draws are functions of a seed.

pub mod aggregate;
pub mod attribution;
pub mod bias;
pub mod bootstrap;
pub mod closing;
pub mod compare;
pub mod dimension;
pub mod metric;
pub mod report;
pub mod results;
pub mod term;
pub mod write;

#[cfg(test)]
mod sample;

pub use aggregate::{Aggregate, Estimate, Group, Summary, aggregate};
pub use attribution::{Attribution, attribute};
pub use bias::{Bias, BiasOptions, bias};
pub use bootstrap::Interval;
pub use compare::{Comparison, Difference, Pairing, Verdict, compare};
pub use dimension::{Dimension, Drive, drives};
pub use metric::Metric;
pub use report::{Picture, Report, ReportOptions};
pub use results::{Episode, Outcome, ProposalStats, RESULTS, Results, ResultsError, Run, TimeShare, WallClock};
