//! The `video` commands: how good the frames of video models are.

use std::path::PathBuf;

use clap::builder::{PossibleValue, TypedValueParser};
use clap::{Args, Subcommand, ValueHint};
use ds_evaluate::evaluation::Part;
use ds_launch::choice::named;
use ds_process::shipped;

const EXAMPLES: &str = "Examples:
  dreamstream video eval --config configs/eval/shipped.toml --quick         minutes: see what comes out
  dreamstream video eval --config configs/eval/shipped.toml                 the figures of docs/measurements/video-model.md
  dreamstream video pairs --cases 3 -o healthy                               effect-free pairs, for gap diagnose --nuisance
  dreamstream video first-frame SCENARIO --prompt 'driving in snow' -o first.png
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
    /// Generated frames beside the reference camera's of the same states: effect-free cases for gap diagnose.
    ///
    /// Each case has several clips, one per generated scenario on its log, and several seeds of the noise of each; its
    /// layout stands in docs/gap-frames.md.
    Pairs(PairsArgs),
    /// Imagine the first frame of a scenario from its layout and a prompt: the teacher's one-frame mode.
    FirstFrame(FirstFrameArgs),
}

/// Arguments of `video pairs`.
#[derive(Debug, Args)]
pub(crate) struct PairsArgs {
    /// Cases.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub cases: u64,
    /// Clips of a case.
    #[arg(long, default_value_t = 8)]
    pub clips: u64,
    /// Seeds of the generator's noise for each clip.
    #[arg(long, default_value_t = 4)]
    pub seeds: u64,
    /// Frames of a clip.
    #[arg(long, default_value_t = 30)]
    pub frames: u32,
    /// The first frame that is kept, counted from the reference camera's own, from which the model starts.
    #[arg(long, default_value_t = 6)]
    pub first: u32,
    /// Seed of the first eight scenarios, one per family; the next seed gives the next eight.
    #[arg(long, default_value_t = 40_000_000)]
    pub first_seed: u64,
    /// The look: `daylight` (clear and overcast in turn), `drawn` (any condition), or the name of an appearance.
    #[arg(long, default_value = "daylight")]
    pub look: String,
    /// Also write the reference camera's frames so many times larger, into large/.
    #[arg(long, default_value_t = 1)]
    pub over: u32,
    /// Model preset.
    #[arg(long, default_value = "configs/models/cpu_train.toml", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub model: PathBuf,
    /// Its weights.
    #[arg(long, default_value = "configs/models/cpu_train.safetensors", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub weights: PathBuf,
    /// Where the cases go.
    #[arg(long, short, default_value = "out/pairs", value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
}

/// Arguments of `video first-frame`.
#[derive(Debug, Args)]
pub(crate) struct FirstFrameArgs {
    /// The scenario.
    #[arg(value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub scenario: PathBuf,
    /// Lighting, weather and what lies on the road, in ordinary words; daylight without them. What else there is to see is told by the
    /// scenario.
    #[arg(long, value_name = "TEXT")]
    pub prompt: Option<String>,
    /// Model preset.
    #[arg(long, default_value = "configs/models/cpu_train.toml", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub model: PathBuf,
    /// Weights of a teacher with its autoencoder; those that ship have learned first frames in every condition.
    #[arg(long, default_value = "configs/models/cpu_train_first.safetensors", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub weights: PathBuf,
    /// Sampling steps.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub steps: u16,
    /// Guidance towards layout and words; 1 is none.
    #[arg(long, default_value_t = 2.5)]
    pub guidance: f32,
    /// Another number, another frame.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// The picture to write; `dreamstream run --first-frame` takes it.
    #[arg(long, short, default_value = "out/first.png", value_hint = ValueHint::FilePath)]
    pub out: PathBuf,
}

/// Arguments of `video eval`.
#[derive(Debug, Args)]
pub(crate) struct VideoEvalArgs {
    /// Arms with their weights, tables and amounts; `docs/video-eval.md` explains every key.
    #[arg(long, value_name = "FILE", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub config: PathBuf,
    /// Measure these parts only; the others stay as an earlier run left them.
    #[arg(long, value_delimiter = ',', value_parser = part())]
    pub only: Vec<Part>,
    /// A look in minutes: few scenarios and short rollouts, into OUT/quick; the figures are no judgement.
    #[arg(long)]
    pub quick: bool,
    /// Where results go; the configuration's own folder without it.
    #[arg(long, short, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}

/// Parses a part of an evaluation.
fn part() -> impl TypedValueParser<Value = Part> {
    let told = Part::ALL.map(|part| {
        PossibleValue::new(part.name()).help(match part {
            Part::Sharpness => "Detail, blocks and seams along whole drives",
            Part::Layout => "Layout IoU, traffic lights, PSNR, perceptual and feature distance, colours, seams",
            Part::Drift => "Feature distance along long rollouts",
            Part::Appearance => "Whether snow, rain, night and fog are still there at frame 100",
            Part::FirstFrames => "Whether first frames from layout and words show what the words say",
            Part::Speed => "Frames a second",
            Part::Videos => "Side-by-side videos",
        })
    });
    named(told, |name| Part::ALL.into_iter().find(|part| part.name() == name))
}
