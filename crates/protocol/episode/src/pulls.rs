//! When to ask for what has not come: first after a pause, then at doubling intervals up to eight times that.

use std::collections::BTreeMap;

use ds_topic::Slot;

use crate::clock::Millis;

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
    /// Replaces what is awaited, keeping the history of what stays, and returns what to ask for now, with the number of
    /// earlier tries.
    pub(crate) fn due(&mut self, now: Millis, pause_ms: u64, missing: &[Slot]) -> Vec<(Slot, u32)> {
        let mut before = std::mem::take(&mut self.awaited);
        let mut asked = Vec::new();
        for slot in missing {
            let fresh = Awaited { since: now, ask_at: now.plus(pause_ms), tries: 0 };
            let mut awaited = before.remove(slot).unwrap_or(fresh);
            if awaited.ask_at <= now {
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
