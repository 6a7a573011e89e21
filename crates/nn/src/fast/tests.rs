//! Parity of the processor's path with the framework's graph, and independence of its results from threads and vectors.

use std::ops::Range;

use ds_space::{Digest, Draws};

use super::arch::Arch;
use super::attention::{Keys, Seen, Tiles, attend};
use super::panels::Packed;
use super::product::{Finish, Source, Target, product};
use super::*;
use crate::array::{Array, Declared, Initial, Weights};
use crate::body::{Autoencoder, Backend, Chunk, Job, Transformer};
use crate::cache::{CachePolicy, KvCache, Positions, ReadOrder};
use crate::dit::DitShape;
use crate::step::{self, CausalPlan, ClipBatch, Level, Prediction};
use crate::tiny_ae::{AeShape, Memory};

pub(crate) fn draw(name: &str, shape: &[usize]) -> Array {
    let draws = Draws::from_seed(7, name);
    Array::new(shape, (0..shape.iter().product::<usize>() as u64).map(|i| draws.normal(i) as f32).collect())
}

/// Weights in which nothing is zero, so that no part is idle.
pub(crate) fn weights(declared: &[Declared]) -> Weights {
    let mut weights = Weights::initialised(declared, &Digest::of(b"fast"));
    for declared in declared.iter().filter(|declared| !matches!(declared.initial, Initial::Normal(_))) {
        let draws = draw(&declared.name, &declared.shape);
        let array = weights.get(&declared.name).expect("declared").clone();
        let values = array.values().iter().zip(draws.values()).map(|(a, b)| a + 0.1 * b).collect();
        weights.insert(&declared.name, Array::new(&declared.shape, values));
    }
    weights
}

/// The presets of configs/models, and one of odd sizes.
pub(crate) fn shapes() -> [DitShape; 3] {
    let smoke = DitShape {
        layers: 2,
        dim: 64,
        heads: 2,
        ffn: 256,
        latent_channels: 4,
        control_inputs: 768,
        control_channels: 8,
        start_channels: 4,
        freq_dim: 64,
        text_dim: 32,
        text_len: 4,
        image_context: false,
        clip_dim: 0,
        reference: false,
        gelu: crate::dit::Gelu::Exact,
        start_every: false,
        cross_every: 1,
        grid_h: 2,
        grid_w: 4,
    };
    let cpu_train = DitShape {
        layers: 6,
        dim: 128,
        heads: 4,
        ffn: 512,
        latent_channels: 12,
        control_channels: 48,
        start_channels: 12,
        start_every: true,
        cross_every: 3,
        grid_h: 6,
        grid_w: 10,
        ..smoke.clone()
    };
    let odd = DitShape {
        layers: 3,
        dim: 60,
        heads: 3,
        ffn: 70,
        latent_channels: 3,
        control_inputs: 12,
        control_channels: 5,
        start_channels: 3,
        freq_dim: 18,
        image_context: true,
        cross_every: 2,
        grid_h: 3,
        grid_w: 7,
        ..smoke.clone()
    };
    [smoke, cpu_train, odd]
}

/// Returns the largest difference over the largest expected value.
pub(crate) fn distance(found: &[f32], expected: &[f32]) -> f32 {
    assert_eq!(found.len(), expected.len());
    let largest = expected.iter().fold(0.0f32, |w, x| w.max(x.abs()));
    let worst = found.iter().zip(expected).fold(0.0f32, |w, (a, b)| if (a - b).abs() <= w { w } else { (a - b).abs() });
    worst / largest
}

