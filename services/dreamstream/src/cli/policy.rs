//! `policy`: flags of its commands.

use std::path::PathBuf;

use clap::{Subcommand, ValueHint};
use ds_process::shipped;

const DOCTOR_EXAMPLES: &str = "Examples:
  dreamstream policy doctor camera
  dreamstream policy doctor mine.toml           an ONNX network by its manifest: docs/own-policies.md
  dreamstream policy doctor camera --policy-weights out/policy/camera_policy.safetensors --json";

/// What to do with a policy.
#[derive(Debug, Subcommand)]
pub(crate) enum PolicyCommand {
    /// Ask a policy about seven generated states whose expert plan is known, and name wrong axes, units, rate,
    /// origin, colour order, hidden state and answers that are not finite. Exit code 1 if anything is wrong.
    #[command(after_help = DOCTOR_EXAMPLES)]
    Doctor {
        /// The name of a built-in policy that is not privileged, or the manifest of an ONNX network.
        policy: String,
        /// Weights of the camera policy; a policy of the panel has panel/NAME.safetensors beside it, or a file of its name.
        #[arg(long, default_value = "configs/models/camera_policy.safetensors", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
        policy_weights: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
}
