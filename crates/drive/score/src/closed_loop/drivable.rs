//! DAC of a state: are all corners on drivable surface (BS `:552-568`, or the map's drivable layers).

use super::moment::Moment;
use super::profile::{DrivableRule, Profile};
use crate::constants::bridgesim::AREA_RADIUS_M;

/// Returns the score; `None` if the map has none of the surfaces that are asked for.
pub(crate) fn score(moment: &Moment<'_>, profile: &Profile) -> Option<f64> {
    match profile.drivable {
        DrivableRule::Lanes => Some(super::unless(!moment.on_lanes(AREA_RADIUS_M))),
        DrivableRule::Layers => moment.around.has_layers.then(|| super::unless(moment.areas.non_drivable)),
    }
}
