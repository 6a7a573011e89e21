//! Equivalences that a rollout must keep: splits, snapshots, replay, cache sources, rings, hostile weights and logs.

use std::sync::Arc;

use ds_nn::body::Chunk;
use ds_nn::cache::{KvCache, Positions, ReadOrder};
use ds_nn::safetensors::WeightsFile;
use ds_nn::{Array, Weights};
use ds_raster::geometry::INVERSE_DEPTH_STEP;
use ds_raster::{Geometry, RgbImage};
use ds_space::{CameraId, CameraModel, DVec3, Digest, Intrinsics, PoseSe2};
use ds_topic::Cache;
use ds_topic::body::Tensor;

use crate::{Backend, Generated, Layout, ModelConfig, Replay, Rollout, VideoError, VideoModel, prompt, sampler};

mod published;

const SMOKE: &str = include_str!("../../../../configs/models/smoke.toml");
const PROMPT: &str = "driving by day, clear sky";

fn model_of(text: &str) -> Arc<VideoModel> {
    let config = ModelConfig::parse(text).expect("the preset is valid");
    Arc::new(VideoModel::untrained(&config, &Digest::of(b"weights")))
}

fn model(cache_source: &str) -> Arc<VideoModel> {
    model_of(&SMOKE.replace("state(2)", cache_source))
}

fn model_on(backend: Backend) -> Arc<VideoModel> {
    let config = ModelConfig::parse(SMOKE).expect("the preset is valid");
    let weights = Weights::initialised(&VideoModel::declare(&config), &Digest::of(b"weights"));
    Arc::new(VideoModel::new_on(backend, &config, &weights).expect("first weights fit"))
}

/// A picture that moves with `k`.
fn picture(k: u32) -> RgbImage {
    let mut image = RgbImage::filled(64, 32, [40, 90, 150]);
    for (x, y) in (0..64).flat_map(|x| (16..32).map(move |y| (x, y))) {
        let line = (x + 3 * k) % 16 < 3;
        image.set_pixel(x, y, if line { [230, 220, 40] } else { [90, 90, 95] });
    }
    image
}

fn layouts(ticks: std::ops::Range<u32>) -> Vec<RgbImage> {
    ticks.map(|k| picture(k + 100)).collect()
}

fn start(model: &Arc<VideoModel>) -> (Rollout, Cache) {
    let key = Digest::of(b"key");
    Rollout::new(Arc::clone(model), key, "front", PROMPT, &picture(0), picture(100)).expect("starts")
}

/// Layouts seen by a car that drives along a plane.
fn told(ticks: std::ops::Range<u32>) -> Vec<Layout> {
    let id = CameraId::new("front").expect("an id");
    let camera = CameraModel::mounted(id, Intrinsics::centred(64, 32, 1.2), DVec3::new(0.0, 0.0, 1.5), 0.0, 0.0);
    let lens = camera.intrinsics;
    let below = |row: usize| (row as f64 + 0.5 - lens.cy_px).max(0.0) / lens.fy_px / 1.5;
    let depths: Arc<[u16]> = (0..32 * 64).map(|at| (below(at / 64) / INVERSE_DEPTH_STEP) as u16).collect();
    let layout = |k: u32| {
        let world_from_camera = PoseSe2::new(0.4 * f64::from(k), 0.0, 0.0).world_from_rig(0.0) * camera.rig_from_camera;
        let geometry = Geometry { lens, world_from_camera, inverse_depths: Arc::clone(&depths), movers: Vec::new() };
        Layout { image: picture(k + 100), geometry: Some(Arc::new(geometry)) }
    };
    ticks.map(layout).collect()
}

const CARRIED: &str = "decoder_layers = 1\ncarried = true";
const FALLS: &str = "decoder_layers = 1\ncarried = true\nfalls = { snow = \"flakes\", rain = \"streaks\" }";

