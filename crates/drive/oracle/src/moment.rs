//! A rollout: 41 states of the ego and the agents beside it, from now on at 10 Hz.

use std::collections::BTreeMap;

use ds_score::{AgentTrack, Executed, MovingBox, VehicleState};
use ds_sim::Simulation;
use ds_world::{LightState, Trajectory, WorldState};

/// Number of states of a rollout: now and 40 steps.
pub(crate) const STATES: usize = 41;

/// What came of driving a trajectory in a copy of the world.
#[derive(Debug, Clone)]
pub(crate) struct Driven {
    /// The ego, rear axle.
    pub(crate) states: Box<Executed>,
    /// All agents that were there at some step.
    pub(crate) tracks: Vec<AgentTrack>,
    /// The lights of each step.
    pub(crate) lights: Vec<Vec<LightState>>,
}

impl Driven {
    /// Drives a trajectory, whose poses are in the rig frame now.
    pub(crate) fn of(now: &Simulation, trajectory: &Trajectory) -> Self {
        let mut copy = now.rollout();
        copy.begin_plan(trajectory);
        let mut states = Box::new([VehicleState::default(); STATES]);
        let mut agents: BTreeMap<u32, AgentTrack> = BTreeMap::new();
        let mut lights = Vec::with_capacity(STATES);
        for (step, state) in states.iter_mut().enumerate() {
            if step > 0 {
                copy.step();
            }
            let world = copy.state();
            *state = VehicleState::from(&world.ego);
            lights.push(world.lights.clone());
            note(&mut agents, world, step);
        }
        Self { states, tracks: agents.into_values().collect(), lights }
    }
}

fn note(agents: &mut BTreeMap<u32, AgentTrack>, world: &WorldState, step: usize) {
    for agent in &world.agents {
        let track = agents.entry(agent.id.0).or_insert_with(|| AgentTrack {
            id: agent.id.0,
            class: agent.class.into(),
            length_m: agent.size.length_m,
            width_m: agent.size.width_m,
            steps: vec![None; STATES],
        });
        track.steps[step] = Some(MovingBox { pose: agent.pose, velocity_mps: agent.velocity_mps });
    }
}
