//! Where control streams, leases and drivers meet: who is connected, who holds what, who must be told.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use ds_episode::Fault;
use ds_episode::driver::Event;
use ds_episode::fleet::{
    AssignError, ComputeClass, Fleet, FleetSettings, Granted, Hello, JoinError, LedgerError, LossCause, Lost, Request,
};
use ds_episode::{FaultClass, Millis};
use ds_process::clock::millis;
use ds_space::{Digest, EpisodeId, InstanceId};
use ds_topic::{ObservationSource, Owner, Role};
use ds_wire::control as pb;
use tokio::sync::{mpsc, watch};

use crate::ledger::LedgerFile;

/// Orders on their way to an instance.
pub(crate) type Line = mpsc::Sender<Result<pb::ToInstance, tonic::Status>>;

struct Connected {
    line: Line,
    hello: pb::Hello,
    /// Tells this stream from an earlier one of the same instance.
    stream: u64,
}

/// What the fleet can do, as its members said.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Abilities {
    /// The video model.
    pub(crate) video: Option<VideoAbility>,
    /// Digest of the camera policy.
    pub(crate) policy: Option<Digest>,
}

/// What a worker said of its video model.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct VideoAbility {
    /// Digest; zero without a model.
    pub(crate) model: Digest,
    /// Digests of the models of the other sources, by their name.
    pub(crate) source_models: BTreeMap<String, Digest>,
    /// Ticks per chunk.
    pub(crate) chunk_ticks: u32,
    /// Ticks of the layouts that it remembers.
    pub(crate) layout_memory_ticks: u32,
    /// Whether it goes on from the geometry of layouts.
    pub(crate) layout_geometry: bool,
    /// Width and height of its frames, in pixels.
    pub(crate) frame_px: [u32; 2],
}

impl VideoAbility {
    /// Returns the digest of what a source is generated with; none where the worker has no such model.
    pub(crate) fn model_of(&self, source: ObservationSource) -> Option<Digest> {
        let model = match source {
            ObservationSource::Dreamstream => Some(self.model),
            source => self.source_models.get(source.name()).copied(),
        };
        model.filter(|model| *model != Digest::default())
    }
}

#[derive(Default)]
struct Lines {
    connected: BTreeMap<InstanceId, Connected>,
    drivers: BTreeMap<EpisodeId, mpsc::Sender<Event>>,
    work_micros: BTreeMap<(EpisodeId, Role), BTreeMap<InstanceId, u64>>,
    streams: u64,
    leases: Leases,
}

/// Leases that were given and that ended before their episode did.
#[derive(Debug, Clone, Default)]
pub(crate) struct Leases {
    /// By role.
    pub(crate) given: BTreeMap<Role, u64>,
    /// By role and cause, as [`LOSSES`] lists them.
    pub(crate) lost: BTreeMap<(Role, &'static str), u64>,
}

/// What a holder was dismissed for: it reported a fault.
const DISMISSED: &str = "dismissed";
/// Why leases end before their episode does.
pub(crate) const LOSSES: [&str; 4] =
    [LossCause::Died.name(), LossCause::Left.name(), LossCause::Rejoined.name(), DISMISSED];

/// The fleet and its lines.
pub(crate) struct Hub {
    fleet: Mutex<Fleet<LedgerFile>>,
    lines: Mutex<Lines>,
    /// How many lines ended.
    goings: watch::Sender<u64>,
    heartbeat_millis: u64,
    lease_millis: u64,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn order(message: pb::to_instance::Message) -> Result<pb::ToInstance, tonic::Status> {
    Ok(pb::ToInstance { message: Some(message) })
}

fn now() -> Millis {
    Millis(millis())
}

impl Hub {
    pub(crate) fn open(
        ledger: LedgerFile,
        settings: FleetSettings,
        heartbeat_millis: u64,
    ) -> Result<Self, LedgerError> {
        let lease_millis = settings.lease_ms;
        let fleet = Fleet::open(ledger, settings, now())?;
        let (fleet, goings) = (Mutex::new(fleet), watch::Sender::default());
        Ok(Self { fleet, lines: Mutex::default(), goings, heartbeat_millis, lease_millis })
    }

    pub(crate) fn term(&self) -> u64 {
        lock(&self.fleet).term()
    }

    /// Reads ledger entries of another kind than the fleet's own.
    pub(crate) fn entries(&self, prefix: &str) -> Result<Vec<(String, Vec<u8>)>, LedgerError> {
        use ds_episode::fleet::Ledger as _;
        lock(&self.fleet).ledger_mut().entries(prefix)
    }