#[test]
fn a_frame_is_carried_from_chunk_to_chunk_and_to_a_successor() {
    carries(&model_of(&SMOKE.replace("decoder_layers = 1", CARRIED)), PROMPT);
    carries(&model_of(&SMOKE.replace("decoder_layers = 1", FALLS)), "a road, flakes in the air");
}

#[test]
fn what_falls_by_the_prompt_is_drawn_at_each_tick_and_never_carried() {
    let model = model_of(&SMOKE.replace("decoder_layers = 1", FALLS));
    let made = |prompt: &str| {
        let (key, first) = (Digest::of(b"key"), &told(0..1)[0]);
        let begun = Rollout::new(Arc::clone(&model), key, "front", prompt, &picture(0), first);
        begun.expect("starts").0.generate(&told(1..9)).expect("generates")
    };
    let prompts = ["a road", "a road, flakes in the air", "a road, streaks in the air"];
    let [dry, snow, rain] = prompts.map(made);
    let falls = model.config().control.falls.as_ref().expect("is told");
    let fall = prompts.map(|prompt| falls.said(prompt, Digest::of(b"key")).is_some());
    assert_eq!(fall, [false, true, true]);
    let last =
        |made: &Generated| (made.frames.last().cloned(), made.committed.last().and_then(|entry| entry.frame.clone()));
    let (shown, carried) = last(&dry);
    assert_eq!(shown, carried.map(|frame| ds_raster::sharpened(&frame, crate::layout::SHARPER)));
    for (name, made) in [("snow", &snow), ("rain", &rain)] {
        let (shown, carried) = last(made);
        let (shown, carried) = (shown.expect("a frame"), carried.expect("a frame"));
        let carried = ds_raster::sharpened(&carried, crate::layout::SHARPER);
        let changed = shown.rgb().iter().zip(carried.rgb()).filter(|(a, b)| a != b).count();
        assert!(changed > 0 && changed < shown.rgb().len(), "{name} covers {changed} values");
    }
}

fn carries(model: &Arc<VideoModel>, prompt: &str) {
    assert_eq!(model.config().layout_memory_ticks(), 4);
    let first = &told(0..1)[0];
    let begin = || {
        let key = Digest::of(b"key");
        Rollout::new(Arc::clone(model), key, "front", prompt, &picture(0), first).expect("starts")
    };
    let (mut rollout, entry) = begin();
    let whole = rollout.generate(&told(1..13)).expect("generates");
    assert!(whole.committed.iter().all(|entry| entry.frame.is_some()));
    let plain = begin().0.generate(&layouts(1..13)).expect("generates");
    assert_ne!(whole.frames[..4], plain.frames[..4], "the first frame is carried into the first chunk");
    for done in 0..3 {
        let log: Vec<Cache> = std::iter::once(&entry).chain(&whole.committed[..done]).cloned().collect();
        let since = 4 * done as u32 + 1;
        let mut successor = Rollout::replay(Replay {
            model: Arc::clone(model),
            draw_key: Digest::of(b"key"),
            camera: "front",
            prompt,
            first_frame: &picture(0),
            entries: &log,
            past: &told(since.saturating_sub(5)..since),
            layouts: &told(since..since + 2),
        })
        .expect("replays");
        let after = successor.generate(&told(since + 2..13)).expect("generates");
        assert_eq!(after.frames, whole.frames[since as usize + 1..]);
        assert_eq!(after.committed, whole.committed[done..]);
        assert_eq!(successor.state_digest(), rollout.state_digest());
    }
}

fn replayed(model: &Arc<VideoModel>, log: &[Cache], since: &[RgbImage]) -> Result<Rollout, VideoError> {
    let since: Vec<Layout> = since.iter().map(Layout::from).collect();
    Rollout::replay(Replay {
        model: Arc::clone(model),
        draw_key: Digest::of(b"key"),
        camera: "front",
        prompt: PROMPT,
        first_frame: &picture(0),
        entries: log,
        past: &[],
        layouts: &since,
    })
}

