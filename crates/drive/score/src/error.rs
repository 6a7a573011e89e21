//! Why something cannot be scored. Each variant names what is wrong and carries the offending value.

use crate::constants::strict::SHORTEST_EXPERT_M;

/// Says why an input is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ScoreError {
    /// A number is NaN or infinite.
    #[error("field {field:?} is {value}")]
    NotFinite {
        /// Which field.
        field: String,
        /// The value.
        value: f64,
    },
    /// The map has no polygon at all.
    #[error("map has no polygons: nothing can be compliant on it")]
    EmptyMap,
    /// The map has no lane.
    #[error("map has no lanes: direction and lane keeping are undefined")]
    NoLanes,
    /// The centreline has fewer than two distinct points.
    #[error("centreline has {points} points, two distinct ones are needed")]
    NoCentreline {
        /// How many points came.
        points: usize,
    },
    /// A polygon has fewer than three points or a number in it is not finite.
    #[error("field {field:?} is no polygon of three or more finite points")]
    BadPolygon {
        /// Which polygon.
        field: String,
    },
    /// The ego lies outside the bounds of the map.
    #[error("ego at ({x_m}, {y_m}) m lies outside the map")]
    EgoOutsideMap {
        /// Position of the ego, in metres.
        x_m: f64,
        /// Position of the ego, in metres.
        y_m: f64,
    },
    /// A box has no area.
    #[error("field {field:?} is a box of {length_m} x {width_m} m, both must be positive")]
    NoSize {
        /// Which box.
        field: String,
        /// Its length, in metres.
        length_m: f64,
        /// Its width, in metres.
        width_m: f64,
    },
    /// A plan has no poses, too many, or a spacing that cannot be sampled.
    #[error("plan of {poses} poses at {dt_s} s is refused: 1..=4096 poses at 0.001 s or more are needed")]
    BadPlan {
        /// How many poses came.
        poses: usize,
        /// Time between them, in seconds.
        dt_s: f64,
    },
    /// A series is too short for what is asked.
    #[error("{what} has {found} states, at least {needed} are needed")]
    TooFewStates {
        /// What is too short.
        what: &'static str,
        /// How many came.
        found: usize,
        /// How many are needed.
        needed: usize,
    },
    /// A time does not come after the one before it.
    #[error("field {field:?} is {value}, not after the one before it")]
    NotRising {
        /// Which field.
        field: String,
        /// The time, in seconds.
        value: f64,
    },
    /// An index points to nothing.
    #[error("field {field:?} is {index}, there are {count}")]
    NoSuchIndex {
        /// Which field.
        field: String,
        /// The index.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// Two frames are not consecutive.
    #[error("frames are {shift_s} s apart, more than 0 and less than 0.55 s are needed")]
    BadShift {
        /// Their distance, in seconds.
        shift_s: f64,
    },
    /// A token is named but no row carries it.
    #[error("no row has token {token:?}")]
    NoSuchRow {
        /// The token.
        token: String,
    },
    /// The expert's path is too short to measure a drive against.
    #[error("expert path is {length_m} m long, profile bridgesim needs at least {SHORTEST_EXPERT_M} m")]
    ExpertStandsStill {
        /// Its length, in metres.
        length_m: f64,
    },
}

/// Refuses a number that is not finite.
pub(crate) fn finite(value: f64, field: impl FnOnce() -> String) -> Result<(), ScoreError> {
    if value.is_finite() { Ok(()) } else { Err(ScoreError::NotFinite { field: field(), value }) }
}

/// Refuses a box without area.
pub(crate) fn sized(length_m: f64, width_m: f64, field: impl Fn() -> String) -> Result<(), ScoreError> {
    finite(length_m, || format!("{}.length", field()))?;
    finite(width_m, || format!("{}.width", field()))?;
    if length_m > 0.0 && width_m > 0.0 { Ok(()) } else { Err(ScoreError::NoSize { field: field(), length_m, width_m }) }
}
