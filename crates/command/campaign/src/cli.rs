//! Arguments of `benchmark`: sets, the drives of their cells on any number of machines, one result, its report.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum, ValueHint};
use ds_benchmark::Keep;
use ds_launch::Networks;
use ds_launch::choice::{agents, named};
use ds_process::shipped;
use ds_topic::{ObservationSource, ProposalScorer};
use ds_world::{AdversaryMode, AgentMode, TrackerKind};

use crate::cli::adverse::Arm;

pub mod adverse;

/// The most scenarios of the generator that are looked at for a set.
const MOST_CANDIDATES: i64 = 100_000;

const HELP: &str =
    "Exit codes: 0 every cell ended, failing policies included; 1 cells are left, go on with `resume`; 2 refused, \
trying again helps nothing; 64 wrong arguments; 130 interrupted.

Examples:
  dreamstream benchmark build base --out sets                           the set `town`: generated scenarios, filtered
  dreamstream benchmark build weather sets/town.set.json --out sets     its thirteen conditions
  dreamstream benchmark build behavior sets/town.set.json --out sets    variants with an adversary
  dreamstream benchmark review sets/town-behavior.set.json              see them from above; accept and reject
  dreamstream benchmark run sets/town.set.json --policy camera --policy lattice --shard 0/2 --out out/0
  dreamstream benchmark resume out/0                                    after a kill, a preemption, a full disk
  dreamstream benchmark merge out/0 out/1 -o out/all && dreamstream benchmark report out/all
  dreamstream benchmark scale --workers 1,2                             how frames/s grow with workers";

/// Arguments of `benchmark`.
#[derive(Debug, Args)]
#[command(after_help = HELP)]
pub struct BenchmarkArgs {
    /// What to do.
    #[command(subcommand)]
    pub command: BenchmarkCommand,
}

/// Commands of `benchmark`.
#[derive(Debug, Subcommand)]
pub enum BenchmarkCommand {
    /// Make a set of scenarios: its manifest says what is in it, under which licence, and what was left out why.
    #[command(subcommand)]
    Build(BuildCommand),
    /// Check manifests: digests, licences, and that every scenario is to be had and is the one that is meant.
    Check {
        /// Manifests (NAME.set.json).
        #[arg(required = true, value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
        manifests: Vec<PathBuf>,
    },
    /// Look at variants: a page with each encounter from above, and verdicts of people beside the manifest.
    Review(ReviewArgs),
    /// Say how many cells, frames and hours a benchmark has, and how much of it is left.
    Plan(PlanArgs),
    /// Drive the cells of one shard; each is written to OUT/cells.jsonl when it ends.
    Run(RunArgs),
    /// Go on with an interrupted run: ended cells stay ended, half-driven ones continue from their last commit.
    Resume {
        /// The folder of the run.
        #[arg(value_hint = ValueHint::DirPath)]
        out: PathBuf,
        /// Another part of the cells than before, written I/N, or `auto`.
        #[arg(long, value_name = "I/N|auto")]
        shard: Option<String>,
        /// Episodes at a time; as before without it.
        #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
        workers: Option<u32>,
        /// Skip cells that ended in these folders, and say how far all shards are, of which these are the others.
        #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath, num_args = 1..)]
        done: Vec<PathBuf>,
        /// Answer Prometheus at this address of loopback while the drives go on. See docs/metrics.md.
        #[arg(long, value_name = "ADDRESS")]
        metrics: Option<SocketAddr>,
    },
    /// Put the results of several runs into one, in any order; missing cells are listed.
    Merge {
        /// Folders of runs, or of merged runs.
        #[arg(required = true, value_hint = ValueHint::DirPath)]
        folders: Vec<PathBuf>,
        /// Merge results of other sets, versions, weights or settings too; the result is stamped mixed.
        #[arg(long)]
        force: bool,
        /// Where the result goes.
        #[arg(long, short, value_hint = ValueHint::DirPath)]
        out: PathBuf,
    },
    /// Put results into tables and a page, with intervals over scenarios and over logs.
    Report {
        /// The folder of a run or of merged runs; tables and page go there.
        #[arg(value_hint = ValueHint::DirPath)]
        folder: PathBuf,
        /// Results that others have published, which stand in a block of their own.
        #[arg(long, default_value = "configs/benchmark/published.toml", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
        published: PathBuf,
        /// Verdicts on variants, in files as `review` writes them, wherever they lie: beside those beside the manifests, or in
        /// the place of one of the same set and reviewer.
        #[arg(long, value_name = "FILE", num_args = 1.., value_hint = ValueHint::FilePath)]
        verdicts: Vec<PathBuf>,
        /// Runs that drove some of the cells again and kept recordings, from which the worst falls are animated too.
        #[arg(long, value_name = "DIR", num_args = 1.., value_hint = ValueHint::DirPath)]
        recordings: Vec<PathBuf>,
    },
    /// Measure how frames per second grow with video workers, and what the fleet around them costs.
    Scale(ScaleArgs),
}

