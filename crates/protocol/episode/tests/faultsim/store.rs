//! What outlives processes in the simulation: the ledger and the journal, both fenced by the term; and the checks that
//! watch every process from outside.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use ds_episode::fleet::{Ledger, LedgerError, Write};
use ds_space::{Digest, InstanceId};
use ds_topic::{Envelope, Role, Slot};

/// The durable part.
#[derive(Default)]
pub(crate) struct Store {
    term: u64,
    entries: BTreeMap<String, Vec<u8>>,
    /// Committed messages, in journal order.
    pub journal: Vec<Envelope>,
    pub iterations: u32,
}

impl Store {
    /// Appends an iteration durably, or names the term in charge.
    pub(crate) fn append(&mut self, term: u64, iteration: u32, messages: Vec<Envelope>) -> Result<(), u64> {
        if term != self.term {
            return Err(self.term);
        }
        assert_eq!(iteration, self.iterations, "iterations are committed once and in order");
        self.journal.extend(messages);
        self.iterations += 1;
        Ok(())
    }

    /// Finds a committed message.
    pub(crate) fn find(&self, slot: Slot) -> Option<Envelope> {
        self.journal.iter().find(|message| message.header.slot == slot).cloned()
    }

    /// Returns the content of every committed output.
    pub(crate) fn contents(&self) -> BTreeMap<Slot, Digest> {
        let outputs = self.journal.iter().filter(|message| ds_episode::due::maker(message.header.slot.topic).is_some());
        outputs.map(|message| (message.header.slot, message.header.content)).collect()
    }
}

/// A handle on the store for a fleet.
#[derive(Clone, Default)]
pub(crate) struct SharedStore(pub Rc<RefCell<Store>>);

impl Ledger for SharedStore {
    fn raise_term(&mut self) -> Result<u64, LedgerError> {
        let mut store = self.0.borrow_mut();
        store.term += 1;
        Ok(store.term)
    }

    fn term(&self) -> Result<u64, LedgerError> {
        Ok(self.0.borrow().term)
    }

    fn entries(&self, prefix: &str) -> Result<Vec<(String, Vec<u8>)>, LedgerError> {
        let store = self.0.borrow();
        let found = store.entries.iter().filter(|(key, _)| key.starts_with(prefix));
        Ok(found.map(|(key, value)| (key.clone(), value.clone())).collect())
    }

    fn commit(&mut self, term: u64, writes: &[Write]) -> Result<(), LedgerError> {
        let mut store = self.0.borrow_mut();
        if store.term != term {
            return Err(LedgerError::Fenced { own: term, current: store.term });
        }
        for (key, value) in writes {
            match value {
                Some(value) => store.entries.insert(key.clone(), value.clone()),
                None => store.entries.remove(key),
            };
        }
        Ok(())
    }
}

/// What must hold whatever happens; a breach panics with the seed in the test's message.
#[derive(Default)]
pub(crate) struct Checks {
    granted: BTreeMap<(Role, u64), InstanceId>,
    accepted: BTreeMap<(Role, u64), InstanceId>,
    made: BTreeMap<(Role, u64, Slot), Digest>,
    executed: BTreeMap<(InstanceId, u64, u32), u32>,
    latest: BTreeMap<Role, u64>,
}

impl Checks {
    /// An epoch was given out: never twice, always a higher one.
    pub(crate) fn grant(&mut self, role: Role, epoch: u64, instance: &InstanceId) {
        let other = self.granted.insert((role, epoch), instance.clone());
        assert_eq!(other, None, "epoch {epoch} of {role} was granted twice");
        let latest = self.latest.insert(role, epoch);
        assert!(latest.is_none_or(|latest| latest < epoch), "epoch {epoch} of {role} after {latest:?}");
    }

    /// Returns who held a role in an epoch.
    pub(crate) fn holder(&self, role: Role, epoch: u64) -> Option<InstanceId> {
        self.granted.get(&(role, epoch)).cloned()
    }

    /// A message was used as an input or committed: one publisher per epoch, and the one it was granted to.
    pub(crate) fn accept(&mut self, message: &Envelope) {
        let header = &message.header;
        let Some(role) = ds_episode::due::maker(header.slot.topic) else { return };
        let key = (role, header.epoch);
        assert_eq!(self.granted.get(&key), Some(&header.publisher), "{} of epoch {}", header.slot, header.epoch);
        let owner = self.accepted.entry(key).or_insert_with(|| header.publisher.clone());
        assert_eq!(*owner, header.publisher, "two owners were accepted in epoch {} of {role}", header.epoch);
    }

    /// A maker was told to work: once per instance, epoch and iteration.
    pub(crate) fn execute(&mut self, instance: &InstanceId, epoch: u64, iteration: u32) {
        let times = self.executed.entry((instance.clone(), epoch, iteration)).or_default();
        *times += 1;
        assert_eq!(*times, 1, "{instance} executed iteration {iteration} twice in epoch {epoch}");
    }

    /// A message was published: by the latest holder alone, with one content per epoch.
    pub(crate) fn publish(&mut self, message: &Envelope, leased: bool) {
        let header = &message.header;
        let Some(role) = ds_episode::due::maker(header.slot.topic) else { return };
        assert!(leased, "{} published {} after its lease ran out", header.publisher, header.slot);
        let latest = self.latest.get(&role).copied();
        assert_eq!(
            latest,
            Some(header.epoch),
            "{} published {} after a successor was named",
            header.publisher,
            header.slot
        );
        let content = self.made.entry((role, header.epoch, header.slot)).or_insert(header.content);
        assert_eq!(*content, header.content, "{} has two contents in epoch {}", header.slot, header.epoch);
    }
}
