//! `collision`: 1 unless the ego touched something by its own fault, then 0 for good.
//!
//! Fault is as the simulator judged it. Agents that already touch the ego in the first state are left out throughout,
//! so that an overlap in the log is nobody's fault.

use ds_space::{AgentId, Tick};
use ds_world::WorldState;

#[derive(Debug, Clone, Default)]
pub(crate) struct Collision {
    overlapping_at_start: Option<Vec<AgentId>>,
    pub(crate) first_contact: Option<Tick>,
    pub(crate) first_at_fault: Option<Tick>,
}

impl Collision {
    /// Takes the next state; returns 0 if the ego is in an at-fault contact in it, else 1.
    pub(crate) fn observe(&mut self, world: &WorldState) -> f64 {
        let left_out = self
            .overlapping_at_start
            .get_or_insert_with(|| world.contacts.iter().map(|contact| contact.agent).collect());
        let mut score = 1.0;
        for contact in world.contacts.iter().filter(|contact| !left_out.contains(&contact.agent)) {
            self.first_contact.get_or_insert(world.tick);
            if contact.at_fault {
                self.first_at_fault.get_or_insert(world.tick);
                score = 0.0;
            }
        }
        score
    }

    /// Returns the score so far.
    pub(crate) fn score(&self) -> f64 {
        if self.first_at_fault.is_some() { 0.0 } else { 1.0 }
    }
}
