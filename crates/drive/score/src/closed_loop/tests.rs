//! Drives on a straight road state by state, their terms worked out by hand for both profiles; laws of symmetry.

use ds_space::{DVec2, PoseSe2};
use proptest::prelude::*;

use super::*;
use crate::driving_score::Term;
use crate::footprint::Footprint;
use crate::motion::VehicleState;
use crate::scene::ObjectClass;

const ZOE: Footprint = Footprint { length_m: 4.084, width_m: 1.730, rear_axle_to_centre_m: 1.21, wheel_base_m: 2.588 };

fn ring([x0, y0, x1, y1]: [f64; 4]) -> Vec<DVec2> {
    [(x0, y0), (x1, y0), (x1, y1), (x0, y1)].map(|(x, y)| DVec2::new(x, y)).to_vec()
}

fn lane(from: (f64, f64), to: (f64, f64), connector: bool) -> LoopLane {
    let (a, b) = (DVec2::new(from.0, from.1), DVec2::new(to.0, to.1));
    let outline = ring([a.x.min(b.x), a.y - 1.75, a.x.max(b.x), a.y + 1.75]);
    LoopLane { line: vec![a, b], outline, connector, on_route: true }
}

/// A lane along +x, one against it to its left, a junction of 100..112 m with a connector, a lane behind it.
fn scene() -> LoopScene {
    LoopScene {
        dt_s: 0.1,
        footprint: ZOE,
        lanes: vec![
            lane((-20.0, 0.0), (100.0, 0.0), false),
            lane((100.0, 3.5), (-20.0, 3.5), false),
            lane((100.0, 0.0), (112.0, 0.0), true),
            lane((112.0, 0.0), (200.0, 0.0), false),
        ],
        drivable: vec![ring([-20.0, -2.75, 200.0, 5.25])],
        junctions: vec![ring([100.0, -2.75, 112.0, 5.25])],
        has_lights: true,
        expert_path: vec![DVec2::ZERO, DVec2::new(160.0, 0.0)],
        window_share: None,
    }
}

fn ego(x_m: f64, y_m: f64, heading_rad: f64, speed_mps: f64) -> LoopEgo {
    let centre = PoseSe2::new(x_m, y_m, heading_rad);
    let axle = centre.to_outer(DVec2::new(-ZOE.rear_axle_to_centre_m, 0.0));
    let state = VehicleState { x_m: axle.x, y_m: axle.y, heading_rad, vx_mps: speed_mps, ..VehicleState::default() };
    LoopEgo { centre, velocity_mps: centre.forward() * speed_mps, state: Some(state) }
}

fn state(tick: u32, ego: LoopEgo) -> LoopState {
    LoopState { tick, ego, objects: Vec::new(), red_lanes: Vec::new() }
}

/// 10 m/s along the lane, beside its centre.
fn straight(states: u32, aside_m: f64) -> Vec<LoopState> {
    (0..states).map(|tick| state(tick, ego(f64::from(tick), aside_m, 0.0, 10.0))).collect()
}

fn object(id: u32, x_m: f64, y_m: f64, speed_mps: f64) -> LoopObject {
    LoopObject {
        id,
        class: ObjectClass::Agent,
        pose: PoseSe2::new(x_m, y_m, 0.0),
        length_m: 4.0,
        width_m: 2.0,
        velocity_mps: DVec2::new(speed_mps, 0.0),
    }
}

fn run(profile: Profile, states: &[LoopState]) -> (Vec<LoopScore>, DrivingScore) {
    closed_loop(&scene(), profile, states).expect("a sound drive")
}

/// Scores one state after one that is the same but for its objects.
fn second(profile: Profile, ego: LoopEgo, objects: Vec<LoopObject>, red_lanes: Vec<usize>) -> LoopScore {
    let states = [state(0, ego), LoopState { objects, red_lanes, ..state(1, ego) }];
    run(profile, &states).0[1]
}

