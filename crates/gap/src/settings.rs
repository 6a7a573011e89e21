//! Every threshold and scale of the diagnosis in one place, each with its reason.
//!
//! Tuned on the practice cases and on effect-free worlds of our own simulator only.

/// Degrees of freedom of the Student-t loss (specification, section 3.1).
pub const NU: f64 = 4.0;
/// Effective share of independent residuals: neighbouring blocks and displacement, speed and heading share their noise.
pub const KAPPA: f64 = 0.25;
/// Effects that each list of the fast pass keeps for a fit.
pub const KEPT: usize = 8;
/// An estimate within this many nuisance standard deviations is not a finding (specification, section 3.3).
pub const MARGIN_SDS: f64 = 2.5;
