//! Variants of generated scenarios: each collides as its class says along the logged drive, and no search is random.

use std::sync::Arc;

use ds_adverse::{MotionModel, Options, Refusal, Rejection, advbmt, variants};
use ds_scenario::{Family, generate};
use ds_sim::{SimConfig, Simulation};
use ds_space::Tick;
use ds_world::{AdversaryMode, CrashClass, Scene};

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
            let margin = variant.margin_ticks.expect("it is solved from the first tick on at least");
            assert!(margin >= 5 && variant.measures.threat.plus(margin) < variant.measures.met.tick, "{margin}");
            assert!(solution.post_encroachment_ticks != Some(0), "they are at no place at once");
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
fn the_arm_of_advbmt_meets_the_ego_in_its_own_shape_and_asks_for_no_way_out() {
    let model = MotionModel::town();
    let options = Options { mode: AdversaryMode::Replay, ..Options::default() };
    let mut fallen = std::collections::BTreeSet::new();
    let mut met = 0;
    for seed in 1000..1012 {
        let scene = generate(Family::FreeCurve, seed);
        let built = advbmt(&scene, &model, &options).expect("the ego drives");
        let again = advbmt(&scene, &model, &options).expect("the ego drives");
        fallen.extend(built.rejected.keys().map(|(_, reason)| *reason));
        assert_eq!(built.rejected, again.rejected);
        assert_eq!(built.candidates.values().sum::<usize>(), 1);
        for (variant, again) in built.variants.into_iter().zip(again.variants) {
            met += 1;
            assert_eq!(variant.scene.digest, again.scene.digest);
            assert!(variant.planned.0 >= 90, "at the end of a window of 91 frames");
            assert_eq!(variant.scene.tracks[variant.agent.0 as usize].size, scene.vehicle.size);
            let fell = |reason| built.rejected.contains_key(&(variant.class, reason));
            assert_eq!(variant.solution.is_none(), fell(Rejection::Unavoidable) || fell(Rejection::Unsolved));
            assert!(variant.solution.is_none() || variant.emptied.is_none(), "who proves too much is wrong");
            let config = SimConfig { agents: None, ..SimConfig::default() };
            let mut simulation = Simulation::new(Arc::new(variant.scene), config, Tick(0)).expect("a sound scene");
            while simulation.state().contacts.is_empty() && simulation.state().tick < variant.planned {
                simulation.step();
            }
            let contacts = &simulation.state().contacts;
            assert!(contacts.iter().any(|contact| contact.agent == variant.agent), "{}", variant.planned);
        }
    }
    assert!(met > 0 && fallen.contains(&Rejection::OffRoad), "{met} {fallen:?}");
}

#[test]
fn a_road_without_junction_has_no_crossing_and_says_so() {
    let scene = generate(Family::FreeCurve, 1000);
    let options = Options { classes: vec![CrashClass::StraightCrossingPaths], ..Options::default() };
    let built = variants(&scene, &MotionModel::town(), &options).expect("the ego drives");
    assert!(built.variants.is_empty());
    assert_eq!(built.rejected[&(CrashClass::StraightCrossingPaths, Rejection::NoTarget)], 1);
}

/// A scenario whose recording ends early.
fn cut(mut scene: Scene, ticks: usize) -> Scene {
    scene.ego_log.truncate(ticks);
    scene.tracks.iter_mut().for_each(|track| track.points.truncate(ticks));
    scene.map.traffic_lights.iter_mut().for_each(|light| light.states.truncate(ticks));
    scene
}

#[test]
fn in_a_shorter_log_contact_lies_before_its_end() {
    let model = MotionModel::town();
    let built =
        variants(&cut(generate(Family::UnprotectedLeft, 1000), 75), &model, &Options::default()).expect("long enough");
    assert!(!built.variants.is_empty(), "{:?}", built.rejected);
    for variant in &built.variants {
        assert!((50..=64).contains(&variant.planned.0), "{}", variant.planned);
        let solution = variant.solution.as_ref().expect("it is solved");
        assert!(solution.from.0 as usize + solution.poses.len() >= 75, "it goes to the last tick");
    }
    let short = advbmt(&cut(generate(Family::UnprotectedLeft, 1000), 75), &model, &Options::default());
    assert_eq!(short.expect_err("no window ends there"), Refusal::Short { last: 74, needed: 90 });
}

#[test]
fn what_cannot_be_varied_is_refused_with_its_number() {
    let model = MotionModel::town();
    assert_eq!(
        variants(&cut(generate(Family::FreeCurve, 1000), 60), &model, &Options::default()).expect_err("too short"),
        Refusal::Short { last: 59, needed: 60 }
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
