//! Agents as boxes per step, ready to be tested against proposals.
//!
//! First-seen rule: the box is taken per step, class and standing from the first step in which the agent appears
//! (PDM `observation/pdm_observation.py:287-295`).

use ds_space::PoseSe2;
use ds_space::plane::{Bounds, OrientedBox};

use super::input::{AgentTrack, ObjectClass};
use crate::constants::navsim::STOPPED_MPS;
use crate::error::{ScoreError, finite, sized};

/// One agent over the horizon.
#[derive(Debug, Clone)]
pub struct TrafficAgent {
    /// Who it is.
    pub id: u32,
    /// What it is.
    pub class: ObjectClass,
    /// Whether it stood still when first seen; static objects always do.
    pub stopped: bool,
    /// Its box per step, `None` where absent.
    pub boxes: Vec<Option<OrientedBox>>,
    /// Around all its boxes.
    pub bounds: Bounds,
}

/// All agents over the horizon.
#[derive(Debug, Clone, Default)]
pub struct Traffic {
    agents: Vec<TrafficAgent>,
}

impl Traffic {
    /// Prepares the first `steps` steps of the tracks.
    ///
    /// # Errors
    /// [`ScoreError::NoSize`] or [`ScoreError::NotFinite`] name the agent.
    pub fn new(tracks: &[AgentTrack], steps: usize) -> Result<Self, ScoreError> {
        let mut agents = Vec::with_capacity(tracks.len());
        for (index, track) in tracks.iter().enumerate() {
            check(index, track)?;
            agents.extend(prepare(track, steps));
        }
        Ok(Self { agents })
    }

    /// Leaves out every agent whose box touches a footprint at step 0, at all steps (log replay policy of v2).
    pub fn leave_out_touching(&mut self, footprint: &OrientedBox) {
        let touches =
            |agent: &TrafficAgent| agent.boxes.first().copied().flatten().is_some_and(|first| first.touches(footprint));
        self.agents.retain(|agent| !touches(agent));
    }

    /// Returns the agents that are left.
    #[must_use]
    pub fn agents(&self) -> &[TrafficAgent] {
        &self.agents
    }
}

fn check(index: usize, track: &AgentTrack) -> Result<(), ScoreError> {
    sized(track.length_m, track.width_m, || format!("agents[{index}]"))?;
    for (step, moving) in track.steps.iter().enumerate() {
        let Some(moving) = moving else { continue };
        let PoseSe2 { position, heading_rad } = moving.pose;
        let velocity = moving.velocity_mps;
        let numbers = [position.x, position.y, heading_rad, velocity.x, velocity.y];
        for (name, value) in ["x", "y", "heading", "vx", "vy"].into_iter().zip(numbers) {
            finite(value, || format!("agents[{index}].steps[{step}].{name}"))?;
        }
    }
    Ok(())
}

fn prepare(track: &AgentTrack, steps: usize) -> Option<TrafficAgent> {
    let steps = &track.steps[..steps.min(track.steps.len())];
    let first_seen = steps.iter().flatten().next()?;
    let boxes: Vec<Option<OrientedBox>> = steps
        .iter()
        .map(|moving| moving.map(|moving| OrientedBox::new(&moving.pose, track.length_m, track.width_m)))
        .collect();
    let bounds = boxes.iter().flatten().fold(Bounds::EMPTY, |all, one| all.union(&one.bounds()));
    let stopped = track.class == ObjectClass::Static || first_seen.velocity_mps.length() <= STOPPED_MPS;
    Some(TrafficAgent { id: track.id, class: track.class, stopped, boxes, bounds })
}
