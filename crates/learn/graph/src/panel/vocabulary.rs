//! Plans as a path and a profile of speed: how both are read off a drive, and the plan that two of them make.
//!
//! A path is x and y of [`POINTS`] points, [`STEP_M`] apart, on the ground of the rig of now, in metres; it begins at the rig
//! and goes on straight beyond its end. A profile says how far along it the car has come at each pose, as offsets from
//! going on at the present speed in the unit of x. A car does not drive backwards.

use super::{PLAN, straight_on_m, units};

/// Points of a path.
pub const POINTS: usize = 24;
/// Numbers of a path.
pub const PATH: usize = 2 * POINTS;
/// Numbers of a profile, one for each pose.
pub const PROFILE: usize = PLAN / 3;
/// The way from one point of a path to the next, in metres.
pub const STEP_M: f32 = 2.0;

/// Position and heading on the ground of the rig: x, y, in metres, and radians.
pub type Place = [f32; 3];

/// Returns the path of a drive through some places, one after the other from the rig on, and how much of it was driven, in metres;
/// beyond the last place it goes on as that one points.
#[must_use]
pub fn path_of(places: &[Place; PROFILE]) -> ([f32; PATH], f32) {
    let ways = ways_m(places);
    let driven_m = ways[PROFILE - 1];
    let mut path = [0.0; PATH];
    for (point, at) in path.chunks_exact_mut(2).enumerate() {
        let along_m = STEP_M * (point + 1) as f32;
        let next = ways.iter().position(|way| *way >= along_m);
        let found = match next {
            Some(next) => {
                let (from, from_m) = if next == 0 { ([0.0; 3], 0.0) } else { (places[next - 1], ways[next - 1]) };
                let share = (along_m - from_m) / (ways[next] - from_m);
                [0, 1].map(|side| from[side] + share * (places[next][side] - from[side]))
            }
            None => {
                let [x, y, heading] = places[PROFILE - 1];
                [x + (along_m - driven_m) * heading.cos(), y + (along_m - driven_m) * heading.sin()]
            }
        };
        at.copy_from_slice(&found);
    }
    (path, driven_m)
}

/// Returns the profile of a drive through some places of a car that has a speed now.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "profiles are single precision")]
pub fn profile_of(places: &[Place; PROFILE], speed_mps: f64) -> [f32; PROFILE] {
    let ways = ways_m(places);
    std::array::from_fn(|pose| ((f64::from(ways[pose]) - straight_on_m(speed_mps, pose)) / units(pose)[0]) as f32)
}

/// Returns how far along its way a drive has come at each place.
fn ways_m(places: &[Place; PROFILE]) -> [f32; PROFILE] {
    let (mut way_m, mut before) = (0.0, [0.0; 3]);
    places.map(|place| {
        way_m += (place[0] - before[0]).hypot(place[1] - before[1]);
        before = place;
        way_m
    })
}

/// Returns how far along the path a car has come at each pose of a profile, in metres.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "plans are single precision")]
pub fn along_m(profile: &[f32], speed_mps: f64) -> [f32; PROFILE] {
    let mut before_m = 0.0_f32;
    std::array::from_fn(|pose| {
        let way_m = straight_on_m(speed_mps, pose) + units(pose)[0] * f64::from(profile[pose]);
        before_m = before_m.max(way_m as f32);
        before_m
    })
}

/// Returns the places of a car that has come so far along a path.
#[must_use]
pub fn places(path: &[f32], along_m: &[f32; PROFILE]) -> [Place; PROFILE] {
    let point = |index: usize| if index == 0 { [0.0, 0.0] } else { [path[2 * index - 2], path[2 * index - 1]] };
    let pointing = |from: usize, to: usize| {
        let (from, to) = (point(from), point(to));
        (to[1] - from[1]).atan2(to[0] - from[0])
    };
    let heading = |index: usize| match index {
        0 => 0.0,
        POINTS => pointing(POINTS - 1, POINTS),
        _ => pointing(index - 1, index + 1),
    };
    along_m.map(|along| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small positive number")]
        let segment = ((along / STEP_M) as usize).min(POINTS);
        let over = along / STEP_M - segment as f32;
        let (from, turned) = (point(segment), heading(segment));
        if segment == POINTS {
            return [from[0] + STEP_M * over * turned.cos(), from[1] + STEP_M * over * turned.sin(), turned];
        }
        let to = point(segment + 1);
        let turn = heading(segment + 1) - turned;
        let turn = turn.sin().atan2(turn.cos());
        [from[0] + over * (to[0] - from[0]), from[1] + over * (to[1] - from[1]), turned + over * turn]
    })
}