#[test]
fn a_frame_comes_for_every_layout_however_calls_are_split_at_chunks() {
    let model = model("state(2)");
    let whole = start(&model).0.generate(&layouts(1..25)).expect("generates");
    assert_eq!((whole.frames.len(), whole.committed.len(), whole.seam), (24, 6, 0.0));
    let mut rollout = start(&model).0;
    let mut frames = Vec::new();
    for part in [1..5, 5..17, 17..25] {
        frames.extend(rollout.generate(&layouts(part)).expect("generates").frames);
    }
    assert_eq!(frames, whole.frames);
    let ticks: Vec<(u32, u32)> = whole.committed.iter().map(|e| (e.first.0, e.ticks)).collect();
    assert_eq!(ticks, [(1, 4), (5, 4), (9, 4), (13, 4), (17, 4), (21, 4)]);
    assert!(rollout.generate::<Layout>(&[]).is_err());
}

#[test]
fn a_partial_chunk_is_made_again_and_only_new_ticks_come_out() {
    let model = model("state(2)");
    let exact = start(&model).0.generate(&layouts(1..21)).expect("generates");
    let mut rollout = start(&model).0;
    let (mut frames, mut committed, mut seams) = (Vec::new(), Vec::new(), Vec::new());
    for part in [1..6, 6..11, 11..16, 16..21] {
        let generated = rollout.generate(&layouts(part)).expect("generates");
        assert_eq!(generated.frames.len(), 5);
        frames.extend(generated.frames);
        committed.extend(generated.committed);
        seams.push(generated.seam);
    }
    // What is committed does not depend on the split; published ticks of whole chunks are equal too.
    assert_eq!(committed, exact.committed);
    assert_eq!(frames[..4], exact.frames[..4]);
    assert_eq!(frames[5..8], exact.frames[5..8], "the rest of the second chunk, made with its true layouts");
    assert_eq!(rollout.state_digest(), {
        let mut rollout = start(&model).0;
        rollout.generate(&layouts(1..21)).expect("generates");
        rollout.state_digest()
    });
    assert!(seams[0] == 0.0 && seams[1..].iter().any(|seam| *seam > 0.0), "{seams:?}");
}

#[test]
fn a_copy_continues_as_if_nothing_had_come_after_it() {
    let model = model("state(2)");
    let mut rollout = start(&model).0;
    rollout.generate(&layouts(1..7)).expect("generates");
    let mut copy = rollout.clone();
    let expected = rollout.generate(&layouts(7..20)).expect("generates").frames;
    rollout.generate(&layouts(50..60)).expect("generates");
    assert_eq!(copy.generate(&layouts(7..20)).expect("generates").frames, expected);
}

#[test]
fn a_successor_replays_the_log_and_gives_the_same_frames() {
    for source in ["state(2)", "clean", "renoise(0.3)", "x0hat(1)"] {
        let model = model(source);
        // Before the first eviction, after it, and in mid-chunk.
        for (done, since) in [(0, 0), (1, 0), (6, 0), (6, 3)] {
            let (mut rollout, entry) = start(&model);
            let mut log = vec![entry];
            let ticks = 4 * done + since;
            if done > 0 {
                log.extend(rollout.generate(&layouts(1..4 * done + 1)).expect("generates").committed);
            }
            if since > 0 {
                rollout.generate(&layouts(4 * done + 1..ticks + 1)).expect("generates");
            }
            let mut successor = replayed(&model, &log, &layouts(4 * done + 1..ticks + 1)).expect("replays");
            assert_eq!(successor.state_digest(), rollout.state_digest());
            let next = layouts(ticks + 1..ticks + 8);
            let (a, b) = (rollout.generate(&next).expect("generates"), successor.generate(&next).expect("generates"));
            assert_eq!((a.frames, a.committed, a.seam), (b.frames, b.committed, b.seam), "{source}, {done}, {since}");
        }
    }
}