    /// Writes ledger entries of another kind than the fleet's own.
    pub(crate) fn commit(&self, writes: &[(String, Option<Vec<u8>>)]) -> Result<(), LedgerError> {
        use ds_episode::fleet::Ledger as _;
        let mut fleet = lock(&self.fleet);
        let term = fleet.term();
        fleet.ledger_mut().commit(term, writes)
    }

    /// Returns how often the ledger was written to.
    pub(crate) fn ledger_commits(&self) -> u64 {
        lock(&self.fleet).ledger_mut().commits()
    }

    /// Takes an instance in and returns the number of its stream.
    pub(crate) fn join(&self, hello: &pb::Hello, line: Line) -> Result<u64, tonic::Status> {
        let instance = InstanceId::new(&hello.instance).map_err(invalid)?;
        let role = pb::role_of(hello.role).ok_or_else(|| tonic::Status::invalid_argument("hello.role is unknown"))?;
        if hello.schema_version != ds_topic::SCHEMA_VERSION {
            return Err(tonic::Status::failed_precondition(format!(
                "hello.schema_version is {}, this orchestrator speaks {}",
                hello.schema_version,
                ds_topic::SCHEMA_VERSION
            )));
        }
        let said = Hello {
            instance: instance.clone(),
            role,
            slots: hello.slots.min(1_024),
            devices: hello.devices.iter().take(64).cloned().collect(),
            shares_device: hello.shares_device,
            class: ComputeClass(hello.compute_class_name.chars().take(512).collect()),
        };
        let joined = lock(&self.fleet).join(now(), said).map_err(refused)?;
        let welcome = pb::to_instance::Message::Welcome(pb::Welcome {
            term: joined.term,
            heartbeat_millis: self.heartbeat_millis,
            device: joined.device.unwrap_or_default(),
        });
        let _gone = line.try_send(order(welcome));
        self.tell_lost(joined.lost);
        let mut lines = lock(&self.lines);
        lines.streams += 1;
        let stream = lines.streams;
        lines.connected.insert(instance, Connected { line, hello: hello.clone(), stream });
        tracing::info!(instance = hello.instance, %role, "joined");
        Ok(stream)
    }

    /// Forgets the line of a stream that ended; the leases run on, for a broken stream proves nothing.
    pub(crate) fn disconnected(&self, instance: &InstanceId, stream: u64) {
        let mut lines = lock(&self.lines);
        if lines.connected.get(instance).is_some_and(|connected| connected.stream == stream) {
            lines.connected.remove(instance);
        }
        drop(lines);
        self.goings.send_modify(|goings| *goings += 1);
    }

    /// Waits until no instance is connected.
    pub(crate) async fn deserted(&self) {
        let mut goings = self.goings.subscribe();
        while !lock(&self.lines).connected.is_empty() {
            if goings.changed().await.is_err() {
                return;
            }
        }
    }

    /// Lets an instance go that said goodbye and holds nothing any more.
    pub(crate) fn leave(&self, instance: &InstanceId) {
        match lock(&self.fleet).leave(instance) {
            Ok(lost) => self.tell_lost(lost),
            Err(error) => tracing::error!(%instance, %error, "leaving failed"),
        }
    }

    /// Cuts all lines: no order follows, members look for another orchestrator until they drain.
    pub(crate) fn close(&self) {
        lock(&self.lines).connected.clear();
    }

    pub(crate) fn drain(&self, instance: &InstanceId) {
        lock(&self.fleet).drain(instance);
    }

    /// Renews the leases of an instance, notes its work and answers its heartbeat.
    pub(crate) fn heartbeat(&self, instance: &InstanceId, beat: &pb::Heartbeat) {
        let mut fleet = lock(&self.fleet);
        let (renewed, term) = (fleet.renew(now(), instance), fleet.term());
        drop(fleet);
        let Ok(Some(held)) = renewed else {
            // It was silent for so long that it lost its roles: only a new hello makes it a member again.
            if let Some(connected) = lock(&self.lines).connected.get(instance) {
                let again = tonic::Status::aborted("silent for longer than the lease: join again");
                let _gone = connected.line.try_send(Err(again));
            }
            return;
        };
        let mut lines = lock(&self.lines);
        for (name, micros) in beat.counters.iter().take(4_096) {
            let Some(id) = name.strip_prefix("work_micros.") else { continue };
            for (episode, role, _) in held.iter().filter(|(episode, ..)| episode.as_str() == id) {
                let work = lines.work_micros.entry((episode.clone(), *role)).or_default();
                work.insert(instance.clone(), *micros);
            }
        }
        let holds = held.iter().map(|(episode, _, epoch)| pb::Ready { episode: episode.to_string(), epoch: *epoch });
        let renew =
            pb::Renew { term, lease_millis: self.lease_millis, progress: beat.progress, holds: holds.collect() };
        if let Some(connected) = lines.connected.get(instance) {
            let _gone = connected.line.try_send(order(pb::to_instance::Message::Renew(renew)));
        }
    }

