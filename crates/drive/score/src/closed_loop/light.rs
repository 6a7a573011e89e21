//! TLC of a state: does the ego run a red light (BS `:697-733`, or `scoring.md` §4).

use super::moment::Moment;
use super::profile::{LightRule, Profile};
use crate::constants::bridgesim::{LIGHT_RADIUS_M, SHORT_LANE_M, SLOW_MPS, STOP_LINE_M};

/// Returns the score; `None` if the map has no light.
pub(crate) fn score(moment: &Moment<'_>, profile: &Profile) -> Option<f64> {
    let lanes = &moment.around.lanes;
    let red = moment.state.red_lanes.iter().map(|lane| &lanes[*lane]);
    let mut red = red.filter(|lane| lane.surface.touches(&moment.ego));
    match profile.lights {
        LightRule::NearEnd => {
            let centre = moment.ego.centre;
            let near_end = |lane: &super::lane::IndexedLane| {
                let length_m = lane.line.length_m();
                lane.surface.bounds().reaches(centre, LIGHT_RADIUS_M)
                    && (length_m < SHORT_LANE_M || length_m - lane.line.coordinates(centre).0 < STOP_LINE_M)
            };
            Some(super::unless(moment.speed_mps > SLOW_MPS && red.any(near_end)))
        }
        LightRule::RouteConnectors => {
            moment.around.has_lights.then(|| super::unless(red.any(|lane| lane.connector && lane.on_route)))
        }
    }
}
