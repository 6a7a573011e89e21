//! A checked and indexed scene: everything about it that does not depend on a plan.

use std::sync::Arc;

use ds_space::DVec2;
use ds_space::plane::{Bounds, Grid, IndexedPolygon, Line};

use super::input::{AgentTrack, AreaKind, MapArea, OpenLoopMap, OpenLoopScene, PastState, SceneNow};
use super::traffic::Traffic;
use crate::comfort::StandardFilters;
use crate::constants::comfort::PAST_TENTHS;
use crate::constants::horizon::{STATES, V1_AGENT_STEPS};
use crate::constants::navsim::MAP_RADIUS_M;
use crate::error::{ScoreError, finite};
use crate::footprint::Footprint;
use crate::motion::{Executor, VehicleState};
use crate::smoothing::unwrap;

/// A map ready to score plans; scenes of the same map share it.
#[derive(Debug)]
pub struct PreparedMap {
    pub(crate) areas: AreaIndex,
    pub(crate) centreline: Line,
    bounds: Bounds,
}

impl PreparedMap {
    /// Checks and indexes a map.
    ///
    /// # Errors
    /// [`ScoreError`] if it is empty, has no lane, no centreline or a bad polygon.
    pub fn new(map: &OpenLoopMap) -> Result<Self, ScoreError> {
        if map.areas.is_empty() {
            return Err(ScoreError::EmptyMap);
        }
        if !map.areas.iter().any(|area| area.kind.is_lane()) {
            return Err(ScoreError::NoLanes);
        }
        for (index, point) in map.centreline.iter().enumerate() {
            finite(point.x, || format!("centreline[{index}].x"))?;
            finite(point.y, || format!("centreline[{index}].y"))?;
        }
        let centreline = Line::new(&map.centreline).ok_or(ScoreError::NoCentreline { points: map.centreline.len() })?;
        let areas = AreaIndex::new(&map.areas)?;
        let bounds = areas.polygons.iter().fold(Bounds::EMPTY, |all, polygon| all.union(polygon.bounds()));
        Ok(Self { areas, centreline, bounds })
    }

    /// Returns the centreline.
    #[must_use]
    pub fn centreline(&self) -> &Line {
        &self.centreline
    }
}

/// A scene ready to score plans.
#[derive(Debug, Clone)]
pub struct PreparedScene {
    pub(crate) footprint: Footprint,
    pub(crate) ego: VehicleState,
    pub(crate) executor: Executor,
    pub(crate) map: Arc<PreparedMap>,
    /// Agents without those that touch the ego now, 41 steps.
    pub(crate) traffic: Traffic,
    /// All agents, 51 steps.
    pub(crate) traffic_v1: Traffic,
    /// Ids of on-route connectors that show red, per step.
    pub(crate) red: Vec<Vec<u32>>,
    /// The states before now that HC looks at.
    pub(crate) past: Option<Vec<VehicleState>>,
    pub(crate) filters: &'static StandardFilters,
}

/// The polygons of the map, indexed.
#[derive(Debug, Clone)]
pub(crate) struct AreaIndex {
    pub(crate) polygons: Vec<IndexedPolygon>,
    pub(crate) kinds: Vec<AreaKind>,
    pub(crate) on_route: Vec<bool>,
    grid: Grid,
}

impl AreaIndex {
    pub(crate) fn new(areas: &[MapArea]) -> Result<Self, ScoreError> {
        let mut polygons = Vec::with_capacity(areas.len());
        for (index, area) in areas.iter().enumerate() {
            let polygon = IndexedPolygon::new(&area.outline, &area.holes)
                .ok_or_else(|| ScoreError::BadPolygon { field: format!("areas[{index}]") })?;
            polygons.push(polygon);
        }
        let boxes: Vec<Bounds> = polygons.iter().map(|polygon| *polygon.bounds()).collect();
        Ok(Self {
            grid: Grid::new(&boxes),
            kinds: areas.iter().map(|area| area.kind).collect(),
            on_route: areas.iter().map(|area| area.on_route && area.kind.is_lane()).collect(),
            polygons,
        })
    }

    /// Returns the polygons that may hold a point, in rising order.
    pub(crate) fn near(&self, point: DVec2) -> &[u32] {
        self.grid.near(point)
    }

    /// Says whether a point lies strictly inside a junction.
    pub(crate) fn in_intersection(&self, point: DVec2) -> bool {
        self.near(point)
            .iter()
            .any(|id| self.kinds[*id as usize] == AreaKind::Intersection && self.polygons[*id as usize].holds(point))
    }
}

impl PreparedScene {
    /// Checks and indexes a scene.
    ///
    /// # Errors
    /// [`ScoreError`] names what cannot be scored: see the table in `docs/scoring.md`.
    pub fn new(scene: &OpenLoopScene) -> Result<Self, ScoreError> {
        Self::on(&Arc::new(PreparedMap::new(&scene.map)?), &scene.now)
    }

