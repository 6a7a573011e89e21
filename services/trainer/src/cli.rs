//! The command line: every command, flag, default and example; parsing only.

use clap::{Parser, Subcommand};

mod data;
mod study;
mod train;
mod video;

pub(crate) use data::{DataCommand, DataListArgs, DataPaintsArgs, DataRenderArgs, DataSheetArgs};
pub(crate) use study::{DrivesArgs, GivenArgs, StudyArgs, StudyCommand};
pub(crate) use train::TrainArgs;
pub(crate) use video::{FirstFrameArgs, PairsArgs, VideoCommand, VideoEvalArgs};

/// Renders clips, trains, and measures what was trained: what happens away from a drive. `dreamstream` starts it.
#[derive(Debug, Parser)]
#[command(name = "dreamstream", bin_name = "dreamstream", version, propagate_version = true)]
pub(crate) struct Cli {
    /// Log filter, such as `info` or `ds_bus=trace`.
    #[arg(long, global = true, env = "DREAMSTREAM_LOG", default_value = "warn,zenoh=error")]
    pub log: String,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Render and look at clips for training and evaluation.
    #[command(subcommand)]
    Data(DataCommand),
    /// Train the video model or a driving policy.
    Train(TrainArgs),
    /// Measure how good the frames of video models are.
    #[command(subcommand)]
    Video(VideoCommand),
    /// Measure observation sources over held-out scenarios, for policies.
    #[command(subcommand)]
    Study(StudyCommand),
}
