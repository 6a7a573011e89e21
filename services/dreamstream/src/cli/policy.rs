//! `policy`: flags of its commands.

use std::path::PathBuf;

use clap::{Subcommand, ValueHint};
use ds_process::shipped;

const DOCTOR_EXAMPLES: &str = "Examples:
  dreamstream policy doctor camera
  dreamstream policy doctor mine.toml           an ONNX network by its manifest: docs/own-policies.md
  dreamstream policy doctor mine.py:Mine        a class of the Python client, whose process it starts: docs/policy-doctor.md
  dreamstream policy doctor mine --policy-listen tcp/127.0.0.1:7448      whoever connects as mine, ROS 2 too
  dreamstream policy doctor camera --policy-weights out/policy/camera_policy.safetensors --json";

/// What to do with a policy.
#[derive(Debug, Subcommand)]
pub(crate) enum PolicyCommand {
    /// Ask a policy about eight generated states whose expert plan is known, 192 times in all, and name wrong axes, units,
    /// rate, origin, colour order, mirrored frames, hidden state and answers that are not finite. Exit code 1 if anything is wrong.
    #[command(after_help = DOCTOR_EXAMPLES)]
    Doctor {
        /// The name of a built-in policy that is not privileged, the manifest of an ONNX network, FILE.py:CLASS, or with
        /// --policy-listen the name of an external policy.
        policy: String,
        /// Where an external policy connects to.
        #[arg(long, value_name = "ENDPOINT")]
        policy_listen: Option<String>,
        /// The external policy holds several sessions at a time: ask it two and eight things at once too.
        #[arg(long, requires = "policy_listen")]
        together: bool,
        /// The Python that has the client and what FILE.py needs.
        #[arg(long, default_value = "python3", value_name = "PROGRAM")]
        python: PathBuf,
        /// Print the plans of the states and nothing else: what another process of this command asks for.
        #[arg(long, hide = true)]
        plans: bool,
        /// Weights of the camera policy; a policy of the panel has panel/NAME.safetensors beside it, or a file of its name.
        #[arg(long, default_value = "configs/models/camera_policy.safetensors", value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
        policy_weights: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
}
