//! Arguments of the gap diagnosis.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueHint};

use ds_cases::fleet::By;
use ds_launch::choice::named;
use ds_process::onlooker::OnlookerArgs;
use ds_process::shipped;
use ds_topic::ObservationSource;

/// Commands of `gap`.
#[derive(Debug, Subcommand)]
pub enum GapCommand {
    /// Diagnose cases: folders with meta.json and logs, or folders of such folders.
    Diagnose(DiagnoseArgs),
    /// Diagnose cases and look for a law where no effect of the library explains them: at which point of the loop a signal is
    /// added, and which (docs/gap-discover.md). `gap diagnose` does so by itself where its verdict is unknown.
    Discover(DiagnoseArgs),
    /// Learn from healthy logs of a vehicle what its nominal simulator gets wrong without any fault.
    Baseline(BaselineArgs),
    /// Say which vehicles of a fleet differ from the others, by which effect, and how common each effect is: nobody has to
    /// know which are healthy.
    Fleet(FleetArgs),
    /// Design the run to drive next: the manoeuvre whose log would tell most of the effects apart that a diagnosis leaves open,
    /// within an envelope; with --run drive it in a simulator that stands for reality, until one effect is sure.
    Next(NextArgs),
    /// Measure on drives that a diagnosis never saw how far the gap shrinks with the effects added.
    Evaluate(EvaluateArgs),
    /// Check any CSV logs by a mapping file, say what looks wrong with them, and make a case of them.
    Import(GapImportArgs),
    /// Draw a diagnosis as one page to look at, and print it as text.
    Explain(ExplainArgs),
    /// Write the effects that were found as the configuration of a run: with it, `run` is the corrected simulator.
    Apply(ApplyArgs),
    /// Diagnose the vehicle logs of a run, drive held-out scenarios again without and with what was found, compare with
    /// the logged drives.
    Close(CloseArgs),
    /// Split a policy's loss of score between the nominal and the real world over frames, dynamics, agents and transport.
    Attribute(AttributeArgs),
    /// Watch a vehicle: recorded cases against a baseline for alarms, so many false ones an hour; or a drive of a running
    /// fleet with a vehicle log while it goes on, diagnosed in a sliding window (with a baseline: from an alarm on), on the bus.
    Watch(WatchArgs),
    /// Serve the built-in car of a case as a simulator, on standard input and output.
    Serve {
        /// The case's folder.
        #[arg(value_hint = ValueHint::DirPath)]
        case: PathBuf,
        /// Declare no parameters, so that all goes through the ports.
        #[arg(long)]
        ports_only: bool,
    },
    /// Say which effects share a signature whatever the data, for a set of recorded channels.
    Isolability {
        /// The channels, such as v,yaw_rate,ax; all without.
        #[arg(long, value_delimiter = ',')]
        channels: Vec<String>,
    },
    /// Compare diagnoses with labels.
    Score(GapScoreArgs),
    /// List the effects that can be switched on and diagnosed.
    Effects,
    /// Print the withheld effects of a sealed run.
    Unseal {
        /// The sealed answer; its key lies beside it as .key.
        #[arg(value_hint = ValueHint::FilePath)]
        answer: PathBuf,
    },
}

