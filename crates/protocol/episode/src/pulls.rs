//! When to ask for what has not come: first after a pause, then at doubling intervals up to eight times that.
//!
//! Whoever works on an order publishes all that it makes of it at once. While nothing of it has come, one question is as
//! good as many: a model that takes seconds would be asked for each of its frames again and again. An order is asked for
//! later than anything else, for whoever is done waits for the slowest of all, and orders are repeated besides. What came
//! late by itself the last time is asked for only when it takes twice as long: a steady episode asks nothing. The scene is
//! asked for at once: it was pushed before who plays a role was chosen, and the journal has it from the beginning.

use std::collections::{BTreeMap, BTreeSet};

use ds_topic::{Role, Slot, Topic};

use crate::clock::Millis;
use crate::due;

/// How much longer than for other messages an order is waited for before it is asked for.
const ORDER_PATIENCE: u64 = 5;

/// The longest that a message is waited for before it is asked for, in pauses.
const LONGEST_PAUSES: u64 = 50;

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
    /// Whether it was answered, so that its coming says nothing of how long it takes.
    answered: bool,
}

/// The messages that are awaited.
#[derive(Debug, Default)]
pub(crate) struct Pulls {
    awaited: BTreeMap<Slot, Awaited>,
    /// How long messages of each topic took of late, in milliseconds.
    usual_ms: BTreeMap<Topic, u64>,
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
        let here: BTreeSet<Slot> = missing.iter().copied().collect();
        for (slot, awaited) in before.iter().filter(|(slot, awaited)| !here.contains(slot) && !awaited.answered) {
            let usual_ms = self.usual_ms.entry(slot.topic).or_default();
            *usual_ms = (*usual_ms / 2).max(now.since(awaited.since));
        }
        for slot in missing {
            let longest_ms = LONGEST_PAUSES * pause_ms;
            let pause_ms = if slot.topic == Topic::Advance { ORDER_PATIENCE * pause_ms } else { pause_ms };
            let usual_ms = self.usual_ms.get(&slot.topic).copied().unwrap_or_default();
            let first_ms = match slot.topic {
                Topic::Scene => 0,
                _ => pause_ms.max((2 * usual_ms).min(longest_ms)),
            };
            let fresh = Awaited { since: now, ask_at: now.plus(first_ms), tries: 0, answered: false };
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

    /// Notes that a question was answered.
    pub(crate) fn answered(&mut self, slot: Slot) {
        if let Some(awaited) = self.awaited.get_mut(&slot) {
            awaited.answered = true;
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    const PAUSE_MS: u64 = 200;

    /// Awaits a frame from `from` on until it comes after `takes` and returns when it was asked for.
    fn asked(pulls: &mut Pulls, from: u64, takes: u64, answered: bool) -> Vec<u64> {
        let slot = Slot::new(Topic::Frame, 1);
        let mut asked = Vec::new();
        for at in (from..from + takes).step_by(100) {
            if !pulls.due(Millis(at), PAUSE_MS, &[slot], &BTreeSet::from([slot])).is_empty() {
                asked.push(at - from);
            }
        }
        if answered {
            pulls.answered(slot);
        }
        assert!(pulls.due(Millis(from + takes), PAUSE_MS, &[], &BTreeSet::new()).is_empty());
        asked
    }

    #[test]
    fn what_takes_long_every_time_is_asked_for_once_only() {
        let mut pulls = Pulls::default();
        assert_eq!(asked(&mut pulls, 0, 3_000, false), [200, 400, 800, 1_600]);
        assert!(asked(&mut pulls, 10_000, 3_000, false).is_empty());
        // A lost push is asked for after twice the usual time, and what an answer took teaches nothing.
        assert_eq!(asked(&mut pulls, 20_000, 6_200, true), [6_000]);
        assert_eq!(asked(&mut pulls, 30_000, 6_300, true), [6_000, 6_200]);
        // Fast again, it is waited for half as long each time; however slow, never for longer than 50 pauses.
        assert!(asked(&mut pulls, 40_000, 100, false).is_empty());
        assert_eq!(asked(&mut pulls, 50_000, 3_100, true), [3_000]);
        asked(&mut pulls, 60_000, 60_000, false);
        assert_eq!(asked(&mut pulls, 200_000, 10_100, true), [10_000]);
    }

    #[test]
    fn the_scene_is_asked_for_at_once_and_again_after_a_pause() {
        let (mut pulls, scene) = (Pulls::default(), Slot::new(Topic::Scene, 0));
        let mut asked = |at| !pulls.due(Millis(at), PAUSE_MS, &[scene], &BTreeSet::from([scene])).is_empty();
        let times: Vec<u64> = (0..1_000).step_by(50).filter(|at| asked(*at)).collect();
        assert_eq!(times, [0, 200, 600]);
    }
}
