//! The command line: every command, flag, default and example; parsing only.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueHint};
use ds_import::Format;
use ds_policy::Learned;
use ds_process::onlooker::OnlookerArgs;
use ds_process::shipped;
use ds_topic::{ObservationSource, ProposalScorer, ScoreProfile};
use ds_video::Backend;
use ds_world::{AgentMode, LayoutBackend, TrackerKind};

mod adverse;
mod benchmark;
mod data;
mod fleet;
mod gap;
mod measure;
mod policy;
mod results;
mod run_plan;
mod study;
mod video;

pub(crate) use adverse::{AdverseArgs, Arm};
pub(crate) use benchmark::{
    BaseArgs, BehaviorArgs, BenchmarkArgs, BenchmarkCommand, BuildCommand, CellArgs, Kept, ReviewArgs, RunArgs,
    ScaleArgs,
};
pub(crate) use data::{DataCommand, DataListArgs, DataRenderArgs, DataSheetArgs};
pub(crate) use fleet::{CertsArgs, HealthArgs, ServeArgs, SubmitArgs, TopArgs, WhyArgs};
pub(crate) use gap::{
    ApplyArgs, AttributeArgs, BaselineArgs, CloseArgs, DiagnoseArgs, EvaluateArgs, ExplainArgs, FleetArgs, GapCommand,
    GapImportArgs, GapScoreArgs, NextArgs, WatchArgs,
};
pub(crate) use measure::MeasureArgs;
pub(crate) use policy::PolicyCommand;
pub(crate) use results::{CompareArgs, MergeArgs, ReportArgs, ScoreArgs};
pub(crate) use run_plan::Align;
pub(crate) use study::{StudyArgs, StudyCommand};
pub(crate) use video::{FirstFrameArgs, VideoCommand, VideoEvalArgs};

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
    #[command(subcommand)]
    Data(DataCommand),
    /// Train the video model or the camera policy.
    Train(TrainArgs),
    /// Measure how good the frames of video models are.
    #[command(subcommand)]
    Video(VideoCommand),
    /// Measure observation sources over held-out scenarios, for policies.
    #[command(subcommand)]
    Study(StudyCommand),
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