    /// Gives roles to somebody and tells them; all epochs go to the ledger in one write.
    pub(crate) fn assign(&self, requests: Vec<Request>) -> Result<Vec<Result<Granted, AssignError>>, LedgerError> {
        let answers = lock(&self.fleet).assign_all(now(), requests)?;
        answers.iter().flatten().for_each(|granted| self.tell_holder(granted));
        Ok(answers)
    }

    fn tell_holder(&self, granted: &Granted) {
        let assign = pb::Assign {
            episode: granted.request.episode.to_string(),
            attempt: granted.request.attempt.0,
            role: pb::role(granted.request.role),
            epoch: granted.owner.epoch,
            term: granted.term,
            lease_millis: granted.lease_ms,
            iteration: 0,
            offer: String::new(),
        };
        self.send(&granted.owner.instance, pb::to_instance::Message::Assign(assign));
        *lock(&self.lines).leases.given.entry(granted.request.role).or_default() += 1;
    }

    /// Takes a role away from an instance that failed in it.
    pub(crate) fn dismiss(&self, episode: &EpisodeId, role: Role, owner: &Owner) -> Result<(), LedgerError> {
        lock(&self.fleet).dismiss(episode, role, owner)?;
        *lock(&self.lines).leases.lost.entry((role, DISMISSED)).or_default() += 1;
        self.release(episode, owner, "dismissed");
        Ok(())
    }

    /// Ends all leases of an episode.
    pub(crate) fn finish(&self, episode: &EpisodeId) -> Result<(), LedgerError> {
        let held = lock(&self.fleet).finish(episode)?;
        for lost in held {
            self.release(episode, &lost.owner, "the episode ended");
        }
        Ok(())
    }

    fn release(&self, episode: &EpisodeId, owner: &Owner, reason: &str) {
        let (episode, reason) = (episode.to_string(), reason.to_owned());
        let release = pb::Release { episode, epoch: owner.epoch, reason };
        self.send(&owner.instance, pb::to_instance::Message::Release(release));
    }

    fn send(&self, instance: &InstanceId, message: pb::to_instance::Message) {
        let lines = lock(&self.lines);
        let sent = lines.connected.get(instance).map(|connected| connected.line.try_send(order(message)));
        if !matches!(sent, Some(Ok(()))) {
            tracing::warn!(%instance, "not connected; its lease will run out");
        }
    }

    /// Frees roles whose holders fell silent.
    pub(crate) fn expire(&self) {
        match lock(&self.fleet).expire(now()) {
            Ok(lost) => self.tell_lost(lost),
            Err(error) => tracing::error!(%error, "leases cannot be ended"),
        }
    }

    fn tell_lost(&self, lost: Vec<Lost>) {
        for loss in lost {
            *lock(&self.lines).leases.lost.entry((loss.role, loss.cause.name())).or_default() += 1;
            let reason = format!("{} {}", loss.owner.instance, loss.cause.name());
            self.tell(&loss.episode, Event::Lost { role: loss.role, epoch: loss.owner.epoch, reason });
        }
    }

    /// Passes on that a holder is ready.
    pub(crate) fn ready(&self, instance: &InstanceId, ready: &pb::Ready) {
        if let Some((episode, role)) = self.held(instance, &ready.episode, ready.epoch) {
            self.tell(&episode, Event::ReadyBy { role, epoch: ready.epoch });
        }
    }

    /// Passes on that a holder failed.
    pub(crate) fn fault(&self, instance: &InstanceId, said: &pb::Fault) {
        let class = match pb::FaultClass::try_from(said.fault_class) {
            Ok(pb::FaultClass::Deterministic) => FaultClass::Deterministic,
            Ok(pb::FaultClass::Policy) => FaultClass::Policy,
            _ => FaultClass::Infrastructure,
        };
        let limited = |text: &str, most| text.chars().take(most).collect::<String>();
        let fault = Fault::new(class, &limited(&said.name, 64), limited(&said.detail, 2_000));
        if let Some((episode, role)) = self.held(instance, &said.episode, said.epoch) {
            self.tell(&episode, Event::Faulted { role, epoch: said.epoch, fault });
        }
    }

