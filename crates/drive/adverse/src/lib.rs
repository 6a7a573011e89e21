//! A scenario and how vehicles usually move → variants of it in which another vehicle collides with the logged ego.
//!
//! For each of the five NHTSA classes collision states are drawn along the logged drive, a beam searches backwards from
//! each through the bicycle to the first tick, and what was found is driven forwards again and checked. The class of a
//! contact comes from a pure classifier, never from the intention. Values in, values out; draws by key; a thread's
//! result depends on nothing else. World frame, SI units, ticks of 0.1 s.

mod advbmt;
mod beam;
mod class;
mod collision;
mod course;
mod encroachment;
mod expert;
mod limits;
mod measure;
mod model;
mod quality;
mod reach;
mod reacting;
mod road;
mod rules;
mod shape;
mod solve;
mod stage;
mod validity;
mod variant;

pub use advbmt::advbmt;
pub use class::{Encounter, Moment, Relation, WINDOW_TICKS, classify};
pub use course::Course;
pub use expert::Expert;
pub use measure::Measures;
pub use model::{ModelError, MotionModel, Step};
pub use quality::{Apart, Quality, Resemblance, Spread, Telling, quality};
pub use rules::{BrokenRules, broken_rules};
pub use solve::{Solution, solved_again};
pub use validity::{Met, Rejection};
pub use variant::{Built, Options, Refusal, Variant, adversary_digest, variants};
