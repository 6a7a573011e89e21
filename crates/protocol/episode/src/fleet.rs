//! Who is there and who holds which role of which episode: leases, epochs, terms, devices, quarantine and cordon.
//!
//! Epochs only grow and are in the ledger before an assignment is returned. A role is free again only after its lease
//! and a margin passed, or when its holder itself gave it up. A suspicion (a broken stream, liveliness) proves nothing and
//! is not asked for here. Reading the ledger with a lower term than its own makes every call fail with `Fenced`.

mod entry;
mod ledger;
mod member;

use std::collections::{BTreeMap, BTreeSet};

use ds_space::{EpisodeId, InstanceId};
use ds_topic::{Owner, Role};

use crate::clock::Millis;
use entry::Seat;
pub use ledger::{Ledger, LedgerError, Write};
pub use member::{ComputeClass, Granted, Hello, Joined, LossCause, Lost, Member, Request};

/// Delays and limits of the fleet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FleetSettings {
    /// How long a renewal holds.
    pub lease_ms: u64,
    /// How much longer a silent holder is waited for.
    pub margin_ms: u64,
    /// An episode that killed so many instances in one role is quarantined (a lost host kills one in each and is no proof).
    pub deaths_to_quarantine: usize,
    /// An instance that failed so many different episodes is cordoned.
    pub failures_to_cordon: usize,
}

impl Default for FleetSettings {
    fn default() -> Self {
        Self { lease_ms: 3_000, margin_ms: 1_000, deaths_to_quarantine: 2, failures_to_cordon: 2 }
    }
}

/// Why an instance was not taken in.
#[derive(Debug, thiserror::Error)]
pub enum JoinError {
    /// All its devices are in use and it does not share.
    #[error("no_free_device: all of {devices:?} are held by other instances, and {instance} does not share")]
    NoFreeDevice {
        /// The instance.
        instance: InstanceId,
        /// The devices that it named.
        devices: Vec<String>,
    },
    /// It can hold nothing.
    #[error("no_slots: {instance} offers 0 slots")]
    NoSlots {
        /// The instance.
        instance: InstanceId,
    },
    /// The ledger failed.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
}

/// Why a role was not given to anybody.
#[derive(Debug, thiserror::Error)]
pub enum AssignError {
    /// The episode killed too many instances; lasting.
    #[error("quarantined: the episode killed {dead:?} in role {role}")]
    Quarantined {
        /// The role.
        role: Role,
        /// Who died while holding it.
        dead: Vec<InstanceId>,
    },
    /// An earlier holder may still act; passing.
    #[error("held: epoch {epoch} of {instance} runs until {until}")]
    Held {
        /// The holder.
        instance: InstanceId,
        /// Its epoch.
        epoch: u64,
        /// When its lease and the margin are over.
        until: Millis,
    },
    /// Nobody has a free slot; passing.
    #[error("no_free_slot: none of {members} instances can take role {role}")]
    NoFreeSlot {
        /// The role.
        role: Role,
        /// How many instances of that role are there.
        members: usize,
    },
    /// Nobody of the attempt's compute class is there; passing, a new attempt may take another class.
    #[error("no_equal_class: {role} ran in class {class:?}, which nobody free has")]
    NoEqualClass {
        /// The role.
        role: Role,
        /// The class that the attempt is bound to.
        class: String,
    },
    /// The ledger failed.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
}

impl AssignError {
    /// Says whether asking again later is pointless.
    #[must_use]
    pub fn lasting(&self) -> bool {
        matches!(self, Self::Quarantined { .. } | Self::Ledger(_))
    }
}

#[derive(Debug, Clone)]
struct Lease {
    owner: Owner,
    /// When the holder must have stopped by its own clock.
    until: Millis,
}

/// A role of an episode under an epoch.
pub type Hold = (EpisodeId, Role, u64);

/// The fleet of one orchestrator.
pub struct Fleet<L> {
    ledger: L,
    term: u64,
    settings: FleetSettings,
    members: BTreeMap<InstanceId, Member>,
    leases: BTreeMap<(EpisodeId, Role), Lease>,
    seats: BTreeMap<(EpisodeId, Role), Seat>,
    deaths: entry::Deaths,
    failures: BTreeMap<InstanceId, BTreeSet<EpisodeId>>,
}