#[test]
fn products_equal_the_plain_sum_on_every_set_of_vectors() {
    let arches = || {
        let mut arches = vec![Arch::Scalar, Arch::new()];
        #[cfg(target_arch = "x86_64")]
        arches.extend(pulp::x86::V3::try_new().map(Arch::V3));
        arches
    };
    for (rows, depth, columns) in [(1, 3, 1), (5, 17, 12), (8, 64, 48), (30, 96, 60), (72, 33, 97)] {
        let (x, w) = (draw("x", &[rows, depth]), draw("w", &[columns, depth]));
        let bias = draw("bias", &[columns]);
        let packed = Packed::linear(w.values(), Some(bias.values()), depth);
        let expected: Vec<f32> = (0..rows * columns)
            .map(|at| {
                let (row, column) = (at / columns, at % columns);
                let pairs = x.values()[row * depth..][..depth].iter().zip(&w.values()[column * depth..][..depth]);
                pairs.map(|(a, b)| a * b).sum::<f32>() + bias.values()[column]
            })
            .collect();
        let mut results = Vec::new();
        for arch in arches() {
            let mut y = vec![0.0; rows * columns];
            let source = Source::rows(x.values(), depth);
            product(arch, rows, &[source], &packed, Target::rows(&mut y, columns), Finish::Plain);
            assert!(distance(&y, &expected) < 1e-5, "{arch:?}, {rows}x{depth}x{columns}");
            if !matches!(arch, Arch::Scalar) {
                results.push(y);
            }
        }
        assert!(results.windows(2).all(|pair| pair[0] == pair[1]), "{rows}x{depth}x{columns}");
    }
}

#[test]
fn attention_equals_the_plain_formula_however_keys_are_grouped() {
    let (rows, head_dim, heads) = (11, 20, 3);
    let dim = heads * head_dim;
    let (q, k, v) = (draw("q", &[rows, dim]), draw("k", &[50, dim]), draw("v", &[50, dim]));
    let mut expected = vec![0.0f32; rows * dim];
    for (row, head) in (0..rows).flat_map(|row| (0..heads).map(move |head| (row, head))) {
        let at = |x: &Array, row: usize, i: usize| f64::from(x.values()[row * dim + head * head_dim + i]);
        let score = |key: usize| (0..head_dim).map(|i| at(&q, row, i) * at(&k, key, i)).sum::<f64>().exp2();
        let total: f64 = (0..50).map(score).sum();
        for i in 0..head_dim {
            let sum: f64 = (0..50).map(|key| score(key) * at(&v, key, i)).sum();
            expected[row * dim + head * head_dim + i] = (sum / total) as f32;
        }
    }
    for cuts in [vec![50], vec![7, 43], vec![33, 1, 16]] {
        let mut first = 0;
        let mut groups: Vec<Keys> = Vec::new();
        for count in cuts {
            let mut keys = Keys::default();
            keys.reset(count, heads, head_dim);
            let range = first * dim..(first + count) * dim;
            keys.fill(0, &k.values()[range.clone()], &v.values()[range], dim, head_dim);
            groups.push(keys);
            first += count;
        }
        let window = groups.remove(0);
        let seen = Seen { window: Some(&window), blocks: &groups };
        let mut out = vec![0.0; rows * dim];
        attend(Arch::new(), Source::rows(q.values(), dim), seen, head_dim, &mut Tiles::default(), &mut out);
        assert!(distance(&out, &expected) < 1e-5);
    }
}

fn inputs(shape: &DitShape, frames: usize) -> (Array, Array, Array) {
    let (n, z) = (shape.tokens(), shape.latent_channels);
    let text = draw("text", &[1, shape.text_len, shape.text_dim]);
    let first = draw("first", &[1, n, 4, z]);
    (text, first, draw("layouts", &[1, frames * n, 4, shape.control_inputs]))
}

