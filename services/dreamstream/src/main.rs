//! The command line: parse, start logging, run one command, exit code.
//!
//! Exit codes: 0 done, 1 failed (a drive that did not complete counts), 64 wrong arguments or settings, 74 what must be kept
//! cannot be written, such as on a full disk, 130 interrupted. `benchmark` has exit codes of its own, see its help.

mod cli;
mod command;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::parser::ValueSource;
use clap::{CommandFactory, FromArgMatches};
use cli::{Cli, Command, Handed};
use ds_launch::{run, runtime};
use ds_process::beside::{self, TRAINER};
use ds_process::terminal::{answer, complain, ended, parsed};

fn main() -> ExitCode {
    let arguments = Cli::command().try_get_matches().and_then(|said| Ok((Cli::from_arg_matches(&said)?, said)));
    let (cli, said) = match parsed(arguments) {
        Ok(parsed) => parsed,
        Err(code) => return code,
    };
    if let Command::Serve(args) = &cli.command {
        let asked = said.value_source("log") == Some(ValueSource::CommandLine);
        return command::serve::run(args, asked.then_some(cli.log.as_str()));
    }
    if let Command::Benchmark(args) = &cli.command {
        return ds_campaign::run(args, &cli.log);
    }
    if let Some((command, Handed { words })) = cli.command.of_trainer() {
        let words = ["--log", &cli.log, command].map(OsString::from).into_iter().chain(words.iter().cloned());
        complain(&beside::replaced_by(TRAINER, words));
        return ExitCode::FAILURE;
    }
    if let Command::Completion { shell } = &cli.command {
        let mut script = Vec::new();
        clap_complete::generate(*shell, &mut Cli::command(), "dreamstream", &mut script);
        answer(String::from_utf8_lossy(&script).trim_end());
        return ExitCode::SUCCESS;
    }
    ended(ds_process::logging::start(&cli.log).and_then(|()| answered(&cli)))
}

fn answered(cli: &Cli) -> anyhow::Result<()> {
    match &cli.command {
        Command::Run(args) => runtime()?.block_on(run::run(args, &cli.log)),
        Command::Submit(args) => runtime()?.block_on(run::submit(args)),
        Command::Import(args) => command::scenario::import(args),
        Command::Scenario(command) => command::scenario::run(command),
        Command::View(args) => command::view::run(args),
        Command::Gap(command) => ds_gap::run(command, &cli.log),
        Command::Score(args) => command::score::run(args),
        Command::Report(args) => command::report::run(args),
        Command::Compare(args) => command::report::compare_runs(args),
        Command::Merge(args) => command::report::merge(args),
        Command::Top(args) => runtime()?.block_on(command::top::run(args)),
        Command::Why(args) => runtime()?.block_on(command::why::run(args)),
        Command::Replay(args) => command::replay::run(args),
        Command::Bench(args) => command::bench::run(args),
        Command::Measure(args) => command::measure::run(args),
        Command::Policy(command) => command::policy::run(command),
        Command::Doctor => command::doctor::run(),
        Command::Health(args) => runtime()?.block_on(command::health::run(args)),
        Command::Certs(args) => command::certs::run(args),
        Command::Serve(_) | Command::Benchmark(_) | Command::Completion { .. } => Ok(()),
        Command::Data(_) | Command::Train(_) | Command::Video(_) | Command::Study(_) => Ok(()),
    }
}
