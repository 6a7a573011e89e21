//! Every threshold and scale of the diagnosis of recorded traffic, each with its reason.
//!
//! Set on effect-free and labelled draws of the own simulator with seeds that no reported figure uses.

/// White part of the floor of a place along a path, its growth per second and per second squared, m.
pub const PLACE_FLOOR_M: [f64; 3] = [0.10, 0.10, 0.05];
/// The same of a speed, m/s.
pub const SPEED_FLOOR_MPS: [f64; 2] = [0.10, 0.06];
/// Scatter of drivers across their lane, m: recorded apart from their paths, and on a lane's centre line.
pub const ASIDE_FLOOR_M: [f64; 2] = [0.06, 0.30];
/// Root mean square displacement at 1, 2, 3 and 5 s and of speed at 3 s that effect-free worlds leave.
pub const LEFT_M: [f64; 4] = [0.13, 0.40, 0.78, 1.8];
/// The same of speed, m/s.
pub const LEFT_MPS: f64 = 0.5;
/// Standard error of an estimate, as a share of its distance from neutral, that no number of agents takes away.
pub const SHAPE_ERROR: f64 = 0.04;
/// Seconds between starts of rollouts.
pub const STRIDE_SECS: f64 = 1.5;
/// Seconds between scored instants of a rollout.
pub const BLOCK_SECS: f64 = 0.5;
/// Log evidence over the nuisance fit that an effect must have.
pub const SINGLE_GAIN: f64 = 6.0;
/// Log evidence that a further effect must add.
pub const FURTHER_GAIN: f64 = 8.0;
/// Temperature of the probabilities.
pub const TEMPERATURE: f64 = 2.0;
/// Log prior odds of one given effect against none.
pub const SINGLE_COST: f64 = 3.0;
/// An estimate within this many nuisance standard deviations is no finding.
pub const MARGIN_SDS: f64 = 2.5;
/// Most effects in one diagnosis.
pub const MOST_EFFECTS: usize = 3;
/// Share of drivers who do not yield in a world without the effect.
pub const LAPSE_SHARE: f64 = 0.03;
/// Mean point loss of an agent that the simulator explains; effect-free agents stay below.
pub const CLEAN_LOSS: f64 = 1.2;
/// Share of agents beyond the clean level from which something is unknown.
pub const STRANGE_SHARE: f64 = 0.2;
/// Width of the passage from known to unknown, as a share of agents.
pub const STRANGE_WIDTH: f64 = 0.04;
/// Evidence difference below which two effects form a group.
pub const GROUP_EVIDENCE: f64 = 3.0;
/// Side of a place, m.
pub const PLACE_M: f64 = 50.0;
/// Draws of every bootstrap.
pub const DRAWS: u64 = 300;