impl<L: Ledger> Fleet<L> {
    /// Opens the ledger: raises the term and takes every recorded holder for leased from `now` on.
    ///
    /// # Errors
    /// [`LedgerError`] if storage fails or an entry cannot be read.
    pub fn open(mut ledger: L, settings: FleetSettings, now: Millis) -> Result<Self, LedgerError> {
        let term = ledger.raise_term()?;
        let seats = entry::seats(&ledger)?;
        let leases = seats
            .iter()
            .filter(|(_, seat)| seat.held)
            .map(|(key, seat)| (key.clone(), Lease { owner: seat.owner.clone(), until: now.plus(settings.lease_ms) }))
            .collect();
        let deaths = entry::deaths(&ledger)?;
        let failures = entry::failures(&ledger)?;
        Ok(Self { ledger, term, settings, members: BTreeMap::new(), leases, seats, deaths, failures })
    }

    /// Returns the term of this orchestrator.
    #[must_use]
    pub fn term(&self) -> u64 {
        self.term
    }

    /// Returns the ledger, for entries of other kinds.
    pub fn ledger_mut(&mut self) -> &mut L {
        &mut self.ledger
    }

    /// Lists the instances, by id.
    pub fn members(&self) -> impl Iterator<Item = &Member> {
        self.members.values()
    }

    /// Returns what an instance holds: episodes, each with the epoch of its lease.
    pub fn held(&self, instance: &InstanceId) -> impl Iterator<Item = (&EpisodeId, u64)> {
        let held = self.leases.iter().filter(move |(_, lease)| lease.owner.instance == *instance);
        held.map(|((episode, _), lease)| (episode, lease.owner.epoch))
    }

    /// Returns the holder of a role.
    #[must_use]
    pub fn owner(&self, episode: &EpisodeId, role: Role) -> Option<&Owner> {
        self.leases.get(&(episode.clone(), role)).map(|lease| &lease.owner)
    }

    /// Takes an instance in. What it held before is free at once: it dropped it before it said hello.
    ///
    /// # Errors
    /// [`JoinError`] if it offers nothing, finds no device, or the ledger fails.
    pub fn join(&mut self, now: Millis, hello: Hello) -> Result<Joined, JoinError> {
        self.check_term()?;
        let instance = hello.instance.clone();
        if hello.slots == 0 {
            return Err(JoinError::NoSlots { instance });
        }
        let lost = self.release_all(&instance, LossCause::Rejoined)?;
        self.members.remove(&instance);
        let device = self.free_device(&hello)?;
        let cordoned = self.is_cordoned(&instance);
        let member = Member { hello, device: device.clone(), heard: now, held: 0, cordoned, draining: false };
        self.members.insert(instance, member);
        Ok(Joined { device, lease_ms: self.settings.lease_ms, term: self.term, lost })
    }

    fn free_device(&self, hello: &Hello) -> Result<Option<String>, JoinError> {
        let users =
            |device: &String| self.members.values().filter(|member| member.device.as_ref() == Some(device)).count();
        let Some(least) = hello.devices.iter().min_by_key(|device| users(device)) else { return Ok(None) };
        if users(least) > 0 && !hello.shares_device {
            return Err(JoinError::NoFreeDevice { instance: hello.instance.clone(), devices: hello.devices.clone() });
        }
        Ok(Some(least.clone()))
    }

    /// Renews all leases of an instance that was heard; returns what it holds, or `None` if it must join first.
    ///
    /// # Errors
    /// [`LedgerError::Fenced`] if another orchestrator is in charge.
    pub fn renew(&mut self, now: Millis, instance: &InstanceId) -> Result<Option<Vec<Hold>>, LedgerError> {
        self.check_term()?;
        let Some(member) = self.members.get_mut(instance) else { return Ok(None) };
        member.heard = now;
        let until = now.plus(self.settings.lease_ms);
        let mut held = Vec::new();
        for ((episode, role), lease) in &mut self.leases {
            if lease.owner.instance == *instance {
                lease.until = until;
                held.push((episode.clone(), *role, lease.owner.epoch));
            }
        }
        Ok(Some(held))
    }

    /// Marks an instance as wanting to leave: it gets no further role.
    pub fn drain(&mut self, instance: &InstanceId) {
        if let Some(member) = self.members.get_mut(instance) {
            member.draining = true;
        }
    }

    /// Lets an instance go that said goodbye, having stopped all its work.
    ///
    /// # Errors
    /// [`LedgerError`] if the ledger fails.
    pub fn leave(&mut self, instance: &InstanceId) -> Result<Vec<Lost>, LedgerError> {
        let lost = self.release_all(instance, LossCause::Left)?;
        self.members.remove(instance);
        Ok(lost)
    }

