//! How the ego and the world move through a clip: on the log, beside it, or slower than it.
//!
//! A training clip starts at a drawn tick of the expert's drive and follows it at another speed, on a drawn lateral
//! offset that drifts with a drawn heading error, so that a model sees what a policy under test will show it. A long
//! clip stretches the log: between ticks, poses are interpolated and speeds scaled.

use ds_space::{DVec2, Draws, PoseSe2, SimTime, Tick};
use ds_world::{AgentState, EgoState, Scene, WorldState};

/// The way through a clip; rates are ticks of the log a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// The tick of the log at the first frame.
    pub from_tick: f64,
    /// How fast the world goes.
    pub world_rate: f64,
    /// How fast the ego goes.
    pub ego_rate: f64,
    /// Beside the log at the first frame, left positive, in metres.
    pub offset_m: f64,
    /// Away from the log's heading, in radians.
    pub heading_rad: f64,
}

impl Drive {
    /// Follows the log over a number of frames; stretches it where it is too short.
    #[must_use]
    pub fn on_log(scene: &Scene, frames: usize) -> Self {
        let last = f64::from(scene.last_tick().0);
        let rate = (last / frames.saturating_sub(1).max(1) as f64).min(1.0);
        Self { from_tick: 0.0, world_rate: rate, ego_rate: rate, offset_m: 0.0, heading_rad: 0.0 }
    }

    /// Draws a drive that strays from the log.
    #[must_use]
    pub fn stray(scene: &Scene, frames: usize, draws: &Draws) -> Self {
        let calm = draws.uniform(3) < 0.3;
        let spread = if calm { 0.0 } else { 1.0 };
        let speed_share = if calm { 1.0 } else { draws.range(4, 0.4, 1.3) };
        let last = (f64::from(scene.last_tick().0) - frames as f64 * speed_share.max(1.0)).max(0.0);
        Self {
            from_tick: draws.range(5, 0.0, last).floor(),
            world_rate: 1.0,
            ego_rate: speed_share,
            offset_m: spread * 0.7 * draws.normal(6),
            heading_rad: spread * 0.04 * draws.normal(7),
        }
    }

    /// Returns the world of a frame, the ego where this drive takes it.
    #[must_use]
    pub fn world(&self, scene: &Scene, frame: usize) -> WorldState {
        let at = self.from_tick + frame as f64 * self.world_rate;
        let (tick, share) = split(at);
        let mut world = scene.logged_world(Tick(tick));
        if self.world_rate < 1.0 {
            let after = scene.logged_world(Tick(tick + 1));
            for agent in &mut world.agents {
                *agent = between(agent, &after, share);
                agent.velocity_mps *= self.world_rate;
            }
            // What falls and blinks is keyed by the frame, not by the log.
            world.tick = Tick(u32::try_from(frame).unwrap_or(u32::MAX));
            world.time = SimTime::at(world.tick, scene.dt);
        }
        world.ego = self.ego(scene, frame);
        world
    }

    fn ego(&self, scene: &Scene, frame: usize) -> EgoState {
        let (tick, share) = split(self.from_tick + frame as f64 * self.ego_rate);
        let (a, b) = (scene.logged_ego(Tick(tick)), scene.logged_ego(Tick(tick + 1)));
        let on_log = a.pose.lerp(&b.pose, share);
        let start = scene.logged_ego(Tick(split(self.from_tick).0)).pose.position;
        let travelled = on_log.position.distance(start).min(30.0);
        let offset = self.offset_m + travelled * self.heading_rad;
        let local = PoseSe2 { position: DVec2::new(0.0, offset), heading_rad: self.heading_rad };
        EgoState { pose: on_log.compose(&local), velocity_mps: a.velocity_mps * self.ego_rate, ..*a }
    }
}

fn split(at: f64) -> (u32, f64) {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "ticks are small and not negative")]
    let tick = at.floor() as u32;
    (tick, at - at.floor())
}

/// Returns an agent on its way to where it is in a later world; one that is gone by then stays.
fn between(agent: &AgentState, after: &WorldState, share: f64) -> AgentState {
    let Some(next) = after.agents.iter().find(|other| other.id == agent.id) else { return agent.clone() };
    AgentState {
        pose: agent.pose.lerp(&next.pose, share),
        z_m: agent.z_m + share * (next.z_m - agent.z_m),
        velocity_mps: agent.velocity_mps.lerp(next.velocity_mps, share),
        ..agent.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_scenario::Family;

    #[test]
    fn a_stretched_log_reaches_its_end_with_the_last_frame_and_moves_evenly() {
        let scene = ds_scenario::generate(Family::LeadBraking, 3);
        let drive = Drive::on_log(&scene, 301);
        let end = drive.world(&scene, 300);
        let gap = end.ego.pose.position.distance(scene.logged_ego(scene.last_tick()).pose.position);
        assert!(gap < 1e-6, "{gap} m from the end of the log");
        // Each second frame is a tick of the log: there the agents are where the log has them.
        for tick in [10u32, 77] {
            let (slow, logged) = (drive.world(&scene, 2 * tick as usize), scene.logged_world(Tick(tick)));
            for (a, b) in slow.agents.iter().zip(&logged.agents) {
                assert!(a.pose.position.distance(b.pose.position) < 1e-9);
                assert!((a.velocity_mps - b.velocity_mps * 0.5).length() < 1e-9);
            }
        }
    }

    #[test]
    fn a_short_clip_on_the_log_is_the_log() {
        let scene = ds_scenario::generate(Family::CutIn, 3);
        let drive = Drive::on_log(&scene, 21);
        let (world, logged) = (drive.world(&scene, 7), scene.logged_world(Tick(7)));
        assert_eq!((world.tick, &world.agents, &world.lights), (logged.tick, &logged.agents, &logged.lights));
        let gap = world.ego.pose.position.distance(logged.ego.pose.position);
        assert!(gap < 1e-9 && (world.ego.pose.heading_rad - logged.ego.pose.heading_rad).abs() < 1e-9);
    }
}