#[test]
fn touches_by_table() {
    let cone = |object: LoopObject| LoopObject { class: ObjectClass::Static, ..object };
    // Half lengths: 2.2575 m (fixed size) or 2.042 m (own), and 2 m.
    for (speed_mps, other, bridgesim, strict) in [
        (10.0, object(1, 4.2, 0.0, 5.0), 0.0, 1.0),
        (10.0, object(1, 4.0, 0.0, 5.0), 0.0, 0.0),
        (10.0, cone(object(1, 4.0, 0.0, 0.0)), 0.0, 0.5),
        (0.04, object(1, 4.0, 0.0, 5.0), 1.0, 1.0),
        (10.0, object(1, -1.1, 1.8, 5.0), 1.0, 1.0),
        // Beside: the fault is that of whoever left its lane, and the ego did not.
        (10.0, object(1, -0.9, 1.8, 5.0), 0.0, 1.0),
        (10.0, object(1, -0.9, 1.8, 0.0), 0.0, 0.0),
        (10.0, object(1, -4.0, 0.0, 15.0), 1.0, 1.0),
    ] {
        for (profile, expected) in [(Profile::bridgesim(), bridgesim), (Profile::strict(), strict)] {
            let got = second(profile, ego(50.0, 0.0, 0.0, speed_mps), vec![shifted(&other, 50.0)], vec![]);
            assert_eq!(got.term(Term::NoAtFaultCollision), Some(expected), "{} {other:?}", profile.label());
            assert_eq!(got.at_fault_object, (expected < 1.0).then_some(1));
        }
    }
}

fn shifted(object: &LoopObject, by_m: f64) -> LoopObject {
    let mut object = *object;
    object.pose.position.x += by_m;
    object
}

#[test]
fn a_touch_at_the_start_counts_in_bridgesim_only() {
    let mut states = straight(3, 0.0);
    states.iter_mut().for_each(|state| state.objects = vec![object(4, 4.0 + f64::from(state.tick), 0.0, 10.0)]);
    let terms = |profile| run(profile, &states).0.iter().map(|score| score.terms[0]).collect::<Vec<_>>();
    assert_eq!(terms(Profile::bridgesim()), vec![Some(0.0); 3]);
    assert_eq!(terms(Profile::strict()), vec![Some(1.0); 3]);
}

#[test]
fn times_to_collision_by_table() {
    // Bumpers: 4.2575 m (fixed) and 4.042 m (own) from centre to centre; looked ahead 1.0 s and 0.9 s.
    for (speed_mps, other, bridgesim, strict) in [
        (10.0, object(1, 14.2, 0.0, 0.0), 0.0, 1.0),
        (10.0, object(1, 13.0, 0.0, 0.0), 0.0, 0.0),
        (10.0, object(1, 14.3, 0.0, 0.0), 1.0, 1.0),
        (10.0, object(1, 9.2, 0.0, 5.0), 0.0, 1.0),
        (0.04, object(1, 4.3, 0.0, -15.0), 1.0, 0.0),
        // From behind: behind in both.
        (10.0, object(1, -8.0, 0.0, 15.0), 1.0, 1.0),
        // Cutting in beside: in the half plane ahead, but not in the cone.
        (10.0, LoopObject { velocity_mps: DVec2::new(10.0, -2.0), ..object(1, 0.5, 3.0, 0.0) }, 0.0, 1.0),
    ] {
        for (profile, expected) in [(Profile::bridgesim(), bridgesim), (Profile::strict(), strict)] {
            let got = second(profile, ego(50.0, 0.0, 0.0, speed_mps), vec![shifted(&other, 50.0)], vec![]);
            assert_eq!(got.term(Term::TimeToCollision), Some(expected), "{} {other:?}", profile.label());
        }
    }
}

#[test]
fn surfaces_by_table() {
    // Half widths 0.926 m (fixed) and 0.865 m (own); lanes end at -1.75 m, the drivable layer at -2.75 m.
    for (y_m, bridgesim, strict) in
        [(0.0, 1.0, 1.0), (-0.82, 1.0, 1.0), (-0.83, 0.0, 1.0), (-1.88, 0.0, 1.0), (-1.89, 0.0, 0.0), (1.75, 1.0, 1.0)]
    {
        for (profile, expected) in [(Profile::bridgesim(), bridgesim), (Profile::strict(), strict)] {
            let got = second(profile, ego(50.0, y_m, 0.0, 10.0), vec![], vec![]);
            assert_eq!(got.term(Term::DrivableArea), Some(expected), "{} {y_m} m", profile.label());
        }
    }
}

