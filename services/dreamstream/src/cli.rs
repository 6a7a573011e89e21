//! The command line: every command, flag, default and example; parsing only.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::builder::TypedValueParser;
use clap::{Args, Parser, Subcommand, ValueHint};
use ds_campaign::cli::BenchmarkArgs;
use ds_campaign::cli::adverse::AdverseArgs;
use ds_gap::cli::GapCommand;
use ds_import::Format;
use ds_launch::choice::named;
use ds_launch::{Networks, RunPlan, SubmitArgs};
use ds_process::onlooker::OnlookerArgs;
use ds_process::shipped;

mod fleet;
mod measure;
mod policy;
mod results;

pub(crate) use fleet::{CertsArgs, HealthArgs, ServeArgs, TopArgs, WhyArgs};
pub(crate) use measure::MeasureArgs;
pub(crate) use policy::PolicyCommand;
pub(crate) use results::{CompareArgs, MergeArgs, ReportArgs, ScoreArgs};

const EXAMPLES: &str = "Examples:
  dreamstream run scenarios/base                       drive all shipped scenarios with the camera policy
  dreamstream run scenarios/base/cut-in.scenario.json --observation reference --out out/cut-in
  dreamstream import scenarionet my_logs/ -o out/imported && dreamstream run out/imported
  dreamstream view out/run/recordings/cut-in.camera.dreamstream.s0.a1.mcap --save drive.rrd
  dreamstream doctor                                   say what this machine has and lacks";

/// A closed-loop simulator for end-to-end driving policies.
#[derive(Debug, Parser)]
#[command(name = "dreamstream", version, about, after_help = EXAMPLES, propagate_version = true)]
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
    /// Drive scenarios in a closed loop; scores, recordings and pictures go to --out.
    Run(RunPlan),
    /// Drive scenarios on a fleet that runs already, such as one started by compose.
    Submit(SubmitArgs),
    /// Convert recorded logs to scenario files.
    Import(ImportArgs),
    /// List, show or generate scenarios.
    #[command(subcommand)]
    Scenario(ScenarioCommand),
    /// Render and look at clips for training and evaluation.
    #[command(disable_help_flag = true)]
    Data(Handed),
    /// Train the video model or a driving policy.
    #[command(disable_help_flag = true)]
    Train(Handed),
    /// Measure how good the frames of video models are.
    #[command(disable_help_flag = true)]
    Video(Handed),
    /// Measure observation sources over held-out scenarios, for policies.
    #[command(disable_help_flag = true)]
    Study(Handed),
    /// Show a recording or a running drive in rerun.
    View(ViewArgs),
    /// Run one service against a recording and compare what it makes.
    Replay(ReplayArgs),
    /// Measure simulation step, layout, bus hop and frame decode on this machine.
    Bench(BenchArgs),
    /// Measure a published video model with drawn weights on a device: time, memory, share of what the device attains.
    Measure(MeasureArgs),
    /// Say what is wrong with how a policy is wrapped.
    #[command(subcommand)]
    Policy(PolicyCommand),
    /// Say what this machine has and lacks.
    Doctor,
    /// Print a completion script for a shell.
    Completion {
        /// The shell.
        shell: clap_complete::Shell,
    },
    /// Score recordings again without simulating, in either profile; or answer case files of the reference scorers.
    Score(ScoreArgs),
    /// Say where the gap between reference logs and a simulator lies, which effect causes it, how far it shrinks.
    #[command(subcommand)]
    Gap(GapCommand),
    /// Put results of one or several runs into tables, plots and a page, with intervals over scenarios.
    Report(ReportArgs),
    /// Compare two runs on the scenarios that both drove: paired differences, intervals, significance.
    Compare(CompareArgs),
    /// Put the results of several runs, such as the shards of one, into one file.
    Merge(MergeArgs),
    /// Build sets of scenarios, drive their cells on any number of machines, merge and report.
    Benchmark(BenchmarkArgs),
    /// Say what a drive waits for: which message, from whom, since when.
    Why(WhyArgs),
    /// Show members and runs of a fleet, again each second: who works, who fell silent, what is driven.
    Top(TopArgs),
    /// Run one of the five services of a fleet, or the Zenoh router between them, in the foreground.
    Serve(ServeArgs),
    /// Ask a service whether it is well; exit code 0 if so.
    Health(HealthArgs),
    /// Make an authority, one certificate per service and the token: what a fleet on a network needs.
    Certs(CertsArgs),
}

impl Command {
    /// Returns the name and the words of a command that the process `trainer` carries out.
    pub(crate) fn of_trainer(&self) -> Option<(&'static str, &Handed)> {
        match self {
            Self::Data(handed) => Some(("data", handed)),
            Self::Train(handed) => Some(("train", handed)),
            Self::Video(handed) => Some(("video", handed)),
            Self::Study(handed) => Some(("study", handed)),
            _ => None,
        }
    }
}

const IMPORT_HELP: &str = "Formats:
  scenarionet   pickles of ScenarioNet and MetaDrive (*.pkl); nothing in them is executed
  argoverse2    folders of Argoverse 2: sensor logs (city_SE3_egovehicle, annotations, calibration) and scenarios of
                motion forecasting (scenario*), each with log_map_archive*.json; tables as .feather or .csv, parquet
                after conversion to .csv
  openscene     folders of OpenScene and NAVSIM (navsim_logs/**/*.pkl) with nuPlan's maps
                (LOCATION/VERSION/map.gpkg) in --maps, or in a folder maps or nuplan-maps-v1.0 in or above them;
                without the map of a drive its layouts show no road, which is said
  commonroad    XML files of CommonRoad, formats 2018b and 2020a: lanelets, lights, signs, obstacles. The ego is the
                first planning problem, whose drive nobody recorded: it is drawn along the lanes to the goal, which is
                said. --ego ID takes another problem, or a recorded vehicle with its own drive