    /// Gives a role to the instance with the most free slots (then the lowest id), its epoch raised in the ledger first.
    ///
    /// # Errors
    /// [`AssignError`]; see [`AssignError::lasting`].
    pub fn assign(&mut self, now: Millis, request: Request) -> Result<Granted, AssignError> {
        self.assign_all(now, vec![request])?.pop().expect("one request has one answer")
    }

    /// Gives roles as [`Fleet::assign`] does, with one write to the ledger for all that somebody takes.
    ///
    /// # Errors
    /// [`LedgerError`] if the ledger fails; nothing is given then.
    pub fn assign_all(
        &mut self,
        now: Millis,
        requests: Vec<Request>,
    ) -> Result<Vec<Result<Granted, AssignError>>, LedgerError> {
        self.check_term()?;
        let key = |request: &Request| (request.episode.clone(), request.role);
        let mut seated: Vec<Result<(Request, Seat), AssignError>> = Vec::with_capacity(requests.len());
        for request in requests {
            // A role that is asked for twice is given once.
            let twin = seated.iter().flatten().find(|(other, _)| key(other) == key(&request));
            seated.push(match twin {
                Some((_, seat)) => {
                    let Owner { instance, epoch } = seat.owner.clone();
                    let until = now.plus(self.settings.lease_ms + self.settings.margin_ms);
                    Err(AssignError::Held { instance, epoch, until })
                }
                None => self.seat(now, request),
            });
        }
        let taken = || seated.iter().flatten();
        let writes: Vec<_> = taken().map(|(request, seat)| entry::write_seat(&key(request), seat)).collect();
        if !writes.is_empty()
            && let Err(error) = self.ledger.commit(self.term, &writes)
        {
            for (_, seat) in taken() {
                self.hold(&seat.owner.instance, -1);
            }
            return Err(error);
        }
        let granted = seated.into_iter().map(|seated| {
            let (request, seat) = seated?;
            let owner = seat.owner.clone();
            self.seats.insert(key(&request), seat);
            let until = now.plus(self.settings.lease_ms);
            self.leases.insert(key(&request), Lease { owner: owner.clone(), until });
            Ok(Granted { request, owner, term: self.term, lease_ms: self.settings.lease_ms })
        });
        Ok(granted.collect())
    }

    /// Chooses who takes a role and counts it as held.
    fn seat(&mut self, now: Millis, request: Request) -> Result<(Request, Seat), AssignError> {
        let key = (request.episode.clone(), request.role);
        let dead: Vec<InstanceId> = self.deaths.get(&key).into_iter().flatten().cloned().collect();
        if dead.len() >= self.settings.deaths_to_quarantine {
            return Err(AssignError::Quarantined { role: request.role, dead });
        }
        if let Some(lease) = self.leases.get(&key) {
            let until = lease.until.plus(self.settings.margin_ms);
            let Owner { instance, epoch } = lease.owner.clone();
            return Err(AssignError::Held { instance, epoch, until });
        }
        let before = self.seats.get(&key);
        let class = before.filter(|seat| seat.attempt == request.attempt).map(|seat| seat.class.clone());
        let epoch = before.map_or(0, |seat| seat.owner.epoch) + 1;
        let (instance, class) = self.choose(now, &request, class)?;
        self.hold(&instance, 1);
        let seat = Seat { owner: Owner { instance, epoch }, attempt: request.attempt, class, held: true };
        Ok((request, seat))
    }

    fn hold(&mut self, instance: &InstanceId, more: i32) {
        if let Some(member) = self.members.get_mut(instance) {
            member.held = member.held.saturating_add_signed(more);
        }
    }

    fn choose(
        &self,
        now: Millis,
        request: &Request,
        class: Option<ComputeClass>,
    ) -> Result<(InstanceId, ComputeClass), AssignError> {
        let role = request.role;
        let members = self.members.values().filter(|member| member.hello.role == role).count();
        let free: Vec<&Member> = self
            .members
            .values()
            .filter(|member| member.hello.role == role && member.held < member.hello.slots)
            .filter(|member| !member.cordoned && !member.draining)
            .filter(|member| now < member.heard.plus(self.settings.lease_ms))
            .filter(|member| request.exclude.as_ref() != Some(&member.hello.instance))
            .collect();
        let equal = free.iter().filter(|member| class.as_ref().is_none_or(|class| member.hello.class == *class));
        let most_free =
            equal.min_by_key(|member| (std::cmp::Reverse(member.hello.slots - member.held), &member.hello.instance));
        match (most_free, class) {
            (Some(member), _) => Ok((member.hello.instance.clone(), member.hello.class.clone())),
            (None, Some(class)) if !free.is_empty() => Err(AssignError::NoEqualClass { role, class: class.0 }),
            (None, _) => Err(AssignError::NoFreeSlot { role, members }),
        }
    }

