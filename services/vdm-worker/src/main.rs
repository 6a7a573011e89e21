//! The vdm-worker process: parse, set up, run, exit code.

use std::process::ExitCode;

fn main() -> ExitCode {
    ds_process::service::main(vdm_worker::run)
}
