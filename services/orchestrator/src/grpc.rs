//! The gRPC services `Runs` and `Fleet`: requests are checked here and handed to registry and hub.

use std::path::PathBuf;
use std::pin::Pin;
use std::sync::Arc;

use ds_process::maker::chain;
use ds_space::InstanceId;
use ds_wire::control as pb;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tokio_stream::{Stream, StreamExt};
use tonic::{Request, Response, Status, Streaming};

use crate::hub::Hub;
use crate::registry::{Registry, run_id};
use crate::submission;

/// `Runs`.
pub(crate) struct RunsService {
    pub(crate) registry: Arc<Registry>,
    pub(crate) folder: PathBuf,
    /// Whether TLS and token are switched off.
    pub(crate) insecure: bool,
}

type Answer<T> = Result<Response<T>, Status>;
type Stream1<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

fn unknown(run: &str) -> Status {
    Status::not_found(format!("run {run:?} is unknown"))
}

#[tonic::async_trait]
impl pb::runs_server::Runs for RunsService {
    type WatchStream = Stream1<pb::RunProgress>;

    async fn submit(&self, request: Request<pb::SubmitRequest>) -> Answer<pb::SubmitResponse> {
        let request = request.into_inner();
        if ds_space::RunId::new(&request.client_id).is_err() {
            return Err(Status::invalid_argument(format!("submit.client_id {:?} is not an id", request.client_id)));
        }
        let id = run_id(&request.client_id);
        let (run, folder) = (id.clone(), self.folder.clone());
        let checked =
            tokio::task::spawn_blocking(move || submission::jobs(&run, &request, &folder).map(|jobs| (request, jobs)));
        let checked = checked.await.map_err(|error| Status::internal(error.to_string()))?;
        let (request, jobs) = checked.map_err(|error| Status::invalid_argument(chain(&error)))?;
        let stored = pb::encode_message(&request);
        let added = self.registry.add(&request.client_id, stored, jobs);
        let (existed, episodes) = added.map_err(|error| Status::failed_precondition(error.to_string()))?;
        let episodes = u32::try_from(episodes).unwrap_or(u32::MAX);
        Ok(Response::new(pb::SubmitResponse { run_id: id.to_string(), episodes, existed }))
    }

    async fn watch(&self, request: Request<pb::WatchRequest>) -> Answer<Self::WatchStream> {
        let id = request.into_inner().run_id;
        let (first, mut seen, mut changed) = self.registry.watch(&id).ok_or_else(|| unknown(&id))?;
        let registry = Arc::clone(&self.registry);
        let (sender, receiver) = mpsc::channel(16);
        tokio::spawn(async move {
            let mut next = Some(first);
            while let Some(message) = next.take() {
                let ended = pb::has_ended(message.status);
                if sender.send(Ok(message)).await.is_err() || ended || changed.changed().await.is_err() {
                    break;
                }
                if let Some((progress, number)) = registry.since(&id, seen) {
                    (next, seen) = (Some(progress), number);
                }
            }
        });
        Ok(Response::new(Box::pin(ReceiverStream::new(receiver))))
    }

    async fn get(&self, request: Request<pb::GetRequest>) -> Answer<pb::Run> {
        let id = request.into_inner().run_id;
        let run = self.registry.get(&id).ok_or_else(|| unknown(&id))?;
        Ok(Response::new(pb::Run { insecure: self.insecure, ..run }))
    }

    async fn list(&self, request: Request<pb::ListRequest>) -> Answer<pb::ListResponse> {
        let limit = match request.into_inner().limit {
            0 => 100,
            limit => limit as usize,
        };
        Ok(Response::new(pb::ListResponse { runs: self.registry.list(limit.min(10_000)) }))
    }

    async fn cancel(&self, request: Request<pb::CancelRequest>) -> Answer<pb::Run> {
        let request = request.into_inner();
        let reason: String = request.reason.chars().take(500).collect();
        self.registry.cancel(&request.run_id, &reason).map(Response::new).ok_or_else(|| unknown(&request.run_id))
    }
}

/// `Fleet`.
pub(crate) struct FleetService {
    pub(crate) hub: Arc<Hub>,
}

#[tonic::async_trait]
impl pb::fleet_server::Fleet for FleetService {
    type JoinStream = Stream1<pb::ToInstance>;

    async fn join(&self, request: Request<Streaming<pb::FromInstance>>) -> Answer<Self::JoinStream> {
        let mut said = request.into_inner();
        let first = said.message().await?.and_then(|message| message.message);
        let Some(pb::from_instance::Message::Hello(hello)) = first else {
            return Err(Status::invalid_argument("the first message must be hello"));
        };
        let (line, orders) = mpsc::channel(256);
        let stream = self.hub.join(&hello, line)?;
        let instance = InstanceId::new(&hello.instance).map_err(|error| Status::invalid_argument(error.to_string()))?;
        let hub = Arc::clone(&self.hub);
        tokio::spawn(async move {
            let mut left = false;
            while let Some(Ok(message)) = said.next().await {
                left |= listen(&hub, &instance, message);
            }
            if left {
                hub.leave(&instance);
            }
            hub.disconnected(&instance, stream);
        });
        Ok(Response::new(Box::pin(ReceiverStream::new(orders))))
    }

    async fn list(&self, _request: Request<pb::ListInstancesRequest>) -> Answer<pb::ListInstancesResponse> {
        let (instances, ledger_commits) = (self.hub.list(), self.hub.ledger_commits());
        Ok(Response::new(pb::ListInstancesResponse { instances, ledger_commits }))
    }
}

/// Takes what an instance says; returns whether it wants to leave.
fn listen(hub: &Hub, instance: &InstanceId, message: pb::FromInstance) -> bool {
    use pb::from_instance::Message;
    match message.message {
        Some(Message::Ready(ready)) => hub.ready(instance, &ready),
        Some(Message::Fault(fault)) => hub.fault(instance, &fault),
        Some(Message::Heartbeat(beat)) => hub.heartbeat(instance, &beat),
        Some(Message::Leaving(_)) => {
            hub.drain(instance);
            return true;
        }
        Some(Message::Released(_) | Message::Hello(_)) | None => {}
    }
    false
}
