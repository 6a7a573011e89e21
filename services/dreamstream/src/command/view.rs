//! `view`: a recording or a running drive in rerun; the process `viewer` shows it.

use std::ffi::OsString;

use anyhow::{Context, Result};
use ds_launch::onlooker as viewer;
use ds_process::beside::{self, VIEWER};

use crate::cli::ViewArgs;
use crate::command::recording;

/// Shows a drive of a running fleet until it ends, or a recording; without `--save` or `--connect` in a window of its own.
///
/// # Errors
/// If there is no viewer, or it says that it cannot show this.
pub(crate) fn run(args: &ViewArgs) -> Result<()> {
    if let Some(episode) = &args.live {
        let url = args.connect.as_deref().unwrap_or_default();
        return beside::call(VIEWER, viewer::drives(&args.fleet, url, &[episode, "--first"]));
    }
    let recording = args.recording.as_ref().context("a recording")?;
    // Said here, whether a viewer is built or not.
    drop(recording::open(recording, args.partial)?);
    let mut words: Vec<OsString> = vec!["recording".into(), recording.into()];
    if args.partial {
        words.push("--partial".into());
    }
    if let Some(path) = &args.save {
        words.extend(["--save".into(), path.into()]);
    }
    if let Some(url) = &args.connect {
        words.extend(["--connect".into(), url.into()]);
    }
    beside::call(VIEWER, words)
}
