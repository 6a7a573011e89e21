//! The five services inside this process: an in-process bus, loopback gRPC, everything else as in a fleet.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result};
use ds_bus::{BusSession, BusSettings, Mode};
use ds_episode::Timing;
use ds_process::maker::MakerFactory;
use ds_process::security::Dial;
use ds_process::{Drain, Member};
use ds_space::InstanceId;
use ds_topic::Role;
use ds_video::Backend;
use policy_bridge::OutsideBus;
use tokio::task::JoinSet;

use crate::cli::RunPlan;
use crate::shipped;

/// How the fleet of one run is made up.
#[derive(Debug, Clone)]
pub(crate) struct FleetPlan {
    /// Ledger and recordings.
    pub folder: PathBuf,
    /// Configuration of the video model.
    pub model: PathBuf,
    /// What computes it.
    pub video_backend: Backend,
    /// Weights of the camera policy.
    pub policy_weights: PathBuf,
    /// Video workers, and episodes under way at a time.
    pub workers: u32,
    /// The policy under test.
    pub policy: String,
    /// Where it connects to, if it is external.
    pub policy_listen: Option<String>,
    /// Whether layouts may be drawn by a graphics adapter.
    pub probe_adapter: bool,
    /// Share of pushes that are dropped.
    pub drop_pushes: f64,
    /// Commands of other programs that take a stage's place.
    pub stages: BTreeMap<Role, String>,
}

impl FleetPlan {
    /// Returns the fleet that the arguments of a run ask for.
    ///
    /// # Errors
    /// If a stage is none, has no command, or is named twice.
    pub(crate) fn of(args: &RunPlan) -> Result<Self> {
        let mut stages = BTreeMap::new();
        for text in &args.stages {
            let named =
                text.split_once('=').and_then(|(role, command)| Some((Role::from_name(role.trim())?, command.trim())));
            let Some((role, command)) = named.filter(|(_, command)| !command.is_empty()) else {
                anyhow::bail!("--stage {text:?} is not ROLE=COMMAND with sim, layout, video or policy as ROLE");
            };
            anyhow::ensure!(stages.insert(role, command.to_owned()).is_none(), "--stage names {role} twice");
        }
        Ok(Self {
            folder: args.out.clone(),
            model: args.model.clone(),
            video_backend: args.video_backend.parse().map_err(anyhow::Error::msg)?,
            policy_weights: args.policy_weights.clone(),
            workers: args.workers,
            policy: args.policy.clone(),
            policy_listen: args.policy_listen.clone(),
            probe_adapter: args.layout_backend != "cpu",
            drop_pushes: args.drop_pushes,
            stages,
        })
    }
}

/// A started fleet.
pub(crate) struct Fleet {
    /// The orchestrator's address.
    pub control: String,
    /// `embedded` or `processes`.
    pub mode: &'static str,
    drain: Drain,
    tasks: JoinSet<Result<()>>,
    children: Option<ds_process::children::Children>,
    bus: Reach,
}

/// How a viewer gets onto the bus of a fleet.
enum Reach {
    Session(BusSession),
    Router(String),
}

impl Fleet {
    /// Wraps child processes that meet at a router.
    #[must_use]
    pub(crate) fn of_children(control: String, router: String, children: ds_process::children::Children) -> Self {
        let (drain, tasks, bus) = (Drain::new(), JoinSet::new(), Reach::Router(router));
        Self { control, mode: "processes", drain, tasks, children: Some(children), bus }
    }

    /// Returns a session that hears what the services say.
    ///
    /// # Errors
    /// If the router cannot be reached.
    pub(crate) async fn tap(&self) -> Result<BusSession> {
        match &self.bus {
            Reach::Session(bus) => Ok(bus.clone()),
            Reach::Router(endpoint) => {
                let connect = vec![endpoint.clone()];
                let settings = BusSettings { mode: Mode::Client, connect, ..BusSettings::default() };
                BusSession::open(&settings).await.context("tap on the bus")
            }
        }
    }

    /// Returns the first service that ended though nobody asked it to.
    ///
    /// # Errors
    /// The reason of its end.
    pub(crate) async fn failed(&mut self) -> anyhow::Error {
        match (self.tasks.join_next().await, &mut self.children) {
            (Some(Ok(Ok(()))), _) => anyhow::anyhow!("a service ended early"),
            (Some(Ok(Err(error))), _) => error,
            (Some(Err(error)), _) => anyhow::Error::new(error),
            (None, Some(children)) => children.supervise().await,
            (None, None) => anyhow::anyhow!("no service runs"),
        }
    }

    /// Drains all services and waits for their end.
    ///
    /// # Errors
    /// The first error of a service.
    pub(crate) async fn stop(mut self) -> Result<()> {
        self.drain.cancel();
        if let Some(children) = self.children.take() {
            return children.stop().await;
        }
        let ended = async {
            while let Some(ended) = self.tasks.join_next().await {
                ended.context("a service panicked")??;
            }
            Ok(())
        };
        tokio::time::timeout(Duration::from_secs(20), ended).await.context("services did not drain in 20 s")?
    }
}

/// Starts all services in this process.
///
/// # Errors
/// If a port, the ledger or the policy bus cannot be opened.
pub(crate) async fn start(plan: &FleetPlan) -> Result<Fleet> {
    let video = Arc::new(vdm_worker::VideoStage::new(plan.model.clone(), None).with_backend(plan.video_backend));
    // Now, for a worker without a model would only be waited for.
    video.model().with_context(|| format!("the video model {}", shipped::describe(&plan.model)))?;
    let settings = BusSettings { drop_share: plan.drop_pushes, ..BusSettings::default() };
    let bus = BusSession::open(&settings).await.context("bus")?;
    let drain = Drain::new();
    let mut tasks = JoinSet::new();
    let mut settings = orchestrator::Settings::default();
    settings.control.listen = "127.0.0.1:0".to_owned();
    settings.journal.folder.clone_from(&plan.folder);
    settings.fleet.episodes = plan.workers;
    let running = orchestrator::start(settings, bus.clone(), drain.clone()).await?;
    let control = format!("http://{}", running.address);
    tasks.spawn(async move { running.ended().await });
    let outside = match &plan.policy_listen {
        Some(listen) => Some(Arc::new(OutsideBus::open(&plan.policy, listen, None, Duration::from_secs(30)).await?)),
        None => None,
    };
    let mut factories: Vec<Arc<dyn MakerFactory>> = vec![
        Arc::new(sim_server::SimStage),
        Arc::new(layout_render::LayoutStage { probe: plan.probe_adapter }),
        Arc::new(policy_bridge::PolicyStage::new(plan.policy_weights.clone(), outside)),
    ];
    factories.extend((0..plan.workers).map(|_| Arc::clone(&video) as Arc<dyn MakerFactory>));
    for (index, factory) in factories.into_iter().enumerate() {
        let role = factory.role();
        let member = Member {
            instance: InstanceId::new(&format!("{role}-{index}")).context("instance")?,
            slots: if role == Role::Video { 1 } else { plan.workers },
            orchestrator: Dial::local(&control)?,
            bus: bus.clone(),
            factory,
            codec: Arc::new(ds_wire::WireCodec),
            timing: Timing::default(),
        };
        let drain = drain.clone();
        tasks.spawn(async move {
            member.run(drain).await;
            Ok(())
        });
    }
    Ok(Fleet { control, mode: "embedded", drain, tasks, children: None, bus: Reach::Session(bus) })
}
