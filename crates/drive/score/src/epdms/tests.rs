//! Drives on a straight road, their sub-scores worked out by hand; bad input by name; laws of symmetry.

use ds_space::{DVec2, PoseSe2};
use proptest::prelude::*;

use super::*;
use crate::constants::horizon::STATES;
use crate::pdms::navsim_v1_executed;
use crate::road::{area, drive, moving, plan, scene, standing};
use crate::scene::{AreaKind, MapArea, ObjectClass, PastState};

fn score(scene: &OpenLoopScene, states: &Executed) -> NavsimV2 {
    let prepared = PreparedScene::new(scene).expect("a sound scene");
    let yardstick = Yardstick::new(&prepared, &plan(10.0), None).expect("a sound plan");
    yardstick.score_executed(&prepared, states, Coverage::Whole).expect("sound states")
}

fn step(violation: Option<Violation>) -> Option<usize> {
    violation.map(|violation| violation.step)
}

/// The reference drives 40 m at 10 m/s on the centreline and breaks nothing.
#[test]
fn drives_by_table() {
    for (speed_mps, aside_m, dac, ddc, ep, lk, epdms) in [
        (10.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0),
        (5.0, 0.0, 1.0, 1.0, 0.5, 1.0, (2.5 + 5.0 + 2.0 + 2.0) / 14.0),
        (10.0, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0),
        (10.0, 0.51, 1.0, 1.0, 1.0, 0.0, 12.0 / 14.0),
        // Half of 2.297 m: the edge of the road at -1.75 m is touched from 0.6015 m on, and touching is outside.
        (10.0, -0.60, 1.0, 1.0, 1.0, 0.0, 12.0 / 14.0),
        (10.0, -0.61, 0.0, 1.0, 1.0, 0.0, 0.0),
        // In the lane beside the route 11 steps count: 1.65 m, 2.2 m, 5.5 m, 11 m.
        (1.5, 3.5, 1.0, 1.0, 0.15, 0.0, (0.75 + 7.0) / 14.0),
        (2.0, 3.5, 1.0, 0.5, 0.2, 0.0, 0.5 * (1.0 + 7.0) / 14.0),
        (5.0, 3.5, 1.0, 0.5, 0.5, 0.0, 0.5 * (2.5 + 7.0) / 14.0),
        (10.0, 3.5, 1.0, 0.0, 1.0, 0.0, 0.0),
    ] {
        let got = score(&scene(10.0), &drive(speed_mps, aside_m));
        let scores = got.scores;
        let row = (scores.drivable_area, scores.driving_direction, scores.lane_keeping);
        assert_eq!(row, (dac, ddc, lk), "{speed_mps} m/s, {aside_m} m aside");
        assert!((scores.ego_progress - ep).abs() < 1e-9 && (got.epdms - epdms).abs() < 1e-9, "{got:?}");
    }
}

#[test]
fn lane_keeping_fails_at_the_twentieth_step_and_pauses_in_junctions() {
    assert_eq!(step(score(&scene(10.0), &drive(10.0, 0.6)).first.lane), Some(19));
    let mut junction = scene(10.0);
    // The centre is at 1.461 m + step; steps 9..=18 lie between 10 and 20 m.
    junction.map.areas.push(area(AreaKind::Intersection, false, [10.0, -3.0, 20.0, 3.0]));
    assert_eq!(step(score(&junction, &drive(10.0, 0.6)).first.lane), Some(29));
}

