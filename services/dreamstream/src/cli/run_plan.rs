//! The plan of a run of which nothing is said but what to drive; how its iterations fit the video model's chunks.

use std::path::Path;

use clap::ValueEnum;
use ds_topic::{ObservationSource, ProposalScorer, ScoreProfile};
use ds_video::Backend;
use ds_world::{AgentMode, LayoutBackend, TrackerKind};

use super::RunPlan;
use ds_process::shipped;

/// How iterations and the video model's chunks fit together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Align {
    /// A cut chunk is made, shown, rolled back and made again with the true layouts.
    Rollback,
    /// Refuse the drive.
    Exact,
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
            model: shipped::find(Path::new("configs/models/cpu_train.toml")),
            video_backend: Backend::Cpu,
            policy_weights: shipped::find(Path::new("configs/models/camera_policy.safetensors")),
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
    use crate::cli::{Cli, Command};

    #[test]
    fn the_default_is_what_the_command_line_means_without_flags() {
        let Command::Run(parsed) = Cli::parse_from(["dreamstream", "run", "x"]).command else { panic!("no run") };
        assert_eq!(parsed, RunPlan { scenarios: vec!["x".into()], ..RunPlan::default() });
    }
}