Examples:
  dreamstream import scenarionet my_logs/ -o out/imported
  dreamstream import argoverse2 sensor/val/02678d04-cc9f-3148-9f95-1ba66347dff9 -o out/imported
  dreamstream import openscene navsim/dataset --maps navsim/dataset/maps -o out/imported
  dreamstream import commonroad scenarios/NGSIM/US101 --ego recorded -o out/imported
  dreamstream run out/imported";

fn formats() -> impl TypedValueParser<Value = Format> {
    named(Format::ALL.map(Format::name), |name| Format::ALL.into_iter().find(|format| format.name() == name))
}

/// Words for the process `trainer`, which knows their flags and their help.
#[derive(Debug, Args)]
pub(crate) struct Handed {
    /// What it is told.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "WORDS")]
    pub words: Vec<OsString>,
}

/// Arguments of `import`.
#[derive(Debug, Args)]
#[command(after_help = IMPORT_HELP)]
pub(crate) struct ImportArgs {
    /// The log format.
    #[arg(value_parser = formats())]
    pub format: Format,
    /// Logs, or folders of them.
    #[arg(required = true, value_hint = ValueHint::AnyPath)]
    pub paths: Vec<PathBuf>,
    /// The folder of nuPlan's maps (what other tools call NUPLAN_MAPS_ROOT), for openscene.
    #[arg(long, value_hint = ValueHint::DirPath)]
    pub maps: Option<PathBuf>,
    /// Who is driven, for commonroad: the id of a planning problem or of a recorded vehicle, or `recorded` for each
    /// vehicle that is recorded for 3 s or more, a scenario each.
    #[arg(long, value_name = "ID")]
    pub ego: Option<String>,
    /// Where the scenario files go.
    #[arg(long, short, default_value = "out/imported", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
}

/// Commands of `scenario`.
#[derive(Debug, Subcommand)]
pub(crate) enum ScenarioCommand {
    /// List scenario files with their length, agents and map size.
    List {
        /// Files or folders.
        #[arg(default_value = "scenarios/base", value_parser = shipped::parser(), value_hint = ValueHint::AnyPath)]
        paths: Vec<PathBuf>,
    },
    /// Describe one scenario.
    Show {
        /// The file.
        #[arg(value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
        path: PathBuf,
    },
    /// Generate scenarios of a family from seeds.
    Generate {
        /// The family, or `all`.
        #[arg(long, default_value = "all")]
        family: String,
        /// The first seed.
        #[arg(long, default_value_t = 0)]
        seed: u64,
        /// How many in all; with `all` the families take turns.
        #[arg(long, default_value_t = 10)]
        count: u32,
        /// Where the files go.
        #[arg(long, short, default_value = "out/generated", value_hint = ValueHint::DirPath)]
        out: PathBuf,
    },
    /// Make variants in which another vehicle collides with the logged ego.
    Adverse(AdverseArgs),
}

/// Arguments of `view`.
#[derive(Debug, Args)]
pub(crate) struct ViewArgs {
    /// A recording (.mcap, or with --partial .mcap.partial of a drive that was killed).
    #[arg(value_hint = ValueHint::FilePath, required_unless_present = "live", conflicts_with = "live")]
    pub recording: Option<PathBuf>,
    /// Show a drive of a running fleet while it goes on: the episode, or a part of its name; the first one without.
    #[arg(long, value_name = "EPISODE", num_args = 0..=1, require_equals = true, default_missing_value = "")]
    pub live: Option<String>,
    /// The fleet, for --live.
    #[command(flatten)]
    pub fleet: OnlookerArgs,
    /// Take what is there of a damaged or incomplete recording; the answer says so.
    #[arg(long)]
    pub partial: bool,
    /// Write an .rrd file instead of opening a viewer.
    #[arg(long, value_hint = ValueHint::FilePath)]
    pub save: Option<PathBuf>,
    /// Send to a running viewer.
    #[arg(long, value_name = "URL")]
    pub connect: Option<String>,
}

/// Arguments of `replay`.
#[derive(Debug, Args)]
pub(crate) struct ReplayArgs {
    /// A recording.
    #[arg(value_hint = ValueHint::FilePath)]
    pub recording: PathBuf,
    /// Take what is there of a damaged or incomplete recording; the answer says so.
    #[arg(long)]
    pub partial: bool,
    /// The service to run: sim-server, layout-render, vdm-worker or policy-bridge.
    #[arg(long, value_parser = ["sim-server", "layout-render", "vdm-worker", "policy-bridge"])]
    pub service: String,
    /// What makes frames and plans.
    #[command(flatten)]
    pub networks: Networks,
    /// Manifests of policies of one's own, one of which made the recording.
    #[arg(long = "policy", value_name = "FILE.toml", value_hint = ValueHint::FilePath)]
    pub manifests: Vec<PathBuf>,
    /// Start from the committed cache or snapshot of this iteration instead of from the beginning.
    #[arg(long, default_value_t = 0)]
    pub from_iteration: u32,
}

/// Arguments of `bench`.
#[derive(Debug, Args)]
pub(crate) struct BenchArgs {
    /// Scenario files to measure on.
    #[arg(default_value = "scenarios/base", value_parser = shipped::parser(), value_hint = ValueHint::AnyPath)]
    pub scenarios: Vec<PathBuf>,
    /// Configuration of the video model.
    #[arg(long, default_value = "configs/models/cpu_train.toml", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub model: PathBuf,
}
