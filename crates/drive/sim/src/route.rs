//! The route command: which way the route turns between 10 m behind the ego and 30 m ahead of it.
//!
//! Left or right if the route's direction turns by more than 0.5 rad in that stretch, the larger turn deciding.

use ds_space::plane::Polyline;
use ds_space::{DVec2, angle};
use ds_world::RouteCommand;

const BEHIND_M: f64 = 10.0;
const AHEAD_M: f64 = 30.0;
const STEP_M: f64 = 2.0;
const TURN_RAD: f64 = 0.5;

/// Returns the command at a position; straight where there is no route.
pub(crate) fn command(route: Option<&Polyline>, position: DVec2) -> RouteCommand {
    let Some(route) = route else { return RouteCommand::Straight };
    let here_m = route.project(position).along_m;
    let mut at_m = here_m - BEHIND_M;
    let mut direction = route.direction_at(at_m);
    let (mut turned_rad, mut largest_rad) = (0.0, 0.0_f64);
    while at_m < here_m + AHEAD_M {
        at_m += STEP_M;
        let next = route.direction_at(at_m);
        turned_rad += angle::turn(direction.to_angle(), next.to_angle());
        direction = next;
        if f64::abs(turned_rad) > largest_rad.abs() {
            largest_rad = turned_rad;
        }
    }
    if largest_rad > TURN_RAD {
        RouteCommand::Left
    } else if largest_rad < -TURN_RAD {
        RouteCommand::Right
    } else {
        RouteCommand::Straight
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn announces_and_holds_a_turn() {
        let route = Polyline::new(&[DVec2::ZERO, DVec2::new(100.0, 0.0), DVec2::new(100.0, -100.0)]);
        for (x, y, expected) in [
            (10.0, 0.0, RouteCommand::Straight),
            (60.0, 0.0, RouteCommand::Straight),
            (75.0, 0.0, RouteCommand::Right),
            (100.0, -5.0, RouteCommand::Right),
            (100.0, -30.0, RouteCommand::Straight),
        ] {
            assert_eq!(command(route.as_ref(), DVec2::new(x, y)), expected, "at {x}, {y}");
        }
        assert_eq!(command(None, DVec2::ZERO), RouteCommand::Straight);
    }
}
