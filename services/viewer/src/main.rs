//! The viewer process: parse, start logging, show one thing, exit code. `dreamstream` starts it where rerun is needed.
//!
//! Exit codes: 0 done, 1 failed, 64 wrong arguments.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use clap::{Parser, Subcommand, ValueHint};
use ds_process::onlooker::OnlookerArgs;
use ds_process::terminal::{answer, ended, parsed};
use ds_record::Recording;
use ds_space::EpisodeId;
use serde::de::DeserializeOwned;
use viewer::follow::{self, Watch};
use viewer::{explained, recording, stream, training};

/// Shows recordings, drives under way, diagnoses and trainings in rerun.
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    /// What is logged on stderr.
    #[arg(long, global = true, default_value = "warn")]
    log: String,
    /// What is shown.
    #[command(subcommand)]
    command: Show,
}

#[derive(Debug, Subcommand)]
enum Show {
    /// A recording; without --save or --connect in a window of its own.
    Recording {
        /// A recording (.mcap, or with --partial .mcap.partial of a drive that was killed).
        #[arg(value_hint = ValueHint::FilePath)]
        recording: PathBuf,
        /// Show what is there of a damaged or incomplete recording.
        #[arg(long)]
        partial: bool,
        /// Write an .rrd file instead of opening a window.
        #[arg(long, value_hint = ValueHint::FilePath)]
        save: Option<PathBuf>,
        /// Send to a running window.
        #[arg(long, value_name = "URL")]
        connect: Option<String>,
    },
    /// Drives of a running fleet, in a running window.
    Drives {
        /// A part of their names; all drives without.
        #[arg(default_value = "")]
        episode: String,
        /// End after the first.
        #[arg(long)]
        first: bool,
        /// Show what is diagnosed beside the drive of exactly this name.
        #[arg(long, requires = "episode", conflicts_with = "first")]
        diagnosed: bool,
        /// Say "ready" on stdout, and end when stdin ends.
        #[arg(long)]
        attended: bool,
        /// The window.
        #[arg(long, value_name = "URL", default_value = stream::DEFAULT_URL)]
        connect: String,
        /// The fleet.
        #[command(flatten)]
        fleet: OnlookerArgs,
    },
    /// Check that a window listens.
    Reach {
        /// The window.
        #[arg(long, value_name = "URL", default_value = stream::DEFAULT_URL)]
        connect: String,
    },
    /// Write a finished diagnosis, JSON on stdin, to an .rrd file.
    Diagnosis {
        /// The file.
        #[arg(value_hint = ValueHint::FilePath)]
        out: PathBuf,
    },
    /// Write a training, JSON on stdin, to an .rrd file.
    Training {
        /// The file.
        #[arg(value_hint = ValueHint::FilePath)]
        out: PathBuf,
    },
}

fn main() -> ExitCode {
    match parsed(Cli::try_parse()) {
        Ok(cli) => ended(ds_process::logging::start(&cli.log).and_then(|()| run(cli.command))),
        Err(code) => code,
    }
}

fn run(command: Show) -> Result<()> {
    match command {
        Show::Recording { recording, partial, save, connect } => {
            let drive = if partial { Recording::open_partial(&recording) } else { Recording::open(&recording) };
            show(&drive?, &recording, save.as_deref(), connect.as_deref())
        }
        Show::Drives { episode, first, diagnosed, attended, connect, fleet } => {
            let watch = match (diagnosed, first) {
                (true, _) => Watch::Diagnosed(EpisodeId::new(&episode).context("name of an episode")?),
                (false, true) => Watch::First(episode),
                (false, false) => Watch::All(episode),
            };
            runtime()?.block_on(watched(&fleet, &connect, watch, attended))
        }
        Show::Reach { connect } => runtime()?.block_on(follow::reach(&connect)),
        Show::Diagnosis { out } => Ok(explained::save(&handed()?, &out)?),
        Show::Training { out } => Ok(training::save(&handed()?, &out)?),
    }
}

fn runtime() -> Result<tokio::runtime::Runtime> {
    Ok(tokio::runtime::Builder::new_multi_thread().enable_all().worker_threads(2).build()?)
}

/// Reads what is handed over on stdin.
fn handed<T: DeserializeOwned>() -> Result<T> {
    serde_json::from_reader(std::io::stdin().lock()).context("JSON on stdin")
}

async fn watched(fleet: &OnlookerArgs, url: &str, watch: Watch, attended: bool) -> Result<()> {
    let ready = || {
        if attended {
            answer("ready");
        }
    };
    let left = async {
        if !attended {
            std::future::pending::<()>().await;
        }
        left().await;
        follow::last_words().await;
    };
    tokio::select! {
        over = follow::follow(fleet, url, watch, ready) => over,
        () = left => Ok(()),
        _ = tokio::signal::ctrl_c() => Ok(()),
    }
}

/// Waits until whoever started this process closes its stdin; on a thread of its own, which no end of the process waits for.
async fn left() {
    let (told, left) = tokio::sync::oneshot::channel();
    std::thread::spawn(move || {
        let _ended = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        let _nobody_waits = told.send(());
    });
    let _thread_ended = left.await;
}

fn show(drive: &Recording, path: &Path, save: Option<&Path>, connect: Option<&str>) -> Result<()> {
    for missing in drive.missing()? {
        answer(&format!("missing: {missing}"));
    }
    if let Some(path) = save {
        recording::save_rrd(drive, path)?;
        answer(&format!("written to {}; open it with `rerun {0}`", path.display()));
        return Ok(());
    }
    if let Some(url) = connect {
        recording::show(drive, url)?;
        answer(&format!("sent to {url}"));
        return Ok(());
    }
    let path = path.with_extension("rrd");
    recording::save_rrd(drive, &path)?;
    match std::process::Command::new("rerun").arg("--bind").arg("127.0.0.1").arg(&path).status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => bail!("the rerun viewer ended with {status}"),
        Err(error) => Err(error).with_context(|| {
            format!("no `rerun` viewer is installed (pip install rerun-sdk==0.36.3); {} is written", path.display())
        }),
    }
}
