//! A rig of several cameras through the maker, against each camera alone, and from its log.

use std::path::Path;

use ds_process::maker::output;
use ds_space::{AttemptId, CameraId, CameraModel, DVec3, Digest, EpisodeId, InstanceId, Intrinsics, PoseSe2, SimTime};
use ds_topic::{Envelope, EpisodeSpec, Header, LayoutGeometry, Motion, ObservationSource, SCHEMA_VERSION};
use ds_video::{Backend, ModelConfig};

use super::*;

const CAMERAS: [&str; 3] = ["front", "left", "right"];
const ROUNDS: u32 = 4;
const REPLAN: u32 = 5;

const SMOKE: &str = include_str!("../../../../configs/models/smoke.toml");

fn own(text: &str) -> Arc<VideoModel> {
    let config = ModelConfig::parse(text).expect("the preset is valid");
    Arc::new(VideoModel::untrained(&config, &Digest::of(b"weights")))
}

fn published() -> Arc<VideoModel> {
    let text = include_str!("../../../../configs/models/wan-smoke.toml");
    let config = ModelConfig::parse(text).expect("the preset is valid");
    Arc::new(VideoModel::drawn(Backend::Framework, &config).expect("a processor is there"))
}

fn picture(camera: u16, tick: u32) -> RgbImage {
    let mut image = RgbImage::filled(64, 32, [40 + 60 * camera as u8, 90, 150]);
    (0..32).for_each(|y| image.set_pixel((7 * tick + y) % 64, y, [255, 255, 0]));
    image
}

fn scene(model: &VideoModel) -> Arc<SceneMessage> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/base/free-curve.scenario.json");
    let (mut scene, _) = ds_scenario::load(&file).expect("a scenario of the repository");
    let lens = Intrinsics::centred(64, 32, 1.2);
    let mounted = |name: &str| {
        CameraModel::mounted(CameraId::new(name).expect("a plain word"), lens, DVec3::new(1.5, 0.0, 1.6), 0.0, 0.05)
    };
    scene.cameras = CAMERAS.iter().map(|name| mounted(name)).collect();
    let spec = EpisodeSpec {
        scenario_digest: scene.digest,
        observation: ObservationSource::Dreamstream,
        replan_period: REPLAN,
        chunk_ticks: model.config().frames_per_chunk() as u32,
        video_model: model.digest(),
        layout_memory_ticks: model.config().layout_memory_ticks() as u32,
        layout_geometry: model.config().control.carried,
        prompt: "a road by day".to_owned(),
        ..EpisodeSpec::replay(EpisodeId::new("rig").expect("a plain word"), &scene.name, Tick(REPLAN * ROUNDS))
    };
    let first_frames = (0u16..).take(CAMERAS.len()).map(|camera| picture(camera, 0)).collect();
    Arc::new(SceneMessage { spec, scene: Arc::new(scene), first_frames, originals: Vec::new() })
}

fn envelope(made: Output) -> Envelope {
    let header = Header {
        episode: EpisodeId::new("rig").expect("a plain word"),
        attempt: AttemptId(1),
        term: 1,
        epoch: 1,
        iteration: 0,
        tick: made.tick,
        time: SimTime(0),
        sequence: 0,
        publisher: InstanceId::new("test").expect("a plain word"),
        schema_version: SCHEMA_VERSION,
        trace: String::new(),
        slot: made.slot,
        content: made.content,
    };
    Envelope { header, body: made.body }
}

fn order(iteration: u32) -> Advance {
    let (first, last) = if iteration == 0 { (0, 0) } else { (1 + REPLAN * (iteration - 1), REPLAN * iteration) };
    Advance {
        iteration,
        first: Tick(first),
        last: Tick(last),
        motion: Motion::Log,
        border: Digest::default(),
        plan_due: false,
        owners: std::collections::BTreeMap::new(),
    }
}

