//! When to ask for what has not come: first after a pause, then at doubling intervals up to eight times that.
//!
//! Whoever works on an order publishes all that it makes of it at once. While nothing of it has come, one question is as
//! good as many: a model that takes seconds would be asked for each of its frames again and again. An order is asked for
//! later than anything else, for whoever is done waits for the slowest of all, and orders are repeated besides.

use std::collections::{BTreeMap, BTreeSet};

use ds_topic::{Role, Slot, Topic};

use crate::clock::Millis;
use crate::due;

/// How much longer than for other messages an order is waited for before it is asked for.
const ORDER_PATIENCE: u64 = 5;

/// Returns of missing messages those that are worth asking for: all that are `published`, and of each maker the first of
/// the others.
pub(crate) fn worthwhile(missing: &[Slot], published: impl Fn(Slot, Role) -> bool) -> BTreeSet<Slot> {
    let mut probed = BTreeSet::new();
    let asked = |slot: &&Slot| due::maker(slot.topic).is_none_or(|role| published(**slot, role) || probed.insert(role));
    missing.iter().filter(asked).copied().collect()
}

#[derive(Debug, Clone, Copy)]
struct Awaited {
    since: Millis,
    ask_at: Millis,
    tries: u32,
}

/// The messages that are awaited.
#[derive(Debug, Default)]
pub(crate) struct Pulls {
    awaited: BTreeMap<Slot, Awaited>,
}

impl Pulls {
    /// Replaces what is awaited, keeping the history of what stays, and returns what to ask for now of what is `worth` it,
    /// with the number of earlier tries.
    pub(crate) fn due(
        &mut self,
        now: Millis,
        pause_ms: u64,
        missing: &[Slot],
        worth: &BTreeSet<Slot>,
    ) -> Vec<(Slot, u32)> {
        let mut before = std::mem::take(&mut self.awaited);
        let mut asked = Vec::new();
        for slot in missing {
            let pause_ms = if slot.topic == Topic::Advance { ORDER_PATIENCE * pause_ms } else { pause_ms };
            let fresh = Awaited { since: now, ask_at: now.plus(pause_ms), tries: 0 };
            let mut awaited = before.remove(slot).unwrap_or(fresh);
            if awaited.ask_at <= now && worth.contains(slot) {
                asked.push((*slot, awaited.tries));
                awaited.tries += 1;
                awaited.ask_at = now.plus(pause_ms << awaited.tries.min(4).saturating_sub(1));
            }
            self.awaited.insert(*slot, awaited);
        }
        asked
    }

    /// Makes a slot be asked for as if it were newly awaited, because its owner changed.
    pub(crate) fn restart(&mut self, now: Millis, which: impl Fn(Slot) -> bool) {
        for (slot, awaited) in &mut self.awaited {
            if which(*slot) {
                awaited.ask_at = now;
                awaited.tries = 0;
            }
        }
    }

    /// Lists what is awaited and since when.
    pub(crate) fn awaited(&self) -> impl Iterator<Item = (Slot, Millis)> + '_ {
        self.awaited.iter().map(|(slot, awaited)| (*slot, awaited.since))
    }
}
