//! The orchestrator process: parse, set up, run, exit code.

use std::process::ExitCode;

fn main() -> ExitCode {
    ds_process::service::main(orchestrator::run)
}
