//! `view`: a recording in rerun, as a file or in a running viewer.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, bail};
use ds_bus::{BusSession, BusSettings, Mode, TlsFiles};
use ds_record::{Recording, view};

use crate::cli::{ControlArgs, ViewArgs};
use crate::command::answer;
use crate::live::{self, Watch};

/// Shows a recording; without `--save` or `--connect` a viewer is started on a temporary file.
///
/// # Errors
/// If the recording cannot be read or no viewer is installed.
pub(crate) fn run(args: &ViewArgs) -> Result<()> {
    let path = args.recording.as_ref().context("a recording")?;
    let recording = Recording::open(path)?;
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
    let path = path.with_extension("rrd");
    view::save_rrd(&recording, &path)?;
    match Command::new("rerun").arg("--bind").arg("127.0.0.1").arg(&path).status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => bail!("the rerun viewer ended with {status}"),
        Err(error) => Err(error).with_context(|| {
            format!("no `rerun` viewer is installed (pip install rerun-sdk==0.36.3); {} is written", path.display())
        }),
    }
}

/// Shows a drive of a running fleet in a running viewer until it ends.
///
/// # Errors
/// If router, orchestrator or viewer cannot be reached.
pub(crate) async fn live(args: &ViewArgs, episode: &str) -> Result<()> {
    let bus = join(&args.bus, args.certificate.as_deref(), &args.control).await?;
    let url = args.connect.clone().unwrap_or_default();
    let watch = Watch { episode: episode.to_owned(), url, one: true };
    tokio::select! {
        shown = live::follow(bus, args.control.dial()?, watch) => shown,
        _ = tokio::signal::ctrl_c() => Ok(()),
    }
}

/// Joins the bus of a running fleet as a viewer.
///
/// # Errors
/// If its router cannot be reached.
pub(crate) async fn join(router: &str, certificate: Option<&Path>, control: &ControlArgs) -> Result<BusSession> {
    let tls = certificate.map(|certificate| TlsFiles {
        ca: control.ca.clone().unwrap_or_default(),
        certificate: certificate.to_path_buf(),
        key: certificate.with_extension("key"),
    });
    let settings = BusSettings { mode: Mode::Client, connect: vec![router.to_owned()], tls, ..BusSettings::default() };
    BusSession::open(&settings).await.with_context(|| format!("router at {router}"))
}
