//! What a plan costs: NAVSIM v2 on the reference cases' scenes, one core, beside a matrix product of the same run.
//!
//! `cargo bench -p ds-score --bench plans`. Prints medians over rounds: a pair (plan and reference, executed and scored),
//! a plan in a batch of 64 that shares reference and scene, a rollout with agents of its own, and a calibration. Bars:
//! 0.22 ms a pair, 0.11 ms a plan.
//! The scenes lie outside the repository; where they are absent the bench says so.
#![expect(clippy::print_stdout, reason = "a bench prints its figures")]

use std::hint::black_box;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use ds_score::{
    AgentTrack, AreaKind, Footprint, MapArea, MovingBox, ObjectClass, OpenLoopMap, PastState, PlannedPoses,
    PreparedMap, PreparedScene, Rollout, SceneNow, Traffic, VehicleState, Yardstick, rank_plans, rank_rollouts,
};
use ds_space::{DVec2, PoseSe2};
use serde_json::Value;

const ROUNDS: usize = 31;
const BATCH: usize = 64;
const CROWD: u32 = 60;
const MATRIX: usize = 256;
const PAIR_BAR_MS: f64 = 0.22;
const PLAN_BAR_MS: f64 = 0.11;

struct Scene {
    map: OpenLoopMap,
    now: SceneNow,
    reference: PlannedPoses,
    plans: Vec<PlannedPoses>,
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(0.0)
}

fn list(value: &Value) -> impl Iterator<Item = &Value> {
    value.as_array().into_iter().flatten()
}

fn point(value: &Value) -> DVec2 {
    DVec2::new(number(&value[0]), number(&value[1]))
}

fn pose(value: &Value) -> PoseSe2 {
    PoseSe2 { position: point(value), heading_rad: number(&value[2]) }
}

fn plan(value: &Value) -> PlannedPoses {
    PlannedPoses { dt_s: number(&value["dt"]), poses: list(&value["poses"]).map(pose).collect() }
}

fn state(value: &Value) -> VehicleState {
    let columns = ["x", "y", "heading", "vx", "vy", "ax", "ay", "steering", "", "angular_velocity", ""];
    VehicleState::from_columns(columns.map(|name| number(&value[name])))
}

fn area(value: &Value, route: &[&str]) -> MapArea {
    let kind = match value["type"].as_str() {
        Some("LANE") => AreaKind::Lane,
        Some("LANE_CONNECTOR") => AreaKind::LaneConnector,
        Some("INTERSECTION") => AreaKind::Intersection,
        Some("CARPARK_AREA") => AreaKind::CarPark,
        _ => AreaKind::Roadblock,
    };
    let on_route = value["id"].as_str().is_some_and(|id| route.contains(&id));
    MapArea { kind, on_route, outline: list(&value["points"]).map(point).collect(), holes: Vec::new() }
}

fn agent(id: u32, value: &Value) -> AgentTrack {
    let step = |step: &Value| {
        let velocity_mps = DVec2::new(number(&step[3]), number(&step[4]));
        (!step.is_null()).then(|| MovingBox { pose: pose(step), velocity_mps })
    };
    let is_agent = matches!(value["type"].as_str(), Some("VEHICLE" | "PEDESTRIAN" | "BICYCLE"));
    AgentTrack {
        id,
        class: if is_agent { ObjectClass::Agent } else { ObjectClass::Static },
        length_m: number(&value["length"]),
        width_m: number(&value["width"]),
        steps: list(&value["steps"]).map(step).collect(),
    }
}

fn scene(case: &Value) -> Scene {
    let map = &case["map"];
    let route: Vec<&str> = list(&map["route_lane_ids"]).filter_map(Value::as_str).collect();
    let ids: Vec<&str> = list(&map["polygons"]).map(|polygon| polygon["id"].as_str().unwrap_or_default()).collect();
    let red = |step: &Value| list(step).filter_map(|red| ids.iter().position(|id| red == *id)).collect();
    Scene {
        map: OpenLoopMap {
            areas: list(&map["polygons"]).map(|polygon| area(polygon, &route)).collect(),
            centreline: list(&map["centerline"]).map(point).collect(),
        },
        now: SceneNow {
            ego: state(&case["ego"]),
            past: case["past"].as_array().map(|past| {
                past.iter().map(|one| PastState { time_s: number(&one["t"]), state: state(one) }).collect()
            }),
            agents: (0u32..).zip(list(&case["agents"])).map(|(id, one)| agent(id, one)).collect(),
            red_areas: list(&case["red_lane_ids"]).map(red).collect(),
            footprint: Footprint::NAVSIM,
        },
        reference: plan(&case["reference"]),
        plans: list(&case["candidates"]).map(|candidate| plan(&candidate["trajectory"])).collect(),
    }
}

fn scenes() -> Vec<Scene> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../../shared/golden/navsim/cases");
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut files: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    files.sort();
    let read = |path: &PathBuf| serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok();
    let cases = files.iter().filter_map(read);
    cases.filter(|case: &Value| case["schema"] == "pdm_score/1").map(|case| scene(&case)).collect()
}

/// Returns the median time of a round in milliseconds, divided by the number of things done in it.
fn median_ms(count: usize, mut round: impl FnMut()) -> f64 {
    round();
    let mut times: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let start = Instant::now();
            round();
            start.elapsed().as_secs_f64() * 1e3 / count as f64
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[ROUNDS / 2]
}