/// Runs chunks against a cache and returns all outputs and the values of all controls.
fn rollout(body: &dyn Transformer, policy: CachePolicy, chunks: usize) -> Vec<Array> {
    let shape = body.shape().clone();
    let (text, first, _) = inputs(&shape, 1);
    let context = body.context(&text, &first);
    let mut cache = KvCache::new(policy);
    let mut outputs = Vec::new();
    for chunk in 0..chunks {
        let frames = if chunk == 0 { 1 } else { policy.chunk };
        let size = [frames, shape.tokens(), 4, shape.latent_channels];
        let layouts = draw(&format!("layouts {chunk}"), &[1, frames * shape.tokens(), 4, shape.control_inputs]);
        let control = body.control(&layouts);
        let values = body.control_values(&control);
        assert_eq!(values.shape(), [1, frames * shape.tokens(), 4, shape.control_channels]);
        let again = body
            .control_of(&Array::new(&[frames, shape.tokens(), 4, shape.control_channels], values.values().to_vec()));
        assert_eq!(body.control_values(&again).values(), values.values());
        outputs.push(values);
        let (noisy, start) = (draw(&format!("noisy {chunk}"), &size), draw("start", &size));
        let window = cache.window(body, frames);
        let step =
            |time| body.denoise(&Chunk { noisy: &noisy, start: &start, control: &control, time }, &window, &context);
        outputs.push(step(1000.0).0);
        let (output, kv) = step(833.3);
        outputs.push(output);
        cache.commit(&kv);
    }
    assert_eq!(body.forwards(), 2 * chunks as u64);
    outputs
}

fn policy(chunk: usize, positions: Positions) -> CachePolicy {
    CachePolicy { window: 3 + chunk, sink: 1, chunk, positions, order: ReadOrder::Slot }
}

#[test]
fn denoising_equals_the_graph_beyond_eviction() {
    for shape in shapes() {
        let weights = weights(&shape.declare());
        for (chunk, positions) in [(1, Positions::CacheRelative), (2, Positions::Absolute)] {
            let [fast, graph] = [Backend::Cpu, Backend::Framework].map(|backend| {
                let body = backend.transformer(&shape, &weights).expect("fits");
                rollout(&*body, policy(chunk, positions), 6)
            });
            for (index, (fast, graph)) in fast.iter().zip(&graph).enumerate() {
                assert_eq!(fast.shape(), graph.shape());
                let distance = distance(fast.values(), graph.values());
                assert!(distance < 1e-4, "dim {}, chunk {chunk}, output {index}: {distance}", shape.dim);
            }
        }
    }
}

#[test]
fn results_do_not_depend_on_threads() {
    let [_, shape, odd] = shapes();
    for shape in [shape, odd] {
        let weights = weights(&shape.declare());
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
            pool.install(|| {
                let fast = FastDit::new(&shape, &weights).expect("fits");
                rollout(&fast, policy(2, Positions::CacheRelative), 4)
            })
        };
        assert_eq!(run(1), run(3));
    }
}

#[test]
fn several_chunks_at_once_give_what_each_gives_alone() {
    let [_, shape, _] = shapes();
    let fast = FastDit::new(&shape, &weights(&shape.declare())).expect("fits");
    let size = [1, shape.tokens(), 4, shape.latent_channels];
    let (text, first, layouts) = inputs(&shape, 1);
    let control = fast.control(&layouts);
    let contexts = [fast.context(&text, &first), fast.context(&draw("other", text.shape()), &first)];
    let noisy = ["a", "b", "c"].map(|name| draw(name, &size));
    let (start, mut cache) = (draw("start", &size), KvCache::new(policy(1, Positions::CacheRelative)));
    let empty = cache.window(&fast, 1);
    let chunk = |at: usize, time: f32| Chunk { noisy: &noisy[at], start: &start, control: &control, time };
    cache.commit(&fast.denoise(&chunk(0, 500.0), &empty, &contexts[0]).1);
    let window = cache.window(&fast, 1);
    let chunks = [chunk(0, 1000.0), chunk(1, 800.0), chunk(2, 300.0)];
    let jobs = [
        Job { chunk: &chunks[0], window: &window, context: &contexts[0] },
        Job { chunk: &chunks[1], window: &empty, context: &contexts[1] },
        Job { chunk: &chunks[2], window: &window, context: &contexts[1] },
    ];
    for (job, (output, kv)) in jobs.iter().zip(fast.denoise_many(&jobs)) {
        let (alone, alone_kv) = fast.denoise(job.chunk, job.window, job.context);
        assert_eq!((output, kv.digest()), (alone, alone_kv.digest()));
    }
}

