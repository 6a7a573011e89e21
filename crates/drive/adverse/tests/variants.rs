//! Variants of generated scenarios: each collides as its class says along the logged drive, and no search is random.

use std::sync::Arc;

use ds_adverse::{MotionModel, Options, Refusal, Rejection, variants};
use ds_scenario::{Family, generate};
use ds_sim::{SimConfig, Simulation};
use ds_space::Tick;
use ds_world::CrashClass;

#[test]
fn every_variant_meets_the_logged_ego_as_planned_and_nobody_before() {
    let model = MotionModel::town();
    let mut classes = Vec::new();
    for (family, seed) in [(Family::CutIn, 1000), (Family::FreeCurve, 1001), (Family::UnprotectedLeft, 1000)] {
        let scene = generate(family, seed);
        let built = variants(&scene, &model, &Options::default()).expect("the ego drives");
        assert!(!built.variants.is_empty(), "{}", scene.name);
        for variant in built.variants {
            classes.push(variant.class);
            assert_eq!(variant.scene.name, format!("{}__{}", scene.name, variant.class.name()));
            assert_eq!(variant.scene.family, variant.class.name());
            let track = &variant.scene.tracks[variant.agent.0 as usize];
            assert!(track.points.iter().all(Option::is_some), "it neither appears nor vanishes");
            let solution = variant.solution.as_ref().expect("an expert was asked for");
            assert_eq!(solution.from, variant.measures.threat.plus(5));
            assert!(solution.poses.len() as u32 > 100 - solution.from.0, "it goes to the end of the scored window");
            let met = variant.measures.met.tick.0.saturating_sub(solution.from.0) as usize;
            let logged = scene.ego_log[variant.measures.met.tick.0 as usize].pose.position;
            assert!(
                met >= solution.poses.len() || solution.poses[met].position.distance(logged) > 0.3,
                "it does otherwise"
            );
            let config = SimConfig { agents: None, ..SimConfig::default() };
            let last = variant.scene.last_tick();
            let mut simulation = Simulation::new(Arc::new(variant.scene), config, Tick(0)).expect("a sound scene");
            while simulation.state().contacts.is_empty() && simulation.state().tick < last {
                simulation.step();
            }
            let state = simulation.state();
            assert_eq!(state.tick, variant.measures.met.tick);
            assert!(state.tick.0.abs_diff(variant.planned.0) <= 3);
            assert!((50..=93).contains(&state.tick.0), "within the scored window");
            assert_eq!(state.contacts.len(), 1);
            assert_eq!(state.contacts[0].agent, variant.agent);
            assert!(state.contacts[0].closing_speed_mps >= 2.0);
            assert!(variant.measures.threat <= state.tick);
        }
    }
    classes.sort_unstable();
    classes.dedup();
    assert!(classes.len() >= 3, "{classes:?}");
}

#[test]
fn the_same_seed_gives_the_same_variants_and_another_seed_others() {
    let (scene, model) = (generate(Family::CutIn, 1000), MotionModel::town());
    let of = |seed| {
        let options = Options { seed, classes: vec![CrashClass::ChangingLanes], ..Options::default() };
        let built = variants(&scene, &model, &options).expect("the ego drives");
        built.variants.iter().map(|variant| variant.scene.digest).collect::<Vec<_>>()
    };
    assert_eq!(of(0), of(0));
    assert_ne!(of(0), of(1));
}

#[test]
fn a_road_without_junction_has_no_crossing_and_says_so() {
    let scene = generate(Family::FreeCurve, 1000);
    let options = Options { classes: vec![CrashClass::StraightCrossingPaths], ..Options::default() };
    let built = variants(&scene, &MotionModel::town(), &options).expect("the ego drives");
    assert!(built.variants.is_empty());
    assert_eq!(built.rejected[&(CrashClass::StraightCrossingPaths, Rejection::NoTarget)], 1);
}

#[test]
fn what_cannot_be_varied_is_refused_with_its_number() {
    let model = MotionModel::town();
    let mut short = generate(Family::FreeCurve, 1000);
    short.ego_log.truncate(90);
    assert_eq!(
        variants(&short, &model, &Options::default()).expect_err("too short"),
        Refusal::Short { last: 89, needed: 100 }
    );
    let mut standing = generate(Family::FreeCurve, 1000);
    let first = standing.ego_log[0];
    standing.ego_log.iter_mut().for_each(|state| *state = first);
    let refusal = variants(&standing, &model, &Options::default()).expect_err("it stands");
    assert!(refusal.to_string().contains("drives 0.0 m"), "{refusal}");
    let mut coarse = generate(Family::FreeCurve, 1000);
    coarse.dt = ds_space::SimTime::from_secs(0.5);
    assert!(matches!(variants(&coarse, &model, &Options::default()), Err(Refusal::TimeStep { .. })));
}
