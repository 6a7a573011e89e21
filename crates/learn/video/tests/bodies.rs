//! Parity of the processor's path with the framework's graph, and independence of its results from threads and vectors.

use std::ops::Range;

use ds_graph::step;
use ds_kernel::{FastAe, FastDit, FastTeacher};
use ds_nn::array::{Array, Weights};
use ds_nn::body::{Autoencoder, Chunk, Job, Transformer};
use ds_nn::cache::{CachePolicy, KvCache, Positions, ReadOrder};
use ds_nn::dit::DitShape;
use ds_nn::step::{CausalPlan, Level, Prediction};
use ds_nn::tiny_ae::{AeShape, Memory};
use ds_video::Backend;

use crate::made::{FRAMES, clips, distance, draw, shapes, weights};

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

fn autoencoders() -> [AeShape; 4] {
    let smoke = AeShape {
        z: 4,
        stride_t: 4,
        encoder_widths: vec![24],
        encoder_blocks: vec![1],
        decoder_widths: [24, 16, 16],
        decoder_blocks: [1, 1, 0],
        decoder_skip: true,
        guides: 1,
        sketch_widths: None,
        carried: false,
    };
    let cpu_train =
        AeShape { z: 12, encoder_widths: vec![96], decoder_widths: [96, 48, 24], guides: 2, ..smoke.clone() };
    let odd = AeShape {
        z: 3,
        stride_t: 2,
        encoder_widths: vec![10],
        encoder_blocks: vec![2],
        decoder_widths: [20, 7, 5],
        decoder_blocks: [2, 1, 1],
        decoder_skip: false,
        guides: 1,
        sketch_widths: Some([9, 6, 5]),
        carried: true,
    };
    let staged = AeShape { encoder_widths: vec![12, 16, 20], encoder_blocks: vec![1, 2, 0], ..odd.clone() };
    [smoke, cpu_train, odd, staged]
}

#[test]
fn the_autoencoder_equals_the_graph_and_streams() {
    // A decoder that sees carried frames may get none.
    for (shape, channels) in autoencoders().into_iter().zip([3, 3, 7, 3]) {
        let weights = weights(&shape.declare());
        let [fast, graph] = [Backend::Cpu, Backend::Framework].map(|b| b.autoencoder(&shape, &weights).expect("fits"));
        let (h, w) = (4, 6);
        let steps = draw("steps", &[5, h, w, shape.inputs()]);
        let latents = graph.encode(&steps, &mut Memory::default());
        let guide = draw("guide", &[5 * shape.stride_t, 8 * h, 8 * w, channels]);
        let guide = (shape.guides > 0).then_some(&guide);
        let frames = graph.decode(&latents, guide, &mut Memory::default());
        for parts in [std::iter::once(0..5).collect(), vec![0..1, 1..3, 3..5], (0..5).map(|at| at..at + 1).collect()] {
            let (mut encoder, mut decoder) = (Memory::default(), Memory::default());
            let (mut found, mut painted) = (Vec::new(), Vec::new());
            for part in parts {
                let now = fast.encode(&frames_of(&steps, part.clone()), &mut encoder);
                assert_eq!(now.shape(), [part.len(), h, w, shape.z]);
                found.extend(now.into_values());
                let guide = guide.map(|all| frames_of(all, part.start * shape.stride_t..part.end * shape.stride_t));
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
    let [_, shape, ..] = autoencoders();
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
