//! Why a pair of frame streams cannot be diagnosed, by name, with the offending file and value.

use std::path::PathBuf;

use ds_diagnosis::CaseError;

/// A case that cannot be read or makes no sense.
#[derive(Debug, thiserror::Error)]
pub enum FramesError {
    /// A file cannot be read, or `meta.json` is not what it should be.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// A picture cannot be decoded.
    #[error("cannot decode {path:?}")]
    Decode {
        /// The file.
        path: PathBuf,
        /// Why.
        source: image::ImageError,
    },
    /// A field of `meta.json` makes no sense.
    #[error("absurd camera: {field} is {value:?}, expected {range}")]
    AbsurdCamera {
        /// Field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What would be believed.
        range: &'static str,
    },
    /// A picture or depth image has another size than the case.
    #[error("picture is {found:?}, expected {expected:?}: {path:?}")]
    Size {
        /// Columns and rows found.
        found: [usize; 2],
        /// Columns and rows of `meta.json`.
        expected: [usize; 2],
        /// The file.
        path: PathBuf,
    },
    /// A column that must be there is not.
    #[error("missing column {column:?} in {path:?}")]
    MissingColumn {
        /// Name of the column.
        column: &'static str,
        /// The file.
        path: PathBuf,
    },
    /// A cell is not a number.
    #[error("not a number: row {row} of column {column:?} is {text:?} in {path:?}")]
    NotANumber {
        /// Row below the head, from 1.
        row: usize,
        /// Column.
        column: &'static str,
        /// What stands there.
        text: String,
        /// The file.
        path: PathBuf,
    },
    /// Times do not grow.
    #[error("time goes back: row {row} has time_s = {time} after {before} in {path:?}")]
    TimeGoesBack {
        /// Row below the head, from 1.
        row: usize,
        /// Time, s.
        time: f64,
        /// Time before, s.
        before: f64,
        /// The file.
        path: PathBuf,
    },
    /// Too few frames have both pictures.
    #[error("too few frames with both pictures: {found}, {needed} are needed, in {path:?}")]
    TooFewFrames {
        /// Frames found.
        found: usize,
        /// Frames needed.
        needed: usize,
        /// The case.
        path: PathBuf,
    },
    /// Too few effect-free pairs to learn from.
    #[error("too few effect-free pairs: {found}, {needed} are needed, in {path:?}")]
    TooFewNuisance {
        /// Cases found.
        found: usize,
        /// Cases needed.
        needed: usize,
        /// The folder.
        path: PathBuf,
    },
    /// A clip has too few simulated streams.
    #[error("too few seeds: meta.json names {found} simulated streams, {needed} are needed, in {path:?}")]
    TooFewSeeds {
        /// Streams named.
        found: usize,
        /// Streams needed.
        needed: usize,
        /// The clip.
        path: PathBuf,
    },
    /// A case has too few clips.
    #[error("too few clips: {found}, {needed} are needed, in case {case:?}")]
    TooFewClips {
        /// Clips found.
        found: usize,
        /// Clips needed.
        needed: usize,
        /// The case.
        case: String,
    },
    /// A simulated stream lacks frames that others of its clip have.
    #[error("missing frames: {found} of {expected} are there, in {path:?}")]
    MissingFrames {
        /// Frames found.
        found: usize,
        /// Frames of the other streams.
        expected: usize,
        /// The stream.
        path: PathBuf,
    },
    /// Every pixel of a stream has one value.
    #[error("stream {stream:?} shows nothing: every pixel has nearly one value, in {path:?}")]
    Blank {
        /// sim or real.
        stream: &'static str,
        /// The case.
        path: PathBuf,
    },
    /// The feature distance cannot be computed.
    #[error("no feature distance")]
    Distance(#[from] ds_stats::SampleError),
}