#[test]
fn only_strict_notices_the_wrong_way() {
    // 3 m/s against the lane: 0.3 m a state from the second one on; 2 m in 7 steps, at most 3.3 m in 11.
    let slow: Vec<LoopState> =
        (0..20).map(|tick| state(tick, ego(50.0 + 0.3 * f64::from(tick), 3.5, 0.0, 3.0))).collect();
    let (strict, _) = run(Profile::strict(), &slow);
    let first = strict.iter().find(|score| score.term(Term::DrivingDirection) < Some(1.0)).expect("it is noticed");
    assert_eq!((first.tick, first.term(Term::DrivingDirection)), (7, Some(0.5)));
    assert_eq!(strict[19].term(Term::DrivingDirection), Some(0.5));
    let (strict, _) = run(Profile::strict(), &straight(20, 3.5));
    assert_eq!((strict[1].terms[2], strict[2].terms[2], strict[6].terms[2]), (Some(1.0), Some(0.5), Some(0.0)));
    let (bridgesim, _) = run(Profile::bridgesim(), &straight(20, 3.5));
    assert!(bridgesim.iter().all(|score| score.term(Term::DrivingDirection) == Some(1.0)));
}

#[test]
fn lanes_are_kept_for_two_seconds() {
    for (profile, aside_m, expected) in [
        (Profile::bridgesim(), 0.51, Some(20)),
        (Profile::strict(), 0.51, Some(19)),
        (Profile::bridgesim(), 0.5, None),
        (Profile::strict(), 0.5, None),
    ] {
        let (states, drive) = run(profile, &straight(40, aside_m));
        let first = states.iter().find(|score| score.term(Term::LaneKeeping) == Some(0.0)).map(|score| score.tick);
        assert_eq!((first, drive.terms[5].first_lost), (expected, expected), "{} {aside_m} m", profile.label());
    }
    // The junction holds twelve states of these: strict pauses.
    let late: Vec<LoopState> = (0..40).map(|tick| state(tick, ego(95.0 + f64::from(tick), 0.6, 0.0, 10.0))).collect();
    let first = |profile| run(profile, &late).1.terms[5].first_lost;
    assert_eq!((first(Profile::bridgesim()), first(Profile::strict())), (Some(20), Some(30)));
}

#[test]
fn red_lights_by_table() {
    // Lane 0 ends at 100 m; lane 2 is the connector, 12 m long, from there on.
    for (x_m, speed_mps, red, bridgesim, strict) in [
        (94.0, 10.0, 0, 1.0, 1.0),
        (95.1, 10.0, 0, 0.0, 1.0),
        (95.1, 0.9, 0, 1.0, 1.0),
        (98.5, 10.0, 2, 1.0, 0.0),
        (106.0, 10.0, 2, 1.0, 0.0),
        (107.5, 10.0, 2, 0.0, 0.0),
        (90.0, 10.0, 2, 1.0, 1.0),
    ] {
        for (profile, expected) in [(Profile::bridgesim(), bridgesim), (Profile::strict(), strict)] {
            let got = second(profile, ego(x_m, 0.0, 0.0, speed_mps), vec![], vec![red]);
            assert_eq!(got.term(Term::TrafficLight), Some(expected), "{} {x_m} m", profile.label());
        }
    }
}

#[test]
fn comfort_of_a_brake_by_hand() {
    // From 10 m/s to 9.6 m/s in one state: a = 4 m/s², jerk = 40 m/s³; in the next state a = 0, jerk = 40 again.
    let speeds = [10.0, 10.0, 10.0, 10.0, 9.6, 9.6, 9.6];
    let states: Vec<LoopState> =
        (0u32..).zip(speeds).map(|(tick, speed)| state(tick, ego(f64::from(tick), 0.0, 0.0, speed))).collect();
    let column = |profile, term| run(profile, &states).0.iter().map(|score| score.term(term)).collect::<Vec<_>>();
    let [one, zero] = [Some(1.0), Some(0.0)];
    assert_eq!(column(Profile::bridgesim(), Term::HistoryComfort), [one, one, one, one, zero, zero, one]);
    assert_eq!(column(Profile::bridgesim(), Term::ExtendedComfort), [one, one, one, one, zero, zero, zero]);
    assert_eq!(column(Profile::strict(), Term::ExtendedComfort), [None, None, None, one, zero, zero, zero]);
    assert_eq!(column(Profile::strict(), Term::HistoryComfort), [None; 7]);
}