/// Arguments of `gap diagnose`.
#[derive(Debug, Args)]
pub struct DiagnoseArgs {
    /// Case folders: tables of logs, or the vehicle logs of runs (OUT/real).
    #[arg(required = true, value_hint = ValueHint::DirPath)]
    pub cases: Vec<PathBuf>,
    /// Fast pass and single fits only: seconds instead of half a minute a case.
    #[arg(long)]
    pub quick: bool,
    /// Scenario files or folders that the vehicle logs were driven in: other road users and the map are diagnosed too, as
    /// `CASE-traffic`.
    #[arg(long, value_parser = shipped::parser(), value_hint = ValueHint::AnyPath)]
    pub scenes: Vec<PathBuf>,
    /// A run of the nominal simulator on the same scenarios, with vehicle logs: its camera frames are compared with those
    /// of the logs wherever both cars are in the same place, as a case of its own.
    #[arg(long, value_name = "RUN", value_hint = ValueHint::DirPath)]
    pub nominal: Option<PathBuf>,
    /// Folder of effect-free pairs of frame streams: what the generator does by itself, for streams
    /// that do not agree pixel by pixel.
    #[arg(long, value_hint = ValueHint::DirPath)]
    pub nuisance: Option<PathBuf>,
    /// Policies that look at frames.
    #[command(flatten)]
    pub panel: PanelArgs,
    /// What healthy drives of the vehicle say: a file of `gap baseline`, or a case of such drives, with which the others are
    /// compared.
    #[arg(long, value_name = "FILE|CASE", value_hint = ValueHint::AnyPath)]
    pub baseline: Option<PathBuf>,
    /// Logs of a vehicle: a command that serves the nominal simulator, instead of the built-in car, or an FMU; `{case}` in it
    /// is the case's folder, see docs/simulators.md and docs/fmu.md.
    #[arg(long, value_name = "COMMAND")]
    pub simulator: Option<String>,
    /// Effects to leave out of the library, to see what is said without them.
    #[arg(long, value_name = "EFFECT", value_delimiter = ',')]
    pub without: Vec<String>,
    /// Keep the diagnoses of an earlier call into this folder whose case, options and program are the same.
    #[arg(long)]
    pub resume: bool,
    /// Draw no pages.
    #[arg(long)]
    pub no_pages: bool,
    /// Where `CASE/diagnosis.json`, `CASE/report.html` and `index.html` go.
    #[arg(long, short, default_value = "out/gap", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
}

/// Policies that look at the frames of a case.
#[derive(Debug, Args)]
pub struct PanelArgs {
    /// Frames: how near the simulated ones are to the real ones for this policy, before and after; camera, one of the panel,
    /// or the manifest of a network that names its feature. Several are told apart by commas.
    #[arg(long, value_name = "POLICY", value_delimiter = ',')]
    pub policy: Vec<String>,
    /// Weights of the camera policy; those of the panel lie in `panel` beside them.
    #[arg(long, default_value = "configs/models/camera_policy.safetensors", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub policy_weights: PathBuf,
}

/// Arguments of `gap baseline`.
#[derive(Debug, Args)]
pub struct BaselineArgs {
    /// Cases of healthy drives of one vehicle, or vehicle logs of runs (OUT/real), on several days if possible; folders of cases
    /// are opened. Three hold the rate of false alarms, ten see small effects too.
    #[arg(required = true, value_hint = ValueHint::DirPath)]
    pub healthy: Vec<PathBuf>,
    /// A command that serves the nominal simulator, instead of the built-in car, as for `gap diagnose`.
    #[arg(long, value_name = "COMMAND")]
    pub simulator: Option<String>,
    /// Where the baseline goes, for `gap diagnose --baseline`.
    #[arg(long, short, default_value = "out/baseline.json", value_hint = ValueHint::FilePath)]
    pub out: PathBuf,
}

/// Arguments of `gap fleet`.
#[derive(Debug, Args)]
pub struct FleetArgs {
    /// Cases of at least four members; folders of cases are opened.
    #[arg(required = true, value_hint = ValueHint::DirPath)]
    pub cases: Vec<PathBuf>,
    /// What a member is: a vehicle, a day of drives or a version of the software, by the field of that name in meta.json.
    #[arg(long, default_value = "vehicle", value_parser = named(By::ALL.map(By::field), By::from_field))]
    pub by: By,
    /// Fast pass and single fits only.
    #[arg(long)]
    pub quick: bool,
    /// Where `fleet.json`, `fleet.html`, `CASE/diagnosis.json` and `CASE/report.html` go.
    #[arg(long, short, default_value = "out/fleet", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
}