pub(crate) const FRAMES: usize = 6;

pub(crate) fn clips(shape: &DitShape, clips: usize) -> ClipBatch {
    let n = shape.tokens();
    ClipBatch {
        clean: draw("clean", &[clips, FRAMES, n, 4, shape.latent_channels]),
        start: draw("start", &[clips, n, 4, shape.latent_channels]),
        given_on: (0..clips).map(|clip| if clip == 2 { 0.0 } else { 1.0 }).collect(),
        layouts: draw("layouts", &[clips, FRAMES * n, 4, shape.control_inputs]),
        layout_on: (0..clips).map(|clip| if clip == 1 { 0.0 } else { 1.0 }).collect(),
        text: draw("text", &[clips, shape.text_len, shape.text_dim]),
        emphasis: Array::new(&[clips, FRAMES, n, 4, 1], vec![1.0; clips * FRAMES * n * 4]),
    }
}

#[test]
fn whole_clips_equal_the_teacher_of_the_graph() {
    for shape in shapes() {
        let (weights, batch) = (weights(&shape.declare()), clips(&shape, 3));
        let noisy = draw("noisy", &[3, FRAMES - 1, shape.tokens(), 4, shape.latent_channels]);
        let levels = [0.9, 0.4, 1.0];
        let teacher = FastTeacher::new(&shape, &weights).expect("fits");
        for prediction in [Prediction::Clean, Prediction::Flow] {
            let expected = step::bidirectional_clean(&shape, &weights, &batch, &noisy, &levels, prediction);
            let found = teacher.clean(&batch, &noisy, &levels, prediction);
            assert_eq!(found.shape(), expected.shape());
            assert!(distance(found.values(), expected.values()) < 1e-4, "dim {}", shape.dim);
        }
    }
}

fn frames_of(array: &Array, frames: Range<usize>) -> Array {
    let shape = array.shape();
    let axes = shape.len();
    let frame: usize = shape[axes - 3..].iter().product();
    let values = array.values()[frames.start * frame..frames.end * frame].to_vec();
    Array::new(&[frames.len(), shape[axes - 3], shape[axes - 2], shape[axes - 1]], values)
}

/// Equivalence 1: the graph's parallel form over a sequence against chunk after chunk of the processor's path.
#[test]
fn the_cached_form_equals_the_parallel_form() {
    let shape = DitShape { start_every: true, ..shapes()[0].clone() };
    let (weights, batch, n) = (weights(&shape.declare()), clips(&shape, 1), shape.tokens());
    for (chunk, window, positions) in [(1, 4, Positions::CacheRelative), (2, 5, Positions::Absolute)] {
        let plan = CausalPlan {
            cache: CachePolicy { window, sink: 1, chunk, positions, order: ReadOrder::Slot },
            context: draw("context", &[1, FRAMES - 1, n, 4, shape.latent_channels]),
            context_level: Level(0.6),
            context_trained: true,
            context_detached: false,
            queries: 1..1,
            query: Array::zeros(&[1, 0, n, 4, shape.latent_channels]),
            query_level: Level(1.0),
            target: draw("target", &[1, FRAMES - 1, n, 4, shape.latent_channels]),
            prediction: Prediction::Clean,
        };
        let expected = step::causal_output(&shape, &weights, &batch, &plan);
        let fast = FastDit::new(&shape, &weights).expect("fits");
        let context = fast.context(&batch.text, &batch.start);
        let mut cache = KvCache::new(plan.cache);
        let mut at = 0;
        while at < FRAMES {
            let count = if at == 0 { 1 } else { chunk.min(FRAMES - at) };
            let layout = n * 4 * shape.control_inputs;
            let layouts = batch.layouts.values()[at * layout..(at + count) * layout].to_vec();
            let control = fast.control(&Array::new(&[1, count * n, 4, shape.control_inputs], layouts));
            let clean = frames_of(&batch.clean, at..at + count);
            let (noisy, time) =
                if at == 0 { (clean.clone(), 0.0) } else { (frames_of(&plan.context, at - 1..at - 1 + count), 600.0) };
            let start = Array::new(clean.shape(), batch.start.values().repeat(count));
            let chunk = Chunk { noisy: &noisy, start: &start, control: &control, time };
            let (output, kv) = fast.denoise(&chunk, &cache.window(&fast, count), &context);
            let expected = frames_of(&expected, at..at + count);
            let worst = output.values().iter().zip(expected.values()).fold(0.0f32, |w, (a, b)| w.max((a - b).abs()));
            assert!(worst < 1e-4, "frame {at}: {worst}");
            cache.commit(&kv);
            at += count;
        }
    }
}

