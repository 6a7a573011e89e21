//! The `study` commands: tables over held-out scenarios.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueHint};

use ds_process::shipped;

const EXAMPLES: &str = "Examples:
  dreamstream study fidelity --config configs/study/fidelity.toml --quick   minutes: see what comes out
  dreamstream study fidelity --config configs/study/fidelity.toml           the figures of docs/measurements/fidelity.md";

/// Measure observation sources over held-out scenarios.
#[derive(Debug, Subcommand)]
#[command(after_help = EXAMPLES)]
pub(crate) enum StudyCommand {
    /// How near the frames of each source are to the reference camera's, for policies: FDπ.
    ///
    /// Writes fidelity.json (figures × 100 with intervals and bias) and index.html with tables, a plot and the scenes
    /// whose frames differ most. Features are kept per scenario and source: Ctrl-C, then the same command, goes on.
    /// docs/fidelity.md says what the figures mean.
    Fidelity(FidelityArgs),
}

/// Arguments of `study fidelity`.
#[derive(Debug, Args)]
pub(crate) struct FidelityArgs {
    /// Sources, panel and amounts; `docs/fidelity.md` explains every key.
    #[arg(long, value_name = "FILE", default_value = "configs/study/fidelity.toml", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub config: PathBuf,
    /// A look in minutes: few scenarios, into OUT/quick; the figures are no judgement.
    #[arg(long)]
    pub quick: bool,
    /// Number of scenarios, instead of the configuration's.
    #[arg(long)]
    pub scenarios: Option<u64>,
    /// Where results go; the configuration's own folder without it.
    #[arg(long, short, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}
