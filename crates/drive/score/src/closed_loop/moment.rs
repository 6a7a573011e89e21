//! One state as the terms look at it: the map indexed once, the ego's box, speed and areas.

use ds_space::DVec2;
use ds_space::plane::OrientedBox;

use super::lane::IndexedLane;
use super::profile::{EgoSize, Profile};
use super::tick::{LoopScene, LoopState};
use crate::constants::bridgesim::{EGO_LENGTH_M, EGO_WIDTH_M};
use crate::ego_area::BoxAreas;
use crate::error::{ScoreError, finite};
use crate::lane_marks::LaneMarks;
use crate::scene::{AreaIndex, AreaKind, MapArea};

/// What does not change during a drive, indexed.
#[derive(Debug, Clone)]
pub(crate) struct Surroundings {
    pub(crate) dt_s: f64,
    pub(crate) lanes: Vec<IndexedLane>,
    /// Lanes, drivable surfaces (as road blocks) and junctions.
    pub(crate) layers: AreaIndex,
    pub(crate) has_layers: bool,
    pub(crate) has_lights: bool,
    length_m: f64,
    width_m: f64,
    rear_axle_to_centre_m: f64,
}

impl Surroundings {
    pub(crate) fn new(scene: &LoopScene, profile: &Profile) -> Result<Self, ScoreError> {
        finite(1.0 / scene.dt_s, || "1 / dt".to_owned())?;
        scene.footprint.check()?;
        let lanes = scene.lanes.iter().enumerate().map(|(index, lane)| IndexedLane::new(index, lane));
        let (length_m, width_m) = match profile.ego_size {
            EgoSize::Fixed => (EGO_LENGTH_M, EGO_WIDTH_M),
            EgoSize::Own => (scene.footprint.length_m, scene.footprint.width_m),
        };
        Ok(Self {
            dt_s: scene.dt_s,
            lanes: lanes.collect::<Result<_, _>>()?,
            layers: AreaIndex::new(&layers(scene))?,
            has_layers: !(scene.drivable.is_empty() && scene.junctions.is_empty()),
            has_lights: scene.has_lights,
            length_m,
            width_m,
            rear_axle_to_centre_m: scene.footprint.rear_axle_to_centre_m,
        })
    }

    pub(crate) fn moment<'a>(&'a self, state: &'a LoopState, marks: &mut LaneMarks) -> Moment<'a> {
        let ego = OrientedBox::new(&state.ego.centre, self.length_m, self.width_m);
        Moment {
            around: self,
            state,
            ego,
            speed_mps: state.ego.velocity_mps.length(),
            rear_axle: ego.centre - ego.forward * self.rear_axle_to_centre_m,
            areas: BoxAreas::new(&self.layers, &ego, marks),
        }
    }
}

fn layers(scene: &LoopScene) -> Vec<MapArea> {
    let area = |kind, on_route, outline: &[DVec2]| MapArea { kind, on_route, outline: outline.to_vec(), holes: vec![] };
    let lane_kind = |connector| if connector { AreaKind::LaneConnector } else { AreaKind::Lane };
    let lanes = scene.lanes.iter().map(|lane| area(lane_kind(lane.connector), lane.on_route, &lane.outline));
    let drivable = scene.drivable.iter().map(|outline| area(AreaKind::Roadblock, false, outline));
    let junctions = scene.junctions.iter().map(|outline| area(AreaKind::Intersection, false, outline));
    lanes.chain(drivable).chain(junctions).collect()
}

/// One state with what every term needs of it.
#[derive(Debug)]
pub(crate) struct Moment<'a> {
    pub(crate) around: &'a Surroundings,
    pub(crate) state: &'a LoopState,
    pub(crate) ego: OrientedBox,
    pub(crate) speed_mps: f64,
    pub(crate) rear_axle: DVec2,
    pub(crate) areas: BoxAreas,
}

impl Moment<'_> {
    /// Says whether the ego is in several lanes at once or off the drivable layers.
    pub(crate) fn astray(&self) -> bool {
        self.areas.multiple_lanes || (self.around.has_layers && self.areas.non_drivable)
    }

    /// Says whether every corner lies strictly inside some lane near by.
    pub(crate) fn on_lanes(&self, radius_m: f64) -> bool {
        self.ego.corners().into_iter().all(|corner| {
            super::lane::near(&self.around.lanes, self.ego.centre, radius_m).any(|(_, lane)| lane.surface.holds(corner))
        })
    }
}