/// The ego's nose is at 4.049 m + 1 m a step.
#[test]
fn collisions_by_table() {
    let ahead = standing(7, 30.0, 0.0);
    let cone = AgentTrackOf { class: ObjectClass::Static, ..AgentTrackOf::from(&ahead) }.track();
    let crossing = |speed_mps: f64| moving(7, PoseSe2::new(30.0, 0.0, 0.0), DVec2::new(speed_mps, 0.0));
    // Rear at 27.75 m: met at step 24; 9 m ahead of it at step 15.
    for (agent, nc, at_fault, ttc, short) in [
        (ahead.clone(), 0.0, Some(24), 0.0, Some(15)),
        (cone, 0.5, Some(24), 0.0, Some(15)),
        // 5 m/s away: the gap of 23.701 m shrinks by 0.5 m a step: none left at step 48; with 9 m ahead, of which the
        // other goes 4.5 m, at step 39, which is not looked at.
        (crossing(5.0), 1.0, None, 1.0, None),
        // 2 m/s: 0.8 m a step: step 30; look-ahead 7.2 m: step 21.
        (crossing(2.0), 0.0, Some(30), 0.0, Some(21)),
        // Behind and faster: it drives into the ego at step 18, whose fault that is not. Nine steps before, its place then
        // is compared with the ego's rear axle now, which makes it "ahead" (as in the reference).
        (moving(7, PoseSe2::new(-12.0, 0.0, 0.0), DVec2::new(15.0, 0.0)), 1.0, None, 0.0, Some(9)),
        // Beside and standing, 1.149 + 0.95 m: touching at 2.0985 m.
        (standing(7, 30.0, 2.09), 0.0, Some(24), 0.0, Some(15)),
        (standing(7, 30.0, 2.11), 1.0, None, 1.0, None),
    ] {
        let mut scene = scene(10.0);
        scene.now.agents.push(agent.clone());
        let got = score(&scene, &drive(10.0, 0.0));
        let row = (got.scores.no_at_fault_collision, step(got.first.at_fault));
        let start = agent.steps[0];
        assert_eq!(row, (nc, at_fault), "{start:?}");
        assert_eq!((got.scores.time_to_collision, step(got.first.time_to_collision)), (ttc, short), "{start:?}");
        assert_eq!(got.first.at_fault.and_then(|first| first.object), at_fault.map(|_| 7));
    }
}

struct AgentTrackOf {
    class: ObjectClass,
    track: crate::scene::AgentTrack,
}

impl AgentTrackOf {
    fn from(track: &crate::scene::AgentTrack) -> Self {
        Self { class: track.class, track: track.clone() }
    }

    fn track(self) -> crate::scene::AgentTrack {
        crate::scene::AgentTrack { class: self.class, ..self.track }
    }
}

#[test]
fn agents_that_touch_at_the_start_count_in_v1_only() {
    let mut scene = scene(10.0);
    scene.now.agents.push(standing(3, 4.0, 0.0));
    let states = drive(10.0, 0.0);
    assert_eq!(score(&scene, &states).scores.no_at_fault_collision, 1.0);
    let prepared = PreparedScene::new(&scene).expect("a sound scene");
    let v1 = navsim_v1_executed(&prepared, &states, &states).expect("sound states");
    assert_eq!((v1.no_at_fault_collision, step(v1.first_at_fault), v1.pdms), (0.0, Some(0), 0.0));
}

#[test]
fn a_red_connector_is_touched_at_the_worked_step() {
    let mut scene = scene(10.0);
    scene.map.areas.push(area(AreaKind::LaneConnector, true, [20.0, -1.75, 30.0, 1.75]));
    scene.map.areas.push(area(AreaKind::LaneConnector, false, [5.0, -1.75, 30.0, 1.75]));
    let red = scene.map.areas.len() - 2;
    for (red_until, expected) in [(41, Some(16)), (17, Some(16)), (16, None), (0, None)] {
        scene.now.red_areas = (0..41).map(|step| if step < red_until { vec![red, red + 1] } else { vec![] }).collect();
        let got = score(&scene, &drive(10.0, 0.0));
        assert_eq!(step(got.first.red_light), expected, "red for {red_until} steps");
        assert_eq!(got.scores.traffic_light, if expected.is_some() { 0.0 } else { 1.0 });
    }
}

#[test]
fn the_human_is_forgiven_for_zeros_only() {
    let scene = scene(10.0);
    let prepared = PreparedScene::new(&scene).expect("a sound scene");
    // The human drives off the road to the right: DAC and LK are 0, and so is DDC as no lane of the route is there.
    let poses = (1..=8).map(|i| PoseSe2::new(5.0 * f64::from(i), -0.9 * f64::from(i).min(4.0), 0.0)).collect();
    let human = PlannedPoses { dt_s: 0.5, poses };
    let yardstick = Yardstick::new(&prepared, &plan(10.0), Some(&human)).expect("sound plans");
    let got = yardstick.score_executed(&prepared, &drive(10.0, -0.7), Coverage::Whole).expect("sound states");
    assert_eq!((got.unfiltered.drivable_area, got.unfiltered.lane_keeping, got.epdms_unfiltered), (0.0, 0.0, 0.0));
    assert_eq!((got.scores.drivable_area, got.scores.lane_keeping, got.epdms), (1.0, 1.0, 1.0));
    let half = SubScores { driving_direction: 0.5, ..got.scores };
    assert_eq!(half.forgiven(&half).driving_direction, 0.5);
}

