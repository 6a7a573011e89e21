//! Benchmarks: sets of scenarios, cells and their keys, shards, results that are appended, merged and put into tables.
//!
//! Values in, values out, and files; nothing here drives. A set is told by its manifest, a cell by the digest over all
//! that its result depends on, so results of many machines meet cell by cell. What tables say stands in
//! `docs/benchmark.md`.

pub mod cell;
mod choice;
pub mod endpoint;
pub mod estimate;
pub mod faults;
pub mod file;
pub mod filter;
pub mod judge;
pub mod licence;
pub mod manifest;
pub mod merge;
pub mod page;
pub mod plot;
pub mod progress;
pub mod published;
pub mod quality;
pub mod record;
pub mod report;
pub mod results;
pub mod review;
pub mod scale;
pub mod session;
pub mod sheet;
pub mod source;
pub mod table;

pub use cell::{Cell, Named, Settings, Shard, ShardError};
pub use file::FileError;
pub use judge::{Judged, Outcome, Scores, judge};
pub use manifest::{Entry, Kind, Manifest, Recipe};
pub use merge::{MergeError, Merged, merge};
pub use progress::Progress;
pub use published::Published;
pub use quality::Quality;
pub use record::{ConditionShown, Losses, Record, Torn, Writer};
pub use report::Report;
pub use results::Results;
pub use review::{Review, VerdictError, Verdicts};
pub use scale::Scaling;
pub use sheet::{Ambiguous, Arm, Differs, Keep, Place, Sheet};
pub use source::SourceError;
