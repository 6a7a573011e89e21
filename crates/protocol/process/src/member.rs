//! A member of the fleet: joins the orchestrator, keeps its leases alive and holds the roles that it is given.
//!
//! When the control stream breaks, all roles are dropped and the member joins again.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use ds_bus::BusSession;
use ds_episode::stage::{Assignment, Event};
use ds_episode::{Codec, Fault, FaultClass, Millis, Timing};
use ds_space::{AttemptId, EpisodeId, IdError, InstanceId};
use ds_topic::{Owner, SCHEMA_VERSION};
use ds_wire::control as pb;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio_stream::wrappers::ReceiverStream;

use crate::Drain;
use crate::clock::millis;
use crate::hold::{self, Report, Tools};
use crate::maker::MakerFactory;
use crate::metrics::Metrics;
use crate::security::Dial;
use crate::tally::Tally;

/// The control stream broke or an order could not be read.
#[derive(Debug, thiserror::Error)]
pub enum MemberError {
    /// The orchestrator is not there.
    #[error("orchestrator cannot be reached: {address:?}")]
    Connect {
        /// Its address.
        address: String,
        /// Why.
        #[source]
        source: tonic::transport::Error,
    },
    /// The stream broke.
    #[error("orchestrator ended the stream: {0}")]
    Stream(Box<tonic::Status>),
    /// The orchestrator closed the stream.
    #[error("orchestrator closed the stream")]
    Closed,
    /// An order holds a bad id.
    #[error(transparent)]
    Id(#[from] IdError),
    /// An order cannot be understood.
    #[error("order refused: {0}")]
    Order(&'static str),
}

/// A started service that wants to work.
pub struct Member {
    /// Its name; a restart is a new instance.
    pub instance: InstanceId,
    /// Episodes that it can hold at once.
    pub slots: u32,
    /// The orchestrator.
    pub orchestrator: Dial,
    /// The data plane.
    pub bus: BusSession,
    /// What it does.
    pub factory: Arc<dyn MakerFactory>,
    /// Reads orders.
    pub codec: Arc<dyn Codec>,
    /// Delays of the protocol.
    pub timing: Timing,
    /// Where it tells what it has done.
    pub metrics: Metrics,
}

/// How long the orchestrator may take to answer.
const CONNECT_WITHIN: Duration = Duration::from_secs(3);
/// How long to wait before joining again.
const REJOIN_AFTER: Duration = Duration::from_millis(500);

impl Member {
    /// Works until `drain`, joining again whenever the stream breaks.
    pub async fn run(self, drain: Drain) {
        let (tally, role, slots) = (Tally::default(), self.factory.role(), self.slots);
        let told = tally.clone();
        self.metrics.add(move |page| told.tell(role, slots, page));
        while !drain.is_cancelled() {
            match self.session(&tally, &drain).await {
                Ok(()) => break,
                Err(error) => tracing::warn!(instance = %self.instance, %error, "joining again"),
            }
            tokio::select! {
                () = tokio::time::sleep(REJOIN_AFTER) => {}
                () = drain.cancelled() => {}
            }
        }
    }

    async fn session(&self, tally: &Tally, drain: &Drain) -> Result<(), MemberError> {
        let connected = self.orchestrator.connect(CONNECT_WITHIN).await;
        let address = self.orchestrator.address().to_owned();
        let channel = connected.map_err(|source| MemberError::Connect { address, source })?;
        let mut client = pb::fleet_client::FleetClient::new(channel);
        let (say, said) = mpsc::channel(256);
        let heard = millis();
        send(&say, pb::from_instance::Message::Hello(self.hello())).await?;
        let stream =
            client.join(ReceiverStream::new(said)).await.map_err(|status| MemberError::Stream(Box::new(status)))?;
        let (reports, reported) = mpsc::channel(256);
        let session = Session {
            member: self,
            tally,
            say,
            reports,
            holders: BTreeMap::new(),
            tasks: JoinSet::new(),
            sent: BTreeMap::new(),
            heard,
            work: BTreeMap::new(),
            beats: 0,
        };
        session.run(stream.into_inner(), reported, drain).await
    }

    fn hello(&self) -> pb::Hello {
        let abilities = self.factory.abilities();
        let class = format!("{} {}", env!("CARGO_PKG_VERSION"), self.factory.compute_class());
        pb::Hello {
            instance: self.instance.to_string(),
            role: pb::role(self.factory.role()),
            slots: self.slots,
            memory_bytes: 0,
            devices: abilities.devices,
            shares_device: abilities.shares_device,
            compute_class: ds_space::Digest::of(class.as_bytes()).0.to_vec().into(),
            compute_class_name: class,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            schema_version: SCHEMA_VERSION,
            offers: Vec::new(),
            video_model: abilities.video_model.0.to_vec().into(),
            source_models: abilities.source_models.iter().map(source_model).collect(),
            chunk_ticks: abilities.chunk_ticks,
            layout_memory_ticks: abilities.layout_memory_ticks,
            layout_geometry: abilities.layout_geometry,
            frame_width_px: abilities.frame_px[0],
            frame_height_px: abilities.frame_px[1],
            policy_model: abilities.policy_model.0.to_vec().into(),
        }
    }
}

fn source_model((source, digest): &(&'static str, ds_space::Digest)) -> pb::SourceModel {
    pb::SourceModel { source: (*source).to_owned(), digest: digest.0.to_vec().into() }
}

async fn send(say: &mpsc::Sender<pb::FromInstance>, message: pb::from_instance::Message) -> Result<(), MemberError> {
    say.send(pb::FromInstance { message: Some(message) }).await.map_err(|_gone| MemberError::Closed)
}

struct Session<'a> {
    member: &'a Member,
    tally: &'a Tally,
    say: mpsc::Sender<pb::FromInstance>,
    reports: mpsc::Sender<Report>,
    holders: BTreeMap<(EpisodeId, u64), mpsc::Sender<Event>>,
    tasks: JoinSet<(EpisodeId, u64)>,
    sent: BTreeMap<u64, u64>,
    /// The own clock when the last message was sent that the orchestrator certainly heard: leases count from there.
    heard: u64,
    work: BTreeMap<EpisodeId, u64>,
    beats: u64,
}

impl Session<'_> {
    async fn run(
        mut self,
        mut orders: tonic::Streaming<pb::ToInstance>,
        mut reported: mpsc::Receiver<Report>,
        drain: &Drain,
    ) -> Result<(), MemberError> {
        let mut beat = tokio::time::interval(Duration::from_millis(500));
        let mut leaving = false;
        loop {
            tokio::select! {
                order = orders.message() => {
                    let order = order.map_err(|status| MemberError::Stream(Box::new(status)))?.ok_or(MemberError::Closed)?;
                    self.obey(order, &mut beat).await?;
                }
                Some(report) = reported.recv() => self.pass_on(report).await?,
                _ = beat.tick() => self.heartbeat().await?,
                Some(ended) = self.tasks.join_next() => self.ended(ended).await?,
                () = drain.cancelled(), if !leaving => {
                    leaving = true;
                    send(&self.say, pb::from_instance::Message::Leaving(pb::Leaving { reason: "drained".to_owned() })).await?;
                    for holder in self.holders.values() {
                        let _full_or_gone = holder.try_send(Event::Drain);
                    }
                }
            }
            if leaving && self.tasks.is_empty() {
                return Ok(());
            }
        }
    }

    async fn obey(&mut self, order: pb::ToInstance, beat: &mut tokio::time::Interval) -> Result<(), MemberError> {
        use pb::to_instance::Message;
        match order.message.ok_or(MemberError::Order("no message"))? {
            Message::Welcome(welcome) => {
                tracing::info!(instance = %self.member.instance, term = welcome.term, device = welcome.device, "joined");
                *beat = tokio::time::interval(Duration::from_millis(welcome.heartbeat_millis.max(20)));
            }
            Message::Assign(assign) => self.take(assign)?,
            Message::Renew(renew) => self.renew(&renew).await?,
            Message::Release(release) => {
                self.holders.remove(&(EpisodeId::new(&release.episode)?, release.epoch));
            }
            Message::Drain(_) => {
                for holder in self.holders.values() {
                    let _full_or_gone = holder.try_send(Event::Drain);
                }
            }
        }
        Ok(())
    }

    fn take(&mut self, assign: pb::Assign) -> Result<(), MemberError> {
        let role = pb::role_of(assign.role).ok_or(MemberError::Order("unknown role"))?;
        if role != self.member.factory.role() {
            return Err(MemberError::Order("another role"));
        }
        let episode = EpisodeId::new(&assign.episode)?;
        let assignment = Assignment {
            episode: episode.clone(),
            attempt: AttemptId(assign.attempt),
            role,
            owner: Owner { instance: self.member.instance.clone(), epoch: assign.epoch },
            term: assign.term,
            lease_until: Millis(self.heard).plus(assign.lease_millis),
        };
        let (holder, orders) = mpsc::channel(64);
        let tools = Tools {
            bus: self.member.bus.clone(),
            factory: Arc::clone(&self.member.factory),
            codec: Arc::clone(&self.member.codec),
            timing: self.member.timing,
            tally: self.tally.clone(),
        };
        let key = (episode, assign.epoch);
        self.holders.insert(key.clone(), holder);
        let reports = self.reports.clone();
        self.tasks.spawn(async move {
            if let Err(error) = hold::hold(tools, assignment, orders, reports.clone()).await {
                let fault = Fault::infrastructure("bus_failed", error);
                let _gone = reports.send(Report::Fault { episode: key.0.clone(), epoch: key.1, fault }).await;
            }
            key
        });
        Ok(())
    }

    async fn renew(&mut self, renew: &pb::Renew) -> Result<(), MemberError> {
        let Some(sent) = self.sent.remove(&renew.progress) else { return Ok(()) };
        self.sent.retain(|beat, _| *beat > renew.progress);
        self.heard = sent;
        let until = Millis(sent).plus(renew.lease_millis);
        for held in &renew.holds {
            if let Some(holder) = self.holders.get(&(EpisodeId::new(&held.episode)?, held.epoch)) {
                let _gone = holder.send(Event::LeaseRenewed { until }).await;
            }
        }
        Ok(())
    }

    async fn heartbeat(&mut self) -> Result<(), MemberError> {
        self.beats += 1;
        self.sent.insert(self.beats, millis());
        let holds = self.holders.keys();
        let beat = pb::Heartbeat {
            progress: self.beats,
            counters: self.work.iter().map(|(episode, micros)| (format!("work_micros.{episode}"), *micros)).collect(),
            holds: holds.map(|(episode, epoch)| pb::Ready { episode: episode.to_string(), epoch: *epoch }).collect(),
        };
        send(&self.say, pb::from_instance::Message::Heartbeat(beat)).await
    }

    async fn pass_on(&mut self, report: Report) -> Result<(), MemberError> {
        let message = match report {
            Report::Ready { episode, epoch } => {
                pb::from_instance::Message::Ready(pb::Ready { episode: episode.to_string(), epoch })
            }
            Report::Fault { episode, epoch, fault } => pb::from_instance::Message::Fault(pb::Fault {
                episode: episode.to_string(),
                epoch,
                fault_class: match fault.class {
                    FaultClass::Infrastructure => pb::FaultClass::Infrastructure,
                    FaultClass::Deterministic => pb::FaultClass::Deterministic,
                    FaultClass::Policy => pb::FaultClass::Policy,
                } as i32,
                name: fault.name,
                detail: fault.detail,
            }),
            Report::Worked { episode, micros } => {
                *self.work.entry(episode).or_default() += micros;
                return self.heartbeat().await;
            }
        };
        send(&self.say, message).await
    }

    async fn ended(&mut self, ended: Result<(EpisodeId, u64), tokio::task::JoinError>) -> Result<(), MemberError> {
        let (episode, epoch) = match ended {
            Ok(key) => key,
            Err(error) => {
                tracing::error!(%error, "a role's task ended badly");
                return Err(MemberError::Order("a role's task ended badly"));
            }
        };
        self.holders.remove(&(episode.clone(), epoch));
        self.work.remove(&episode);
        send(&self.say, pb::from_instance::Message::Released(pb::Released { episode: episode.to_string(), epoch }))
            .await
    }
}