    /// Ends leases whose time and margin are over, records the deaths, forgets instances that stayed silent so long.
    ///
    /// # Errors
    /// [`LedgerError`] if the ledger fails.
    pub fn expire(&mut self, now: Millis) -> Result<Vec<Lost>, LedgerError> {
        let over = |until: Millis| until.plus(self.settings.margin_ms) <= now;
        let ended: Vec<(EpisodeId, Role)> =
            self.leases.iter().filter(|(_, lease)| over(lease.until)).map(|(key, _)| key.clone()).collect();
        let lost = self.release_keys(&ended, LossCause::Died)?;
        let silent = self.settings.lease_ms + self.settings.margin_ms;
        self.members.retain(|_, member| now.since(member.heard) < silent);
        Ok(lost)
    }

    /// Ends a lease whose holder reported a fault, and counts it against that instance.
    ///
    /// # Errors
    /// [`LedgerError`] if the ledger fails.
    pub fn dismiss(&mut self, episode: &EpisodeId, role: Role, owner: &Owner) -> Result<(), LedgerError> {
        let write = entry::write_failure(&owner.instance, episode);
        self.ledger.commit(self.term, &[write])?;
        self.failures.entry(owner.instance.clone()).or_default().insert(episode.clone());
        let cordoned = self.is_cordoned(&owner.instance);
        if let Some(member) = self.members.get_mut(&owner.instance) {
            member.cordoned = cordoned;
        }
        let key = (episode.clone(), role);
        if self.leases.get(&key).is_some_and(|lease| lease.owner == *owner) {
            self.release_keys(&[key], LossCause::Left)?;
        }
        Ok(())
    }

    /// Ends all leases of an episode that ended, and returns who held them, to be told so.
    ///
    /// # Errors
    /// [`LedgerError`] if the ledger fails.
    pub fn finish(&mut self, episode: &EpisodeId) -> Result<Vec<Lost>, LedgerError> {
        let keys: Vec<_> = self.leases.keys().filter(|(held, _)| held == episode).cloned().collect();
        self.release_keys(&keys, LossCause::Left)
    }

    fn check_term(&self) -> Result<(), LedgerError> {
        let current = self.ledger.term()?;
        if current == self.term { Ok(()) } else { Err(LedgerError::Fenced { own: self.term, current }) }
    }

    fn is_cordoned(&self, instance: &InstanceId) -> bool {
        self.failures.get(instance).is_some_and(|episodes| episodes.len() >= self.settings.failures_to_cordon)
    }

    fn release_all(&mut self, instance: &InstanceId, cause: LossCause) -> Result<Vec<Lost>, LedgerError> {
        let held = |lease: &Lease| lease.owner.instance == *instance;
        let keys: Vec<_> = self.leases.iter().filter(|(_, lease)| held(lease)).map(|(key, _)| key.clone()).collect();
        self.release_keys(&keys, cause)
    }

    fn release_keys(&mut self, keys: &[(EpisodeId, Role)], cause: LossCause) -> Result<Vec<Lost>, LedgerError> {
        let mut writes = Vec::new();
        let mut lost = Vec::new();
        for key in keys {
            let (Some(lease), Some(seat)) = (self.leases.get(key), self.seats.get(key)) else { continue };
            writes.push(entry::write_seat(key, &Seat { held: false, ..seat.clone() }));
            if cause == LossCause::Died {
                writes.push(entry::write_death(key, &lease.owner.instance));
            }
            lost.push(Lost { episode: key.0.clone(), role: key.1, owner: lease.owner.clone(), cause });
        }
        if lost.is_empty() {
            return Ok(lost);
        }
        self.ledger.commit(self.term, &writes)?;
        for loss in &lost {
            let key = (loss.episode.clone(), loss.role);
            self.leases.remove(&key);
            if let Some(seat) = self.seats.get_mut(&key) {
                seat.held = false;
            }
            if let Some(member) = self.members.get_mut(&loss.owner.instance) {
                member.held = member.held.saturating_sub(1);
            }
            if cause == LossCause::Died {
                self.deaths.entry(key).or_default().insert(loss.owner.instance.clone());
            }
        }
        Ok(lost)
    }
}
