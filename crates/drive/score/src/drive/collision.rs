//! `collision`: 1 unless the ego touched something by its own fault, then 0 for good.
//!
//! Fault is as the simulator judged it. Agents that already touch the ego in the first state are left out throughout,
//! so that an overlap in the log is nobody's fault.

use ds_space::AgentId;
use ds_world::WorldState;

/// The touches of a drive so far.
#[derive(Debug, Clone, Default)]
pub(crate) struct Collision {
    overlapping_at_start: Option<Vec<AgentId>>,
    at_fault: bool,
}

impl Collision {
    /// Takes the next state.
    pub(crate) fn observe(&mut self, world: &WorldState) {
        let left_out = self
            .overlapping_at_start
            .get_or_insert_with(|| world.contacts.iter().map(|contact| contact.agent).collect());
        self.at_fault |= world.contacts.iter().any(|contact| contact.at_fault && !left_out.contains(&contact.agent));
    }

    /// Returns the score so far; `None` before the first state.
    pub(crate) fn score(&self) -> Option<f64> {
        self.overlapping_at_start.as_ref().map(|_| if self.at_fault { 0.0 } else { 1.0 })
    }
}

#[cfg(test)]
mod tests {
    use ds_space::{SimTime, Tick};
    use ds_world::{Contact, ContactKind, EgoState};

    use super::*;

    #[test]
    fn only_own_fault_costs_and_first_overlaps_are_left_out() {
        let contact = |agent, at_fault| Contact {
            agent: AgentId(agent),
            kind: ContactKind::Side,
            at_fault,
            closing_speed_mps: 1.0,
        };
        let mut collision = Collision::default();
        assert_eq!(collision.score(), None);
        for (tick, (contacts, expected)) in (0..).zip([
            (vec![contact(3, true)], 1.0),
            (vec![contact(3, true), contact(5, false)], 1.0),
            (vec![contact(6, true)], 0.0),
            (vec![], 0.0),
        ]) {
            let (tick, time, ego) = (Tick(tick), SimTime(0), EgoState::default());
            let world = WorldState { tick, time, ego, agents: Vec::new(), lights: Vec::new(), contacts };
            collision.observe(&world);
            assert_eq!(collision.score(), Some(expected), "{tick:?}");
        }
    }
}