#[test]
fn broken_logs_are_refused_by_field() {
    let model = model("state(2)");
    let (mut rollout, entry) = start(&model);
    let mut log = vec![entry];
    log.extend(rollout.generate(&layouts(1..13)).expect("generates").committed);
    let check = |change: &dyn Fn(&mut Vec<Cache>), expected: &str| {
        let mut log = log.clone();
        change(&mut log);
        let message = match replayed(&model, &log, &[]) {
            Ok(_) => "accepted".to_owned(),
            Err(error) => error.to_string(),
        };
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    };
    check(&|_| (), "accepted");
    check(&Vec::clear, "\"entries\"");
    check(&|log| drop(log.remove(1)), "entry 2: field \"chunk\" is 2, 1 expected");
    check(&|log| log[2].cached_input.values[7] = f32::NAN, "\"cached_input\" holds NaN at index 7");
    check(&|log| log[2].clean.shape[0] = u32::MAX, "\"clean\" has shape");
    check(&|log| log[2].control = Tensor::default(), "\"control\" has shape []");
    check(&|log| log[2].cached_input.values[7] += 1.0, "recovery mismatch at chunk 2: cache_digest");
    check(&|log| log[1].clean.values[0] += 1.0, "recovery mismatch at chunk 1: decoder_digest");
    check(&|log| log[0].conditioning = Digest::default(), "recovery mismatch at chunk 0: conditioning");
    let late = replayed(&model, &log, &layouts(0..4));
    assert!(matches!(late, Err(VideoError::Entry { field: "layouts", .. })));
}

#[test]
fn renoising_by_zero_is_the_clean_source() {
    let frames = |source: &str| start(&model(source)).0.generate(&layouts(1..25)).expect("generates").frames;
    assert_eq!(frames("renoise(0)"), frames("clean"));
    assert_ne!(frames("renoise(0.5)"), frames("clean"));
}

#[test]
fn the_state_source_saves_one_forward_pass_per_chunk() {
    let count = |source: &str| {
        let model = model(source);
        let mut rollout = start(&model).0;
        let before = model.dit.forwards();
        rollout.generate(&layouts(1..13)).expect("generates");
        model.dit.forwards() - before
    };
    assert_eq!((count("state(2)"), count("clean"), count("x0hat(1)")), (3 * 2, 3 * 3, 3 * 3));
}

#[test]
fn the_state_source_caches_the_state_that_enters_its_step() {
    let model = model("state(2)");
    let (mut rollout, _) = start(&model);
    let entry = rollout.generate(&layouts(1..5)).expect("generates").committed.remove(0);
    // state(2) = (1 − σ)·x̂0 + σ·ε with the noise of step 2: taking the noise away leaves the first estimate.
    let noise = sampler::noise(&Digest::of(b"key"), "front", 1, 2, &[1, 8, 4, 4]);
    let sigma = sampler::sigmas(2, 5.0)[1];
    let estimate = entry.cached_input.values.iter().zip(noise.values()).map(|(x, e)| (x - sigma * e) / (1.0 - sigma));
    let largest = estimate.fold(0.0f32, |largest, value| largest.max(value.abs()));
    assert!(largest < 2.0, "an untrained model's estimate is small: {largest}");
    assert_ne!(entry.cached_input, entry.clean);
}

#[test]
fn back_ends_give_the_same_frames_up_to_rounding() {
    let digest = model("state(2)").digest();
    let run = |backend| {
        let model = model_on(backend);
        assert_eq!((model.backend(), model.digest()), (backend, digest));
        let (mut rollout, entry) = start(&model);
        let mut log = vec![entry];
        let generated = rollout.generate(&layouts(1..42)).expect("generates");
        log.extend(generated.committed);
        assert_eq!(replayed(&model, &log, &layouts(41..42)).expect("replays").state_digest(), rollout.state_digest());
        (generated.frames, log)
    };
    let ((cpu, log), (framework, _)) = (run(Backend::Cpu), run(Backend::Framework));
    let pairs = || cpu.iter().zip(&framework).flat_map(|(a, b)| a.rgb().iter().zip(b.rgb()));
    assert!(pairs().all(|(a, b)| a.abs_diff(*b) <= 1), "rounding to a byte may fall either way, no more");
    assert!(pairs().filter(|(a, b)| a != b).count() < pairs().count() / 100);
    // The log of one back end is no log of the other: keys and values differ in their last bits.
    let mixed = replayed(&model_on(Backend::Framework), &log, &[]);
    assert!(matches!(mixed, Err(VideoError::RecoveryMismatch { .. })));
}

