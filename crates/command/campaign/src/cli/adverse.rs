//! Arguments of `scenario adverse`.

use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum, ValueHint};
use ds_adverse::{Built, MotionModel, Options, Refusal, advbmt, variants};
use ds_process::shipped;
use ds_world::{AdversaryMode, CrashClass, Scene};

const EXAMPLES: &str = "Examples:
  dreamstream scenario adverse scenarios/base -o out/adverse      all classes, motion model fitted on generated traffic
  dreamstream scenario adverse out/imported --fit other_logs/     motion model fitted on other logs than the scenarios'
  dreamstream run out/adverse --policy lattice                    drive them

Writes BASE__CLASS.scenario.json for each variant and adverse.json: what came out for each scenario, what is recorded of
each variant, and how many candidates fell to which reason. A folder that holds an adverse.json is refused. docs/adversaries.md says how they are searched and checked.";

/// Arguments of `scenario adverse`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct AdverseArgs {
    /// Scenario files, or folders of them.
    #[arg(required = true, value_parser = shipped::parser(), value_hint = ValueHint::AnyPath)]
    pub paths: Vec<PathBuf>,
    /// Where variants and the report go.
    #[arg(long, short, default_value = "out/adverse", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
    /// Fit the motion model on these scenarios instead of taking the shipped one; not on those that are varied.
    #[arg(long, num_args = 1.., value_name = "SCENARIO", value_hint = ValueHint::AnyPath)]
    pub fit: Vec<PathBuf>,
    /// Only these classes.
    #[arg(long, value_delimiter = ',', value_parser = PossibleValuesParser::new(CrashClass::ALL.map(CrashClass::name))
        .map(|name| CrashClass::from_name(&name).expect("only names of classes pass")))]
    pub class: Vec<CrashClass>,
    /// What adversaries do about an ego that leaves its log.
    #[arg(long, default_value = "reactive", value_parser = PossibleValuesParser::new(AdversaryMode::ALL.map(AdversaryMode::name))
        .map(|name| AdversaryMode::from_name(&name).expect("only names of modes pass")))]
    pub mode: AdversaryMode,
    /// How adversaries are found: `own`, or `advbmt-default`, an arm for comparison with the collision states and the filter that
    /// Adv-BMT is released with, and mode replay.
    #[arg(long, value_enum, default_value = "own")]
    pub arm: Arm,
    /// Do not ask whether an expert can avoid the contact.
    #[arg(long)]
    pub unsolved: bool,
    /// Seed of the draws.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// The tick at which the policy takes over; contact is planned 30 to 70 ticks later.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(..=100_000))]
    pub hand_over: u32,
}

/// How adversaries are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Arm {
    /// This project's search: checked and solved by an expert.
    Own,
    /// Collision states and filter of Adv-BMT as it is released: neither checked nor solved.
    AdvbmtDefault,
}

impl Arm {
    /// Returns the name on the command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Own => "own",
            Self::AdvbmtDefault => "advbmt-default",
        }
    }

    /// Returns the mode that adversaries of this arm have where another one is asked for.
    pub(crate) fn mode(self, asked: AdversaryMode) -> AdversaryMode {
        if self == Self::Own { asked } else { AdversaryMode::Replay }
    }

    /// Searches the variants of a scenario.
    ///
    /// # Errors
    /// As for [`variants`].
    pub(crate) fn search(self, scene: &Scene, model: &MotionModel, options: &Options) -> Result<Built, Refusal> {
        match self {
            Self::Own => variants(scene, model, options),
            Self::AdvbmtDefault => advbmt(scene, model, options),
        }
    }
}