/// Equivalence 4: before anything is evicted, positions in the window are positions since the start.
#[test]
fn positions_agree_until_something_is_evicted() {
    let [shape, ..] = shapes();
    let run = |positions, chunks| {
        let body = FastDit::new(&shape, &weights(&shape.declare())).expect("fits");
        rollout(&body, policy(1, positions), chunks)
    };
    // The window holds the sink, two frames and the chunk.
    let held = 4;
    assert_eq!(run(Positions::CacheRelative, held), run(Positions::Absolute, held));
    assert_ne!(run(Positions::CacheRelative, held + 1), run(Positions::Absolute, held + 1));
}

/// Equivalence 5: the order in which the ring is read changes nothing but rounding.
#[test]
fn ring_and_shifted_reading_agree() {
    for shape in shapes() {
        let run = |order| {
            let body = FastDit::new(&shape, &weights(&shape.declare())).expect("fits");
            rollout(&body, CachePolicy { order, ..policy(1, Positions::CacheRelative) }, 7)
        };
        for (ring, shifted) in run(ReadOrder::Slot).iter().zip(&run(ReadOrder::Age)) {
            assert!(distance(ring.values(), shifted.values()) < 1e-5);
        }
    }
}

/// Equivalence 8: weights and cached latents kept in bf16 move the output by a bounded amount.
#[test]
fn bf16_weights_stay_within_their_bound() {
    // Truncation to eight bits of mantissa, rounded to nearest even.
    let rounded = |value: f32| {
        let bits = value.to_bits();
        f32::from_bits((bits + 0x7fff + (bits >> 16 & 1)) & 0xffff_0000)
    };
    for shape in shapes() {
        let exact = weights(&shape.declare());
        let mut half = exact.clone();
        half.iter_mut().flat_map(|(_, array)| array.values_mut()).for_each(|value| *value = rounded(*value));
        let run = |weights: &Weights| {
            let body = FastDit::new(&shape, weights).expect("fits");
            rollout(&body, policy(1, Positions::CacheRelative), 6)
        };
        for (index, (found, expected)) in run(&half).iter().zip(&run(&exact)).enumerate() {
            let distance = distance(found.values(), expected.values());
            assert!(distance > 0.0 && distance < 3e-2, "dim {}, output {index}: {distance}", shape.dim);
        }
    }
}

/// Equivalence 7.
#[test]
fn a_head_of_zeros_gives_its_bias() {
    let [shape, ..] = shapes();
    let mut weights = weights(&shape.declare());
    weights.insert("head.head.weight", Array::zeros(&[16, 64]));
    let bias = weights.get("head.head.bias").expect("declared").clone();
    let outputs = rollout(&FastDit::new(&shape, &weights).expect("fits"), policy(1, Positions::CacheRelative), 2);
    let rows = outputs[1].values().chunks_exact(16).flat_map(|row| row.iter().zip(bias.values()));
    assert!(rows.fold(0.0f32, |w, (a, b)| w.max((a - b).abs())) < 1e-6);
}

