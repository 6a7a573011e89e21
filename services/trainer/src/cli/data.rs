//! The `data` commands: clips for training and evaluation.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueHint};

use ds_process::shipped;

const EXAMPLES: &str = "Examples:
  dreamstream data render --config configs/data/smoke.toml       seconds: see what comes out
  dreamstream data render --config configs/data/narrow.toml      the layout training set; Ctrl-C, same command: goes on
  dreamstream data render --config configs/data/test.toml --world b --out training/data/test_b
  dreamstream data sheet training/data/narrow -o narrow.png      look at it
  dreamstream data list training/data/narrow                     one line per clip
  dreamstream data paints training/data/narrow                   what colours vehicles have there";

/// Render, list and look at clips.
#[derive(Debug, Subcommand)]
#[command(after_help = EXAMPLES)]
pub(crate) enum DataCommand {
    /// Render the clips of a recipe: frames, layouts, classes and prompts, in shards with an index.
    Render(DataRenderArgs),
    /// Draw a contact sheet of a set: four frames and the first layout of each shown clip, two clips a row.
    Sheet(DataSheetArgs),
    /// Print one line per clip of a set: scenario, network, appearance, prompt.
    List(DataListArgs),
    /// Print the paints of the vehicles of a set, as `control.paints` of a preset takes them.
    Paints(DataPaintsArgs),
}

/// Arguments of `data render`.
#[derive(Debug, Args)]
pub(crate) struct DataRenderArgs {
    /// The recipe; `configs/data` holds those of the project, `docs/data.md` explains every key.
    #[arg(long, value_name = "FILE", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub config: PathBuf,
    /// Where the clips go; the recipe's folder without it.
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
    /// The world of the frames: `a`, the reference camera's, or `b`, the second one, for evaluation only; the recipe's
    /// without it. World B has a camera rig of its own, and the layouts with it.
    #[arg(long, value_parser = ["a", "b"])]
    pub world: Option<String>,
}

/// Arguments of `data sheet`.
#[derive(Debug, Args)]
pub(crate) struct DataSheetArgs {
    /// The folder of a rendered set.
    #[arg(value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub set: PathBuf,
    /// The picture to write; `sheet.png` in the set's folder without it.
    #[arg(short, long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub out: Option<PathBuf>,
    /// How many clips to show, evenly spread.
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u16).range(1..=256))]
    pub clips: u16,
}

/// Arguments of `data list`.
#[derive(Debug, Args)]
pub(crate) struct DataListArgs {
    /// The folder of a rendered set.
    #[arg(value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub set: PathBuf,
}

/// Arguments of `data paints`.
#[derive(Debug, Args)]
pub(crate) struct DataPaintsArgs {
    /// The folder of a rendered set.
    #[arg(value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub set: PathBuf,
    /// How many to print: those at equal steps from the darkest to the brightest.
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u16).range(1..=256))]
    pub count: u16,
}
