//! Steps per second of a crowded street with reactive traffic, on one thread.
//!
//! A step is one 0.1 s tick with all tracks, contacts and ego sub-steps, without snapshot or publishing; a plan is
//! begun every 5 ticks and counted. Run with `cargo bench -p ds-sim`.
#![expect(clippy::print_stdout, reason = "a bench prints its figures")]

use std::time::Instant;

use ds_sim::{IdmScope, SimConfig, Simulation};
use ds_space::Tick;

#[path = "../tests/drive/street.rs"]
mod street;

fn main() {
    for (moving, scope) in [(60, IdmScope::BehindEgo), (60, IdmScope::All), (150, IdmScope::All)] {
        let scene = street::shared(street::crowded(moving));
        let config = SimConfig { agents: Some(scope), ..SimConfig::default() };
        let start = Simulation::new(scene.clone(), config, Tick(0)).expect("the scene is sound");
        let plans: Vec<_> =
            (0..40).map(|i| street::expert_plan(&scene, Tick(5 * i), &scene.logged_ego(Tick(5 * i)).pose)).collect();
        let mut rates: Vec<f64> = (0..31)
            .map(|_| {
                let mut simulation = start.clone();
                let began = Instant::now();
                for plan in &plans {
                    simulation.begin_plan(plan);
                    (0..5).for_each(|_| {
                        simulation.step();
                    });
                }
                200.0 / began.elapsed().as_secs_f64()
            })
            .collect();
        rates.sort_by(f64::total_cmp);
        let tracks = scene.tracks.len();
        println!("{tracks} tracks, {moving} moving, idm {scope:?}: {:.0} steps/s (median of 31)", rates[15]);
    }
}