fn autoencoders() -> [AeShape; 3] {
    let smoke = AeShape {
        z: 4,
        stride_t: 4,
        encoder_width: 24,
        encoder_blocks: 1,
        decoder_widths: [24, 16, 16],
        decoder_blocks: [1, 1, 0],
        guides: 1,
    };
    let cpu_train = AeShape { z: 12, encoder_width: 96, decoder_widths: [96, 48, 24], guides: 2, ..smoke.clone() };
    let odd = AeShape {
        z: 3,
        stride_t: 2,
        encoder_width: 10,
        encoder_blocks: 2,
        decoder_widths: [20, 7, 5],
        decoder_blocks: [2, 1, 1],
        guides: 0,
    };
    [smoke, cpu_train, odd]
}

#[test]
fn the_autoencoder_equals_the_graph_and_streams() {
    for shape in autoencoders() {
        let weights = weights(&shape.declare());
        let [fast, graph] = [Backend::Cpu, Backend::Framework].map(|b| b.autoencoder(&shape, &weights).expect("fits"));
        let (h, w) = (4, 6);
        let steps = draw("steps", &[5, h, w, shape.inputs()]);
        let latents = graph.encode(&steps, &mut Memory::default());
        let layouts = draw("layouts", &[5 * shape.stride_t, 8 * h, 8 * w, 3]);
        let layouts = (shape.guides > 0).then_some(&layouts);
        let frames = graph.decode(&latents, layouts, &mut Memory::default());
        for parts in [vec![0..5], vec![0..1, 1..3, 3..5], (0..5).map(|at| at..at + 1).collect()] {
            let (mut encoder, mut decoder) = (Memory::default(), Memory::default());
            let (mut found, mut painted) = (Vec::new(), Vec::new());
            for part in parts {
                let now = fast.encode(&frames_of(&steps, part.clone()), &mut encoder);
                assert_eq!(now.shape(), [part.len(), h, w, shape.z]);
                found.extend(now.into_values());
                let guide = layouts.map(|all| frames_of(all, part.start * shape.stride_t..part.end * shape.stride_t));
                let now = fast.decode(&frames_of(&latents, part), guide.as_ref(), &mut decoder);
                painted.extend(now.into_values());
            }
            assert!(distance(&found, latents.values()) < 1e-4);
            assert!(distance(&painted, frames.values()) < 1e-4);
        }
    }
}

/// Equivalence 2 and 3 to the bit: parts, snapshots and threads change nothing.
#[test]
fn streaming_equals_whole_clip_work_to_the_bit() {
    let [_, shape, _] = autoencoders();
    let fast = FastAe::new(&shape, &weights(&shape.declare())).expect("fits");
    let latents = draw("latents", &[4, 4, 6, shape.z]);
    let whole = fast.decode(&latents, None, &mut Memory::default());
    let mut memory = Memory::default();
    let mut parts = fast.decode(&frames_of(&latents, 0..1), None, &mut memory).into_values();
    let snapshot = memory.clone();
    let digest = memory.digest();
    parts.extend(fast.decode(&frames_of(&latents, 1..4), None, &mut memory).into_values());
    assert_eq!(parts, whole.values());
    assert_ne!(memory.digest(), digest);
    assert_eq!(snapshot.digest(), digest, "a snapshot keeps what it holds");
    let mut again = snapshot;
    let rest = fast.decode(&frames_of(&latents, 1..4), None, &mut again);
    assert_eq!(rest.values(), &whole.values()[whole.values().len() / 4..]);
    assert_eq!(again.digest(), memory.digest());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("threads start");
    assert_eq!(pool.install(|| fast.decode(&latents, None, &mut Memory::default())), whole);
}

#[test]
fn wrong_weights_are_named() {
    let [shape, ..] = shapes();
    let mut weights = weights(&shape.declare());
    weights.remove("blocks.1.ffn.0.bias");
    let error = FastDit::new(&shape, &weights).err().map(|error| error.to_string());
    assert_eq!(error.as_deref(), Some("weight \"blocks.1.ffn.0.bias\" is missing"));
    assert!("gpu".parse::<Backend>().is_err() && "cpu".parse() == Ok(Backend::Cpu));
}
