//! How a command looks on a fleet that runs: its arguments, its seat on the bus, the drives under way and their scenes.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, Result};
use clap::{Args, ValueHint};
use ds_bus::{BusSession, BusSettings, Holder, Mode, TlsFiles};
use ds_space::EpisodeId;
use ds_topic::{Envelope, Event, EventKind, SceneMessage, Slot, Topic};
use ds_wire::Body;
use ds_wire::control as pb;
use pb::runs_client::RunsClient;

use crate::section::SecuritySection;
use crate::security::{Control, Dial};

/// How long the journal may take to give a scene, how often it is asked, and how long between.
const SCENE_WITHIN: Duration = Duration::from_secs(1);
const SCENE_TRIES: u32 = 20;
const SCENE_AGAIN: Duration = Duration::from_millis(300);

/// How to reach the orchestrator of a fleet.
#[derive(Debug, Clone, Args)]
pub struct ControlArgs {
    /// The orchestrator's address.
    #[arg(
        long,
        visible_alias = "control",
        env = "DREAMSTREAM_CONTROL_ORCHESTRATOR",
        default_value = "http://127.0.0.1:4710"
    )]
    pub orchestrator: String,
    /// The authority that signed the orchestrator's certificate, for https addresses (see `dreamstream certs`).
    #[arg(long, env = "DREAMSTREAM_SECURITY_CA", value_hint = ValueHint::FilePath)]
    pub ca: Option<PathBuf>,
    /// The file with the token that the orchestrator asks for.
    #[arg(long, env = "DREAMSTREAM_SECURITY_TOKEN", value_hint = ValueHint::FilePath)]
    pub token: Option<PathBuf>,
    /// Speak to an orchestrator on another host without TLS.
    #[arg(long, env = "DREAMSTREAM_SECURITY_INSECURE")]
    pub insecure: bool,
}

impl ControlArgs {
    /// Returns how to reach the orchestrator.
    ///
    /// # Errors
    /// If the address is none, a file cannot be read, or the address is in clear beyond loopback.
    pub fn dial(&self) -> Result<Dial> {
        let (ca, token) = (self.ca.clone().unwrap_or_default(), self.token.clone().unwrap_or_default());
        let security = SecuritySection { ca, token, insecure: self.insecure, ..SecuritySection::default() };
        Dial::new(&self.orchestrator, &security)
    }
}

/// How to look on a fleet.
#[derive(Debug, Clone, Args)]
pub struct OnlookerArgs {
    /// Where the fleet's router listens.
    #[arg(long, env = "DREAMSTREAM_BUS_ROUTER", default_value = "tcp/127.0.0.1:7447", value_name = "ENDPOINT")]
    pub bus: String,
    /// The certificate of an onlooker (`viewer`, `gap`), for a tls endpoint; its key lies beside it as .key.
    #[arg(long, value_hint = ValueHint::FilePath)]
    pub certificate: Option<PathBuf>,
    /// The fleet.
    #[command(flatten)]
    pub control: ControlArgs,
}

impl OnlookerArgs {
    /// Returns how to look on a fleet on loopback.
    #[must_use]
    pub fn local(bus: &str, orchestrator: &str) -> Self {
        let control = ControlArgs { orchestrator: orchestrator.to_owned(), ca: None, token: None, insecure: false };
        Self { bus: bus.to_owned(), certificate: None, control }
    }

    /// Returns the words that give another process these arguments.
    #[must_use]
    pub fn words(&self) -> Vec<std::ffi::OsString> {
        let mut words = vec!["--bus".into(), self.bus.clone().into()];
        words.extend(["--orchestrator".into(), self.control.orchestrator.clone().into()]);
        let files =
            [("--certificate", &self.certificate), ("--ca", &self.control.ca), ("--token", &self.control.token)];
        for (flag, file) in files {
            if let Some(file) = file {
                words.extend([flag.into(), file.into()]);
            }
        }
        if self.control.insecure {
            words.push("--insecure".into());
        }
        words
    }

    /// Joins the bus.
    ///
    /// # Errors
    /// If its router cannot be reached.
    pub async fn join(&self) -> Result<BusSession> {
        let tls = self.certificate.as_ref().map(|certificate| TlsFiles {
            ca: self.control.ca.clone().unwrap_or_default(),
            certificate: certificate.clone(),
            key: certificate.with_extension("key"),
        });
        let connect = vec![self.bus.clone()];
        let settings = BusSettings { mode: Mode::Client, connect, tls, ..BusSettings::default() };
        BusSession::open(&settings).await.with_context(|| format!("router at {}", self.bus))
    }

    /// Returns a client of the orchestrator.
    ///
    /// # Errors
    /// If it does not answer.
    pub async fn runs(&self) -> Result<RunsClient<Control>> {
        let channel = self.control.dial()?.connect(Duration::from_secs(5)).await;
        Ok(RunsClient::new(channel.context("orchestrator does not answer")?))
    }
}

/// Returns the episodes that are being driven.
///
/// # Errors
/// If the orchestrator refuses.
pub async fn under_way(runs: &mut RunsClient<Control>) -> Result<Vec<pb::EpisodeResult>> {
    let mut found = Vec::new();
    for run in runs.list(pb::ListRequest { limit: 0 }).await.context("orchestrator")?.into_inner().runs {
        if run.status != i32::from(pb::Status::Running) {
            continue;
        }
        let run = runs.get(pb::GetRequest { run_id: run.run_id }).await.context("orchestrator")?.into_inner();
        let driven = |episode: &pb::EpisodeResult| episode.status == i32::from(pb::Status::Running);
        found.extend(run.episodes.into_iter().filter(driven));
    }
    Ok(found)
}

/// Returns the scene of a drive under way.
///
/// # Errors
/// If no journal gives it.
pub async fn scene_of(bus: &BusSession, episode: &EpisodeId) -> Result<SceneMessage> {
    for _ in 0..SCENE_TRIES {
        let asked = bus.pull(episode, &Holder::Journal, Slot::new(Topic::Scene, 0), SCENE_WITHIN).await?;
        if let Some(envelope) = asked {
            return SceneMessage::from_bytes(&envelope.body).context("scene");
        }
        tokio::time::sleep(SCENE_AGAIN).await;
    }
    anyhow::bail!("nobody gives the scene of {episode}: is it still being driven, and may this certificate ask?")
}

/// Says whether a message is the last of its drive.
#[must_use]
pub fn ends_drive(envelope: &Envelope) -> bool {
    let ended = |event: Event| matches!(event.kind, EventKind::Completed | EventKind::Failed | EventKind::Aborted);
    envelope.header.slot.topic == Topic::Event && Event::from_bytes(&envelope.body).is_ok_and(ended)
}