/// Multiplies two square matrices row by row, in the order that streams through memory.
fn matrix_product_ms() -> f64 {
    let a: Vec<f64> = (0..MATRIX * MATRIX).map(|i| (i % 7) as f64).collect();
    let b: Vec<f64> = (0..MATRIX * MATRIX).map(|i| (i % 5) as f64).collect();
    let mut c = vec![0.0; MATRIX * MATRIX];
    median_ms(1, || {
        c.fill(0.0);
        for (row, out) in a.chunks_exact(MATRIX).zip(c.chunks_exact_mut(MATRIX)) {
            for (share, line) in row.iter().zip(b.chunks_exact(MATRIX)) {
                out.iter_mut().zip(line).for_each(|(sum, value)| *sum += share * value);
            }
        }
        black_box(&c);
    })
}

fn pair(map: &Arc<PreparedMap>, scene: &Scene, plan: &PlannedPoses) {
    let prepared = PreparedScene::on(map, &scene.now).expect("a sound scene");
    let yardstick = Yardstick::new(&prepared, &scene.reference, None).expect("a sound plan");
    black_box(yardstick.score(&prepared, plan).expect("a sound plan"));
}

/// Measures rollouts that were executed elsewhere, each with a crowd of its own around the ego.
fn rollouts_ms(scene: &Scene, map: &Arc<PreparedMap>) -> f64 {
    let prepared = PreparedScene::on(map, &scene.now).expect("a sound scene");
    let ego = prepared.ego().pose();
    let crowd: Vec<AgentTrack> = (0..CROWD)
        .map(|id| {
            let place = DVec2::new(8.0 * f64::from(id / 6) - 20.0, 7.0 * f64::from(id % 6) - 17.0);
            let velocity_mps = ego.forward() * f64::from(id % 9);
            let step = |step: u32| {
                let position = ego.to_outer(place) + velocity_mps * (0.1 * f64::from(step));
                Some(MovingBox { pose: PoseSe2 { position, heading_rad: ego.heading_rad }, velocity_mps })
            };
            let steps = (0..41).map(step).collect();
            AgentTrack { id, class: ObjectClass::Agent, length_m: 4.5, width_m: 1.9, steps }
        })
        .collect();
    let states = prepared.executor().execute(prepared.ego(), &scene.plans[0]).expect("a sound plan");
    median_ms(BATCH, || {
        let ready = |_| prepared.traffic_of(&crowd).expect("sound agents");
        let traffics: Vec<Traffic> = (0..BATCH).map(ready).collect();
        let rollouts: Vec<Rollout<'_>> =
            traffics.iter().map(|traffic| Rollout { states: &states, reacting: Some(traffic) }).collect();
        black_box(rank_rollouts(&prepared, &rollouts[0], &rollouts).expect("sound states"));
    })
}

fn main() {
    let scenes = scenes();
    if scenes.is_empty() {
        println!("skipped: no reference cases beside this checkout");
        return;
    }
    let index = |scene: &Scene| Arc::new(PreparedMap::new(&scene.map).expect("a sound map"));
    let maps: Vec<Arc<PreparedMap>> = scenes.iter().map(index).collect();
    let pairs: usize = scenes.iter().map(|scene| scene.plans.len()).sum();
    let each_pair = |indexed: bool| {
        for (scene, map) in scenes.iter().zip(&maps) {
            for plan in &scene.plans {
                if indexed { pair(map, scene, plan) } else { pair(&index(scene), scene, plan) }
            }
        }
    };
    let calibration_ms = matrix_product_ms();
    let pair_ms = median_ms(pairs, || each_pair(true));
    let whole_ms = median_ms(pairs, || each_pair(false));
    let mut slowest_ms = 0.0f64;
    let mut batch_sum_ms = 0.0;
    for (scene, map) in scenes.iter().zip(&maps) {
        let plans: Vec<PlannedPoses> = scene.plans.iter().cycle().take(BATCH).cloned().collect();
        let ms = median_ms(BATCH, || {
            let prepared = PreparedScene::on(map, &scene.now).expect("a sound scene");
            black_box(rank_plans(&prepared, &scene.reference, &plans).expect("sound plans"));
        });
        slowest_ms = slowest_ms.max(ms);
        batch_sum_ms += ms;
    }
    let batch_ms = batch_sum_ms / scenes.len() as f64;
    let rollout_ms = rollouts_ms(&scenes[0], &maps[0]);
    println!("{} scenes, {pairs} pairs, median of {ROUNDS} rounds, one core", scenes.len());
    println!("matrix product {MATRIX}^3 f64        {calibration_ms:.3} ms");
    println!("pair, map indexed before      {pair_ms:.4} ms (bar {PAIR_BAR_MS}), {:.0} a second", 1e3 / pair_ms);
    println!("pair, map indexed each time   {whole_ms:.4} ms");
    println!(
        "plan in a batch of {BATCH}         {batch_ms:.4} ms (bar {PLAN_BAR_MS}), slowest scene {slowest_ms:.4} ms"
    );
    println!("rollout among {CROWD} own agents     {rollout_ms:.4} ms, agents made ready each time, batch of {BATCH}");
    println!("pairs per matrix product      {:.0}", calibration_ms / pair_ms);
}