    /// As [`Self::new`], on a map that is indexed already.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn on(map: &Arc<PreparedMap>, now: &SceneNow) -> Result<Self, ScoreError> {
        if let Some((name, value)) = now.ego.not_finite() {
            return Err(ScoreError::NotFinite { field: format!("ego.{name}"), value });
        }
        now.footprint.check()?;
        let ego = now.ego.position();
        if map.bounds.distance_squared(ego) > MAP_RADIUS_M * MAP_RADIUS_M {
            return Err(ScoreError::EgoOutsideMap { x_m: ego.x, y_m: ego.y });
        }
        let past = now.past.as_deref().map(resample_past).transpose()?;
        let mut scene = Self {
            footprint: now.footprint,
            ego: now.ego,
            executor: Executor::new(now.footprint.wheel_base_m),
            map: Arc::clone(map),
            traffic: Traffic::default(),
            traffic_v1: Traffic::new(&now.agents, V1_AGENT_STEPS)?,
            red: red_on_route(now, &map.areas)?,
            past,
            filters: StandardFilters::get(),
        };
        scene.traffic = scene.traffic_of(&now.agents)?;
        Ok(scene)
    }

    /// Returns agents as v2 tests them in this scene: 41 steps, without those that touch the ego now.
    ///
    /// # Errors
    /// As [`Traffic::new`].
    pub fn traffic_of(&self, agents: &[AgentTrack]) -> Result<Traffic, ScoreError> {
        let mut traffic = Traffic::new(agents, STATES)?;
        traffic.leave_out_touching(&self.footprint.at(&self.ego.pose()));
        Ok(traffic)
    }

    /// Returns the ego's state now.
    #[must_use]
    pub fn ego(&self) -> &VehicleState {
        &self.ego
    }

    /// Returns the ego's rectangle.
    #[must_use]
    pub fn footprint(&self) -> &Footprint {
        &self.footprint
    }

    /// Returns the simulation that executes plans in this scene.
    #[must_use]
    pub fn executor(&self) -> &Executor {
        &self.executor
    }
}

fn red_on_route(now: &SceneNow, areas: &AreaIndex) -> Result<Vec<Vec<u32>>, ScoreError> {
    let count = areas.polygons.len();
    let mut steps = Vec::with_capacity(STATES);
    for (step, red) in now.red_areas.iter().take(STATES).enumerate() {
        let mut ids = Vec::new();
        for index in red {
            let id = u32::try_from(*index).ok().filter(|_| *index < count);
            let field = || format!("red_areas[{step}]");
            let id = id.ok_or_else(|| ScoreError::NoSuchIndex { field: field(), index: *index, count })?;
            if areas.on_route[*index] {
                ids.push(id);
            }
        }
        steps.push(ids);
    }
    steps.resize(STATES, Vec::new());
    Ok(steps)
}

/// Interpolates the past at the times that HC looks at; before the first state it is held.
fn resample_past(past: &[PastState]) -> Result<Vec<VehicleState>, ScoreError> {
    if past.len() < 2 {
        return Err(ScoreError::TooFewStates { what: "past", found: past.len(), needed: 2 });
    }
    let mut before_s = f64::NEG_INFINITY;
    for (index, one) in past.iter().enumerate() {
        finite(one.time_s, || format!("past[{index}].t"))?;
        if one.time_s <= before_s {
            return Err(ScoreError::NotRising { field: format!("past[{index}].t"), value: one.time_s });
        }
        before_s = one.time_s;
        if let Some((name, value)) = one.state.not_finite() {
            return Err(ScoreError::NotFinite { field: format!("past[{index}].{name}"), value });
        }
    }
    let mut headings: Vec<f64> = past.iter().map(|one| one.state.heading_rad).collect();
    unwrap(&mut headings);
    Ok(PAST_TENTHS.map(|tenth| past_at(past, &headings, f64::from(tenth) / 10.0)).collect())
}

fn past_at(past: &[PastState], headings: &[f64], time_s: f64) -> VehicleState {
    let to = past.partition_point(|one| one.time_s < time_s).clamp(1, past.len() - 1);
    let (a, b) = (&past[to - 1], &past[to]);
    let share = ((time_s - a.time_s) / (b.time_s - a.time_s)).clamp(0.0, 1.0);
    let mix = |a: f64, b: f64| a + (b - a) * share;
    VehicleState {
        x_m: mix(a.state.x_m, b.state.x_m),
        y_m: mix(a.state.y_m, b.state.y_m),
        heading_rad: mix(headings[to - 1], headings[to]),
        vx_mps: mix(a.state.vx_mps, b.state.vx_mps),
        vy_mps: mix(a.state.vy_mps, b.state.vy_mps),
        ax_mps2: mix(a.state.ax_mps2, b.state.ax_mps2),
        ay_mps2: mix(a.state.ay_mps2, b.state.ay_mps2),
        ..VehicleState::default()
    }
}
