//! `view`: a recording in rerun, as a file or in a running viewer.

use std::process::Command;

use anyhow::{Context, Result, bail};
use ds_record::{Recording, view};

use crate::cli::ViewArgs;
use crate::command::answer;

/// Shows a recording; without `--save` or `--connect` a viewer is started on a temporary file.
///
/// # Errors
/// If the recording cannot be read or no viewer is installed.
pub fn run(args: &ViewArgs) -> Result<()> {
    let recording = Recording::open(&args.recording)?;
    for missing in recording.missing()? {
        answer(&format!("missing: {missing}"));
    }
    if let Some(path) = &args.save {
        view::save_rrd(&recording, path)?;
        answer(&format!("written to {}; open it with `rerun {0}`", path.display()));
        return Ok(());
    }
    if let Some(url) = &args.connect {
        view::show(&recording, url)?;
        answer(&format!("sent to {url}"));
        return Ok(());
    }
    let path = args.recording.with_extension("rrd");
    view::save_rrd(&recording, &path)?;
    match Command::new("rerun").arg("--bind").arg("127.0.0.1").arg(&path).status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => bail!("the rerun viewer ended with {status}"),
        Err(error) => Err(error).with_context(|| {
            format!("no `rerun` viewer is installed (pip install rerun-sdk==0.36.3); {} is written", path.display())
        }),
    }
}