/// Arguments of `benchmark plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// What to drive.
    #[command(flatten)]
    pub what: CellArgs,
    /// Frames a second that one machine makes, where nothing was driven by which to tell.
    #[arg(long, default_value_t = 105.0, value_parser = rate)]
    pub rate: f64,
    /// Machines, one shard each; as many as folders are named by --done without it, or 1.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub machines: Option<u32>,
    /// Folders of all shards, which may still be driven: say how many cells are left and how long they take at the rate of those that
    /// ended.
    #[arg(long, value_name = "DIR", num_args = 1.., value_hint = ValueHint::DirPath)]
    pub done: Vec<PathBuf>,
}

/// Arguments of `benchmark scale`.
#[derive(Debug, Args)]
#[command(
    after_help = "Every count of workers is driven on a fleet of its own, one process for each service and worker. \
Real and simulated rows never stand in one table. With simulated workers the generation of frames is taken out: what is \
left is what orchestrator, simulator and bus can serve.

Examples:
  dreamstream benchmark scale --workers 1,2
  dreamstream benchmark scale --workers 1,16,64 --simulated 0.5 --kill-every 60 --episodes 640"
)]
pub struct ScaleArgs {
    /// Scenario files, or folders of them.
    #[arg(default_values = ["scenarios/base"], value_parser = shipped::parser(), value_hint = ValueHint::AnyPath)]
    pub scenarios: Vec<PathBuf>,
    /// Counts of video workers, a row each; efficiency is against the first.
    #[arg(long, value_delimiter = ',', default_values_t = [1, 2], value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub workers: Vec<u32>,
    /// Workers generate nothing: they wait so long for each chunk and return a grey frame.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub simulated: Option<f64>,
    /// Kill a worker each so many seconds, where a row has several; it is started again, and nothing may be lost or
    /// different.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub kill_every: Option<f64>,
    /// Episodes of the row with the most workers, eight per worker without it; other rows drive as many per worker.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub episodes: Option<u32>,
    /// Length of a drive, in seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 8.0, value_parser = seconds)]
    pub duration: f64,
    /// The policy; it is not what is measured.
    #[arg(long, default_value = "constant-velocity")]
    pub policy: String,
    /// What makes frames and plans.
    #[command(flatten)]
    pub networks: Networks,
    /// Where table and page go; those of an earlier measurement are moved to OUT/earlier.
    #[arg(long, short, default_value = "out/scale", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
}

/// Reads a number of frames per second above 0.
fn rate(text: &str) -> Result<f64, String> {
    let rate = text.parse::<f64>().ok().filter(|rate| *rate > 0.0 && rate.is_finite());
    rate.ok_or_else(|| "not a number of frames per second above 0".to_owned())
}

/// Reads a length of time above 0.
fn seconds(text: &str) -> Result<f64, String> {
    let secs = text.parse::<f64>().ok().filter(|secs| *secs > 0.0 && *secs <= 86_400.0);
    secs.ok_or_else(|| "not a number of seconds above 0, at most 86400".to_owned())
}

/// Commands of `benchmark build`.
#[derive(Debug, Subcommand)]
pub enum BuildCommand {
    /// A base set: generated scenarios, or imported logs.
    Base(BaseArgs),
    /// A base set's variants with an adversary that an expert survives.
    Behavior(BehaviorArgs),
    /// The thirteen conditions of a base set.
    Weather {
        /// The manifest of the base set.
        #[arg(value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
        base: PathBuf,
        /// The set's name; `BASE-weather` without it.
        #[arg(long)]
        name: Option<String>,
        /// Only every so many-th scenario.
        #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
        every: u32,
        /// The folder that the manifest goes to.
        #[arg(long, short, default_value = "sets", value_hint = ValueHint::DirPath)]
        out: PathBuf,
    },
}

