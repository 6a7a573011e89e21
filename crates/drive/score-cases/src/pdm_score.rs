//! `pdm_score/1` as it stands in a file, and as the scene and plans it means.

use std::collections::BTreeMap;

use ds_score::{
    AreaKind, Footprint, MapArea, OpenLoopMap, OpenLoopScene, PastState, PlannedPoses, SceneNow, VehicleState,
};
use ds_space::DVec2;
use serde::Deserialize;

use crate::agents::{self, AgentFile};
use crate::error::ScoreCaseError;
use crate::fields::{point, pose};

#[derive(Deserialize)]
pub(crate) struct Case {
    map: MapFile,
    #[serde(default)]
    red_lane_ids: Vec<Vec<String>>,
    #[serde(default)]
    agents: Vec<AgentFile>,
    ego: EgoFile,
    past: Option<Vec<PastFile>>,
    pub(crate) reference: PlanFile,
    pub(crate) human: Option<PlanFile>,
    pub(crate) candidates: Vec<Candidate>,
}

#[derive(Deserialize)]
struct MapFile {
    polygons: Vec<PolygonFile>,
    #[serde(default)]
    route_lane_ids: Vec<String>,
    /// Points of x, y and, not needed here, heading.
    centerline: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
struct PolygonFile {
    id: String,
    #[serde(rename = "type")]
    kind: String,
    points: Vec<[f64; 2]>,
    #[serde(default)]
    holes: Vec<Vec<[f64; 2]>>,
}

#[derive(Deserialize)]
struct EgoFile {
    x: f64,
    y: f64,
    heading: f64,
    vx: f64,
    #[serde(default)]
    vy: f64,
    #[serde(default)]
    ax: f64,
    #[serde(default)]
    ay: f64,
    #[serde(default)]
    steering: f64,
    #[serde(default)]
    steering_rate: f64,
    #[serde(default)]
    angular_velocity: f64,
    #[serde(default)]
    angular_acceleration: f64,
}

#[derive(Deserialize)]
struct PastFile {
    t: f64,
    #[serde(flatten)]
    state: EgoFile,
}

/// A plan as a policy gives it.
#[derive(Deserialize)]
pub(crate) struct PlanFile {
    dt: f64,
    poses: Vec<[f64; 3]>,
}

#[derive(Deserialize)]
pub(crate) struct Candidate {
    pub(crate) name: Option<String>,
    pub(crate) trajectory: PlanFile,
}

impl PlanFile {
    pub(crate) fn plan(&self) -> PlannedPoses {
        PlannedPoses { dt_s: self.dt, poses: self.poses.iter().map(pose).collect() }
    }
}

impl EgoFile {
    fn state(&self) -> VehicleState {
        VehicleState {
            x_m: self.x,
            y_m: self.y,
            heading_rad: self.heading,
            vx_mps: self.vx,
            vy_mps: self.vy,
            ax_mps2: self.ax,
            ay_mps2: self.ay,
            steering_rad: self.steering,
            steering_rate_radps: self.steering_rate,
            yaw_rate_radps: self.angular_velocity,
            yaw_acceleration_radps2: self.angular_acceleration,
        }
    }
}

impl PastFile {
    fn state(&self) -> PastState {
        PastState { time_s: self.t, state: self.state.state() }
    }
}

impl Case {
    /// Makes the scene that the file describes.
    pub(crate) fn scene(&self) -> Result<OpenLoopScene, ScoreCaseError> {
        let areas = self.map.polygons.iter().enumerate().map(|(i, polygon)| self.area(i, polygon));
        let past = self.past.as_ref().filter(|past| !past.is_empty());
        let now = SceneNow {
            ego: self.ego.state(),
            past: past.map(|past| past.iter().map(PastFile::state).collect()),
            agents: agents::tracks(&self.agents)?,
            red_areas: self.red_areas(),
            footprint: Footprint::NAVSIM,
        };
        let map = OpenLoopMap { areas: areas.collect::<Result<_, _>>()?, centreline: self.centreline()? };
        Ok(OpenLoopScene { map, now })
    }

    fn area(&self, index: usize, polygon: &PolygonFile) -> Result<MapArea, ScoreCaseError> {
        let kind = match polygon.kind.as_str() {
            "ROADBLOCK" => AreaKind::Roadblock,
            "LANE" => AreaKind::Lane,
            "LANE_CONNECTOR" => AreaKind::LaneConnector,
            "INTERSECTION" => AreaKind::Intersection,
            "CARPARK_AREA" => AreaKind::CarPark,
            other => {
                let field = format!("map.polygons[{index}].type");
                return Err(ScoreCaseError::Value { field, value: other.to_owned() });
            }
        };
        Ok(MapArea {
            kind,
            on_route: self.map.route_lane_ids.contains(&polygon.id),
            outline: polygon.points.iter().map(point).collect(),
            holes: polygon.holes.iter().map(|hole| hole.iter().map(point).collect()).collect(),
        })
    }

    fn centreline(&self) -> Result<Vec<DVec2>, ScoreCaseError> {
        let read = |(index, point): (usize, &Vec<f64>)| match point.as_slice() {
            [x, y, ..] => Ok(DVec2::new(*x, *y)),
            short => {
                let field = format!("map.centerline[{index}]");
                Err(ScoreCaseError::Length { field, found: short.len(), needed: 2 })
            }
        };
        self.map.centerline.iter().enumerate().map(read).collect()
    }

    /// Ids that no polygon carries lie outside the map and cannot be touched.
    fn red_areas(&self) -> Vec<Vec<usize>> {
        let mut connectors: BTreeMap<&str, usize> = BTreeMap::new();
        for (index, polygon) in self.map.polygons.iter().enumerate() {
            if polygon.kind == "LANE_CONNECTOR" || polygon.kind == "LANE" {
                connectors.insert(&polygon.id, index);
            }
        }
        let step = |ids: &Vec<String>| ids.iter().filter_map(|id| connectors.get(id.as_str()).copied()).collect();
        self.red_lane_ids.iter().map(step).collect()
    }
}