/// Arguments of `gap next`.
#[derive(Debug, Args)]
pub struct NextArgs {
    /// Case folders with logs of a vehicle; folders of cases are opened.
    #[arg(required = true, value_hint = ValueHint::DirPath)]
    pub cases: Vec<PathBuf>,
    /// What healthy drives of the vehicle say: a file of `gap baseline`, or a case of such drives.
    #[arg(long, value_name = "FILE|CASE", value_hint = ValueHint::AnyPath)]
    pub baseline: Option<PathBuf>,
    /// Limits of accelerations, speed, tyres and place, as TOML (docs/gap-next.md); the built-in ones without.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub envelope: Option<PathBuf>,
    /// Drive it, add its log to a copy of the case, diagnose again, and so on: at most five runs.
    #[arg(long)]
    pub run: bool,
    /// With --run: an effect of the car that stands for reality, beside the mismatch that every car has.
    #[arg(long, value_name = "ID=VALUE", requires = "run")]
    pub effect: Vec<String>,
    /// With --run: its effects and its mismatch as a configuration of a run; the usual mismatch is then left out.
    #[arg(long, value_name = "FILE", requires = "run", value_hint = ValueHint::FilePath)]
    pub config: Option<PathBuf>,
    /// With --run: a command that serves the car that stands for reality, see docs/simulators.md; `{case}` in it is the case's
    /// folder. Actuators and sensors stay the built-in ones.
    #[arg(long, value_name = "COMMAND", requires = "run")]
    pub simulator: Option<String>,
    /// Fast pass and single fits only.
    #[arg(long)]
    pub quick: bool,
    /// Seed of the search, of the draws of the envelope and of the noise of runs.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Where `CASE/next.json`, `CASE/next.html` and `CASE/commands.csv` go, with --run the grown case as `CASE/case`.
    #[arg(long, short, default_value = "out/next", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
}

/// Arguments of `gap evaluate`.
#[derive(Debug, Args)]
pub struct EvaluateArgs {
    /// A diagnosis.json.
    #[arg(value_hint = ValueHint::FilePath)]
    pub diagnosis: PathBuf,
    /// The folder of the case with the drives to measure on.
    #[arg(value_hint = ValueHint::DirPath)]
    pub case: PathBuf,
    /// Numbers of the drives; all of them without.
    #[arg(long, value_delimiter = ',')]
    pub drives: Vec<usize>,
    /// Numbers of the frames, first to last; all of them without.
    #[arg(long, value_name = "FIRST-LAST", conflicts_with = "drives")]
    pub frames: Option<String>,
    /// Logs of a vehicle: the command that the diagnosis was made with; it is run on the drives without and with what was found.
    #[arg(long, value_name = "COMMAND", conflicts_with = "frames")]
    pub simulator: Option<String>,
    /// Policies that look at frames.
    #[command(flatten)]
    pub panel: PanelArgs,
    /// Where the figures go as JSON.
    #[arg(long, short, value_hint = ValueHint::FilePath)]
    pub out: Option<PathBuf>,
}

/// Arguments of `gap score`.
#[derive(Debug, Args)]
pub struct GapScoreArgs {
    /// The folder with `CASE/diagnosis.json`.
    #[arg(value_hint = ValueHint::DirPath)]
    pub diagnoses: PathBuf,
    /// The labels; `labels.json` in the folder without.
    #[arg(long, value_hint = ValueHint::FilePath)]
    pub labels: Option<PathBuf>,
    /// Labels of cases of other engines: how often what occurs there is the constant beside which probabilities have skill.
    #[arg(long, value_name = "LABELS", num_args = 1.., value_hint = ValueHint::FilePath)]
    pub others: Vec<PathBuf>,
    /// The folder of the cases with their twins without effects (`WORLD/without`): says how well diagnoses tell where the
    /// gap lies.
    #[arg(long, value_name = "WORLD", value_hint = ValueHint::DirPath)]
    pub twins: Option<PathBuf>,
}

