//! Bags of robots → columns of numbers: MCAP, ROS 1 bags and rosbag2's SQLite files, read by the message definitions they
//! carry.
//!
//! [`topics`] says what a bag holds, [`series`] takes named fields out of named topics with a stamp for each, in one
//! pass; [`glance`] keeps their ranges alone.
//! Everything in a bag is from outside: sizes are bounded before anything is allocated, and whatever does not fit is an
//! error by name. What a field means is not known here.

mod container;
mod contents;
mod definition;
mod error;
mod fix;
mod probe;
mod usual;
mod wire;

pub use container::Format;
pub use contents::{Topic, topics};
pub use error::BagError;
pub use fix::Plane;
pub use probe::{Clock, Glance, Series, Wanted, glance, series};
