//! What sets of pictures are compared by: features, their reductions, and distances between their distributions.
//!
//! [`features`] is a fixed bank of gradients and colour, no trained network. [`Principal`] reduces features of many
//! columns. [`Compared`] is FDπ of one policy: the Fréchet distance of what the policy attends to, over paired frames of
//! a real set and of other sources, with what belongs beside it: bias, bound, intervals over scenarios.

mod compared;
mod error;
pub mod features;
mod interval;
mod pool;
mod principal;
mod scenarios;
mod tokens;

pub use compared::{Compared, Distance, Unit, picks};
pub use error::FidelityError;
pub use interval::{CONFIDENCE, Interval, correlation, mean_of, ratio, recentred};
pub use pool::{mean_pooled, placed};
pub use principal::Principal;
pub use scenarios::Features;
pub use tokens::{TokenSpread, token_squares};
