//! Milliseconds to rank 64 proposals: `cargo bench -p ds-oracle -- FILE.scenario.json...`; shipped scenarios without.
#![expect(clippy::print_stdout, reason = "a bench prints its figures")]

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use ds_oracle::{AgentsIn, Oracle};
use ds_sim::{IdmScope, SimConfig, Simulation};
use ds_space::{PoseSe2, SimTime, Tick};
use ds_world::{Proposal, Trajectory, TrajectoryPoint};

fn fan(speed_mps: f64) -> Vec<Proposal> {
    let arc = |index: u32| {
        let (curve, pace) = (f64::from(index % 8) - 3.5, f64::from(index / 8) / 7.0);
        let point = |step: u32| {
            let (time_s, turn) = (0.5 * f64::from(step), 0.01 * curve * f64::from(step));
            let way_m = time_s * speed_mps * (0.3 + 0.9 * pace);
            let pose = PoseSe2::new(way_m * (0.5 * turn).cos(), way_m * (0.5 * turn).sin(), turn);
            TrajectoryPoint { after: SimTime::from_secs(time_s), pose }
        };
        Proposal { trajectory: Trajectory::new((1..=8).map(point).collect()).expect("sound"), score: 0.0 }
    };
    (0..64).map(arc).collect()
}

fn median_ms(oracle: &Oracle, now: &Simulation, proposals: &[Proposal], agents: AgentsIn) -> f64 {
    let mut millis: Vec<f64> = (0..7)
        .map(|_| {
            let began = Instant::now();
            let ranked = oracle.rank(now, proposals, agents).expect("ranks");
            assert_eq!(ranked.scores.len(), proposals.len());
            began.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    millis.sort_by(f64::total_cmp);
    millis[3]
}

fn main() {
    let given: Vec<PathBuf> = std::env::args().skip(1).filter(|text| !text.starts_with("--")).map(Into::into).collect();
    let base = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../scenarios/base");
    let files = if given.is_empty() { ds_scenario::list(&base).expect("shipped scenarios") } else { given };
    for file in files {
        let (scene, _warnings) = ds_scenario::load(&file).expect("a scenario");
        let agents = Some(IdmScope::BehindEgo);
        let config = SimConfig { agents, ..SimConfig::default() };
        let mut now = Simulation::new(Arc::new(scene), config, Tick(0)).expect("a simulation");
        for _ in 0..30 {
            now.step();
        }
        let oracle = Oracle::new(now.scene()).expect("an oracle");
        let proposals = fan(now.state().ego.speed_mps().max(3.0));
        let [reacting, open] =
            [AgentsIn::Reacting, AgentsIn::Open].map(|agents| median_ms(&oracle, &now, &proposals, agents));
        let (name, count) = (&now.scene().name, now.state().agents.len());
        println!("{name}: {count} agents, 64 proposals: reacting {reacting:.1} ms, open {open:.1} ms");
    }
}