#[test]
fn strict_judges_comfort_over_the_last_second_and_a_half() {
    let mut states = straight(40, 0.0);
    // 3 m/s² are more than the 2.4 m/s² allowed forwards.
    for state in &mut states[20..] {
        state.ego.state.iter_mut().for_each(|state| state.ax_mps2 = 3.0);
    }
    let (scores, _) = run(Profile::strict(), &states);
    let at = |tick: usize| scores[tick].term(Term::HistoryComfort);
    assert_eq!((at(14), at(15), at(18), at(30)), (None, Some(1.0), Some(1.0), Some(0.0)));
}

#[test]
fn a_perfect_drive_and_its_totals() {
    let (scores, drive) = run(Profile::bridgesim(), &straight(81, 0.0));
    assert!(scores.iter().all(|score| score.epdms() == Some(1.0)));
    assert_eq!((drive.mean_epdms, drive.ticks, drive.ended), (Some(1.0), 81, None));
    // 80 m of 160 m, counted from the first state.
    assert!((drive.driving_score.expect("it applies") - 0.5).abs() < 1e-12);
    let windowed = LoopScene { window_share: Some(0.5), ..scene() };
    let (_, drive) = closed_loop(&windowed, Profile::bridgesim(), &straight(81, 0.0)).expect("a sound drive");
    assert_eq!(drive.route_completion, Some(1.0));
    // Half of the states in the second half of the path: strict counts what was left.
    let late: Vec<LoopState> = (80..121).map(|tick| state(tick, ego(f64::from(tick), 0.0, 0.0, 10.0))).collect();
    let completion = |profile| run(profile, &late).1.route_completion.expect("it applies");
    assert!((completion(Profile::bridgesim()) - 0.25).abs() < 1e-12);
    assert!((completion(Profile::strict()) - 0.5).abs() < 1e-12);
}

#[test]
fn totals_by_table() {
    let score = |terms: [Option<f64>; 8]| {
        let (at_fault_object, ttc_object, route_share, ending) = (None, None, None, None);
        LoopScore { tick: 0, terms, at_fault_object, ttc_object, route_share, ending }.epdms()
    };
    let all = Some(1.0);
    let zero = Some(0.0);
    assert_eq!(score([all; 8]), Some(1.0));
    assert_eq!(score([all, all, all, all, zero, all, all, all]), Some(6.0 / 11.0));
    assert_eq!(score([all, all, all, zero, all, all, all, all]), Some(0.0));
    assert_eq!(score([Some(0.5), None, all, None, all, zero, None, None]), Some(0.5 * 5.0 / 7.0));
    assert_eq!(score([all, all, all, all, None, None, None, None]), None);
}

#[test]
fn drives_end_by_table() {
    for (x_m, y_m, expected) in [
        (152.0, 0.0, None),
        (152.1, 0.0, Some(Ending::Arrived)),
        (50.0, 4.0, None),
        (50.0, -4.1, Some(Ending::LeftRoute)),
        (-16.0, 0.0, None),
        (-16.1, 0.0, Some(Ending::DroveBackwards)),
    ] {
        for profile in [Profile::bridgesim(), Profile::strict()] {
            assert_eq!(second(profile, ego(x_m, y_m, 0.0, 5.0), vec![], vec![]).ending, expected, "({x_m}, {y_m})");
        }
    }
    let states: Vec<LoopState> = (0..160).map(|tick| state(tick, ego(f64::from(tick), 0.0, 0.0, 10.0))).collect();
    let (_, drive) = run(Profile::strict(), &states);
    assert_eq!((drive.ended, drive.route_completion), (Some((153, Ending::Arrived)), Some(1.0)));
}

