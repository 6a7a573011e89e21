//! A reactive adversary in the simulator: it meets the logged ego as planned, resumes to the bit, keeps to the road.

use std::sync::{Arc, LazyLock};

use ds_adverse::{MotionModel, Options, Variant, variants};
use ds_scenario::{Family, generate};
use ds_sim::{SimConfig, Simulation};
use ds_space::plane::polygon::holds;
use ds_space::{DVec2, PoseSe2, SimTime, Tick};
use ds_world::{AdversaryMode, Scene, Trajectory, TrajectoryPoint, WorldState};

/// Returns variants with reactive adversaries, searched once, in a mode.
fn built(mode: AdversaryMode) -> Vec<Variant> {
    static SEARCHED: LazyLock<Vec<Variant>> = LazyLock::new(|| {
        let model = MotionModel::town();
        [(Family::CutIn, 1000), (Family::FreeCurve, 1001), (Family::UnprotectedLeft, 1000)]
            .into_iter()
            .flat_map(|(family, seed)| {
                variants(&generate(family, seed), &model, &Options::default()).expect("the ego drives").variants
            })
            .collect()
    });
    let in_mode = |variant: &Variant| {
        let mut variant = variant.clone();
        variant.scene.adversary.as_mut().expect("it has one").mode = mode;
        variant
    };
    SEARCHED.iter().map(in_mode).collect()
}

fn logged(scene: &Scene) -> Simulation {
    let config = SimConfig { agents: None, ..SimConfig::default() };
    Simulation::new(Arc::new(scene.clone()), config, Tick(0)).expect("a sound scene")
}

#[test]
fn along_the_logged_drive_it_touches_within_three_ticks_of_plan() {
    for mode in AdversaryMode::ALL {
        for variant in built(mode) {
            let mut simulation = logged(&variant.scene);
            while simulation.state().contacts.is_empty() && simulation.state().tick < variant.scene.last_tick() {
                simulation.step();
            }
            let state = simulation.state();
            let name = &variant.scene.name;
            assert!(state.contacts.iter().any(|contact| contact.agent == variant.agent), "{name} {mode:?}");
            assert!(state.tick.0.abs_diff(variant.planned.0) <= 3, "{name} {mode:?}: {}", state.tick);
        }
    }
}

/// Steps a simulation; from hand-over on the ego keeps its speed for a moment and then brakes to a stand.
fn step(simulation: &mut Simulation) -> &WorldState {
    if simulation.state().tick == Tick(20) {
        let speed_mps = simulation.state().ego.speed_mps();
        let at = |i: u32| {
            let secs = f64::from(i) * 0.5;
            let braking = (secs - 1.5).max(0.0).min(speed_mps / 3.0);
            let way_m = speed_mps * secs.min(1.5) + speed_mps * braking - 1.5 * braking * braking;
            TrajectoryPoint { after: SimTime::from_secs(secs), pose: PoseSe2::new(way_m, 0.0, 0.0) }
        };
        let plan = Trajectory::new((1..=40).map(at).collect()).expect("a sound plan");
        simulation.begin_plan(&plan);
    }
    simulation.step()
}

#[test]
fn it_resumes_at_any_tick_to_the_bit() {
    for variant in built(AdversaryMode::Reactive).into_iter().take(4) {
        let scene = Arc::new(variant.scene.clone());
        let mut simulation = logged(&scene);
        let whole: Vec<_> = (0..150).map(|_| step(&mut simulation).clone()).collect();
        let mut simulation = logged(&scene);
        for state in &whole {
            let bytes = simulation.snapshot();
            let config = SimConfig { agents: None, ..SimConfig::default() };
            simulation = Simulation::restore(Arc::clone(&scene), config, &bytes).expect("its own snapshot");
            assert_eq!(simulation.snapshot(), bytes);
            assert_eq!(step(&mut simulation), state);
        }
    }
}

#[test]
fn it_meets_an_ego_that_brakes_no_less_often_than_one_that_only_replays() {
    let met = |mode| {
        let meets = |variant: &Variant| {
            let mut simulation = logged(&variant.scene);
            (0..100).any(|_| step(&mut simulation).contacts.iter().any(|contact| contact.agent == variant.agent))
        };
        built(mode).iter().filter(|variant| meets(variant)).count()
    };
    let (reactive, replayed) = (met(AdversaryMode::Reactive), met(AdversaryMode::Replay));
    assert!(reactive >= replayed && reactive > 0, "{reactive} against {replayed}");
}

#[test]
fn it_aims_anew_at_an_ego_that_brakes_and_never_leaves_the_road() {
    for mode in [AdversaryMode::Reactive, AdversaryMode::Unshielded] {
        let mut differed = 0;
        for variant in built(mode) {
            let mut replayed = variant.scene.clone();
            replayed.adversary = None;
            let (mut plain, mut simulation) = (logged(&replayed), logged(&variant.scene));
            let place = |state: &WorldState| {
                state.agents.iter().find(|agent| agent.id == variant.agent).expect("it is always there").clone()
            };
            let mut apart_m = 0.0f64;
            for tick in 1..=150 {
                let (agent, as_planned) = (place(step(&mut simulation)), place(step(&mut plain)));
                let on_road = |corner: &DVec2| replayed.map.drivable.iter().any(|area| holds(area, *corner));
                assert!(agent.corners().iter().all(on_road), "{} {mode:?} at {tick}", replayed.name);
                apart_m = apart_m.max(agent.pose.position.distance(as_planned.pose.position));
            }
            differed += u32::from(apart_m > 1.0);
        }
        assert!(differed > 0, "{mode:?}: an ego that leaves its log changes nothing");
    }
}