/// What to drive, with which world, policy and observation, on which fleet, and where the results go: what `run` is told,
/// and what `gap close` and `gap attribute` plan.
#[derive(Debug, Clone, PartialEq, Args)]
pub(crate) struct RunPlan {
    /// Scenario files, or folders of them.
    #[arg(required = true, value_parser = shipped::parser(), value_hint = ValueHint::AnyPath)]
    pub scenarios: Vec<PathBuf>,
    /// The policy under test: camera, diffusiondrive, drivor, ltf, constant-velocity or lattice; privileged, as references:
    /// log-replay, route-follower, idm, careful or expert; an ONNX network by its manifest, such as mine.toml; or the name of
    /// an external policy, which connects at --policy-listen.
    #[arg(long, default_value = "camera")]
    pub policy: String,
    /// What makes the frames that the policy sees: dreamstream, the video model; reference, a rich renderer in place of a
    /// real camera; sim-rgb, a plain game-engine look; layout, the condition image; per-frame, dreamstream-clean-cache,
    /// dreamstream-no-layout and dreamstream-no-guidance, the video model with a part taken away; logged, the log's frames
    /// whatever the ego does; reprojected, the same half a second old and warped to where the ego is; abroad, a second
    /// world's camera. docs/observation-sources.md says what each is.
    #[arg(
        long,
        default_value = "dreamstream",
        value_parser = named(ObservationSource::ALL.map(ObservationSource::name), ObservationSource::from_name)
    )]
    pub observation: ObservationSource,
    /// Ticks executed of each plan (Δr).
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub replan: u32,
    /// Length of a plan, in seconds (H).
    #[arg(long, default_value_t = 8.0, value_name = "SECONDS")]
    pub horizon: f64,
    /// Frames that the policy sees (K).
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub history: u32,
    /// Who ranks the policy's proposals: the policy itself, or an oracle that rolls each out in a copy of the world.
    #[arg(long, default_value = "learned", value_parser = named(["learned", "oracle"], ProposalScorer::from_name))]
    pub scorer: ProposalScorer,
    /// How the oracle rolls out: with agents that react to each proposal, or in NAVSIM's open-loop form.
    #[arg(long, default_value = "reacting", value_parser = named(["reacting", "navsim"], oracle))]
    pub oracle: ProposalScorer,
    /// Definition of the driving score: as the public benchmark computes it, or as its definition means it.
    #[arg(long, default_value = "bridgesim", value_parser = named(ScoreProfile::ALL.map(ScoreProfile::name), ScoreProfile::from_name))]
    pub profile: ScoreProfile,
    /// Refuse policies that see more than frames, so that results can be compared.
    #[arg(long)]
    pub benchmark: bool,
    /// What to do where the replan period is no multiple of the video model's chunk.
    #[arg(long, value_enum, default_value = "rollback")]
    pub align: Align,
    /// How much of each scenario to drive, in seconds; 0 for all.
    #[arg(long, default_value_t = 8.0, value_name = "SECONDS")]
    pub duration: f64,
    /// Iterations driven by the log before the policy takes over.
    #[arg(long, default_value_t = 0)]
    pub warm_up: u32,
    /// Seed of all draws; give several to drive each scenario several times.
    #[arg(long, default_values_t = [0])]
    pub seed: Vec<u64>,
    /// Look of the reference camera that gives the first frame: `day`, `seed-N`, or a condition by any of lighting
    /// (day, sunrise, sunset, twilight, golden_hour, blue_hour, night), weather (clear, overcast, snow, rain, fog) and
    /// surface (dry, snow_covered, sand_covered, puddles): `snow`, `rain-night`, `lighting=sunset,surface=puddles`;
    /// a number behind it (`snow-7`, `lighting=night,seed=7`) draws another one.
    #[arg(long, default_value = "day")]
    pub appearance: String,
    /// What the video model is told in words; without it the template's words on look and scenario, as in training.
    #[arg(long, value_name = "TEXT")]
    pub prompt: Option<String>,
    /// A PNG or JPEG that the video model starts from, such as the log's own picture, in place of the reference camera's
    /// frame: of the camera's size or larger; borders beyond the camera's aspect ratio are cut off. For the only camera
    /// or that named `front`; may be given for several.
    #[arg(long = "first-frame", value_name = "[CAMERA=]FILE")]
    pub first_frames: Vec<String>,
    /// Which agents react.
    #[arg(long, default_value = "idm-behind-ego", value_parser = agents())]
    pub agents: AgentMode,
    /// Tracker of the planned trajectory.
    #[arg(long, default_value = "lqr", value_parser = named(TrackerKind::ALL.map(TrackerKind::name), TrackerKind::from_name))]
    pub tracker: TrackerKind,
    /// Layout back end.
    #[arg(
        long,
        default_value = "cpu",
        value_parser = named(LayoutBackend::ALL.map(LayoutBackend::name), LayoutBackend::from_name)
    )]
    pub layout_backend: LayoutBackend,
    /// Configuration of the video model; its weights lie beside it as .safetensors.
    #[arg(long, default_value = "configs/models/cpu_train.toml", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub model: PathBuf,
    /// What computes the video model: cpu, the fast path of this project, or framework, the machine-learning framework's
    /// graph, several times slower and equal to 1e-4, or that graph on a graphics processor, in builds with that feature; a
    /// replay needs the one that the recording was made with.
    #[arg(long, default_value = "cpu", value_parser = backend(&Backend::ALL))]
    pub video_backend: Backend,
    /// Weights of the camera policy; a policy of the panel has panel/NAME.safetensors beside it, or a file of its name.
    #[arg(long, default_value = "configs/models/camera_policy.safetensors", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub policy_weights: PathBuf,
    /// Start the five services as processes of their own over Zenoh on loopback.
    #[arg(long)]
    pub processes: bool,
    /// A program of any language that takes a stage's place on the bus: sim, layout, video or policy, then the command.
    /// It learns where to join from the environment; may be given for several stages. Implies --processes.
    #[arg(long = "stage", value_name = "ROLE=COMMAND")]
    pub stages: Vec<String>,
    /// Video workers to start, and episodes to drive at a time: as many as cores serve; one for external policies and devices.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub workers: Option<u32>,
    /// Where an external policy connects to, such as tcp/127.0.0.1:7447; its name is given by --policy.
    #[arg(long, value_name = "ENDPOINT")]
    pub policy_listen: Option<String>,
    /// Give the external policy the time of the wall clock for each plan, and drive no faster: for hardware in the loop. Who is
    /// late is not waited for; see docs/wall-clock.md. Results depend on the machine and are never mixed with others.
    #[arg(long, conflicts_with_all = ["benchmark", "seal"])]
    pub wall_clock: bool,
    /// Only the scenarios whose index modulo N is I, written I/N: for job arrays.
    #[arg(long, value_name = "I/N")]
    pub shard: Option<String>,
    /// Where results, recordings and pictures go. One run at a time holds the folder; results of an earlier one are moved to
    /// OUT/earlier/1, 2 and so on.
    #[arg(long, short, default_value = "out/run", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
    /// Go on with an interrupted run in --out: finished episodes stay finished.
    #[arg(long)]
    pub resume: bool,
    /// Delete the results of an earlier run in --out instead of moving them aside.
    #[arg(long, conflicts_with = "resume")]
    pub overwrite: bool,
    /// Show the drives in a running rerun viewer while they go on.
    #[arg(long, value_name = "URL", num_args = 0..=1, require_equals = true, default_missing_value = "")]
    pub live: Option<String>,
    /// Make no pictures; else each drive's are made as it ends, beside those that go on.
    #[arg(long)]
    pub no_pictures: bool,
    /// Effects of the world beyond the nominal one, and other settings of a run, as `gap apply` writes them.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub config: Option<PathBuf>,
    /// An effect of the world, such as steer_delay=0.15; may be given several times. `gap effects` lists them.
    #[arg(long = "effect", value_name = "ID=VALUE")]
    pub effects: Vec<String>,
    /// Give the world a law that no effect is, such as "steering: 0.02*delta*abs(ay)": a signal added at a port of the loop, see
    /// docs/gap-discover.md. May be repeated.
    #[arg(long = "law", value_name = "PORT: TERMS", conflicts_with = "seal")]
    pub laws: Vec<String>,
    /// Write the log that a real vehicle would have made of each drive to OUT/real.
    #[arg(long)]
    pub vehicle_log: bool,
    /// Drive in a world with withheld effects: draws them, writes the answer encrypted to FILE (its key to FILE.key),
    /// keeps of the drives only what a real vehicle logs.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["config", "effects", "resume"], value_hint = ValueHint::FilePath)]
    pub seal: Option<PathBuf>,
    /// Answer Prometheus at this address of loopback, such as 127.0.0.1:9464, while the drives go on; with --processes the
    /// orchestrator does. See docs/metrics.md.
    #[arg(long, value_name = "ADDRESS")]
    pub metrics: Option<SocketAddr>,
    /// Test aid: draw the withheld effects by this seed.
    #[arg(long, hide = true, requires = "seal")]
    pub seal_seed: Option<u64>,
    /// Test aid: drop this share of all pushes on the bus (0 to 1).
    #[arg(long, default_value_t = 0.0, hide = true)]
    pub drop_pushes: f64,
}

