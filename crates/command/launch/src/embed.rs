//! The five services inside this process: an in-process bus, loopback gRPC, everything else as in a fleet.

use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result};
use ds_bus::{BusSession, BusSettings, Mode};
use ds_episode::Timing;
use ds_process::children::Children;
use ds_process::maker::MakerFactory;
use ds_process::metrics::Metrics;
use ds_process::onlooker::OnlookerArgs;
use ds_process::section::{MetricsSection, SecuritySection};
use ds_process::security::Dial;
use ds_process::shipped;
use ds_process::{Drain, Member};
use ds_space::InstanceId;
use ds_topic::Role;
use policy_bridge::OutsideBus;
use tokio::task::JoinSet;

use crate::children::Meeting;
use crate::fleet_plan::FleetPlan;

/// A started fleet.
pub struct Fleet {
    /// The orchestrator's address.
    pub control: String,
    /// `embedded` or `processes`.
    pub mode: &'static str,
    drain: Drain,
    tasks: JoinSet<Result<()>>,
    children: Option<Children>,
    /// Where an onlooker finds the bus, if it is to.
    bus: Option<String>,
}

impl Fleet {
    /// Wraps child processes that meet at a router.
    #[must_use]
    pub fn of_children(Meeting { control, router, children }: Meeting) -> Self {
        let (drain, tasks, bus) = (Drain::new(), JoinSet::new(), Some(router));
        Self { control, mode: "processes", drain, tasks, children: Some(children), bus }
    }

    /// Returns how another process looks on.
    ///
    /// # Errors
    /// If the fleet was not started to be looked on.
    pub fn seat(&self) -> Result<OnlookerArgs> {
        let bus = self.bus.as_deref().context("nobody may look on this fleet")?;
        Ok(OnlookerArgs::local(bus, &self.control))
    }

    /// Returns its processes, if it has some.
    pub fn children(&mut self) -> Option<&mut Children> {
        self.children.as_mut()
    }

    /// Returns the first service that ended though nobody asked it to.
    ///
    /// # Errors
    /// The reason of its end.
    pub async fn failed(&mut self) -> anyhow::Error {
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
    pub async fn stop(mut self) -> Result<()> {
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
pub async fn start(plan: &FleetPlan) -> Result<Fleet> {
    let video = Arc::new(plan.networks.video());
    // Now, for a worker without a model would only be waited for.
    video.model().with_context(|| format!("the video model {}", shipped::describe(&plan.networks.model)))?;
    let mut settings = BusSettings { drop_share: plan.drop_pushes, ..BusSettings::default() };
    if plan.live {
        settings = BusSettings { mode: Mode::Router, listen: vec!["tcp/127.0.0.1:0".to_owned()], ..settings };
    }
    let bus = BusSession::open(&settings).await.context("bus")?;
    let drain = Drain::new();
    let mut tasks = JoinSet::new();
    let mut settings = orchestrator::Settings::default();
    settings.control.listen = "127.0.0.1:0".to_owned();
    settings.journal.folder.clone_from(&plan.folder);
    settings.fleet.episodes = plan.workers;
    let metrics = Metrics::default();
    metrics.add_process("run", &bus);
    let section = MetricsSection { listen: plan.metrics.map(|address| address.to_string()).unwrap_or_default() };
    tasks.spawn(metrics.open(&section, &SecuritySection::default(), drain.clone())?);
    let running = orchestrator::start(settings, bus.clone(), &metrics, drain.clone()).await?;
    let control = format!("http://{}", running.address);
    tasks.spawn(async move { running.ended().await });
    let outside = match &plan.policy_listen {
        Some(listen) => Some(Arc::new(OutsideBus::open(&plan.policy, listen, None, Duration::from_secs(30)).await?)),
        None => None,
    };
    let mut factories: Vec<Arc<dyn MakerFactory>> = vec![
        Arc::new(sim_server::SimStage),
        Arc::new(layout_render::LayoutStage { probe: plan.probe_adapter }),
        Arc::new(
            policy_bridge::PolicyStage::new(plan.networks.policy_weights.clone(), outside).with_own(&plan.manifests)?,
        ),
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
            metrics: metrics.clone(),
        };
        let drain = drain.clone();
        tasks.spawn(async move {
            member.run(drain).await;
            Ok(())
        });
    }
    let bus = bus.listens().first().cloned();
    Ok(Fleet { control, mode: "embedded", drain, tasks, children: None, bus })
}
