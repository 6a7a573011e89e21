//! DDC of a state: does the ego drive against its lane (BS `:676-695`, or travel against lanes within 1 s).

use std::collections::VecDeque;

use ds_space::DVec2;
use ds_space::angle::turn;

use super::lane;
use super::moment::Moment;
use super::profile::{DirectionRule, Profile};
use crate::constants::bridgesim::{AREA_RADIUS_M, SLOW_MPS};
use crate::constants::horizon::DT_S;
use crate::constants::navsim::DIRECTION_STEPS;
use crate::metric::driving_direction::value;

/// How far the ego went against its lanes in each of the last states.
#[derive(Debug, Clone, Default)]
pub(crate) struct Direction {
    last: Option<DVec2>,
    opposed_m: VecDeque<f64>,
}

impl Direction {
    /// Returns the score of the next state; `None` if there are no lanes to have a direction.
    pub(crate) fn observe(&mut self, moment: &Moment<'_>, profile: &Profile, off_road: bool) -> Option<f64> {
        match profile.direction {
            DirectionRule::BestLane => Some(super::unless(!off_road && opposes_best(moment))),
            DirectionRule::OpposedTravel => self.opposed_travel(moment),
        }
    }

    fn opposed_travel(&mut self, moment: &Moment<'_>) -> Option<f64> {
        let centre = moment.ego.centre;
        let step_m = self.last.replace(centre).map_or(0.0, |last| (centre - last).length());
        if moment.around.lanes.is_empty() {
            return None;
        }
        let counts = !moment.areas.centre_in_intersection && opposes_all(moment);
        self.opposed_m.push_back(if counts { step_m } else { 0.0 });
        let states = (DIRECTION_STEPS as f64 * DT_S / moment.around.dt_s).round() as usize + 1;
        while self.opposed_m.len() > states {
            self.opposed_m.pop_front();
        }
        Some(value(self.opposed_m.iter().sum()))
    }
}

fn opposes_best(moment: &Moment<'_>) -> bool {
    let heading_rad = moment.state.ego.centre.heading_rad;
    moment.speed_mps > SLOW_MPS
        && lane::best(&moment.around.lanes, moment.ego.centre, heading_rad, moment.speed_mps, AREA_RADIUS_M)
            .is_some_and(|place| place.turned_rad > std::f64::consts::FRAC_PI_2)
}

/// Says whether lanes hold the centre and all of them lead the other way.
fn opposes_all(moment: &Moment<'_>) -> bool {
    let centre = moment.ego.centre;
    let mut holding = lane::near(&moment.around.lanes, centre, 0.0)
        .filter(|(_, lane)| lane.surface.holds(centre))
        .map(|(_, lane)| lane.line.heading_at(lane.line.coordinates(centre).0))
        .peekable();
    let heading_rad = moment.state.ego.centre.heading_rad;
    holding.peek().is_some() && holding.all(|lane| turn(lane, heading_rad).abs() > std::f64::consts::FRAC_PI_2)
}
