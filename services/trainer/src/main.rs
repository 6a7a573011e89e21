//! The trainer process: renders clips, trains, and measures what was trained. `dreamstream` starts it for `data`, `train`,
//! `video` and `study`, whose words it takes as they were said.
//!
//! Exit codes: 0 done, 1 failed, 64 wrong arguments or settings, 74 what must be kept cannot be written.

mod cli;
mod command;

use std::process::ExitCode;

use clap::Parser;
use cli::{Cli, Command};
use ds_process::terminal::{ended, parsed};

fn main() -> ExitCode {
    match parsed(Cli::try_parse()) {
        Ok(cli) => ended(ds_process::logging::start(&cli.log).and_then(|()| run(&cli.command))),
        Err(code) => code,
    }
}

fn run(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Data(command) => command::data::run(command),
        Command::Train(args) => command::train::run(args),
        Command::Video(command) => command::video::run(command),
        Command::Study(command) => command::study::run(command),
    }
}
