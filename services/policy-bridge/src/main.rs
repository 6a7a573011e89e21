//! The policy-bridge process: parse, set up, run, exit code.

use std::process::ExitCode;

fn main() -> ExitCode {
    ds_process::service::main(policy_bridge::run)
}
