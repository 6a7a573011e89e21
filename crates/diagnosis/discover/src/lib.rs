//! Logs that no effect of the library explains → at which point of the loop a law acts, and which: a short sum of products of
//! what the car is asked for and how it moves, ranked together with its port, since the port alone cannot be told.
//!
//! [`discover`] takes a case and its diagnosis. Method and limits: `docs/gap-discover.md`.

mod beyond;
mod free;
mod law;
mod linear;
mod port;
mod report;
mod shrink;
mod spectrum;
mod tables;
mod terms;

pub use beyond::extrapolated_share;
pub use report::discover;

/// What a law must show, and how its evidence becomes a probability.
mod settings {
    /// Log evidence over the nuisance fit from which a law is offered.
    pub(crate) const LAW_GAIN: f64 = 8.0;
    /// The same where the diagnosis says that nothing is missing: traits of healthy vehicles of worlds with brush tyres reached 31.
    pub(crate) const ASKED_GAIN: f64 = 40.0;
    /// Share of the gap that a law must close where one is measured.
    pub(crate) const LEAST_SHARE: f64 = 0.1;
    /// Change of a metric, in units of its floor, from which a law counts as moving it.
    pub(crate) const MOVED: f64 = 0.1;
    /// Log evidence that a law must have over the best effect of the library where one was accepted.
    pub(crate) const OVER_LIBRARY: f64 = 10.0;
    /// Temperature of the probabilities: model error makes evidences of some tens differ by a few by chance.
    pub(crate) const TEMPERATURE: f64 = 2.0;
    /// Log evidence within which another port's best law counts as equivalent.
    pub(crate) const EQUIVALENT: f64 = 3.0;
    /// Ports whose best law is fitted to the simulator itself.
    pub(crate) const REFINED: usize = 3;
    /// Share of a free signal's log evidence that a law must have to be what acts there.
    pub(crate) const LEAST_OF_FREE: f64 = 0.3;
    /// Share of its log evidence with which a free signal stands beside laws: it explains these drives and predicts no other.
    pub(crate) const FREE_SHARE: f64 = 0.8;
    /// Share of a free signal's weight from which laws decide between the points of one family.
    pub(crate) const TELLING_SHARE: f64 = 0.15;
    /// Factor on the weight of a free signal at the steering beside one that pushes the car.
    pub(crate) const OF_ITSELF: f64 = 0.9;
    /// Log evidence that a table must have over the best sum of products at its port: it has more to choose from, and says less.
    pub(crate) const OVER_SUMS: f64 = 5.0;
    /// Cosine of two tables, knot by knot, from which they are much the same.
    pub(crate) const ALIKE: f64 = 0.7;
    /// Share of the refits without one drive in which a term must be kept.
    pub(crate) const STABLE: f64 = 0.8;
}