/// Returns the numbers of a plan through some places, of a car that has a speed now.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "plans are single precision")]
pub fn plan_of(places: &[Place; PROFILE], speed_mps: f64) -> [f32; PLAN] {
    let mut plan = [0.0; PLAN];
    for (pose, (numbers, place)) in plan.chunks_exact_mut(3).zip(places).enumerate() {
        let units = units(pose);
        let from = [straight_on_m(speed_mps, pose), 0.0, 0.0];
        (0..3).for_each(|side| numbers[side] = ((f64::from(place[side]) - from[side]) / units[side]) as f32);
    }
    plan
}

/// Returns the places that a plan goes through, of a car that has a speed now.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "places are single precision")]
pub fn places_of(plan: &[f32], speed_mps: f64) -> [Place; PROFILE] {
    std::array::from_fn(|pose| {
        let (units, from) = (units(pose), [straight_on_m(speed_mps, pose), 0.0, 0.0]);
        std::array::from_fn(|side| (from[side] + units[side] * f64::from(plan[3 * pose + side])) as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A left turn of 20 m radius at a speed that grows from 6 m/s by 1 m/s².
    fn turn() -> [Place; PROFILE] {
        std::array::from_fn(|pose| {
            let after_s = 0.5 * (pose + 1) as f32;
            let angle = (6.0 * after_s + 0.5 * after_s * after_s) / 20.0;
            [20.0 * angle.sin(), 20.0 * (1.0 - angle.cos()), angle]
        })
    }

    #[test]
    fn a_drive_is_found_again_from_its_path_and_its_profile() {
        let driven = turn();
        let (path, way_m) = path_of(&driven);
        assert!((way_m - 32.0).abs() < 0.2, "{way_m}");
        let profile = profile_of(&driven, 6.0);
        let again = places(&path, &along_m(&profile, 6.0));
        for (one, other) in driven.iter().zip(&again) {
            let apart_m = (one[0] - other[0]).hypot(one[1] - other[1]);
            assert!(apart_m < 0.2 && (one[2] - other[2]).abs() < 0.08, "{one:?} {other:?}");
        }
        let plan = plan_of(&again, 6.0);
        let back = places_of(&plan, 6.0);
        assert!(back.as_flattened().iter().zip(again.as_flattened()).all(|(a, b)| (a - b).abs() < 1e-5));
        let [x, y, heading] = units(7);
        assert!((plan[21] - (again[7][0] - 24.0) / x as f32).abs() < 1e-5);
        assert!((plan[22] - again[7][1] / y as f32).abs() < 1e-5);
        assert!((plan[23] - again[7][2] / heading as f32).abs() < 1e-5);
    }

    #[test]
    fn a_car_that_stands_stays_and_one_that_leaves_its_path_goes_on_straight() {
        let (path, way_m) = path_of(&[[0.0; 3]; PROFILE]);
        assert_eq!((way_m, path[0], path[1], path[2]), (0.0, 2.0, 0.0, 4.0));
        let standing = along_m(&[-9.0; PROFILE], 2.0);
        assert_eq!((standing, places(&path, &standing)), ([0.0; PROFILE], [[0.0; 3]; PROFILE]));
        let far = places(&path, &[60.0; PROFILE]);
        assert!((far[0][0] - 60.0).abs() < 1e-4 && far[0][1] == 0.0, "{far:?}");
    }
}