#[test]
fn what_does_not_apply_is_refused_or_none() {
    let standing = LoopScene { expert_path: vec![DVec2::ZERO, DVec2::new(0.9, 0.0)], ..scene() };
    let error = ClosedLoop::new(&standing, Profile::bridgesim()).expect_err("it stands still").to_string();
    assert_eq!(error, "expert path is 0.9 m long, profile bridgesim needs at least 1 m");
    let (scores, drive) = closed_loop(&standing, Profile::strict(), &straight(20, 0.0)).expect("a sound drive");
    assert_eq!((drive.route_completion, drive.expert_stands_still), (None, true));
    assert_eq!((drive.driving_score, scores[0].route_share), (drive.mean_epdms, None));

    let bare = LoopScene { lanes: vec![], drivable: vec![], junctions: vec![], has_lights: false, ..scene() };
    assert_eq!(ClosedLoop::new(&bare, Profile::bridgesim()).map(|_| ()), Err(ScoreError::NoLanes));
    let (scores, _) = closed_loop(&bare, Profile::strict(), &straight(2, 0.0)).expect("a sound drive");
    assert_eq!(scores[1].terms, [Some(1.0), None, None, None, Some(1.0), None, None, None]);
    assert_eq!(scores[1].epdms(), Some(1.0));
}

/// Makes a sound input bad.
type Spoil<T> = fn(&mut T);

#[test]
fn bad_input_is_refused_by_name() {
    let spoiled: [(&str, Spoil<LoopState>); 5] = [
        ("\"states[1].ego.x\" is NaN", |state| state.ego.centre.position.x = f64::NAN),
        ("\"states[1].ego.vy\" is inf", |state| state.ego.velocity_mps.y = f64::INFINITY),
        ("\"states[1].objects[0]\" is a box of 4 x 0 m", |state| {
            state.objects = vec![LoopObject { width_m: 0.0, ..object(1, 0.0, 0.0, 0.0) }];
        }),
        ("\"states[1].objects[0].heading\" is NaN", |state| {
            state.objects = vec![object(1, 0.0, 0.0, 0.0)];
            state.objects[0].pose.heading_rad = f64::NAN;
        }),
        ("\"states[1].red_lanes\" is 9, there are 4", |state| state.red_lanes = vec![9]),
    ];
    for (says, spoil) in spoiled {
        let mut states = straight(2, 0.0);
        spoil(&mut states[1]);
        let error = closed_loop(&scene(), Profile::bridgesim(), &states).expect_err(says).to_string();
        assert!(error.contains(says), "{error:?} does not say {says:?}");
    }
    let error = closed_loop(&scene(), Profile::bridgesim(), &straight(1, 0.0)).expect_err("one state").to_string();
    assert_eq!(error, "drive has 1 states, at least 2 are needed");
    let spoiled: [(&str, Spoil<LoopScene>); 4] = [
        ("\"expert_path\"", |scene| scene.expert_path.clear()),
        ("\"lanes[1].outline\"", |scene| scene.lanes[1].outline.clear()),
        ("\"1 / dt\" is inf", |scene| scene.dt_s = 0.0),
        ("\"ego\" is a box of 0 x", |scene| scene.footprint.length_m = 0.0),
    ];
    for (says, spoil) in spoiled {
        let mut scene = scene();
        spoil(&mut scene);
        let error = ClosedLoop::new(&scene, Profile::strict()).map(|_| ()).expect_err(says).to_string();
        assert!(error.contains(says), "{error:?} does not say {says:?}");
    }
}

