//! A run on a fleet from submission to its end, through the control plane; an orchestrator that goes away may come back.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use anyhow::{Result, ensure};
use ds_wire::control as pb;
use pb::runs_client::RunsClient;
use tonic::Code;

use crate::security::{Control, Dial};

/// The largest message on the control plane, in bytes.
const MAX_MESSAGE_BYTES: usize = 1 << 30;
/// How long an orchestrator may be away, in tries half a second apart.
const TRIES: u32 = 60;

/// A run that ended.
pub struct Ended {
    /// What the orchestrator says of it.
    pub run: pb::Run,
    /// What decides the bits of a result, by role.
    pub compute_classes: BTreeMap<String, String>,
}

/// The episodes of a run under way as last told, by their ids.
pub type EpisodeResults = BTreeMap<String, pb::EpisodeResult>;

/// What came of talking to the orchestrator once.
enum Talk {
    Ended(Ended),
    /// The orchestrator went away; it may come back and go on from its ledger.
    Cut(tonic::Status),
}

/// Submits a run and follows it to its end; `progress` is shown all episodes whenever one changes.
///
/// # Errors
/// If the orchestrator refuses the run, or stays away.
pub async fn drive(
    request: &pb::SubmitRequest,
    control: &Dial,
    progress: &mut impl FnMut(&EpisodeResults),
) -> Result<Ended> {
    let mut tries = 0;
    loop {
        match talk(request, control, progress).await? {
            Talk::Ended(ended) => return Ok(ended),
            Talk::Cut(status) => {
                tries += 1;
                ensure!(tries < TRIES, "the orchestrator went away: {}", status.message());
                tracing::warn!(%status, "asking the orchestrator again");
                tokio::time::sleep(Duration::from_millis(500)).await;
            }
        }
    }
}

async fn talk(request: &pb::SubmitRequest, control: &Dial, progress: &mut impl FnMut(&EpisodeResults)) -> Result<Talk> {
    let channel = match control.connect(Duration::from_secs(5)).await {
        Ok(channel) => channel,
        Err(error) => return Ok(Talk::Cut(tonic::Status::unavailable(error.to_string()))),
    };
    match follow(request, channel, progress).await {
        Ok(ended) => Ok(Talk::Ended(ended)),
        Err(status) if matches!(status.code(), Code::Unavailable | Code::Unknown | Code::Internal) => {
            Ok(Talk::Cut(status))
        }
        Err(status) => Err(anyhow::anyhow!("orchestrator refused ({:?}): {}", status.code(), status.message())),
    }
}

async fn follow(
    request: &pb::SubmitRequest,
    channel: Control,
    progress: &mut impl FnMut(&EpisodeResults),
) -> Result<Ended, tonic::Status> {
    let mut runs = RunsClient::new(channel.clone())
        .max_decoding_message_size(MAX_MESSAGE_BYTES)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let run_id = runs.submit(request.clone()).await?.into_inner().run_id;
    let mut stream = runs.watch(pb::WatchRequest { run_id: run_id.clone() }).await?.into_inner();
    let mut seen = EpisodeResults::new();
    let mut ended = false;
    while let Some(told) = stream.message().await? {
        ended = pb::has_ended(told.status);
        seen.extend(told.episodes.into_iter().map(|episode| (episode.episode.clone(), episode)));
        progress(&seen);
    }
    if !ended {
        return Err(tonic::Status::unavailable("the progress stream was cut"));
    }
    let run = runs.get(pb::GetRequest { run_id }).await?.into_inner();
    let mut fleet = pb::fleet_client::FleetClient::new(channel);
    let members = fleet.list(pb::ListInstancesRequest {}).await?.into_inner();
    Ok(Ended { run, compute_classes: classes(&members) })
}

fn classes(members: &pb::ListInstancesResponse) -> BTreeMap<String, String> {
    let mut classes: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let connected = members.instances.iter().filter(|instance| instance.connected);
    for hello in connected.filter_map(|instance| instance.hello.as_ref()) {
        let Some(role) = pb::role_of(hello.role) else { continue };
        classes.entry(role.name().to_owned()).or_default().insert(hello.compute_class_name.clone());
    }
    classes.into_iter().map(|(role, names)| (role, names.into_iter().collect::<Vec<_>>().join(" | "))).collect()
}