const IMPORT_HELP: &str = "Formats:
  scenarionet   pickles of ScenarioNet and MetaDrive (*.pkl); nothing in them is executed
  argoverse2    folders of Argoverse 2: sensor logs (city_SE3_egovehicle, annotations, calibration) and scenarios of
                motion forecasting (scenario*), each with log_map_archive*.json; tables as .feather or .csv, parquet
                after conversion to .csv
  openscene     folders of OpenScene and NAVSIM (navsim_logs/**/*.pkl) with nuPlan's maps
                (LOCATION/VERSION/map.gpkg) in --maps, or in a folder maps or nuplan-maps-v1.0 in or above them;
                without the map of a drive its layouts show no road, which is said

Examples:
  dreamstream import scenarionet my_logs/ -o out/imported
  dreamstream import argoverse2 sensor/val/02678d04-cc9f-3148-9f95-1ba66347dff9 -o out/imported
  dreamstream import openscene navsim/dataset --maps navsim/dataset/maps -o out/imported
  dreamstream run out/imported";

fn formats() -> impl TypedValueParser<Value = Format> {
    named(Format::ALL.map(Format::name), |name| Format::ALL.into_iter().find(|format| format.name() == name))
}

fn agents() -> impl TypedValueParser<Value = AgentMode> {
    let told = AgentMode::ALL.map(|mode| {
        PossibleValue::new(mode.name()).help(match mode {
            AgentMode::LogReplay => "All follow their log",
            AgentMode::IdmBehindEgo => "Those behind the ego drive by IDM",
            AgentMode::IdmAll => "All with a route drive by IDM",
            AgentMode::Interactive => {
                "The same; they change lanes, yield by right of way, and people on foot walk by themselves"
            }
        })
    });
    named(told, AgentMode::from_name)
}