/// Applies a motion of the plane to a drive; `mirror` is −1 for a reflection.
fn moved(
    scene: &LoopScene,
    states: &[LoopState],
    point: impl Fn(DVec2) -> DVec2,
    angle: impl Fn(f64) -> f64,
    mirror: f64,
) -> (LoopScene, Vec<LoopState>) {
    let (mut scene, mut states) = (scene.clone(), states.to_vec());
    let zero = point(DVec2::ZERO);
    let pose = |pose: PoseSe2| PoseSe2 { position: point(pose.position), heading_rad: angle(pose.heading_rad) };
    let all = |points: &mut Vec<DVec2>| points.iter_mut().for_each(|place| *place = point(*place));
    for lane in &mut scene.lanes {
        all(&mut lane.line);
        all(&mut lane.outline);
    }
    scene.drivable.iter_mut().chain(&mut scene.junctions).for_each(all);
    all(&mut scene.expert_path);
    for state in &mut states {
        state.ego.centre = pose(state.ego.centre);
        state.ego.velocity_mps = point(state.ego.velocity_mps) - zero;
        if let Some(state) = &mut state.ego.state {
            let axle = pose(state.pose());
            (state.x_m, state.y_m, state.heading_rad) = (axle.position.x, axle.position.y, axle.heading_rad);
            state.yaw_rate_radps *= mirror;
            state.ay_mps2 *= mirror;
        }
        for object in &mut state.objects {
            object.pose = pose(object.pose);
            object.velocity_mps = point(object.velocity_mps) - zero;
        }
    }
    (scene, states)
}

fn weaving(speed_mps: f64, aside_m: f64, sway: f64, others: &[(f64, f64, f64, f64)]) -> Vec<LoopState> {
    let drive = |tick: u32| {
        let time_s = 0.1 * f64::from(tick) + 0.03;
        let heading_rad = sway * (1.7 * time_s).sin();
        let objects = (0u32..).zip(others).map(|(id, (x, y, heading, speed))| LoopObject {
            id,
            class: if id % 3 == 2 { ObjectClass::Static } else { ObjectClass::Agent },
            pose: PoseSe2::new(x + heading.cos() * speed * time_s, y + heading.sin() * speed * time_s, *heading),
            length_m: 4.1,
            width_m: 1.9,
            velocity_mps: DVec2::from_angle(*heading) * *speed,
        });
        LoopState {
            tick,
            ego: ego(60.0 + speed_mps * time_s, aside_m + sway * time_s, heading_rad, speed_mps),
            objects: objects.collect(),
            red_lanes: if tick > 25 { vec![0, 2] } else { vec![] },
        }
    };
    (0..45).map(drive).collect()
}

fn same(a: &(Vec<LoopScore>, DrivingScore), b: &(Vec<LoopScore>, DrivingScore)) -> Result<(), TestCaseError> {
    for (a, b) in a.0.iter().zip(&b.0) {
        prop_assert_eq!((a.terms, a.at_fault_object, a.ttc_object), (b.terms, b.at_fault_object, b.ttc_object));
        prop_assert_eq!(a.ending, b.ending);
    }
    let close = |a: Option<f64>, b: Option<f64>| (a.expect("applies") - b.expect("applies")).abs() < 1e-7;
    prop_assert!(close(a.1.driving_score, b.1.driving_score) && close(a.1.route_completion, b.1.route_completion));
    Ok(())
}

proptest! {
    #[test]
    fn a_moved_turned_mirrored_reordered_and_later_drive_scores_the_same(
        speed in 0.5..14.0f64, aside in -3.0..4.5f64, sway in -0.3..0.3f64,
        others in prop::collection::vec((40.0..140.0f64, -6.0..8.0f64, -3.0..3.0f64, 0.0..12.0f64), 0..6),
        x in -1e5..1e5f64, y in -1e5..1e5f64, turn in -3.0..3.0f64, rotate in 0usize..5, later in 1u32..1000,
    ) {
        let here = weaving(speed, aside, sway, &others);
        for profile in [Profile::bridgesim(), Profile::strict()] {
            let score = |scene: &LoopScene, states: &[LoopState]| closed_loop(scene, profile, states).expect("a sound drive");
            let once = score(&scene(), &here);
            let base = PoseSe2::new(x, y, turn);
            let (there, states) = moved(&scene(), &here, |point| base.to_outer(point), |angle| angle + turn, 1.0);
            same(&once, &score(&there, &states))?;
            let flip = |point: DVec2| DVec2::new(point.x, -point.y);
            let (there, states) = moved(&scene(), &here, flip, |angle| -angle, -1.0);
            same(&once, &score(&there, &states))?;
            let mut states = here.clone();
            for state in &mut states {
                state.tick += later;
                let count = state.objects.len().max(1);
                state.objects.rotate_left(rotate % count);
            }
            same(&once, &score(&scene(), &states))?;
        }
    }
}
