//! Distance along a route, followed from state to state so that a route that crosses itself is read in order.
//!
//! Each reading looks only at the route from 15 m before to 30 m after the last one.

use ds_space::DVec2;
use ds_space::plane::Polyline;
use ds_world::Scene;

const BEHIND_M: f64 = 15.0;
const AHEAD_M: f64 = 30.0;
/// A drive shorter than this is a standing one: nothing to be measured against.
pub(crate) const SHORTEST_M: f64 = 1.0;

/// A place on a route that moves with its vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Odometer {
    along_m: f64,
    /// Distance of the last position from the route, in metres.
    pub(crate) beside_m: f64,
}

impl Odometer {
    /// Starts at a known distance along the route.
    pub(crate) fn new(along_m: f64) -> Self {
        Self { along_m, beside_m: 0.0 }
    }

    /// Moves to the place nearest to a position and returns its distance along the route.
    pub(crate) fn read(&mut self, route: &Polyline, position: DVec2) -> f64 {
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
        self.beside_m = nearest.sqrt();
        self.along_m
    }
}

/// The route and where the logged expert was on it at each tick.
#[derive(Debug, Clone)]
pub(crate) struct Expert {
    pub(crate) route: Polyline,
    along_m: Vec<f64>,
}

impl Expert {
    /// Follows the logged drive along the scene's route, or along its own path where there is none. `None` if the
    /// expert does not move and there is no route.
    pub(crate) fn of(scene: &Scene) -> Option<Self> {
        let path: Vec<DVec2> = scene.ego_log.iter().map(|ego| ego.pose.position).collect();
        let route = Polyline::new(&scene.route).or_else(|| Polyline::new(&path))?;
        let mut odometer = Odometer::new(route.project(*path.first()?).along_m);
        let along_m = path.iter().map(|position| odometer.read(&route, *position)).collect();
        Some(Self { route, along_m })
    }

    /// Returns how far along the route the expert was at a tick, the last one held.
    pub(crate) fn along_m(&self, tick: ds_space::Tick) -> f64 {
        self.along_m[(tick.0 as usize).min(self.along_m.len() - 1)]
    }

    /// Returns how far along the route the log ends.
    pub(crate) fn end_m(&self) -> f64 {
        self.along_m[self.along_m.len() - 1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loop_is_read_in_order() {
        // A square of 60 m that comes back to its start and goes on along its first side.
        let corners = [(0.0, 0.0), (60.0, 0.0), (60.0, 60.0), (0.0, 60.0), (0.0, 0.0), (60.0, 0.0)];
        let route = Polyline::new(&corners.map(|(x, y)| DVec2::new(x, y))).expect("a line");
        let mut odometer = Odometer::new(0.0);
        for i in 0..=145 {
            let along_m = 2.0 * f64::from(i);
            let read_m = odometer.read(&route, route.at(along_m) + DVec2::new(0.1, 0.1));
            assert!((read_m - along_m).abs() < 0.3, "{read_m} at {along_m}");
        }
    }
}
