//! Milliseconds and GFLOP/s of training steps of the transformer, the framework's beside the processor's path and the
//! matrix product of the `gemm` crate: `cargo bench -p ds-video --bench step`, or with `-- fast` without the framework.
//!
//! One clip on one thread, in processor time, which a shared machine can still tell. The sizes are those of
//! `configs/models/cpu_train.toml`: six latent frames for the teacher; eleven with six queries for the student; the
//! same with gradients that stop at the cache, as Self Forcing has them. Counted are products alone, forward once and
//! backward twice, whether or not a gradient stops early.

use std::hint::black_box;
use std::ops::Range;

use ds_graph::step;
use ds_kernel::peak::Yardstick;
use ds_kernel::train;
use ds_nn::cache::{CachePolicy, Positions, ReadOrder};
use ds_nn::dit::DitShape;
use ds_nn::step::{BidirectionalPlan, CausalPlan, ClipBatch, Level, Prediction, Step};
use ds_nn::team::Team;
use ds_nn::{Array, Weights, work};
use ds_space::{Digest, Draws};
use ds_video::ModelConfig;

const ROUNDS: usize = 9;
const SIDE: usize = 768;

fn shape() -> DitShape {
    let preset = include_str!("../../../../configs/models/cpu_train.toml");
    ModelConfig::parse(preset).expect("the preset is valid").dit()
}

fn draw(name: &str, shape: &[usize]) -> Array {
    Array::normal(shape, &Draws::from_seed(7, name))
}

fn clip(shape: &DitShape, frames: usize) -> ClipBatch {
    let (n, z) = (shape.tokens(), shape.latent_channels);
    ClipBatch {
        clean: draw("clean", &[1, frames, n, 4, z]),
        start: draw("start", &[1, n, 4, z]),
        layouts: draw("layouts", &[1, frames * n, 4, shape.control_inputs]),
        layout_on: vec![1.0],
        given_on: vec![1.0],
        text: draw("text", &[1, shape.text_len, shape.text_dim]),
        emphasis: Array::new(&[1, frames, n, 4, 1], vec![1.0; frames * n * 4]),
    }
}

fn causal_plan(shape: &DitShape, frames: usize, queries: Range<usize>, detached: bool) -> CausalPlan {
    let (n, z) = (shape.tokens(), shape.latent_channels);
    let cache =
        CachePolicy { window: 5, sink: 1, chunk: 1, positions: Positions::CacheRelative, order: ReadOrder::Slot };
    CausalPlan {
        cache,
        context: draw("context", &[1, frames - 1, n, 4, z]),
        context_level: Level(0.6),
        context_trained: !detached,
        context_detached: detached,
        query: draw("query", &[1, queries.len(), n, 4, z]),
        query_level: Level(0.95),
        queries,
        target: draw("target", &[1, frames - 1, n, 4, z]),
        prediction: Prediction::Clean,
    }
}

/// Milliseconds of this thread's processor time.
fn now_ms() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").expect("Linux tells a thread's time");
    text.split(' ').next().and_then(|word| word.parse::<f64>().ok()).expect("the first word is nanoseconds") * 1e-6
}

type Bench<'a> = (&'static str, f64, Box<dyn Fn() -> f32 + Sync + 'a>);

fn benches<'a>(shape: &'a DitShape, weights: &'a Weights, framework: bool) -> Vec<Bench<'a>> {
    let n = shape.tokens();
    let mut list: Vec<Bench<'a>> = Vec::new();
    let both: [(&str, &str); 3] = [
        ("bidirectional, framework", "bidirectional, fast"),
        ("causal, framework", "causal, fast"),
        ("causal detached, framework", "causal detached, fast"),
    ];
    let noise = draw("noise", &[1, 5, n, 4, shape.latent_channels]);
    let plan = BidirectionalPlan { levels: vec![0.7], noise, prediction: Prediction::Clean };
    let (six, eleven) = (clip(shape, 6), clip(shape, 11));
    let operations = work::train(shape, [6 * n, 6, 36 * n * n]);
    type Run<P> = fn(&DitShape, &Weights, &ClipBatch, &P) -> Step;
    let bodies: [(bool, Run<BidirectionalPlan>); 2] = [(true, step::bidirectional), (false, train::bidirectional)];
    for (slow, run) in bodies.into_iter().filter(|(slow, _)| framework || !slow) {
        let (batch, plan) = (six.clone(), plan.clone());
        let name = if slow { both[0].0 } else { both[0].1 };
        list.push((name, operations, Box::new(move || run(shape, weights, &batch, &plan).loss)));
    }
    for (at, detached) in [(1, false), (2, true)] {
        // Frames 0..11 see 1 to 5 frames, queries 5..11 all 5.
        let seen = 1 + 2 + 3 + 4 + 7 * 5 + 6 * 5;
        let operations = work::train(shape, [17 * n, 11, seen * n * n]);
        let bodies: [(bool, Run<CausalPlan>); 2] = [(true, step::causal), (false, train::causal)];
        for (slow, run) in bodies.into_iter().filter(|(slow, _)| framework || !slow) {
            let (batch, plan) = (eleven.clone(), causal_plan(shape, 11, 5..11, detached));
            let name = if slow { both[at].0 } else { both[at].1 };
            list.push((name, operations, Box::new(move || run(shape, weights, &batch, &plan).loss)));
        }
    }
    list
}

fn main() {
    let framework = !std::env::args().any(|argument| argument == "fast");
    let shape = shape();
    let weights = Weights::initialised(&shape.declare(), &Digest::of(b"bench"));
    let benches = benches(&shape, &weights, framework);
    let mut times = Team::new(1).run(1, |_| {
        let mut times: Vec<Vec<f64>> = vec![Vec::new(); benches.len() + 1];
        let mut yardstick = Yardstick::new(SIDE);
        for round in 0..=ROUNDS {
            let mut time = |at: usize, run: &mut dyn FnMut() -> f32| {
                let start = now_ms();
                black_box(run());
                // The first round warms up.
                times[at].extend((round > 0).then(|| now_ms() - start));
            };
            time(0, &mut || yardstick.run(1));
            for (at, (_, _, run)) in benches.iter().enumerate() {
                time(at + 1, &mut || run());
            }
        }
        times
    });
    let mut report = format!("one clip, one thread, median processor time of {ROUNDS} rounds\n");
    let named = std::iter::once(("gemm, the yardstick", 2.0 * (SIDE as f64).powi(3)));
    for ((name, operations), times) in named.chain(benches.iter().map(|(n, o, _)| (*n, *o))).zip(&mut times[0]) {
        times.sort_by(f64::total_cmp);
        let ms = times[times.len() / 2];
        report += &format!(
            "  {name:<28} {ms:>9.2} ms {:>7.3} GFLOP {:>7.1} GFLOP/s\n",
            operations * 1e-9,
            operations / ms * 1e-6
        );
    }
    std::io::Write::write_all(&mut std::io::stdout(), report.as_bytes()).expect("stdout is open");
}
