//! TTC of a state: do ego and others meet within 1 s if all go on as they move (BS `:600-647`, or `scoring.md` §4).

use super::collision::{Collisions, box_of};
use super::moment::Moment;
use super::profile::{Profile, TtcRule};
use super::tick::LoopObject;
use crate::collision_type::{is_ahead, is_behind};
use crate::constants::bridgesim::{STOPPED_MPS, TTC_STEP_S, TTC_STEPS};
use crate::constants::horizon::DT_S;
use crate::constants::navsim::{TTC_AHEAD, TTC_STOPPED_MPS};

/// Returns the score and the object that is met; `collision` is the state's NC.
pub(crate) fn score(
    moment: &Moment<'_>,
    profile: &Profile,
    collision: f64,
    collisions: &Collisions,
) -> (f64, Option<u32>) {
    let met = |object: &&LoopObject| match profile.time_to_collision {
        TtcRule::HalfPlane => in_half_plane(moment, object),
        TtcRule::Cone => !collisions.leaves_out(object.id) && in_cone(moment, object),
    };
    let met = moment.state.objects.iter().filter(met).map(|object| object.id).min();
    let collided = profile.time_to_collision == TtcRule::HalfPlane && collision == 0.0;
    (super::unless(collided || met.is_some()), met)
}

/// That the ego is in a wrong area adds nothing: what is not behind is ahead.
fn in_half_plane(moment: &Moment<'_>, object: &LoopObject) -> bool {
    let other = box_of(object);
    moment.speed_mps >= STOPPED_MPS
        && (1..=TTC_STEPS).any(|step| {
            let secs = f64::from(step) * TTC_STEP_S;
            let ego = moment.ego.moved(moment.state.ego.velocity_mps * secs);
            let other = other.moved(object.velocity_mps * secs);
            ego.touches(&other) && (other.centre - ego.centre).dot(ego.forward) >= 0.0
        })
}

/// Only the first touch is judged, as one that does not count makes the object ignored. Unlike in NAVSIM both are moved
/// on before it is asked who is ahead of whom, so that a faster car behind is not.
fn in_cone(moment: &Moment<'_>, object: &LoopObject) -> bool {
    if moment.speed_mps < TTC_STOPPED_MPS {
        return false;
    }
    let other = box_of(object);
    let forward = moment.ego.forward;
    let touch = TTC_AHEAD.iter().find_map(|ahead| {
        let secs = *ahead as f64 * DT_S;
        let ego = moment.ego.moved(forward * (moment.speed_mps * secs));
        let other = other.moved(object.velocity_mps * secs);
        let axle = moment.rear_axle + forward * (moment.speed_mps * secs);
        ego.touches(&other).then(|| other.centre - axle)
    });
    touch.is_some_and(|offset| {
        let astray = || moment.astray() || moment.around.layers.in_intersection(moment.rear_axle);
        is_ahead(forward, offset) || (!is_behind(forward, offset) && astray())
    })
}