/// Parses a choice by its name.
fn named<T: Clone + Send + Sync + 'static>(
    names: impl Into<PossibleValuesParser>,
    from_name: fn(&str) -> Option<T>,
) -> impl TypedValueParser<Value = T> {
    names.into().map(move |name| from_name(&name).expect("a possible value"))
}

/// Parses one of some back ends of the video model by its name.
fn backend(some: &[Backend]) -> impl TypedValueParser<Value = Backend> {
    named(some.iter().map(|backend| backend.name()).collect::<Vec<_>>(), |name| name.parse().ok())
}

/// Returns the oracle that rolls out in the named way.
fn oracle(way: &str) -> Option<ProposalScorer> {
    match way {
        "reacting" => Some(ProposalScorer::Oracle),
        "navsim" => Some(ProposalScorer::OracleNavsim),
        _ => None,
    }
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

/// Arguments of `train`.
#[derive(Debug, Args)]
pub(crate) struct TrainArgs {
    /// The stage, or all that the recipe describes, in this order: autoencoder; prior (all looks, no layout); teacher
    /// (follows layouts, sees whole clips); trajectories (what the teacher makes under guidance); ode (the causal
    /// student learns from them); self-forcing (the student learns from its own rollouts); decoder (guided by
    /// layouts); ship (writes the weights). Apart from these: policy, a driving policy (--kind); plan, what the recipe costs and
    /// how far it is; unpack, which takes a shipped file apart so that a recipe can go on from it.
    #[arg(value_parser = [
        "all", "autoencoder", "prior", "teacher", "trajectories", "ode", "self-forcing", "decoder", "ship", "policy", "plan",
        "unpack",
    ])]
    pub stage: String,
    /// The recipe: configs/train/cpu_train.toml for the video model, configs/train/policy.toml for the policy.
    #[arg(long, value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub config: Option<PathBuf>,
    /// Where `ship` writes (else beside the model's configuration), what `unpack` takes apart, what `policy` measures.
    #[arg(long, value_hint = ValueHint::FilePath)]
    pub weights: Option<PathBuf>,
    /// Whose transformer `ship` writes, instead of the most refined student's, or `unpack` finds; `autoencoder` for that
    /// alone, without a transformer.
    #[arg(long, value_parser = ["autoencoder", "prior", "teacher", "ode", "self_forcing"])]
    pub of: Option<String>,
    /// What computes, instead of the recipe's `backend`; of vulkan and cuda, builds with that feature.
    #[arg(long, value_parser = backend(&Backend::ALL))]
    pub backend: Option<Backend>,
    /// Also write training.rrd, losses and samples for the rerun viewer, beside the page.
    #[arg(long)]
    pub rerun: bool,
    /// Which policy `policy` trains.
    #[arg(long, default_value = "camera", value_parser = named(Learned::ALL.map(Learned::name), Learned::of))]
    pub kind: Learned,
    /// Work folder of the policy's training; the video model's is named by its recipe. Training there is resumed.
    #[arg(long, short, default_value = "training", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
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
    /// Configuration of the video model.
    #[arg(long, default_value = "configs/models/cpu_train.toml", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub model: PathBuf,
    /// What computes the video model: the one that the recording was made with, cpu, framework, vulkan or cuda.
    #[arg(long, default_value = "cpu", value_parser = backend(&Backend::ALL))]
    pub video_backend: Backend,
    /// Weights of the camera policy; a policy of the panel has panel/NAME.safetensors beside it, or a file of its name.
    #[arg(long, default_value = "configs/models/camera_policy.safetensors", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub policy_weights: PathBuf,
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