#[test]
fn extended_comfort_weighs_two_of_sixteen() {
    let scores = score(&scene(10.0), &drive(10.0, 0.6)).scores;
    assert!((scores.epdms(Some(1.0)) - 14.0 / 16.0).abs() < 1e-12);
    assert!((scores.epdms(Some(0.0)) - 12.0 / 16.0).abs() < 1e-12);
}

/// Makes a sound scene bad.
type Spoil = fn(&mut OpenLoopScene);

#[test]
fn bad_input_is_refused_by_name() {
    let cases: [(&str, Spoil); 10] = [
        ("map has no polygons", |scene| scene.map.areas.clear()),
        ("map has no lanes", |scene| scene.map.areas.retain(|area| !area.kind.is_lane())),
        ("centreline has 1 points", |scene| scene.map.centreline.truncate(1)),
        ("\"areas[0]\" is no polygon", |scene| scene.map.areas[0].outline.truncate(2)),
        ("outside the map", |scene| scene.now.ego.x_m = 351.0),
        ("\"ego.vx\" is NaN", |scene| scene.now.ego.vx_mps = f64::NAN),
        ("\"agents[0]\" is a box of 0 x 1.9 m", |scene| {
            scene.now.agents.push(crate::scene::AgentTrack { length_m: 0.0, ..standing(0, 9.0, 0.0) });
        }),
        ("\"agents[0].steps[0].x\" is inf", |scene| scene.now.agents.push(standing(0, f64::INFINITY, 0.0))),
        ("past has 1 states", |scene| {
            scene.now.past = Some(vec![PastState { time_s: 0.0, state: VehicleState::default() }]);
        }),
        ("\"red_areas[0]\" is 99", |scene| scene.now.red_areas = vec![vec![99]]),
    ];
    for (says, spoil) in cases {
        let mut scene = scene(10.0);
        spoil(&mut scene);
        let error = navsim_v2(&scene, &plan(10.0), None, &plan(10.0)).expect_err(says).to_string();
        assert!(error.contains(says), "{error:?} does not say {says:?}");
    }
}

/// A scene with everything in it, at places that no rounding can decide.
fn busy(speed_mps: f64, others: &[(f64, f64, f64, f64)]) -> OpenLoopScene {
    let mut scene = scene(speed_mps);
    scene.map.areas.push(area(AreaKind::Intersection, false, [40.3, -1.75, 52.1, 8.75]));
    scene.map.areas.push(area(AreaKind::LaneConnector, true, [40.3, -1.75, 52.1, 1.75]));
    let red = scene.map.areas.len() - 1;
    scene.now.red_areas = (0..STATES).map(|step| if step > 30 { vec![red] } else { vec![] }).collect();
    scene.now.agents = (0u32..)
        .zip(others)
        .map(|(id, (x, y, heading, speed))| {
            moving(id, PoseSe2::new(*x, *y, *heading), DVec2::from_angle(*heading) * *speed)
        })
        .collect();
    let past = |tenths: i32| {
        let time_s = f64::from(tenths) / 10.0;
        let state = VehicleState {
            x_m: speed_mps * time_s,
            vx_mps: speed_mps,
            ax_mps2: 0.3 * time_s,
            ..VehicleState::default()
        };
        PastState { time_s, state }
    };
    scene.now.past = Some([-15, -10, -5, 0].map(past).to_vec());
    scene
}

fn moved(
    scene: &OpenLoopScene,
    point: impl Fn(DVec2) -> DVec2,
    angle: impl Fn(f64) -> f64,
    mirror: f64,
) -> OpenLoopScene {
    let mut scene = scene.clone();
    let turned = |area: &mut MapArea| area.outline.iter_mut().for_each(|corner| *corner = point(*corner));
    scene.map.areas.iter_mut().for_each(turned);
    scene.map.centreline.iter_mut().for_each(|place| *place = point(*place));
    let state = |state: &mut VehicleState| {
        let place = point(state.position());
        (state.x_m, state.y_m, state.heading_rad) = (place.x, place.y, angle(state.heading_rad));
        state.vy_mps *= mirror;
        state.ay_mps2 *= mirror;
        state.steering_rad *= mirror;
        state.yaw_rate_radps *= mirror;
    };
    state(&mut scene.now.ego);
    scene.now.past.iter_mut().flatten().for_each(|past| state(&mut past.state));
    let zero = point(DVec2::ZERO);
    for moving in scene.now.agents.iter_mut().flat_map(|agent| &mut agent.steps).flatten() {
        moving.pose = PoseSe2 { position: point(moving.pose.position), heading_rad: angle(moving.pose.heading_rad) };
        moving.velocity_mps = point(moving.velocity_mps) - zero;
    }
    scene
}