#[test]
fn rollouts_at_once_give_what_each_gives_alone() {
    let model = model("state(2)");
    let run = |key: u8| {
        let begun = Rollout::new(Arc::clone(&model), Digest::of(&[key]), "front", PROMPT, &picture(0), picture(100));
        let (mut rollout, _) = begun.expect("starts");
        (rollout.generate(&layouts(1..22)).expect("generates").frames, rollout.state_digest())
    };
    let alone: Vec<_> = (0..4).map(run).collect();
    let at_once: Vec<_> = std::thread::scope(|scope| {
        let run = &run;
        let threads: Vec<_> = (0..4).map(|key| scope.spawn(move || run(key))).collect();
        threads.into_iter().map(|thread| thread.join().expect("the thread ends")).collect()
    });
    assert!(alone == at_once);
    assert_ne!(alone[0].1, alone[1].1);
}

#[test]
fn every_cache_source_rolls_on() {
    let run = |source: &str| {
        let text = SMOKE.replace("state(2)", source).replace("steps = 2", "steps = 4");
        let (mut rollout, _) = start(&model_of(&text));
        let generated = rollout.generate(&layouts(1..121)).expect("generates finite values");
        let cached = &generated.committed[29];
        assert_eq!((generated.frames.len(), cached.first.0), (120, 117));
        // Only the clean source keeps what is decoded.
        assert_eq!(cached.cached_input == cached.clean, source == "clean", "{source}");
        rollout.state_digest()
    };
    let digests = ["clean", "renoise(0.3)", "state(2)", "state(4)", "x0hat(1)", "x0hat(3)"].map(run);
    let different: std::collections::BTreeSet<Digest> = digests.into_iter().collect();
    assert_eq!(different.len(), 6);
}

#[test]
fn any_number_of_steps_rolls_on() {
    let run = |steps: usize| {
        let source = if steps == 1 { "clean" } else { "state(2)" };
        let text = SMOKE.replace("state(2)", source).replace("steps = 2", &format!("steps = {steps}"));
        start(&model_of(&text)).0.generate(&layouts(1..9)).expect("generates finite values").frames
    };
    let frames = [1, 2, 3, 4].map(run);
    assert!(frames.iter().all(|frames| frames.len() == 8) && frames.windows(2).all(|pair| pair[0] != pair[1]));
}

#[test]
fn an_own_model_may_have_drawn_weights() {
    let nowhere = std::path::Path::new("/nowhere");
    let drawn = ModelConfig::parse(&format!("{SMOKE}\n[weights]\ndrawn = true\n")).expect("valid");
    let model = VideoModel::load_on(Backend::Cpu, &drawn, nowhere).expect("no file is read");
    assert_eq!(start(&Arc::new(model)).0.generate(&layouts(1..5)).expect("generates").frames.len(), 4);
    let asked = ModelConfig::parse(SMOKE).expect("valid");
    assert!(VideoModel::load_on(Backend::Cpu, &asked, nowhere).is_err());
}

#[test]
fn ring_and_shifted_reading_agree() {
    for backend in [Backend::Cpu, Backend::Framework] {
        ring_and_shifted_reading_agree_on(backend);
    }
}

