//! The plan of a run: what is driven how, as arguments and as a value; how its iterations fit the video model's chunks.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, ValueEnum, ValueHint};
use ds_process::onlooker::ControlArgs;
use ds_process::shipped;
use ds_topic::{ObservationSource, ProposalScorer, ScoreProfile};
use ds_world::{AgentMode, LayoutBackend, TrackerKind};

use crate::choice::{agents, named, oracle};
use crate::networks::Networks;

/// How iterations and the video model's chunks fit together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Align {
    /// A cut chunk is made, shown, rolled back and made again with the true layouts.
    Rollback,
    /// Refuse the drive.
    Exact,
}

/// What to drive, with which world, policy and observation, on which fleet, and where the results go: what `run` is told,
/// and what `gap close` and `gap attribute` plan.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct RunPlan {
    /// Scenario files, or folders of them.
    #[arg(required = true, value_parser = shipped::parser(), value_hint = ValueHint::AnyPath)]
    pub scenarios: Vec<PathBuf>,
    /// The policy under test: camera, diffusiondrive, diffusiondrive_v2, drivor, ltf, rap, sparsedrive, constant-velocity or lattice;
    /// privileged, as references: log-replay, route-follower, idm, careful or expert; an ONNX network by its manifest, such as mine.toml; or the name of
    /// an external policy, which connects at --policy-listen.
    #[arg(long, default_value = "camera")]
    pub policy: String,
    /// What makes the frames that the policy sees: dreamstream, the video model; reference, a rich renderer in place of a
    /// real camera; sim-rgb, a plain game-engine look; layout, the condition image; per-frame, dreamstream-clean-cache,
    /// dreamstream-no-layout and dreamstream-no-guidance, the video model with a part taken away; logged, the log's frames
    /// whatever the ego does; reprojected, the same half a second old and warped to where the ego is; second-camera, a second
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
    /// What makes frames and plans.
    #[command(flatten)]
    pub networks: Networks,
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

/// Arguments of `submit`.
#[derive(Debug, Args)]
pub struct SubmitArgs {
    /// The fleet.
    #[command(flatten)]
    pub control: ControlArgs,
    /// What to drive; the settings of the fleet itself are ignored.
    #[command(flatten)]
    pub run: RunPlan,
}

impl Default for RunPlan {
    fn default() -> Self {
        Self {
            scenarios: Vec::new(),
            policy: "camera".to_owned(),
            observation: ObservationSource::Dreamstream,
            replan: 5,
            horizon: 8.0,
            history: 1,
            scorer: ProposalScorer::Learned,
            oracle: ProposalScorer::Oracle,
            profile: ScoreProfile::Bridgesim,
            benchmark: false,
            align: Align::Rollback,
            duration: 8.0,
            warm_up: 0,
            seed: vec![0],
            appearance: "day".to_owned(),
            prompt: None,
            first_frames: Vec::new(),
            agents: AgentMode::IdmBehindEgo,
            tracker: TrackerKind::Lqr,
            layout_backend: LayoutBackend::Cpu,
            networks: Networks::default(),
            processes: false,
            stages: Vec::new(),
            workers: None,
            policy_listen: None,
            wall_clock: false,
            shard: None,
            out: "out/run".into(),
            resume: false,
            overwrite: false,
            live: None,
            no_pictures: false,
            config: None,
            effects: Vec::new(),
            laws: Vec::new(),
            vehicle_log: false,
            seal: None,
            seal_seed: None,
            metrics: None,
            drop_pushes: 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        plan: RunPlan,
    }

    #[test]
    fn the_default_is_what_the_command_line_means_without_flags() {
        let parsed = Line::parse_from(["run", "x"]).plan;
        assert_eq!(parsed, RunPlan { scenarios: vec!["x".into()], ..RunPlan::default() });
    }
}
