//! `progress`: the ego's distance along the route ÷ the logged expert's over the same ticks, clipped to 0..=1.
//!
//! Not applicable while the expert has moved less than 1 m. Distances are read from state to state, each reading looking only
//! at the route from 15 m before to 30 m after the last one, so that a route that crosses itself is read in order.

use ds_space::plane::Polyline;
use ds_space::{DVec2, Tick};
use ds_world::Scene;

const BEHIND_M: f64 = 15.0;
const AHEAD_M: f64 = 30.0;
/// A drive shorter than this is a standing one: nothing to be measured against.
const SHORTEST_M: f64 = 1.0;

/// How far the ego and the expert have come since the first state.
#[derive(Debug, Clone)]
pub(crate) struct Progress {
    expert: Option<Expert>,
    travel: Option<Travel>,
}

#[derive(Debug, Clone, Copy)]
struct Travel {
    odometer: Odometer,
    ego_start_m: f64,
    expert_start_m: f64,
    ego_m: f64,
    expert_m: f64,
}

impl Progress {
    /// Prepares to measure a drive through a scene.
    pub(crate) fn new(scene: &Scene) -> Self {
        Self { expert: Expert::of(scene), travel: None }
    }

    /// Takes the ego's position at the next tick; the first one is where the drive is measured from.
    pub(crate) fn observe(&mut self, tick: Tick, position: DVec2) {
        let Some(expert) = &self.expert else { return };
        let expert_along_m = expert.along_m(tick);
        let mut odometer = self.travel.map_or(Odometer { along_m: expert_along_m }, |travel| travel.odometer);
        let along_m = odometer.read(&expert.route, position);
        let ego_start_m = self.travel.map_or(along_m, |travel| travel.ego_start_m);
        let expert_start_m = self.travel.map_or(expert_along_m, |travel| travel.expert_start_m);
        let (ego_m, expert_m) = (along_m - ego_start_m, expert_along_m - expert_start_m);
        self.travel = Some(Travel { odometer, ego_start_m, expert_start_m, ego_m, expert_m });
    }

    /// Returns the score so far.
    pub(crate) fn score(&self) -> Option<f64> {
        let Travel { ego_m, expert_m, .. } = self.travel?;
        (expert_m >= SHORTEST_M).then(|| (ego_m / expert_m).clamp(0.0, 1.0))
    }
}

/// A place on a route that moves with its vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Odometer {
    along_m: f64,
}

impl Odometer {
    /// Moves to the place nearest to a position and returns its distance along the route.
    fn read(&mut self, route: &Polyline, position: DVec2) -> f64 {
        let (points, arcs_m) = (route.points(), route.arcs_m());
        let (first, last) = (route.segment_at(self.along_m - BEHIND_M), route.segment_at(self.along_m + AHEAD_M));
        let mut nearest = f64::INFINITY;
        for segment in first..=last {
            let edge = points[segment + 1] - points[segment];
            let share = ((position - points[segment]).dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
            let squared = (points[segment] + edge * share - position).length_squared();
            if squared < nearest {
                nearest = squared;
                self.along_m = arcs_m[segment] + share * (arcs_m[segment + 1] - arcs_m[segment]);
            }
        }
        self.along_m
    }
}

/// The route and where the logged expert was on it at each tick.
#[derive(Debug, Clone)]
struct Expert {
    route: Polyline,
    along_m: Vec<f64>,
}

impl Expert {
    /// Follows the logged drive along the scene's route, or along its own path where there is none. `None` if the
    /// expert does not move and there is no route.
    fn of(scene: &Scene) -> Option<Self> {
        let path: Vec<DVec2> = scene.ego_log.iter().map(|ego| ego.pose.position).collect();
        let route = Polyline::new(&scene.route).or_else(|| Polyline::new(&path))?;
        let mut odometer = Odometer { along_m: route.project(*path.first()?).along_m };
        let along_m = path.iter().map(|position| odometer.read(&route, *position)).collect();
        Some(Self { route, along_m })
    }

    /// Returns how far along the route the expert was at a tick, the last one held.
    fn along_m(&self, tick: Tick) -> f64 {
        self.along_m[(tick.0 as usize).min(self.along_m.len() - 1)]
    }
}

#[cfg(test)]
mod tests;
