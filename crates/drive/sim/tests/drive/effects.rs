//! Effects in the running world: absent at their neutral value, felt otherwise, and carried through a snapshot.

use std::sync::Arc;

use ds_effect::{Effect, Insertion, Setting, library};
use ds_sim::{IdmScope, Manners, SimConfig, Simulation};
use ds_space::{DVec2, Digest, PoseSe2, SimTime, Tick};
use ds_world::{EgoState, Reading, Scene, Trajectory, TrajectoryPoint, WorldState};

use crate::street::{crowded, shared};
use crate::town::{self, town};

const KEY: Digest = Digest([7; 32]);

/// Everything that a drive shows.
#[derive(Debug, PartialEq)]
struct Drive {
    worlds: Vec<WorldState>,
    estimates: Vec<EgoState>,
    readings: Vec<Reading>,
}

fn config(effects: Vec<Setting>, vehicle_log: bool) -> SimConfig {
    let agents = Some(IdmScope::All);
    SimConfig { agents, effects, vehicle_log, ..SimConfig::default() }
}

fn drive(scene: &Arc<Scene>, config: &SimConfig, restore_at: Option<u32>) -> Drive {
    let mut simulation = Simulation::new(scene.clone(), config.clone(), Tick(0)).expect("the scene is sound");
    let (mut worlds, mut estimates, mut readings) = (Vec::new(), Vec::new(), Vec::new());
    for tick in 0..60 {
        if tick >= 5 && tick % 5 == 0 {
            simulation.begin_plan(&lively_plan(tick, &simulation.state().ego.pose));
        }
        if restore_at == Some(tick) {
            let bytes = simulation.snapshot();
            simulation = Simulation::restore(scene.clone(), config.clone(), &bytes).expect("its own snapshot");
        }
        worlds.push(simulation.step().clone());
        estimates.push(simulation.ego_estimate());
        readings.extend(simulation.readings(&KEY));
    }
    Drive { worlds, estimates, readings }
}

/// A weaving way with gas and brakes, as a plan of 4 s in the rig of an ego at `pose`.
fn lively_plan(tick: u32, pose: &PoseSe2) -> Trajectory {
    let at = |secs: f64| DVec2::new(8.0 * secs + 3.0 * (1.1 * secs).sin(), 1.2 * (1.7 * secs).sin());
    let points = (1..=8).map(|i| {
        let secs = 0.1 * f64::from(tick) + 0.5 * f64::from(i);
        let heading_rad = (at(secs + 0.01) - at(secs - 0.01)).to_angle();
        let there = PoseSe2 { position: at(secs), heading_rad };
        TrajectoryPoint { after: SimTime::from_secs(0.5 * f64::from(i)), pose: pose.relative(&there) }
    });
    Trajectory::new(points.collect()).expect("the plan is sound")
}

/// A strong value of each parameter.
pub(crate) fn strong(effect: &Effect, mass_kg: f64) -> Setting {
    let values: Vec<f64> = effect
        .parameters
        .iter()
        .map(|parameter| {
            let (low, high) = parameter.slab;
            let limit = !parameter.neutral.is_finite();
            parameter.reported(
                if limit {
                    low
                } else if parameter.neutral < high {
                    high
                } else {
                    low
                },
                mass_kg,
            )
        })
        .collect();
    Setting::new(effect.id, &values).expect("a sound setting")
}

#[test]
fn neutral_effects_change_no_bit() {
    let scene = shared(crowded(12));
    let nominal = drive(&scene, &config(Vec::new(), true), None);
    for effect in library() {
        let neutral = Setting::new(effect.id, &effect.neutral()).expect("neutral is sound");
        assert_eq!(drive(&scene, &config(vec![neutral], true), None), nominal, "{}", effect.id);
    }
}

#[test]
fn neutral_effects_change_no_bit_among_agents_that_decide() {
    let scene = shared(town());
    for manners in [Manners::default(), Manners::ALL] {
        let nominal = town::drive(&scene, &town::config(manners, Vec::new()), None);
        for effect in library() {
            let neutral = Setting::new(effect.id, &effect.neutral()).expect("neutral is sound");
            assert_eq!(town::drive(&scene, &town::config(manners, vec![neutral]), None), nominal, "{}", effect.id);
        }
    }
}

#[test]
fn what_others_decide_and_the_map_are_felt_in_a_scene_and_resume_to_the_bit() {
    let scene = shared(town());
    let nominal = town::drive(&scene, &town::config(Manners::ALL, Vec::new()), None);
    for effect in library().iter().filter(|effect| effect.needs_scene()) {
        let config = town::config(Manners::ALL, vec![strong(effect, scene.vehicle.mass_kg)]);
        let altered = town::drive(&scene, &config, None);
        assert!(altered != nominal, "{} is not felt", effect.id);
        for at in [3, 61, 110] {
            assert!(town::drive(&scene, &config, Some(at)) == altered, "{} restored at {at}", effect.id);
        }
    }
}

