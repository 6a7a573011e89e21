//! Where the ego is going, and whether it can still get away: a sample of what a point mass reaches after 0.5 s.
//!
//! Each escape holds a longitudinal and a lateral acceleration in the ego's frame of now; the body keeps its heading. A
//! sample can only miss ways out, so what it leaves open is open. World frame, ticks of 0.1 s.

use ds_space::plane::{OrientedBox, Path};
use ds_space::{DVec2, PoseSe2, angle};
use ds_vehicle::{Control, Rolling};
use ds_world::{VehicleParameters, WorldState};

const REACTION_TICKS: usize = 5;
/// How far it is looked ahead.
pub(crate) const TICKS: usize = 30;
const DT_SECS: f64 = 0.1;
const LONGITUDINAL_MPS2: [f64; 5] = [-7.6, -5.0, -2.5, 0.0, 2.5];
const LATERAL_MPS2: [f64; 5] = [-4.0, -2.0, 0.0, 2.0, 4.0];
/// How long the lateral acceleration lasts before it is taken back as long.
const SIDEWAYS_TICKS: usize = 8;
/// An ego that is farther from its route, or more turned from it, is not on it, in metres and radians.
const ON_ROUTE: (f64, f64) = (4.0, 1.0);
/// After so long the forecast ego is on its route, in seconds.
const ROUTE_SECS: f64 = 2.0;

/// The ways out that are on the road and clear of others.
pub(crate) struct Escapes {
    bodies: Vec<Vec<OrientedBox>>,
}

impl Escapes {
    /// Samples the ways out of a world.
    pub(crate) fn of(
        world: &WorldState,
        vehicle: &VehicleParameters,
        others: &[Vec<OrientedBox>],
        on_road: &dyn Fn(&OrientedBox) -> bool,
    ) -> Self {
        let mut bodies = Vec::new();
        for longitudinal in LONGITUDINAL_MPS2 {
            for lateral in LATERAL_MPS2 {
                let way = way_out(world, vehicle, longitudinal, lateral);
                let clear = way
                    .iter()
                    .zip(others)
                    .skip(REACTION_TICKS)
                    .step_by(3)
                    .all(|(body, others)| on_road(body) && !others.iter().any(|other| other.touches(body)));
                if clear {
                    bodies.push(way);
                }
            }
        }
        Self { bodies }
    }

    /// Says whether one of them stays clear of a body that moves so.
    pub(crate) fn remain(&self, threat: &[OrientedBox]) -> bool {
        self.bodies.iter().any(|way| !way.iter().zip(threat).any(|(body, threat)| body.touches(threat)))
    }
}

/// Returns the ego's body of the next ticks: as it moves now for the reaction, then with two held accelerations.
fn way_out(world: &WorldState, vehicle: &VehicleParameters, ahead: f64, aside: f64) -> Vec<OrientedBox> {
    let ego = &world.ego;
    let centre = ego.centre(vehicle);
    let body = vehicle.size.footprint(&centre);
    let (mut offset, mut aside_mps, mut speed) = (DVec2::ZERO, 0.0, ego.speed_mps().max(0.0));
    let mut forward = centre.forward();
    let step = |i: usize| {
        let mut turned = forward;
        if i < REACTION_TICKS {
            turned = DVec2::from_angle(forward.to_angle() + ego.yaw_rate_radps * DT_SECS);
        } else {
            let since = i - REACTION_TICKS;
            let push = if since < SIDEWAYS_TICKS {
                aside
            } else if since < 2 * SIDEWAYS_TICKS {
                -aside
            } else {
                0.0
            };
            // A car that stands goes nowhere sideways.
            aside_mps = if speed < 0.5 { 0.0 } else { aside_mps + push * DT_SECS };
            speed = (speed + ahead * DT_SECS).max(0.0);
        }
        forward = turned;
        offset += forward * (speed * DT_SECS) + forward.perp() * (aside_mps * DT_SECS);
        OrientedBox { centre: body.centre + offset, forward, ..body }
    };
    (0..TICKS).map(step).collect()
}