/// Arguments of `gap import`.
#[derive(Debug, Args)]
pub struct GapImportArgs {
    /// The mapping: which column or field is which channel, in which unit, frame and sign; see docs/gap-real-logs.md.
    #[arg(value_parser = shipped::parser(), value_hint = ValueHint::FilePath, required_unless_present = "suggest")]
    pub mapping: Option<PathBuf>,
    /// The folder of the logs that the mapping lists; that of the mapping without. Or log files of the same layout: each
    /// becomes a case of its own name below --out, whether the mapping lists it or not.
    #[arg(value_hint = ValueHint::AnyPath)]
    pub logs: Vec<PathBuf>,
    /// Where the case goes, or the cases of several logs; without, the logs are only checked. With --suggest the file of
    /// the proposed mapping.
    #[arg(long, short, value_hint = ValueHint::AnyPath)]
    pub out: Option<PathBuf>,
    /// Propose a mapping for this bag (MCAP, ROS 1 or rosbag2) by its topics, or for this text file by its columns and data.
    #[arg(long, value_name = "LOG", value_hint = ValueHint::AnyPath, conflicts_with_all = ["mapping", "logs"])]
    pub suggest: Option<PathBuf>,
}

/// Arguments of `gap explain`.
#[derive(Debug, Args)]
pub struct ExplainArgs {
    /// A diagnosis.json, or a folder of diagnoses as `gap diagnose` writes it.
    #[arg(default_value = "out/gap", value_hint = ValueHint::AnyPath)]
    pub diagnosis: PathBuf,
    /// The case that it was made from: adds residuals over time, the road and example pictures. Without, the one that
    /// `gap diagnose` noted.
    #[arg(long, value_hint = ValueHint::DirPath)]
    pub case: Option<PathBuf>,
    /// Where the page goes; beside the diagnosis without.
    #[arg(long, short, value_hint = ValueHint::FilePath)]
    pub out: Option<PathBuf>,
    /// Write residuals over time, the road coloured by the gap and the effects for the rerun viewer as well.
    #[arg(long, value_name = "FILE.rrd", value_hint = ValueHint::FilePath)]
    pub rerun: Option<PathBuf>,
}

/// Arguments of `gap apply`.
#[derive(Debug, Args)]
pub struct ApplyArgs {
    /// A diagnosis.json; several, such as that of a car and that of its camera, are put together.
    #[arg(required = true, value_hint = ValueHint::FilePath)]
    pub diagnoses: Vec<PathBuf>,
    /// Leave the ordinary mismatch out that was measured with the effects.
    #[arg(long)]
    pub effects_only: bool,
    /// Where the configuration goes.
    #[arg(long, short, default_value = "corrected.toml", value_hint = ValueHint::FilePath)]
    pub out: PathBuf,
}

/// Arguments of `gap close`.
#[derive(Debug, Args)]
pub struct CloseArgs {
    /// A run in the real world: its folder, with vehicle logs in real/.
    #[arg(value_hint = ValueHint::DirPath)]
    pub real: PathBuf,
    /// Scenarios of that run to keep from the fit and to drive again.
    #[arg(required = true, value_parser = shipped::parser(), value_hint = ValueHint::AnyPath)]
    pub scenarios: Vec<PathBuf>,
    /// The policy that drove.
    #[arg(long, default_value = "camera")]
    pub policy: String,
    /// What made the frames.
    #[arg(long, default_value = "reference", value_parser = named(ObservationSource::ALL.map(ObservationSource::name), ObservationSource::from_name))]
    pub observation: ObservationSource,
    /// How much of each scenario was driven, in seconds; 0 for all.
    #[arg(long, default_value_t = 8.0, value_name = "SECONDS")]
    pub duration: f64,
    /// Fast pass and single fits only.
    #[arg(long)]
    pub quick: bool,
    /// Where diagnosis, configuration, runs and comparison go.
    #[arg(long, short, default_value = "out/close", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
}