fn same(a: &NavsimV2, b: &NavsimV2) -> Result<(), TestCaseError> {
    let discrete = |one: &NavsimV2| {
        let one_ep = |scores: SubScores| SubScores { ego_progress: 0.0, ..scores };
        (one_ep(one.scores), one_ep(one.reference), one.areas, one.first, one.comfort_terms, one.history_terms)
    };
    prop_assert_eq!(discrete(a), discrete(b));
    prop_assert!((a.scores.ego_progress - b.scores.ego_progress).abs() < 1e-7);
    prop_assert!((a.epdms - b.epdms).abs() < 1e-7);
    Ok(())
}

fn others() -> impl Strategy<Value = Vec<(f64, f64, f64, f64)>> {
    prop::collection::vec((-20.0..60.0f64, -6.0..10.0f64, -3.0..3.0f64, 0.0..12.0f64), 0..6)
}

proptest! {
    #[test]
    fn a_moved_turned_mirrored_and_reordered_scene_scores_the_same(
        speed in 1.0..14.0f64, aside in -3.0..8.0f64, others in others(),
        x in -1e5..1e5f64, y in -1e5..1e5f64, turn in -3.0..3.0f64, rotate in 0usize..5,
    ) {
        let here = busy(speed, &others);
        let poses = |side: f64| {
            let at = |i: u32| {
                let share = (f64::from(i) / 5.0).min(1.0);
                PoseSe2::new(0.5 * speed * f64::from(i), side * aside * share, 0.0)
            };
            PlannedPoses { dt_s: 0.5, poses: (1..=8).map(at).collect() }
        };
        let score = |scene: &OpenLoopScene, side: f64| {
            navsim_v2(scene, &plan(speed), Some(&poses(side)), &poses(side)).expect("a sound scene")
        };
        let once = score(&here, 1.0);
        let frame = PoseSe2::new(x, y, turn);
        same(&once, &score(&moved(&here, |point| frame.to_outer(point), |angle| angle + turn, 1.0), 1.0))?;
        same(&once, &score(&moved(&here, |point| DVec2::new(point.x, -point.y), |angle| -angle, -1.0), -1.0))?;
        let mut reordered = here.clone();
        let count = reordered.now.agents.len().max(1);
        reordered.now.agents.rotate_left(rotate % count);
        same(&once, &score(&reordered, 1.0))?;
    }

    #[test]
    fn scores_stay_within_bounds_and_a_batch_equals_pairs(speed in 0.0..14.0f64, others in others()) {
        let scene = busy(speed, &others);
        let prepared = PreparedScene::new(&scene).expect("a sound scene");
        let reference = plan(speed);
        let other = plan(0.7 * speed);
        let pair = Yardstick::new(&prepared, &reference, None).expect("a plan").score(&prepared, &other).expect("a plan");
        let batch = crate::oracle::rank_plans(&prepared, &reference, std::slice::from_ref(&other)).expect("plans");
        prop_assert_eq!(batch.scores[0].scores, pair.scores);
        prop_assert_eq!(batch.reference.scores, pair.reference);
        prop_assert!((0.0..=1.0).contains(&pair.epdms));
        let states = prepared.executor().execute(prepared.ego(), &other).expect("a plan");
        let rollout = |states| crate::oracle::Rollout { states, reacting: None };
        let first = prepared.executor().execute(prepared.ego(), &reference).expect("a plan");
        let driven = crate::oracle::rank_rollouts(&prepared, &rollout(&first), &[rollout(&states)]).expect("states");
        prop_assert_eq!(driven, batch);
    }
}

#[test]
fn a_rollout_meets_its_own_agents() {
    let scene = scene(10.0);
    let prepared = PreparedScene::new(&scene).expect("a sound scene");
    let states = drive(10.0, 0.0);
    let own = prepared.traffic_of(&[standing(9, 30.0, 0.0)]).expect("sound agents");
    let rollout = |reacting| crate::oracle::Rollout { states: &states, reacting };
    let got =
        crate::oracle::rank_rollouts(&prepared, &rollout(None), &[rollout(Some(&own)), rollout(None)]).expect("sound");
    assert_eq!((got.scores[0].scores.no_at_fault_collision, got.scores[1].scores.no_at_fault_collision), (0.0, 1.0));
    assert_eq!(got.scores[0].first.at_fault, Some(Violation { step: 24, object: Some(9) }));
    assert_eq!(got.best(), Some(1));
}