/// Returns the ego's bodies of the next ticks from its executed state: at constant acceleration and turn rate, which go over
/// into its route.
pub(crate) fn forecast_ego(
    world: &WorldState,
    vehicle: &VehicleParameters,
    dt_secs: f64,
    route: Option<&Path>,
) -> Vec<OrientedBox> {
    let ego = &world.ego;
    let mut car = Rolling { pose: ego.pose, speed_mps: ego.speed_mps().max(0.0) };
    let bend_pm = if car.speed_mps > 0.5 { ego.yaw_rate_radps / car.speed_mps } else { 0.0 };
    let on_route = route.and_then(|route| {
        let foot = route.nearest(ego.pose.position);
        let turned_rad = angle::turn(route.heading_rad(foot.station_m), ego.pose.heading_rad);
        (foot.left_m.abs() < ON_ROUTE.0 && turned_rad.abs() < ON_ROUTE.1).then_some((route, foot))
    });
    let mut way_m = 0.0;
    let step = |i: usize| {
        // Acceleration fades: nobody brakes for three seconds because of one moment.
        let fade = (1.0 - i as f64 * dt_secs / 1.5).max(0.0);
        let control = Control {
            acceleration_mps2: ego.acceleration_mps2.x.clamp(-8.0, 3.0) * fade,
            curvature_pm: bend_pm.clamp(-0.2, 0.2),
        };
        let before_mps = car.speed_mps;
        car = car.forwards(control, dt_secs);
        way_m += 0.5 * (before_mps + car.speed_mps) * dt_secs;
        let share = ((i + 1) as f64 * dt_secs / ROUTE_SECS).min(1.0);
        let pose = on_route.as_ref().map_or(car.pose, |(route, foot)| {
            let on = route.pose(foot.station_m + way_m);
            let beside = on.position + on.left() * (foot.left_m * (1.0 - share));
            car.pose.lerp(&PoseSe2 { position: beside, heading_rad: on.heading_rad }, share)
        });
        let centre = PoseSe2 {
            position: pose.position + pose.forward() * vehicle.rear_axle_to_centre_m,
            heading_rad: pose.heading_rad,
        };
        vehicle.size.footprint(&centre)
    };
    (0..TICKS).map(step).collect()
}

#[cfg(test)]
mod tests {
    use ds_space::{SimTime, Tick};
    use ds_world::EgoState;

    use super::*;

    #[test]
    fn an_ego_on_its_route_is_forecast_onto_it_and_one_that_left_it_is_not() {
        let route = Path::new(&[DVec2::new(-50.0, 0.0), DVec2::new(0.0, 0.0), DVec2::new(40.0, 40.0)]);
        let forecast = |left_m: f64, route: Option<&Path>| {
            let pose = PoseSe2::new(-10.0, left_m, 0.0);
            let ego = EgoState { pose, velocity_mps: DVec2::new(10.0, 0.0), ..EgoState::default() };
            let (tick, time) = (Tick(0), SimTime::default());
            let world = WorldState { tick, time, ego, agents: vec![], lights: vec![], contacts: vec![] };
            let boxes = forecast_ego(&world, &VehicleParameters::PACIFICA, 0.1, route);
            assert_eq!(boxes.len(), TICKS);
            (boxes[TICKS - 1].centre, boxes[TICKS - 1].forward.to_angle())
        };
        let (on, heading_rad) = forecast(0.5, route.as_ref());
        // a path's heading goes over from corner to corner
        assert!((on.x - on.y).abs() < 1.5 && on.y > 8.0 && (0.4..0.8).contains(&heading_rad), "{on} {heading_rad}");
        for (left_m, route) in [(0.5, None), (5.0, route.as_ref())] {
            let (straight, heading_rad) = forecast(left_m, route);
            assert!((straight.y - left_m).abs() < 1e-9 && heading_rad.abs() < 1e-9, "{straight} {heading_rad}");
        }
    }
}
