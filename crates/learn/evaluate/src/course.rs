//! The course of a drive: which moment of the log each frame shows.
//!
//! Frame k shows log time start + k·pace, in ticks; at the end of the log the drive turns back in time, and at its
//! beginning forward again, so that a drive is as long as wanted and every frame has a true counterpart. Between ticks,
//! poses are mixed.

use std::sync::Arc;

use ds_space::Tick;
use ds_world::{Scene, WorldState};

/// A drive along a log.
#[derive(Debug, Clone)]
pub struct Course {
    scene: Arc<Scene>,
    start: f64,
    pace: f64,
}

impl Course {
    /// Starts at a tick of the log and moves on by `pace` ticks a frame; a start behind the end counts as the end.
    #[must_use]
    pub fn new(scene: Arc<Scene>, start: u32, pace: f64) -> Self {
        let start = f64::from(start.min(scene.last_tick().0));
        Self { scene, start, pace }
    }

    /// Returns the scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Returns the log time of a frame, in ticks.
    #[must_use]
    pub fn time(&self, frame: u32) -> f64 {
        let last = f64::from(self.scene.last_tick().0);
        if last <= 0.0 {
            return 0.0;
        }
        let there_and_back = (self.start + f64::from(frame) * self.pace).rem_euclid(2.0 * last);
        if there_and_back > last { 2.0 * last - there_and_back } else { there_and_back }
    }

    /// Returns the world that a frame shows.
    #[must_use]
    pub fn world(&self, frame: u32) -> WorldState {
        let time = self.time(frame);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "times lie within the log")]
        let tick = time.floor() as u32;
        let share = time - f64::from(tick);
        let mut world = self.scene.logged_world(Tick(tick));
        if share < 1e-9 {
            return world;
        }
        let later = self.scene.logged_world(Tick(tick + 1));
        world.ego.pose = world.ego.pose.lerp(&later.ego.pose, share);
        for agent in &mut world.agents {
            if let Ok(index) = later.agents.binary_search_by_key(&agent.id, |other| other.id) {
                agent.pose = agent.pose.lerp(&later.agents[index].pose, share);
            }
        }
        world
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_scenario::Family;

    #[test]
    fn a_course_follows_the_log_and_turns_at_its_ends() {
        let scene = Arc::new(ds_scenario::generate(Family::LeadBraking, 1));
        let course = Course::new(Arc::clone(&scene), 0, 1.0);
        assert_eq!(course.world(7), scene.logged_world(Tick(7)));
        assert_eq!(course.world(160), scene.logged_world(Tick(140)), "150 is the last tick of the log");
        assert_eq!(course.world(300), scene.logged_world(Tick(0)));
        let slow = Course::new(Arc::clone(&scene), 10, 0.5);
        assert_eq!(slow.world(4), scene.logged_world(Tick(12)));
        let (before, between, after) = (slow.world(4), slow.world(5), slow.world(6));
        let middle = before.ego.pose.position.midpoint(after.ego.pose.position);
        assert!(between.ego.pose.position.distance(middle) < 1e-9);
        let agent = between.agents[0].pose.position;
        assert!(agent.distance(before.agents[0].pose.position.midpoint(after.agents[0].pose.position)) < 1e-9);
        assert_eq!(Course::new(scene, 900, 1.0).time(0), 150.0);
    }
}
