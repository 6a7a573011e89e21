//! LK of a state: has the ego been beside its lane for too long (BS `:735-756`, or `scoring.md` §4).

use super::lane;
use super::moment::Moment;
use super::profile::{KeepingRule, Profile};
use crate::constants::bridgesim::{KEEPING_RADIUS_M, LANE_OFFSET_M, LANE_WINDOW_S};
use crate::constants::horizon::DT_S;
use crate::constants::navsim::LANE_STEPS;

/// For how many states on end the ego has been beside its lane.
#[derive(Debug, Clone, Default)]
pub(crate) struct Keeping {
    beside: u32,
}

impl Keeping {
    /// Returns the score of the next state; `None` if there are no lanes to keep.
    pub(crate) fn observe(&mut self, moment: &Moment<'_>, profile: &Profile, off_road: bool) -> Option<f64> {
        match profile.keeping {
            KeepingRule::Everywhere => {
                if off_road {
                    return Some(1.0);
                }
                self.count(moment);
                Some(super::unless(f64::from(self.beside) * moment.around.dt_s > LANE_WINDOW_S))
            }
            KeepingRule::OutsideJunctions => {
                if moment.around.lanes.is_empty() {
                    return None;
                }
                if !moment.areas.centre_in_intersection {
                    self.count(moment);
                }
                let states = (f64::from(LANE_STEPS) * DT_S / moment.around.dt_s).round();
                Some(super::unless(f64::from(self.beside) >= states))
            }
        }
    }

    fn count(&mut self, moment: &Moment<'_>) {
        let heading_rad = moment.state.ego.centre.heading_rad;
        let lanes = &moment.around.lanes;
        if let Some(place) = lane::best(lanes, moment.ego.centre, heading_rad, moment.speed_mps, KEEPING_RADIUS_M) {
            self.beside = if place.lateral_m.abs() > LANE_OFFSET_M { self.beside + 1 } else { 0 };
        }
    }
}