#[test]
fn strong_effects_are_felt_where_they_act() {
    // What this short drive cannot excite; the nominal car has no drag area for the wind, its tyre a clip for a knee.
    let beyond = [
        "steer_saturation",
        "power_limit",
        "brake_fade",
        "tr_v0",
        "obs_latency",
        "wind_steady",
        "tyre_knee",
        "drive_split",
    ];
    let scene = shared(crowded(12));
    let nominal = drive(&scene, &config(Vec::new(), true), None);
    for effect in library().iter().filter(|effect| !beyond.contains(&effect.id) && !effect.needs_scene()) {
        let altered = drive(&scene, &config(vec![strong(effect, scene.vehicle.mass_kg)], true), None);
        match effect.insertion {
            Insertion::Sensor | Insertion::Clock => {
                assert_eq!(altered.worlds, nominal.worlds, "{}: sensors move nothing", effect.id);
                assert_ne!(altered.readings, nominal.readings, "{}", effect.id);
            }
            Insertion::Agent => {
                let others = |drive: &Drive| drive.worlds.iter().map(|world| world.agents.clone()).collect::<Vec<_>>();
                assert_ne!(others(&altered), others(&nominal), "{}", effect.id);
            }
            _ => {
                let ego = |drive: &Drive| drive.worlds.iter().map(|world| world.ego).collect::<Vec<_>>();
                assert_ne!(ego(&altered), ego(&nominal), "{}", effect.id);
            }
        }
    }
}

#[test]
fn altered_worlds_resume_to_the_bit() {
    let scene = shared(crowded(12));
    for ids in [&["steer_delay", "accel_lag", "tr_delay"][..], &["steer_backlash", "tyre_relaxation", "pose_latency"]] {
        let settings = |id: &&str| strong(ds_effect::find(id).expect("an effect"), scene.vehicle.mass_kg);
        let config = config(ids.iter().map(settings).collect(), true);
        let whole = drive(&scene, &config, None);
        for at in [3, 20, 41] {
            assert_eq!(drive(&scene, &config, Some(at)), whole, "{ids:?} restored at {at}");
        }
    }
}

#[test]
fn the_vehicle_log_is_what_the_car_did() {
    let scene = shared(crowded(4));
    let drive = drive(&scene, &config(Vec::new(), true), None);
    assert_eq!(drive.readings.len(), 120, "20 Hz");
    let arm = 0.5 * scene.vehicle.wheel_base_m;
    for (tick, world) in drive.worlds.iter().enumerate().skip(8) {
        let centre = world.ego.pose.position + world.ego.pose.forward() * arm;
        let last = &drive.readings[2 * tick + 1];
        // A quarter of a tick before the state.
        let gap = (last.x_m - centre.x).hypot(last.y_m - centre.y);
        let moved = 0.025 * world.ego.speed_mps();
        assert!((gap - moved).abs() < 0.08, "tick {tick}: {gap} m, expected {moved} m");
        assert!((last.yaw_rate_radps - world.ego.yaw_rate_radps).abs() < 0.05, "tick {tick}");
        assert!((last.steering_rad - world.ego.steering_rad).abs() < 0.03, "tick {tick}");
    }
    assert!(drive.worlds.iter().zip(&drive.estimates).all(|(world, estimate)| world.ego == *estimate));
}

#[test]
fn a_delayed_command_reaches_the_wheel_later() {
    let scene = shared(crowded(4));
    let log = |effects: Vec<Setting>| drive(&scene, &config(effects, true), None).readings;
    let delay = Setting::new("steer_delay", &[0.2]).expect("sound");
    let offset = |readings: &[Reading], samples: usize| -> f64 {
        let pairs = readings.iter().zip(&readings[samples..]).skip(20);
        pairs.map(|(early, late)| (late.steering_rad - early.cmd_steer_rad).powi(2)).sum()
    };
    let (nominal, delayed) = (log(Vec::new()), log(vec![delay]));
    let best = |readings: &[Reading]| {
        (0..9).min_by(|a, b| offset(readings, *a).total_cmp(&offset(readings, *b))).expect("a lag")
    };
    assert_eq!(best(&delayed) - best(&nominal), 4, "0.2 s are four samples");
}

/// Laws with memory and without, at every port of a run: each is felt where it acts, and resumes to the bit.
#[test]
fn laws_are_felt_where_they_act_and_resume_to_the_bit() {
    let scene = shared(crowded(12));
    // a law that is nil passes the commands along the same chain
    let still = drive(&scene, &config(vec![Setting::new("drive: 0*1", &[]).expect("sound")], true), None);
    for (text, of_sensors) in [
        ("steering: 0.5*slack(delta,0.004) + 0.002*sin(0.8)", false),
        ("steering.linkage: 0.4*late(delta,0.2)", false),
        ("drive: 0.5*slow(accel,0.4) - 0.01*v*t", false),
        ("lateral.front: 400*sign(delta_rate)", false),
        ("lateral.rear: 3000*slip_rear", false),
        ("lateral.body.yaw: 300*sin(0.3)", false),
        ("lateral.body.side: 2*s", false),
        ("sensor.x: 0.2*sin(0.5)", true),
        ("sensor.yaw_rate: 0.001*t + 0.02*late(delta,0.3)", true),
        ("sensor.v_wheel: 0.03*v", true),
    ] {
        let config = config(vec![Setting::new(text, &[]).expect("a sound law")], true);
        let obeyed = drive(&scene, &config, None);
        assert!(obeyed.readings != still.readings, "{text} is not felt");
        assert_eq!(obeyed.worlds == still.worlds, of_sensors, "{text}: sensors move nothing, all else does");
        for at in [3, 31, 55] {
            assert!(drive(&scene, &config, Some(at)) == obeyed, "{text} restored at {at}");
        }
    }
    let follower = config(vec![Setting::new("follower: 0.1*gap", &[]).expect("a sound law")], true);
    let refused = follower.check().expect_err("a run has no such port").to_string();
    assert!(refused.contains("follower"), "{refused}");
}
