//! Runs and fleet over gRPC, admission, ledger, journal, score: the only process that moves time.
//!
//! It starts no processes. Finished episodes stay finished over a restart, unfinished ones go on from their last commit.

mod admission;
mod conditioning;
mod conductor;
mod grpc;
mod hub;
mod journal;
mod ledger;
mod metrics;
mod pace;
mod registry;
mod scorer;
mod settings;
mod storage;
mod submission;

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result};
use ds_bus::BusSession;
use ds_episode::Timing;
use ds_episode::fleet::FleetSettings;
use ds_process::Drain;
use ds_process::metrics::Metrics;
use ds_process::security::Door;
use ds_space::InstanceId;
use ds_wire::control as pb;
use tokio::task::JoinHandle;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::Server;
use tonic::transport::server::TcpIncoming;

pub use conditioning::{Conditioning, ConditioningError};
pub use settings::Settings;

use conductor::Stand;
use hub::Hub;
use registry::Registry;
use storage::Storage;

/// How long members may take to say goodbye before their streams are told to end.
const GOODBYES_WITHIN: Duration = Duration::from_millis(300);
/// The largest request, in bytes.
const MAX_MESSAGE_BYTES: usize = 1 << 30;

/// A started orchestrator.
pub struct Running {
    /// Where it serves.
    pub address: SocketAddr,
    done: JoinHandle<Result<()>>,
}

impl Running {
    /// Waits for its end.
    ///
    /// # Errors
    /// Why it ended, if not by a drain.
    pub async fn ended(self) -> Result<()> {
        self.done.await.context("orchestrator panicked")?
    }
}

/// Runs the process until `drain`.
///
/// # Errors
/// If a setting, the ledger, the bus or a port is refused.
pub async fn run(settings: Settings, drain: Drain) -> Result<()> {
    let metrics = Metrics::default();
    let answered = metrics.open(&settings.metrics, &settings.security, drain.clone())?;
    let bus = ds_process::service::open_bus(&settings.bus, &settings.security).await?;
    metrics.add_process("orchestrator", &bus);
    let running = start(settings, bus, &metrics, drain).await?;
    tokio::try_join!(answered, running.ended())?;
    Ok(())
}

/// Opens ledger and port, takes up unfinished runs and serves until `drain`; `metrics` learns what comes of it.
///
/// # Errors
/// If a setting, the ledger or the port is refused.
pub async fn start(settings: Settings, bus: BusSession, metrics: &Metrics, drain: Drain) -> Result<Running> {
    settings.check()?;
    let listen: SocketAddr = settings
        .control
        .listen
        .parse()
        .with_context(|| format!("setting \"control.listen\" is {:?}, not an address", settings.control.listen))?;
    let door = settings.security.door("control.listen", listen)?;
    let folder = settings.journal.folder.clone();
    std::fs::create_dir_all(&folder).with_context(|| format!("folder {}", folder.display()))?;
    let storage = Storage::default();
    let ledger = ledger::LedgerFile::open(&folder.join("ledger.redb"), storage.clone()).context("ledger.redb")?;
    let fleet = &settings.fleet;
    let leases =
        FleetSettings { lease_ms: fleet.lease_millis, margin_ms: fleet.margin_millis, ..FleetSettings::default() };
    let hub = Arc::new(Hub::open(ledger, leases, fleet.heartbeat_millis).context("ledger.redb")?);
    let registry = Arc::new(Registry::new(Arc::clone(&hub)));
    take_up(&registry, &folder)?;
    let tally = metrics::Tally::default();
    let told = (tally.clone(), Arc::clone(&hub), Arc::clone(&registry));
    metrics.add(move |page| told.0.tell(&told.1, &told.2, page));
    let stand = Stand {
        bus,
        hub: Arc::clone(&hub),
        instance: InstanceId::new(&format!("orchestrator-{}", hub.term())).context("instance")?,
        term: hub.term(),
        timing: Timing {
            pull_after_ms: fleet.pull_after_millis,
            iteration_deadline_ms: fleet.iteration_deadline_millis,
            vacancy_deadline_ms: fleet.vacancy_deadline_millis,
            ..Timing::default()
        },
        folder: folder.clone(),
        storage,
        tally,
    };
    let limits = admission::Limits {
        episodes: fleet.episodes as usize,
        attempts: fleet.attempts,
        vacancy: Duration::from_millis(fleet.vacancy_deadline_millis),
    };
    serve(door, hub, registry, stand, limits, drain).await
}

