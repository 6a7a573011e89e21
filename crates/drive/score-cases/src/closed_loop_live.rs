//! `closed_loop_live/1`: a drive state by state under profile `bridgesim` → terms per state, route completion, DS.
//!
//! The ego pose is that of the box's centre, velocities are those of the world. Every given state counts. Stable means
//! that noise of 1e-6 m on the ego's positions changes no term in three draws.

use std::collections::BTreeMap;

use ds_score::{
    AgentTrack, DrivingScore, Footprint, LoopEgo, LoopLane, LoopObject, LoopScene, LoopScore, LoopState, MovingBox,
    Profile, TERMS, closed_loop, window_share,
};
use ds_space::plane::corridor;
use ds_space::{DVec2, Draws, PoseSe2};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::agents::{self, AgentFile};
use crate::error::ScoreCaseError;
use crate::fields::point;

const COLUMN_NAMES: [&str; TERMS + 1] = ["nc", "dac", "ddc", "tlc", "ttc", "lk", "hc", "ec", "score"];
const DEFAULT_DT_S: f64 = 0.1;
const NOISE_M: f64 = 1e-6;
const NOISE_DRAWS: u64 = 3;
const NOISE_SEED: u64 = 2;
/// The most states of a recording that are believed.
const MOST_FRAMES: usize = 1 << 20;

#[derive(Deserialize)]
pub(crate) struct Case {
    dt: Option<f64>,
    lanes: Vec<LaneFile>,
    ego: Vec<[f64; 5]>,
    #[serde(default)]
    agents: Vec<AgentFile>,
    #[serde(default)]
    red_lane_ids: Vec<Vec<String>>,
    route: Vec<[f64; 2]>,
    expert_window: Option<WindowFile>,
}

#[derive(Deserialize)]
struct LaneFile {
    id: String,
    polyline: Vec<[f64; 2]>,
    width: Option<f64>,
    polygon: Option<Vec<[f64; 2]>>,
}

/// First state, end, the expert's speed in metres per second, states in the recording.
#[derive(Deserialize)]
struct WindowFile(usize, usize, f64, usize);

pub(crate) fn answer(case: &Case) -> Result<Value, ScoreCaseError> {
    let dt_s = case.dt.unwrap_or(DEFAULT_DT_S);
    let share = case.expert_window.as_ref().map(|window| share_of(window, dt_s)).transpose()?;
    let scene = scene(case, dt_s, share.flatten());
    let states = states(case)?;
    let score = |states: &[LoopState]| {
        closed_loop(&scene, Profile::bridgesim(), states).map_err(ScoreCaseError::score("lanes, ego, agents and route"))
    };
    let (scores, drive) = score(&states)?;
    let mut stable = true;
    for draw in 0..NOISE_DRAWS {
        let (again, _) = score(&noisy(&states, draw))?;
        stable &= again.iter().zip(&scores).all(|(again, once)| again.terms == once.terms);
    }
    let mut answer = json!({ "expected": expected(&scores, &drive, stable) });
    if let Some(share) = share {
        answer["expected_rc_delta"] = json!(share);
    }
    Ok(answer)
}

fn expected(scores: &[LoopScore], drive: &DrivingScore, stable: bool) -> Value {
    let row = |score: &LoopScore| -> Vec<Option<f64>> {
        score.terms.iter().copied().chain(std::iter::once(score.epdms())).collect()
    };
    json!({
        "stable": stable,
        "columns": COLUMN_NAMES,
        "frames": scores.iter().map(row).collect::<Vec<_>>(),
        "route_length_m": drive.route_length_m,
        "raw_route_completion": scores.iter().map(|score| score.route_share).collect::<Vec<_>>(),
        "route_completion": drive.route_completion,
        "mean_epdms": drive.mean_epdms,
        "driving_score": drive.driving_score,
    })
}

/// The expert of these cases drives straight at a constant speed.
fn share_of(window: &WindowFile, dt_s: f64) -> Result<Option<f64>, ScoreCaseError> {
    let WindowFile(start, end, speed_mps, recorded) = window;
    if *recorded > MOST_FRAMES {
        return Err(ScoreCaseError::Length {
            field: "expert_window[3]".to_owned(),
            found: *recorded,
            needed: MOST_FRAMES,
        });
    }
    let positions: Vec<DVec2> = (0..*recorded).map(|i| DVec2::new(i as f64 * speed_mps * dt_s, 0.0)).collect();
    Ok(window_share(&positions, *start, *end))
}

fn scene(case: &Case, dt_s: f64, window_share: Option<f64>) -> LoopScene {
    let lane = |lane: &LaneFile| {
        let line: Vec<DVec2> = lane.polyline.iter().map(point).collect();
        let width_m = lane.width.unwrap_or(ds_score::constants::strict::LANE_WIDTH_M);
        let outline = match &lane.polygon {
            Some(polygon) => polygon.iter().map(point).collect(),
            None => corridor(&line, width_m),
        };
        LoopLane { line, outline, connector: false, on_route: false }
    };
    LoopScene {
        dt_s,
        footprint: Footprint::NAVSIM,
        lanes: case.lanes.iter().map(lane).collect(),
        drivable: Vec::new(),
        junctions: Vec::new(),
        has_lights: true,
        expert_path: case.route.iter().map(point).collect(),
        window_share,
    }
}

fn states(case: &Case) -> Result<Vec<LoopState>, ScoreCaseError> {
    let mut lanes: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (index, lane) in case.lanes.iter().enumerate() {
        lanes.entry(&lane.id).or_default().push(index);
    }
    let tracks = agents::tracks(&case.agents)?;
    let state = |(index, ego): (usize, &[f64; 5])| {
        let objects = tracks.iter().filter_map(|track| {
            let &AgentTrack { id, class, length_m, width_m, ref steps } = track;
            let MovingBox { pose, velocity_mps } = steps.get(index).copied().flatten()?;
            Some(LoopObject { id, class, pose, length_m, width_m, velocity_mps })
        });
        let [x, y, heading, vx, vy] = *ego;
        let red = case.red_lane_ids.get(index).into_iter().flatten();
        LoopState {
            tick: u32::try_from(index).unwrap_or(u32::MAX),
            ego: LoopEgo { centre: PoseSe2::new(x, y, heading), velocity_mps: DVec2::new(vx, vy), state: None },
            objects: objects.collect(),
            red_lanes: red.filter_map(|id| lanes.get(id.as_str())).flatten().copied().collect(),
        }
    };
    Ok(case.ego.iter().enumerate().map(state).collect())
}

fn noisy(states: &[LoopState], draw: u64) -> Vec<LoopState> {
    let draws = Draws::from_seed(NOISE_SEED, "stability");
    let mut states = states.to_vec();
    let count = states.len() as u64;
    for (index, state) in (0u64..).zip(&mut states) {
        let at = 2 * (draw * count + index);
        state.ego.centre.position += DVec2::new(draws.normal(at), draws.normal(at + 1)) * NOISE_M;
    }
    states
}