fn ego(tick: u32) -> PoseSe2 {
    PoseSe2::new(0.3 * f64::from(tick), 0.0, 0.0)
}

/// A wall 10 m away.
fn depths() -> Arc<[u16]> {
    vec![6_553; 64 * 32].into()
}

/// The layout of a tick as a rollout takes it.
fn layout(camera: &CameraModel, index: u16, tick: u32) -> Layout {
    let world_from_camera = ego(tick).world_from_rig(0.0) * camera.rig_from_camera;
    let geometry =
        Geometry { lens: camera.intrinsics, world_from_camera, inverse_depths: depths(), movers: Vec::new() };
    Layout { geometry: Some(Arc::new(geometry)), ..Layout::from(picture(index, tick + 100)) }
}

/// All layouts of the drive.
fn layouts() -> Inputs {
    let mut inputs = Inputs::default();
    for (tick, camera) in (0..=REPLAN * ROUNDS).flat_map(|tick| (0u16..3).map(move |camera| (tick, camera))) {
        let geometry = LayoutGeometry { inverse_depths: depths(), movers: Vec::new() };
        let layout = ds_topic::Layout {
            image: picture(camera, tick + 100),
            encoding: Encoding::None,
            ego_in_world: ego(tick),
            geometry: Some(geometry),
        };
        let slot = Slot::of_camera(Topic::Layout, tick, camera);
        inputs.0.insert(slot, envelope(output(slot, Tick(tick), &layout)));
    }
    inputs
}

#[test]
fn cameras_of_a_rig_are_made_as_each_alone_and_restored_from_their_logs() {
    let carrying = SMOKE.replace("decoder_layers = 1", "decoder_layers = 1\ncarried = true");
    for model in [own(SMOKE), own(&carrying), published()] {
        check(model);
    }
}

fn check(model: Arc<VideoModel>) {
    let mut inputs = layouts();
    let scene = scene(&model);
    let mut maker = Rollouts::new(Arc::clone(&model), Arc::clone(&scene));
    let mut made = Vec::new();
    for iteration in 0..=ROUNDS {
        made.extend(maker.work(&order(iteration), &inputs).expect("works"));
    }
    for (index, seen) in (0u16..).zip(&scene.scene.cameras) {
        let (key, prompt, camera) = (scene.spec.draw_key(), scene.prompt(), seen.id.as_str());
        let first = layout(seen, index, 0);
        let begun = Rollout::new(Arc::clone(&model), key, camera, prompt, &picture(index, 0), first);
        let (mut alone, _) = begun.expect("starts");
        let mut frames = vec![alone.first_frame().clone()];
        for iteration in 1..=ROUNDS {
            let ticks = 1 + REPLAN * (iteration - 1)..=REPLAN * iteration;
            let layouts: Vec<Layout> = ticks.map(|tick| layout(seen, index, tick)).collect();
            frames.extend(alone.generate(&layouts).expect("generates").frames);
        }
        let slots = |one: &&Output| one.slot.topic == Topic::Frame && one.slot.camera == index;
        let found: Vec<&Output> = made.iter().filter(slots).collect();
        assert_eq!(found.len(), frames.len(), "{camera}");
        for (one, image) in found.into_iter().zip(frames) {
            let mut inputs = Inputs::default();
            inputs.0.insert(one.slot, envelope(one.clone()));
            assert!(inputs.decode::<Frame>(one.slot).expect("decodes").image == image, "{camera}, {}", one.slot);
        }
    }
    // A successor at the last iteration gives the same bytes.
    let cache = made.iter().filter(|one| one.slot.topic == Topic::Cache);
    inputs.0.extend(cache.map(|one| (one.slot, envelope(one.clone()))));
    let mut successor = Rollouts::new(model, scene);
    successor.restore(&order(ROUNDS), &inputs).expect("restores");
    let again = successor.work(&order(ROUNDS), &inputs).expect("works");
    assert!(!again.is_empty() && made.ends_with(&again));
}