fn ring_and_shifted_reading_agree_on(backend: Backend) {
    let model = model_on(backend);
    let shape = [1, model.config().dit().tokens(), 4, model.config().vae.z];
    let context = model.dit.context(&prompt::hashed(PROMPT, 4, 32), &Array::zeros(&shape));
    let inputs = model.config().ae().inputs();
    let control = model.dit.control(&Array::zeros(&[1, shape[1], 4, inputs]));
    let run = |order| {
        let mut cache = KvCache::new(ds_nn::cache::CachePolicy {
            order,
            window: 5,
            positions: Positions::CacheRelative,
            ..model.config().cache()
        });
        let mut output = Array::default();
        for chunk in 0..9 {
            let noisy = sampler::noise(&Digest::of(b"ring"), "front", chunk, 1, &shape);
            let start = Array::zeros(&shape);
            let input = Chunk { noisy: &noisy, start: &start, control: &control, time: 833.0 };
            let kv;
            (output, kv) = model.dit.denoise(&input, &cache.window(&*model.dit, 1), &context);
            cache.commit(&kv);
        }
        output
    };
    let (ring, shifted) = (run(ReadOrder::Slot), run(ReadOrder::Age));
    let worst = ring.values().iter().zip(shifted.values()).fold(0.0f32, |w, (a, b)| w.max((a - b).abs()));
    assert!(worst < 1e-4, "{worst}");
}

#[test]
fn what_a_rollout_depends_on() {
    let model = model("state(2)");
    let run = |key: &str, camera: &str, prompt: &str, first: u32, on: u32| {
        let (key, first) = (Digest::of(key.as_bytes()), picture(first));
        let rollout = Rollout::new(Arc::clone(&model), key, camera, prompt, &first, picture(100));
        rollout.expect("starts").0.generate(&layouts(on..on + 8)).expect("generates").frames
    };
    let base = run("key", "front", PROMPT, 0, 1);
    assert_eq!(run("key", "front", PROMPT, 0, 1), base);
    for other in [
        run("other", "front", PROMPT, 0, 1),
        run("key", "left", PROMPT, 0, 1),
        run("key", "front", "night", 0, 1),
        run("key", "front", PROMPT, 5, 1),
        run("key", "front", PROMPT, 0, 3),
    ] {
        assert_ne!(other, base);
    }
}

#[test]
fn two_workers_give_the_same_frames() {
    let run = || {
        let mut rollout = start(&model("state(2)")).0;
        (rollout.generate(&layouts(1..25)).expect("generates").frames, rollout.state_digest())
    };
    let other = std::thread::spawn(run);
    assert_eq!(run(), other.join().expect("the thread ends"));
}

#[test]
fn weight_files_are_checked_against_the_model() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("weights.safetensors");
    let config = ModelConfig::parse(SMOKE).expect("the preset is valid");
    let mut file = WeightsFile {
        weights: Weights::initialised(&VideoModel::declare(&config), &Digest::of(b"weights")),
        ..WeightsFile::default()
    };
    let load = |change: &dyn Fn(&mut WeightsFile)| {
        let mut changed = file.clone();
        change(&mut changed);
        changed.write(&path).expect("writes");
        VideoModel::load(&config, &path)
    };
    let good = load(&|_| ()).map_err(|error| error.to_string()).expect("loads");
    assert_eq!(good.digest(), model("state(2)").digest());
    let zero_std = Array::zeros(&[config.vae.z]);
    assert!(matches!(load(&|f| f.weights.insert("vae.latent.std", zero_std.clone())), Err(VideoError::Weights(_))));
    assert!(matches!(load(&|f| drop(f.weights.remove("vae.decoder.stem.bias"))), Err(VideoError::Weights(_))));
    let named = |digest: &str| {
        let digest = digest.to_owned();
        move |f: &mut WeightsFile| drop(f.metadata.insert("config_digest".to_owned(), digest.clone()))
    };
    assert!(load(&named(&config.digest().to_string())).is_ok());
    assert!(matches!(load(&named("0000")), Err(VideoError::OtherConfig { .. })));
    file.weights.insert("dit.surprise", Array::zeros(&[1]));
    file.write(&path).expect("writes");
    assert!(matches!(VideoModel::load(&config, &path), Err(VideoError::Weights(_))));
}
