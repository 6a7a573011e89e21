//! The `study` commands: tables over held-out scenarios.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueHint};

use ds_process::shipped;

const EXAMPLES: &str = "Examples:
  dreamstream study fidelity --quick                  minutes: see what comes out
  dreamstream study correlation --quick
  dreamstream study sensitivity --scenarios 64
  dreamstream study anchor --recorded frames.toml     in units of two folders of real frames
  dreamstream study fidelity --quick --fid inception.toml    FID by a network of your own (ONNX), beside FDπ
  dreamstream study parts --config configs/study/parts.toml    people, paint, road …: what makes plans differ
  dreamstream study drives --real out/reference --source out/dreamstream
  dreamstream study drives --recorded frames.toml     two folders of pictures of the same states: real, generated
  dreamstream study closed-loop --quick               drives; Ctrl-C, then the same command, goes on";

/// Measure observation sources over held-out scenarios.
///
/// Each writes STUDY.json and index.html (pictures, plots and tables) into the configuration's folder; what was done is
/// kept, so that the same command goes on after Ctrl-C. docs/fidelity.md says what figures and keys mean.
#[derive(Debug, Subcommand)]
#[command(after_help = EXAMPLES)]
pub(crate) enum StudyCommand {
    /// How near the frames of each source are to the reference camera's, for policies: FDπ.
    Fidelity(StudyArgs),
    /// Whether sources that are far are those on which policies plan badly: r of FDπ with PDMS over sources.
    Correlation(StudyArgs),
    /// How much FDπ answers to edits of the world, beside other distances; hard scenarios.
    Sensitivity(StudyArgs),
    /// How FDπ grows along a drive, with and without a part of the video model.
    Rollout(StudyArgs),
    /// The video model without one of its parts.
    Ablation(StudyArgs),
    /// How far sources are from frames that real cameras recorded, in units of two such sets: --recorded FILE.
    Anchor(StudyArgs),
    /// Which part of a frame (people, paint, road …) makes a policy plan otherwise than on the reference camera's frame.
    Parts(StudyArgs),
    /// How near the frames of recorded drives, or folders of pictures, are to those of others, for policies: FDπ between them.
    Drives(DrivesArgs),
    /// How far driving scores lie from those of the same drives on the reference camera's frames.
    ClosedLoop(StudyArgs),
}

/// Arguments of a study.
#[derive(Debug, Args)]
pub(crate) struct StudyArgs {
    /// Sources, panel and amounts; configs/study/STUDY.toml without it.
    #[arg(long, value_name = "FILE", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub config: Option<PathBuf>,
    /// A look in minutes: few scenarios, into OUT/quick; the figures are no judgement.
    #[arg(long)]
    pub quick: bool,
    /// Number of scenarios, instead of the configuration's; of closed-loop all or, with --quick, every eighth.
    #[arg(long)]
    pub scenarios: Option<u64>,
    /// Folders of frames that real cameras recorded, with their calibration: the distance of the first two becomes the unit of
    /// a table that stands first. docs/fidelity.md shows such a file. Not of parts and closed-loop.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub recorded: Option<PathBuf>,
    #[command(flatten)]
    pub given: GivenArgs,
    /// Where results go; the configuration's own folder without it.
    #[arg(long, short, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}

/// Networks for FID and FVD.
#[derive(Debug, Args)]
pub(crate) struct GivenArgs {
    /// Manifest of an ONNX network that turns a frame into features: states its Fréchet distance, FID. docs/fidelity.md shows
    /// one. Not of parts and closed-loop.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub fid: Option<PathBuf>,
    /// The same of a network of clips: FVD.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub fvd: Option<PathBuf>,
}

/// Arguments of `study drives`.
#[derive(Debug, Args)]
pub(crate) struct DrivesArgs {
    /// The folder of recordings (*.mcap) that count as real, or of the run that made them.
    #[arg(long, value_name = "DIR", required_unless_present = "recorded", value_hint = ValueHint::DirPath)]
    pub real: Option<PathBuf>,
    /// Such a folder of the same scenarios and seeds; may be given more than once.
    #[arg(long, value_name = "DIR", required_unless_present = "recorded", value_hint = ValueHint::DirPath)]
    pub source: Vec<PathBuf>,
    /// Folders of pictures with their calibration, in place of recordings: the first counts as real, the others hold pictures
    /// of the same states under the same names. docs/fidelity.md shows such a file.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["real", "source"], value_hint = ValueHint::FilePath)]
    pub recorded: Option<PathBuf>,
    #[command(flatten)]
    pub given: GivenArgs,
    /// Whose panel looks, every how many ticks, with how many resamples; configs/study/fidelity.toml without it.
    #[arg(long, value_name = "FILE", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub config: Option<PathBuf>,
    /// Where drives.json goes; no file without it.
    #[arg(long, short, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}
