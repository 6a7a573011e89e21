//! Arguments of `train`.

use std::path::PathBuf;

use clap::{Args, ValueHint};
use ds_launch::choice::{backend, named};
use ds_policy::Learned;
use ds_process::shipped;
use ds_video::Backend;

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
    #[arg(long, value_parser = ["autoencoder", "prior", "teacher", "ode", "self_forcing", "decoder"])]
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