/// Arguments of `benchmark build base`.
#[derive(Debug, Args)]
pub struct BaseArgs {
    /// Scenario files, or folders of them, such as `import` writes; scenarios of the generator (`town`) without.
    #[arg(value_parser = shipped::parser(), value_hint = ValueHint::AnyPath)]
    pub scenarios: Vec<PathBuf>,
    /// The set's name; `town` or `logs` without it.
    #[arg(long)]
    pub name: Option<String>,
    /// Of `town`: how many scenarios to look at; the families take turns.
    #[arg(long, default_value_t = 320, conflicts_with = "scenarios", value_parser = clap::value_parser!(u32).range(1..=MOST_CANDIDATES))]
    pub candidates: u32,
    /// Of `town`: the first seed.
    #[arg(long, default_value_t = 20_000, conflicts_with = "scenarios", value_parser = clap::value_parser!(u64).range(..=u64::MAX - MOST_CANDIDATES as u64))]
    pub seed: u64,
    /// Of logs: take only the scenarios that this file names, one a line.
    #[arg(long, value_name = "FILE", requires = "scenarios", value_hint = ValueHint::FilePath)]
    pub names: Option<PathBuf>,
    /// Take all candidates: drive none of them to see which tell policies apart.
    #[arg(long)]
    pub unfiltered: bool,
    /// The policy that must solve what stays.
    #[arg(long, default_value = "log-replay", value_parser = ["log-replay", "route-follower"])]
    pub expert: String,
    /// Episodes at a time; as many as there are processors without it.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub workers: Option<u32>,
    /// The folder that the manifest goes to; the drives of the filter go to NAME.filter in it.
    #[arg(long, short, default_value = "sets", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
}

/// Arguments of `benchmark build behavior`.
#[derive(Debug, Args)]
pub struct BehaviorArgs {
    /// The manifest of the base set.
    #[arg(value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub base: PathBuf,
    /// The set's name; `BASE-behavior` without it. Further variants of a scenario go to NAME-extended.
    #[arg(long)]
    pub name: Option<String>,
    /// Seed of the search.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// What the adversaries do about an ego that leaves its log: replay, reactive or reactive-unshielded.
    #[arg(long, default_value = "reactive", value_parser = named(AdversaryMode::ALL.map(AdversaryMode::name), AdversaryMode::from_name))]
    pub mode: AdversaryMode,
    /// How adversaries are found: `own`, or `advbmt-default`, an arm for comparison with the collision states and the filter that
    /// Adv-BMT is released with, and mode replay; nobody has to solve it.
    #[arg(long, value_enum, default_value = "own")]
    pub arm: Arm,
    /// Only every so many-th scenario.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub every: u32,
    /// The folder that the manifests go to; scenarios and solutions go to NAME in it.
    #[arg(long, short, default_value = "sets", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
}

/// Arguments of `benchmark review`.
#[derive(Debug, Args)]
#[command(
    after_help = "Verdicts go to SET.REVIEWER.verdicts.json beside the manifest, under the digest of the adversary: a \
variant that is made anew is unreviewed again. Who is accepted by somebody and rejected by nobody is reported as a set of \
its own; with two reviewers `review`, `check` and `report` tell kappa.

Examples:
  dreamstream benchmark review sets/town-behavior.set.json
  dreamstream benchmark review sets/town-behavior.set.json --accept cut-in-1__rear-end --reject 'cut-in-2__rear-end=no road'"
)]
pub struct ReviewArgs {
    /// The manifest of a set of kind behavior.
    #[arg(value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub manifest: PathBuf,
    /// Variants that may stay.
    #[arg(long, value_name = "NAME", num_args = 1..)]
    pub accept: Vec<String>,
    /// Variants that may not, with the reason.
    #[arg(long, value_name = "NAME=REASON", num_args = 1..)]
    pub reject: Vec<String>,
    /// Who says so: letters, digits, - and _.
    #[arg(long, default_value = "reviewer", value_name = "WHO")]
    pub reviewer: String,
}

