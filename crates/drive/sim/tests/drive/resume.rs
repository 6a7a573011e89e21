//! Snapshots: the same bits after a restore at any tick, and a named error for anything else.

use std::sync::Arc;

use ds_sim::{IdmScope, SimConfig, SimError, Simulation, SnapshotError, TrackerKind};
use ds_space::{PoseSe2, SimTime, Tick};
use ds_world::{Scene, Trajectory, TrajectoryPoint, WorldState};
use proptest::prelude::*;

use crate::street::{crowded, shared};

fn plans() -> impl Strategy<Value = Trajectory> {
    proptest::collection::vec((0.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64), 1..9).prop_map(|points| {
        let (mut x_m, mut y_m) = (0.0, 0.0);
        let points = points.into_iter().enumerate().map(|(i, (ahead, aside, turn))| {
            x_m += 6.0 * ahead;
            y_m += aside;
            let after = SimTime::from_secs(0.5 * (i + 1) as f64);
            TrajectoryPoint { after, pose: PoseSe2::new(x_m, y_m, 0.5 * turn) }
        });
        Trajectory::new(points.collect()).expect("the plan is sound")
    })
}

fn config(choice: u32) -> SimConfig {
    let tracker = if choice.is_multiple_of(2) { TrackerKind::Lqr } else { TrackerKind::PurePursuit };
    let scope = if (choice / 2).is_multiple_of(2) { IdmScope::All } else { IdmScope::BehindEgo };
    SimConfig { tracker, agents: Some(scope), ..SimConfig::default() }
}

/// Warm-up on the log, then both plans in turn every 5 ticks; returns every state, restoring before one tick.
fn drive(scene: &Arc<Scene>, config: &SimConfig, plans: &[Trajectory; 2], restore_at: Option<u32>) -> Vec<WorldState> {
    let mut simulation = Simulation::new(scene.clone(), config.clone(), Tick(0)).expect("the scene is sound");
    (0..60)
        .map(|tick| {
            if tick >= 5 && tick % 5 == 0 {
                simulation.begin_plan(&plans[(tick / 5 % 2) as usize]);
            }
            if restore_at == Some(tick) {
                let before = simulation.state().clone();
                let bytes = simulation.snapshot();
                simulation = Simulation::restore(scene.clone(), config.clone(), &bytes).expect("its own snapshot");
                assert_eq!(simulation.state(), &before, "the restored state of tick {tick}");
                assert_eq!(simulation.snapshot(), bytes, "the snapshot of the restored state");
            }
            simulation.step().clone()
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn a_restored_simulation_goes_on_to_the_bit(a in plans(), b in plans(), at in 0u32..60, choice in 0u32..4) {
        let (scene, plans) = (shared(crowded(30)), [a, b]);
        let whole = drive(&scene, &config(choice), &plans, None);
        let resumed = drive(&scene, &config(choice), &plans, Some(at));
        prop_assert_eq!(whole, resumed);
    }

    #[test]
    fn no_changed_or_cut_snapshot_is_accepted(at in 0usize..100_000, flip in 1u8..=255) {
        let scene = shared(crowded(12));
        let mut simulation = Simulation::new(scene.clone(), config(0), Tick(4)).expect("the scene is sound");
        let point = TrajectoryPoint { after: SimTime::from_secs(1.0), pose: PoseSe2::new(8.0, 0.0, 0.0) };
        simulation.begin_plan(&Trajectory::new(vec![point]).expect("the plan is sound"));
        simulation.step();
        let bytes = simulation.snapshot();
        let at = at % bytes.len();
        let mut changed = bytes.clone();
        changed[at] ^= flip;
        prop_assert!(Simulation::restore(scene.clone(), config(0), &changed).is_err());
        prop_assert!(Simulation::restore(scene, config(0), &bytes[..at]).is_err());
    }
}

#[test]
fn refuses_snapshots_of_another_scene_or_configuration() {
    let scene = shared(crowded(12));
    let bytes = Simulation::new(scene.clone(), config(0), Tick(0)).expect("the scene is sound").snapshot();
    let mut other = crowded(12);
    other.digest = ds_space::Digest::of(b"another street");
    for (scene, config, bytes, expected) in [
        (shared(other), config(0), bytes.clone(), SnapshotError::Scene),
        (scene.clone(), config(1), bytes.clone(), SnapshotError::Config),
        (scene.clone(), config(0), b"rubbish".to_vec(), SnapshotError::Magic),
        (scene.clone(), config(0), b"DSIM".to_vec(), SnapshotError::Length { bytes: 4 }),
    ] {
        let refused = Simulation::restore(scene, config, &bytes).err();
        assert_eq!(refused, Some(SimError::Snapshot(expected)));
    }
}
