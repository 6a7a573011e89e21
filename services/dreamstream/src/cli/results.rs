//! Arguments of the commands that work on what was driven or recorded: scores, reports.

use std::path::PathBuf;

use clap::{Args, ValueHint};

/// Arguments of `score`.
#[derive(Debug, Args)]
pub(crate) struct ScoreArgs {
    /// Recordings (.mcap).
    #[arg(value_hint = ValueHint::FilePath, conflicts_with = "cases")]
    pub recordings: Vec<PathBuf>,
    /// Definition of the driving score; the recording's own without.
    #[arg(long, value_parser = ["bridgesim", "strict"])]
    pub profile: Option<String>,
    /// Take what is there of a damaged or incomplete recording; the answer says so.
    #[arg(long)]
    pub partial: bool,
    /// A folder of case files of the reference scorers to answer.
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub cases: Option<PathBuf>,
    /// Where the scores or answers go as JSON.
    #[arg(long, short, value_hint = ValueHint::FilePath)]
    pub out: Option<PathBuf>,
}

/// Arguments of `report`.
#[derive(Debug, Args)]
pub(crate) struct ReportArgs {
    /// Folders of runs, or their results files.
    #[arg(required = true, value_hint = ValueHint::AnyPath)]
    pub runs: Vec<PathBuf>,
    /// Report also on runs with damaged or incomplete recordings; page, tables and JSON say so.
    #[arg(long)]
    pub partial: bool,
    /// The scenario set that others are changes of, for proposal coverage.
    #[arg(long)]
    pub base_set: Option<String>,
    /// Where page and tables go.
    #[arg(long, short, default_value = "out/report", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
}

/// Arguments of `compare`.
#[derive(Debug, Args)]
pub(crate) struct CompareArgs {
    /// The run that is compared with: its folder or results file.
    #[arg(value_hint = ValueHint::AnyPath)]
    pub run_a: PathBuf,
    /// The run whose gain or loss is told.
    #[arg(value_hint = ValueHint::AnyPath)]
    pub run_b: PathBuf,
    /// Compare also runs with damaged or incomplete recordings; page, tables and JSON say so.
    #[arg(long)]
    pub partial: bool,
    /// Compare a run that was driven by the wall clock with one that was not; the tables say so.
    #[arg(long)]
    pub force: bool,
    /// Where page and tables go, if they are wanted.
    #[arg(long, short, value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}

/// Arguments of `merge`.
#[derive(Debug, Args)]
pub(crate) struct MergeArgs {
    /// Folders of runs, or their results files.
    #[arg(required = true, value_hint = ValueHint::AnyPath)]
    pub runs: Vec<PathBuf>,
    /// Merge runs of other versions, weights or settings too.
    #[arg(long)]
    pub force: bool,
    /// Merge also runs with damaged or incomplete recordings; what comes of them is refused again without `--partial`.
    #[arg(long)]
    pub partial: bool,
    /// Where the merged results file goes.
    #[arg(long, short, default_value = "out/merged", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
}
