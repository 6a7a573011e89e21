//! The car and its drivers, once: tyres and forces of the single track, the intelligent driver model, trackers of a plan.
//!
//! One parameter set, the [`Plant`](ds_effect::Plant) that effects edit. Nothing is integrated here: the simulator steps
//! a car forward in time, the gap diagnosis fits one to a log, and each keeps the scheme that its purpose needs; forces
//! come from here. SI units, x forward, y left, angles counter-clockwise. No clock, no files.

mod bicycle;
mod force;
mod idm;
mod nominal;
mod tracker;
mod tyre;

pub use bicycle::{Control, Rolling};
pub use force::{GRAVITY_MPS2, STANDING_MPS, air_n, held, rolling_mps2, slip_rad, slope_mps2};
pub use idm::{Above, Exponent, Form, IdmParameters, Lead, Shortest};
pub use nominal::{UNDERSTEER_S2_PER_M, nominal};
pub use tracker::lqr;
pub use tracker::{Command, Profile, Reference, Tracker, stopping};
pub use tyre::{Axle, Saturation, Tyre, axles, built_share};
