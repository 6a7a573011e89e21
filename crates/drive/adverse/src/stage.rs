//! Where an adversary is searched for: the scene with its bodies by tick, the road, and the body that it gets.

use ds_space::plane::OrientedBox;
use ds_space::{DVec2, Draws, PoseSe2, Tick};
use ds_vehicle::Rolling;
use ds_world::{AgentClass, AgentState, EgoState, Scene, Size, WorldState};

use crate::model::MotionModel;
use crate::road::Road;

/// The body of the adversary: boxes stand around their centre, cars roll on their rear axle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Body {
    pub size: Size,
}

impl Body {
    /// From the rear axle to the centre, in metres, at the share of the default ego.
    pub(crate) fn arm_m(&self) -> f64 {
        0.282 * self.size.length_m
    }

    pub(crate) fn wheel_base_m(&self) -> f64 {
        0.597 * self.size.length_m
    }

    pub(crate) fn centre(&self, car: &Rolling) -> PoseSe2 {
        PoseSe2 { position: car.pose.position + car.pose.forward() * self.arm_m(), heading_rad: car.pose.heading_rad }
    }

    pub(crate) fn rear(&self, centre: &PoseSe2) -> PoseSe2 {
        PoseSe2 { position: centre.position - centre.forward() * self.arm_m(), heading_rad: centre.heading_rad }
    }

    /// Returns the box of a car, grown by a margin to all sides.
    pub(crate) fn grown(&self, centre: &PoseSe2, margin_m: f64) -> OrientedBox {
        OrientedBox::new(centre, self.size.length_m + 2.0 * margin_m, self.size.width_m + 2.0 * margin_m)
    }
}

/// Returns the box of the ego, and the adversary.
pub(crate) fn pair<'a>(scene: &Scene, state: &'a WorldState) -> Option<(OrientedBox, &'a AgentState)> {
    let track = scene.adversary.as_ref()?.track;
    let adversary = state.agents.iter().find(|agent| agent.id == track)?;
    Some((ego_body(scene, &state.ego), adversary))
}

/// Returns the box of an ego of the scene's vehicle.
fn ego_body(scene: &Scene, ego: &EgoState) -> OrientedBox {
    scene.vehicle.size.footprint(&ego.centre(&scene.vehicle))
}

/// A scene made ready for the search.
#[derive(Debug)]
pub(crate) struct Stage<'a> {
    pub scene: &'a Scene,
    pub road: Road<'a>,
    pub model: &'a MotionModel,
    pub body: Body,
    pub dt_secs: f64,
    /// Logged bodies of others by tick.
    others: Vec<Vec<OrientedBox>>,
    /// The logged ego by tick.
    ego: Vec<OrientedBox>,
}

impl<'a> Stage<'a> {
    pub(crate) fn new(scene: &'a Scene, model: &'a MotionModel, draws: &Draws) -> Self {
        let boxes = |tick: Tick| {
            let seen = |track: &ds_world::Track| track.at(tick).map(|point| track.size.footprint(&point.pose));
            scene.tracks.iter().filter_map(seen).collect()
        };
        let ego = |tick: Tick| ego_body(scene, scene.logged_ego(tick));
        let ticks = Tick(0).to(scene.last_tick());
        Self {
            scene,
            road: Road::new(&scene.map),
            model,
            body: Body { size: footprint(scene, draws) },
            dt_secs: scene.dt.secs(),
            others: ticks.clone().map(boxes).collect(),
            ego: ticks.map(ego).collect(),
        }
    }

    pub(crate) fn ego(&self, tick: u32) -> &OrientedBox {
        &self.ego[tick as usize]
    }

    /// Returns the logged velocity of the ego in the world, in metres per second.
    pub(crate) fn ego_velocity(&self, tick: u32) -> DVec2 {
        let ego = self.scene.logged_ego(Tick(tick));
        ego.pose.forward() * ego.velocity_mps.x + ego.pose.left() * ego.velocity_mps.y
    }

    /// Says whether a body comes closer than a margin to anybody but the ego.
    pub(crate) fn meets_others(&self, tick: u32, grown: &OrientedBox) -> bool {
        self.others[tick as usize].iter().any(|other| other.touches(grown))
    }
}

/// Draws the size of a logged car of the scene, or takes that of the ego.
fn footprint(scene: &Scene, draws: &Draws) -> Size {
    let cars: Vec<Size> = scene
        .tracks
        .iter()
        .filter(|track| track.class == AgentClass::Vehicle && (3.2..=6.0).contains(&track.size.length_m))
        .map(|track| track.size)
        .collect();
    if cars.is_empty() { scene.vehicle.size } else { cars[draws.below(0, cars.len() as u64) as usize] }
}

/// Returns by how much two boxes overlap, and the unit normal from the first to the second along which that is least;
/// the overlap is negative if they are apart.
pub(crate) fn overlap(a: &OrientedBox, b: &OrientedBox) -> (f64, DVec2) {
    let offset = b.centre - a.centre;
    let mut least = (f64::INFINITY, DVec2::X);
    for axis in [a.forward, a.forward.perp(), b.forward, b.forward.perp()] {
        let reach = |one: &OrientedBox| {
            one.half_length_m * one.forward.dot(axis).abs() + one.half_width_m * one.forward.perp().dot(axis).abs()
        };
        let depth_m = reach(a) + reach(b) - offset.dot(axis).abs();
        if depth_m < least.0 {
            least = (depth_m, if offset.dot(axis) < 0.0 { -axis } else { axis });
        }
    }
    least
}

/// Returns the distance between two boxes, 0 where they touch.
pub(crate) fn gap_m(a: &OrientedBox, b: &OrientedBox) -> f64 {
    if a.touches(b) {
        return 0.0;
    }
    let from = |one: &OrientedBox, other: &OrientedBox| {
        let away = |corner: DVec2| {
            let offset = corner - other.centre;
            let local = DVec2::new(offset.dot(other.forward), other.forward.perp_dot(offset)).abs();
            (local - DVec2::new(other.half_length_m, other.half_width_m)).max(DVec2::ZERO).length()
        };
        one.corners().map(away).into_iter().fold(f64::INFINITY, f64::min)
    };
    from(a, b).min(from(b, a))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_and_overlaps_by_table() {
        let car = |x: f64, y: f64, degrees: f64| OrientedBox::new(&PoseSe2::new(x, y, degrees.to_radians()), 4.0, 2.0);
        let ego = car(0.0, 0.0, 0.0);
        for (other, gap, depth, normal) in [
            (car(5.0, 0.0, 0.0), 1.0, -1.0, DVec2::X),
            (car(3.8, 0.5, 0.0), 0.0, 0.2, DVec2::X),
            (car(0.0, -2.9, 90.0), 0.0, 0.1, DVec2::NEG_Y),
            (car(7.0, 6.0, 0.0), 5.0, -4.0, DVec2::Y),
        ] {
            assert!((gap_m(&ego, &other) - gap).abs() < 1e-9, "{other:?}");
            let (got, axis) = overlap(&ego, &other);
            assert!((got - depth).abs() < 1e-9 && axis.distance(normal) < 1e-9, "{other:?}: {got} {axis}");
        }
    }
}