    fn held(&self, instance: &InstanceId, episode: &str, epoch: u64) -> Option<(EpisodeId, Role)> {
        let episode = EpisodeId::new(episode).ok()?;
        let fleet = lock(&self.fleet);
        let holds = |role: &Role| {
            fleet.owner(&episode, *role).is_some_and(|owner| owner.instance == *instance && owner.epoch == epoch)
        };
        let role = Role::ALL.into_iter().find(holds)?;
        drop(fleet);
        Some((episode, role))
    }

    fn tell(&self, episode: &EpisodeId, event: Event) {
        let driver = lock(&self.lines).drivers.get(episode).cloned();
        if let Some(driver) = driver
            && driver.try_send(event).is_err()
        {
            tracing::warn!(%episode, "the driver's queue is full; the instance repeats itself");
        }
    }

    /// Connects a driver; events of its episode go there until [`Hub::forget`].
    pub(crate) fn drive(&self, episode: &EpisodeId, driver: mpsc::Sender<Event>) {
        lock(&self.lines).drivers.insert(episode.clone(), driver);
    }

    /// Disconnects a driver.
    pub(crate) fn forget(&self, episode: &EpisodeId) {
        let mut lines = lock(&self.lines);
        lines.drivers.remove(episode);
        lines.work_micros.retain(|(id, _), _| id != episode);
    }

    /// Returns how long the makers of each role worked on an episode, in seconds, in loop order.
    pub(crate) fn work_secs(&self, episode: &EpisodeId) -> [f64; 4] {
        let lines = lock(&self.lines);
        Role::ALL.map(|role| {
            let of_role = lines.work_micros.get(&(episode.clone(), role));
            of_role.map_or(0.0, |work| work.values().sum::<u64>() as f64 * 1e-6)
        })
    }

    /// Returns how many leases were given and lost.
    pub(crate) fn leases(&self) -> Leases {
        lock(&self.lines).leases.clone()
    }

    /// Returns the models that connected members have; `None` where no member of the role is connected.
    pub(crate) fn abilities(&self) -> Abilities {
        // Empty is as good as zero: there is no model.
        let digest = |bytes: &[u8]| <[u8; 32]>::try_from(bytes).map_or(Digest::default(), Digest);
        let of_source = |model: &pb::SourceModel| (model.source.clone(), digest(&model.digest));
        let lines = lock(&self.lines);
        let mut abilities = Abilities::default();
        for hello in lines.connected.values().map(|connected| &connected.hello) {
            match pb::role_of(hello.role) {
                Some(Role::Video) => {
                    abilities.video = Some(VideoAbility {
                        model: digest(&hello.video_model),
                        source_models: hello.source_models.iter().take(16).map(of_source).collect(),
                        chunk_ticks: hello.chunk_ticks,
                        layout_memory_ticks: hello.layout_memory_ticks,
                        layout_geometry: hello.layout_geometry,
                        frame_px: [hello.frame_width_px, hello.frame_height_px],
                    });
                }
                Some(Role::Policy) => abilities.policy = Some(digest(&hello.policy_model)),
                Some(Role::Sim | Role::Layout) | None => {}
            }
        }
        abilities
    }

    /// Lists all instances.
    pub(crate) fn list(&self) -> Vec<pb::Instance> {
        let fleet = lock(&self.fleet);
        let lines = lock(&self.lines);
        let at = now();
        let instance = |member: &ds_episode::fleet::Member| {
            let ds_episode::fleet::Hello { instance, role, slots, .. } = &member.hello;
            let connected = lines.connected.get(instance);
            let named = || pb::Hello {
                instance: instance.to_string(),
                role: pb::role(*role),
                slots: *slots,
                ..pb::Hello::default()
            };
            let holds = fleet.held(instance);
            pb::Instance {
                hello: Some(connected.map_or_else(named, |connected| connected.hello.clone())),
                holds: holds.map(|(episode, epoch)| pb::Ready { episode: episode.to_string(), epoch }).collect(),
                cordoned: member.cordoned,
                draining: member.draining,
                silent_millis: at.since(member.heard),
                device: member.device.clone().unwrap_or_default(),
                connected: connected.is_some(),
            }
        };
        fleet.members().map(instance).collect()
    }
}

fn invalid(error: impl std::fmt::Display) -> tonic::Status {
    tonic::Status::invalid_argument(error.to_string())
}

fn refused(error: JoinError) -> tonic::Status {
    match error {
        JoinError::NoFreeDevice { .. } => tonic::Status::resource_exhausted(error.to_string()),
        JoinError::NoSlots { .. } => tonic::Status::invalid_argument(error.to_string()),
        JoinError::Ledger(_) => tonic::Status::failed_precondition(error.to_string()),
    }
}
