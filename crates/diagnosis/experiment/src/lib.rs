//! What to drive next: the explanations that a diagnosis leaves → the manoeuvre whose log would tell most of them apart,
//! within an envelope; and the loop that drives it, adds the log and diagnoses again.
//!
//! [`choose()`] designs one run, [`run()`] is the loop. Whoever moves the car is a [`ds_dynamics::motion::Motion`]; files and
//! processes stay outside. Equations and limits: `docs/gap-next.md`.

mod bound;
mod choose;
mod cma;
mod design;
mod drive;
mod envelope;
mod error;
mod predict;
mod report;
mod run;
mod settings;

pub use choose::choose;
pub use design::{Design, LIBRARY, NAMES};
pub use drive::{Driven, World};
pub use envelope::{Envelope, Margin, Site};
pub use error::ExperimentError;
pub use report::{Checked, Considered, Curve, Curves, Hypothesis, Next, Pair, Planned, Refused, Run};
pub use run::{Logged, drive, join, run};
pub use settings::{ENOUGH, LEAST_NATS, MOST_RUNS, Settings};