/// Arguments of `gap attribute`.
#[derive(Debug, Args)]
pub struct AttributeArgs {
    /// Scenario files, or folders of them.
    #[arg(required = true, value_parser = shipped::parser(), value_hint = ValueHint::AnyPath)]
    pub scenarios: Vec<PathBuf>,
    /// The real world: a run configuration with its effects.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub config: PathBuf,
    /// The policies.
    #[arg(long, value_delimiter = ',', default_value = "camera")]
    pub policy: Vec<String>,
    /// What makes the frames of the real world.
    #[arg(long, default_value = "reference", value_parser = named(ObservationSource::ALL.map(ObservationSource::name), ObservationSource::from_name))]
    pub real_frames: ObservationSource,
    /// What makes the frames of the nominal world.
    #[arg(long, default_value = "dreamstream", value_parser = named(ObservationSource::ALL.map(ObservationSource::name), ObservationSource::from_name))]
    pub nominal_frames: ObservationSource,
    /// How much of each scenario to drive, in seconds; 0 for all.
    #[arg(long, default_value_t = 8.0, value_name = "SECONDS")]
    pub duration: f64,
    /// Seeds; give several to drive each scenario several times.
    #[arg(long, default_values_t = [0])]
    pub seed: Vec<u64>,
    /// Go on with an interrupted attribution: cells that are finished are not driven again.
    #[arg(long)]
    pub resume: bool,
    /// Where runs and shares go.
    #[arg(long, short, default_value = "out/attribution", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
}

/// Arguments of `gap watch`.
#[derive(Debug, Args)]
pub struct WatchArgs {
    /// Case folders, watched one after another as logs of one vehicle; or the episode of a running fleet or a part of its
    /// name, the first one without.
    #[arg(value_name = "CASE|EPISODE", value_hint = ValueHint::DirPath)]
    pub watched: Vec<String>,
    /// What healthy drives of the vehicle leave: a file of `gap baseline`. Nothing is diagnosed before an alarm.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub baseline: Option<PathBuf>,
    /// False alarms allowed an hour of driving.
    #[arg(long, default_value_t = 1.0, value_name = "R", requires = "baseline")]
    pub alarms_per_hour: f64,
    /// A running fleet: drives to watch one after another, whose evidence adds up; one that is over before the one before was
    /// looked at is missed.
    #[arg(long, default_value_t = 1, value_name = "N", requires = "baseline")]
    pub drives: usize,
    /// Recorded cases: fast pass and single fits only at the first alarm.
    #[arg(long)]
    pub quick: bool,
    /// Recorded cases: alarms only, no diagnosis.
    #[arg(long)]
    pub alarms_only: bool,
    /// How much of the drive is looked at by one diagnosis, in seconds.
    #[arg(long, default_value_t = 20.0, value_name = "SECONDS")]
    pub window: f64,
    /// What counts as real: a vehicle log or recording (.mcap), or another drive of the fleet by a part of its name; the
    /// watched drive then stands for the nominal simulator. Without, the drive's own log against its nominal car.
    #[arg(long, value_name = "EPISODE|LOG.mcap", value_hint = ValueHint::FilePath)]
    pub reference: Option<String>,
    /// Send drive and diagnosis to a running rerun viewer; without URL to the one of this host.
    #[arg(long, value_name = "URL", num_args = 0..=1, default_missing_value = "")]
    pub connect: Option<String>,
    /// Simulated time between two diagnoses, in seconds.
    #[arg(long, default_value_t = 3.0, value_name = "SECONDS")]
    pub every: f64,
    /// The fleet.
    #[command(flatten)]
    pub fleet: OnlookerArgs,
    /// Where alarms and diagnosis of recorded cases go as JSON; of a drive that goes on, one line of JSON each.
    #[arg(long, short, value_hint = ValueHint::FilePath)]
    pub out: Option<PathBuf>,
}

impl WatchArgs {
    /// Returns the part of an episode's name that is wanted.
    pub fn episode(&self) -> &str {
        self.watched.first().map_or("", String::as_str)
    }
}