/// Takes up the runs that the ledger holds.
fn take_up(registry: &Registry, folder: &std::path::Path) -> Result<()> {
    for stored in registry.stored().context("ledger.redb")? {
        let request: pb::SubmitRequest = pb::decode_message(&stored).context("a stored run")?;
        let run = registry::run_id(&request.client_id);
        match submission::jobs(&run, &request, folder) {
            Ok(jobs) => {
                let (_, episodes) = registry.add(&request.client_id, stored, jobs).context("ledger.redb")?;
                tracing::info!(%run, episodes, "run taken up");
            }
            Err(error) => tracing::error!(%run, %error, "run cannot be taken up"),
        }
    }
    Ok(())
}

async fn serve(
    door: Door,
    hub: Arc<Hub>,
    registry: Arc<Registry>,
    stand: Stand,
    limits: admission::Limits,
    drain: Drain,
) -> Result<Running> {
    let incoming = TcpIncoming::bind(door.listen)
        .map_err(|error| anyhow::anyhow!("{error}"))
        .with_context(|| format!("listen on {}", door.listen))?;
    let incoming = incoming.with_nodelay(Some(true));
    let address = incoming.local_addr().context("own address")?;
    let runs =
        grpc::RunsService { registry: Arc::clone(&registry), folder: stand.folder.clone(), insecure: door.insecure };
    let runs = pb::runs_server::RunsServer::new(runs)
        .max_decoding_message_size(MAX_MESSAGE_BYTES)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let runs = InterceptedService::new(runs, door.guard.clone());
    let fleet = pb::fleet_server::FleetServer::new(grpc::FleetService { hub: Arc::clone(&hub) });
    let fleet = InterceptedService::new(fleet, door.guard);
    let (health_reporter, health) = tonic_health::server::health_reporter();
    health_reporter.set_serving::<pb::runs_server::RunsServer<grpc::RunsService>>().await;
    let reflection = tonic_reflection::server::Builder::configure()
        .register_encoded_file_descriptor_set(ds_wire::DESCRIPTOR_SET)
        .build_v1()
        .context("reflection")?;
    let mut server = Server::builder();
    if let Some(tls) = door.tls {
        server = server.tls_config(tls).context("certificate of the control server")?;
    }
    let router = server.add_service(runs).add_service(fleet).add_service(health).add_service(reflection);
    tracing::info!(%address, term = stand.term, "serving");
    let storage = stand.storage.clone();
    let admission = tokio::spawn(admission::admit(stand, registry, limits, drain.clone()));
    let expiry = tokio::spawn(expire(Arc::clone(&hub), drain.clone()));
    let done = tokio::spawn(async move {
        let (stop, leaving) = (drain.clone(), Arc::clone(&hub));
        let served = router.serve_with_incoming_shutdown(incoming, async move {
            stop.cancelled().await;
            // Members say goodbye on streams that stay open for as long as they have work.
            let _some_stay = tokio::time::timeout(GOODBYES_WITHIN, leaving.deserted()).await;
        });
        let limited = async {
            drain.cancelled().await;
            tokio::time::sleep(Duration::from_secs(3)).await;
        };
        tokio::select! {
            served = served => served.context("gRPC server")?,
            error = storage.failure() => {
                // Nothing is recorded from here on: whoever drives learns of the end, and nothing else.
                admission.abort();
                expiry.abort();
                hub.close();
                return Err(anyhow::Error::new(error));
            }
            () = limited => tracing::debug!("open streams were cut"),
        }
        drain.cancel();
        admission.await.context("admission")?;
        expiry.await.context("expiry")
    });
    Ok(Running { address, done })
}

/// Looks for silent holders.
async fn expire(hub: Arc<Hub>, drain: Drain) {
    let mut beat = tokio::time::interval(Duration::from_millis(100));
    loop {
        tokio::select! {
            () = drain.cancelled() => return,
            _ = beat.tick() => hub.expire(),
        }
    }
}