/// Which cells a benchmark has.
#[derive(Debug, Args)]
pub struct CellArgs {
    /// Manifests (NAME.set.json).
    #[arg(required = true, value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub manifests: Vec<PathBuf>,
    /// The policies, as `run` takes them; privileged ones are anchors in rows of their own.
    #[arg(long = "policy", required = true, num_args = 1..)]
    pub policies: Vec<String>,
    /// What makes the frames, as `run --observation` takes it.
    #[arg(
        long = "observation",
        default_values = ["dreamstream"],
        num_args = 1..,
        value_parser = named(ObservationSource::ALL.map(ObservationSource::name), ObservationSource::from_name)
    )]
    pub observations: Vec<ObservationSource>,
    /// Which agents react.
    #[arg(long = "agents", default_values = ["idm-all"], num_args = 1.., value_parser = agents())]
    pub agents: Vec<AgentMode>,
    /// Who ranks the policy's proposals.
    #[arg(
        long = "scorer",
        default_values = ["learned"],
        num_args = 1..,
        value_parser = named(["learned", "oracle", "oracle-navsim"], ProposalScorer::from_name)
    )]
    pub scorers: Vec<ProposalScorer>,
    /// Seeds of all draws; those of a report are not those that were used to select.
    #[arg(long = "seed", default_values_t = [1], num_args = 1..)]
    pub seeds: Vec<u64>,
    /// Seeds that base sets are driven on only to select by: the report then follows the scenarios of a high score there
    /// through all conditions, on the seeds of --seed.
    #[arg(long = "selection-seed", num_args = 1..)]
    pub selection: Vec<u64>,
    /// Ticks executed of each plan (Δr).
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub replan: u32,
    /// Length of a plan, in ticks (H).
    #[arg(long, default_value_t = 80, value_parser = clap::value_parser!(u32).range(1..=300))]
    pub horizon: u32,
    /// Frames that the policy sees (K).
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub history: u32,
    /// Tracker of the planned trajectory.
    #[arg(long, default_value = "lqr", value_parser = named(TrackerKind::ALL.map(TrackerKind::name), TrackerKind::from_name))]
    pub tracker: TrackerKind,
    /// What makes frames and plans.
    #[command(flatten)]
    pub networks: Networks,
}

/// Arguments of `benchmark run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// What to drive.
    #[command(flatten)]
    pub what: CellArgs,
    /// What the benchmark is to show, declared before it is driven: endpoints that the report corrects together.
    #[arg(long, value_name = "FILE", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub endpoints: Option<PathBuf>,
    /// Which part of the cells, written I/N; `auto` reads SLURM_ARRAY_TASK_ID and SLURM_ARRAY_TASK_COUNT, or
    /// JOB_COMPLETION_INDEX and DREAMSTREAM_SHARDS.
    #[arg(long, default_value = "0/1", value_name = "I/N|auto")]
    pub shard: String,
    /// Episodes at a time; as many as there are processors without it.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub workers: Option<u32>,
    /// Which recordings stay: of a drive of 8 s some megabytes; frames can be made again to the bit.
    #[arg(long, value_enum, default_value = "none")]
    pub keep: Kept,
    /// Where an external policy connects to, such as tcp/127.0.0.1:7447.
    #[arg(long, value_name = "ENDPOINT")]
    pub policy_listen: Option<String>,
    /// Skip cells that ended in these folders, and say how far all shards are, of which these are the others.
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath, num_args = 1..)]
    pub done: Vec<PathBuf>,
    /// Answer Prometheus at this address of loopback, such as 127.0.0.1:9464, while the drives go on. See docs/metrics.md.
    #[arg(long, value_name = "ADDRESS")]
    pub metrics: Option<SocketAddr>,
    /// Where results go; a folder that holds some is refused.
    #[arg(long, short, default_value = "out/benchmark", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
}

/// Which recordings stay.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Kept {
    /// All.
    All,
    /// Those of drives without success.
    Failures,
    /// World states, plans and scores of all: enough to score again. The same command with `--keep all` and another
    /// folder makes the frames again.
    States,
    /// None.
    None,
}

impl From<Kept> for Keep {
    fn from(kept: Kept) -> Self {
        match kept {
            Kept::All => Self::All,
            Kept::Failures => Self::Failures,
            Kept::States => Self::States,
            Kept::None => Self::None,
        }
    }
}
