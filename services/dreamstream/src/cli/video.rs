//! The `video` commands: how good the frames of video models are.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum, ValueHint};
use ds_appraisal::evaluation::Part;

const EXAMPLES: &str = "Examples:
  dreamstream video eval --config configs/eval/shipped.toml --quick         minutes: see what comes out
  dreamstream video eval --config configs/eval/shipped.toml                 the figures of docs/video-eval.md
  dreamstream video eval --config configs/eval/shipped.toml --only drift    one part anew, the others as they were";

/// Measure frames of video models.
#[derive(Debug, Subcommand)]
#[command(after_help = EXAMPLES)]
pub(crate) enum VideoCommand {
    /// Roll weights out over held-out scenarios: do frames follow layouts, keep their look, stay sharp, how fast?
    ///
    /// Writes eval.json (figures with intervals and sample counts), outcome.json (everything) and index.html with plots
    /// and videos. What was rolled out is kept per rollout: Ctrl-C, then the same command, goes on; weights or settings
    /// that change are rolled out anew.
    Eval(VideoEvalArgs),
}

/// Arguments of `video eval`.
#[derive(Debug, Args)]
pub(crate) struct VideoEvalArgs {
    /// Arms with their weights, tables and amounts; `docs/video-eval.md` explains every key.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub config: PathBuf,
    /// Measure these parts only; the others stay as an earlier run left them.
    #[arg(long, value_enum, value_delimiter = ',')]
    pub only: Vec<PartName>,
    /// A look in minutes: few scenarios and short rollouts, into OUT/quick; the figures are no judgement.
    #[arg(long)]
    pub quick: bool,
    /// Where results go; the configuration's own folder without it.
    #[arg(long, short, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}

/// A part of an evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum PartName {
    /// Layout IoU, traffic lights, PSNR, perceptual and feature distance, colours, seams.
    Layout,
    /// Feature distance along long rollouts.
    Drift,
    /// Whether snow, rain, night and fog are still there at frame 100.
    Appearance,
    /// Frames a second.
    Speed,
    /// Side-by-side videos.
    Videos,
}

impl PartName {
    /// Returns the part.
    pub(crate) fn part(self) -> Part {
        match self {
            Self::Layout => Part::Layout,
            Self::Drift => Part::Drift,
            Self::Appearance => Part::Appearance,
            Self::Speed => Part::Speed,
            Self::Videos => Part::Videos,
        }
    }
}
