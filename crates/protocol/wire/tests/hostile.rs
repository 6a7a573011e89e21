//! Hostile bytes at every message: each is refused by name and value, without a panic and without a giant allocation.

use std::sync::Arc;

use bytes::Bytes;
use ds_raster::{Encoding, Mover, RgbImage};
use ds_space::{AgentId, CameraId, CameraModel, DVec2, DVec3, Digest, EpisodeId, Intrinsics, PoseSe2, SimTime, Tick};
use ds_topic::body::Tensor;
use ds_topic::{
    Advance, Cache, Ego, EpisodeSpec, Event, EventKind, Frame, Layout, LayoutGeometry, Motion, Plan, SceneMessage,
    Score, Slot, Topic, World,
};
use ds_wire::policy::{Observation, PolicyHello, PolicyMessage, PolicyPlan};
use ds_wire::{Body, split, v1};
use ds_world::{
    AgentClass, AgentState, EgoState, Lane, LaneId, LaneKind, Map, Origin, Proposal, RouteCommand, Scene, Size, Track,
    Trajectory, TrajectoryPoint, VehicleParameters, WorldState,
};

/// One key and length in front of content, as protobuf writes it.
fn field(number: u8, content: &[u8]) -> Vec<u8> {
    let mut bytes = vec![number << 3 | 2];
    let mut length = content.len();
    while length >= 0x80 {
        bytes.push((length & 0x7f) as u8 | 0x80);
        length >>= 7;
    }
    bytes.push(length as u8);
    bytes.extend_from_slice(content);
    bytes
}

/// What every message must refuse: garbage, groups, deep nesting, lengths beyond the end, a second header, too long.
fn refuses_what_is_not_a_message<B: Body>(sound: &B) {
    let bytes = sound.to_bytes();
    assert!(B::from_bytes(&bytes).is_ok());
    let with = |extra: &[u8]| [&bytes[..], extra].concat();
    let hostile = [
        bytes[..bytes.len() - 1].to_vec(),
        with(&[0xff; 11]),
        with(&[0x12, 0xff, 0xff, 0xff, 0xff, 0x0f]),
        with(&[0x1a, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01]),
        with(&[0x07]),
        with(&[0x00, 0x00]),
        with(&[0x0a, 0x00]),
        with(&[0x6b; 200]),
        with(&[0x6c]),
        vec![0; ds_wire::body::max_bytes(B::TOPIC) + 1],
    ];
    for (index, bytes) in hostile.iter().enumerate() {
        let error = B::from_bytes(bytes).err().unwrap_or_else(|| panic!("{:?} case {index} was accepted", B::TOPIC));
        let text = error.to_string();
        assert!(text.starts_with(B::TOPIC.name()), "{:?} case {index}: {text:?} does not name its message", B::TOPIC);
    }
}

fn refused<B: Body>(message: impl prost::Message, says: &str) {
    let error = B::from_bytes(&message.encode_to_vec()).err().unwrap_or_else(|| panic!("accepted, wanted {says:?}"));
    assert!(error.to_string().contains(says), "{:?} does not say {says:?}", error.to_string());
}

fn trajectory() -> Trajectory {
    let point = |n: i64| TrajectoryPoint { after: SimTime(n * 100_000_000), pose: PoseSe2::new(n as f64, 0.0, 0.0) };
    Trajectory::new((1..=4).map(point).collect()).expect("sound")
}

fn plan() -> Plan {
    let proposals = vec![Proposal { trajectory: trajectory(), score: 0.5 }];
    Plan { trajectory: trajectory(), proposals, observed: Some(SimTime(0)), answered: None, context: None }
}

fn advance() -> Advance {
    let motion = Motion::Plan(trajectory());
    let owners = std::collections::BTreeMap::new();
    let border = Digest::of(b"border");
    Advance { iteration: 1, first: Tick(1), last: Tick(5), motion, border, plan_due: true, owners }
}

fn agent(id: u32) -> AgentState {
    AgentState {
        id: AgentId(id),
        class: AgentClass::Vehicle,
        size: Size { length_m: 4.0, width_m: 2.0, height_m: 1.5 },
        pose: PoseSe2::new(1.0, 2.0, 0.5),
        z_m: 0.0,
        velocity_mps: DVec2::X,
    }
}

fn world() -> World {
    let agents = (0..4).map(agent).collect();
    let ego = EgoState::default();
    let state = WorldState { tick: Tick(3), time: SimTime(3), ego, agents, lights: vec![], contacts: vec![] };
    World { state, before: Digest::default(), snapshot: Some(vec![1, 2, 3]), verdict: None, readings: Vec::new() }
}

fn image() -> RgbImage {
    RgbImage::filled(8, 4, [10, 20, 30])
}

fn frame() -> Frame {
    Frame { image: image(), encoding: Encoding::Png, seam: 0.0 }
}

fn layout() -> Layout {
    let mover = Mover { id: 1, pose: PoseSe2::default(), bottom_m: 0.0, size_m: [4.0, 2.0, 1.5] };
    let geometry = LayoutGeometry { inverse_depths: vec![7; 32].into(), movers: vec![mover] };
    Layout { image: image(), encoding: Encoding::None, ego_in_world: PoseSe2::default(), geometry: Some(geometry) }
}

fn cache() -> Cache {
    let tensor = Tensor { shape: vec![2, 2], values: vec![1.0; 4] };
    let digest = Digest::of(b"state");
    Cache {
        chunk: 1,
        first: Tick(1),
        ticks: 4,
        cached_input: tensor.clone(),
        clean: tensor.clone(),
        control: tensor,
        conditioning: digest,
        cache_digest: digest,
        encoder_digest: digest,
        decoder_digest: digest,
        frame: Some(image()),
    }
}

fn scene() -> SceneMessage {
    let lane = Lane {
        name: "a".to_owned(),
        kind: LaneKind::Road,
        centre_line: vec![DVec2::ZERO, DVec2::X],
        polygon: vec![],
        speed_limit_mps: None,
        successors: vec![LaneId(0)],
        predecessors: vec![],
        left: None,
        right: None,
    };
    let lens = Intrinsics::centred(160, 96, 1.2);
    let id = CameraId::new("front").expect("an id");
    let track = Track { name: "t".to_owned(), class: AgentClass::Cone, size: agent(0).size, points: vec![None; 2] };
    let scene = Scene {
        adversary: None,
        name: "s".to_owned(),
        family: String::new(),
        digest: Digest::of(b"scene"),
        dt: SimTime(100_000_000),
        map: Map { lanes: vec![lane], ..Map::default() },
        vehicle: VehicleParameters::ZOE,
        ego_log: vec![EgoState::default()],
        route: vec![],
        tracks: vec![track],
        cameras: vec![CameraModel::mounted(id, lens, DVec3::Z, 0.0, 0.0)],
        prompt: String::new(),
        origin: Origin::default(),
    };
    SceneMessage { spec: spec(), scene: Arc::new(scene), first_frames: vec![image()], originals: Vec::new() }
}

fn spec() -> EpisodeSpec {
    EpisodeSpec {
        policy: "camera".to_owned(),
        appearance: String::new(),
        ..EpisodeSpec::replay(EpisodeId::new("e").expect("an id"), "s", Tick(80))
    }
}

#[test]
fn no_topic_takes_what_is_not_its_message() {
    refuses_what_is_not_a_message(&scene());
    refuses_what_is_not_a_message(&advance());
    refuses_what_is_not_a_message(&world());
    refuses_what_is_not_a_message(&Ego { estimate: EgoState::default(), command: RouteCommand::Left });
    refuses_what_is_not_a_message(&layout());
    refuses_what_is_not_a_message(&frame());
    refuses_what_is_not_a_message(&plan());
    refuses_what_is_not_a_message(&cache());
    refuses_what_is_not_a_message(&Score { values: vec![("progress".to_owned(), Some(0.5))] });
    refuses_what_is_not_a_message(&Event { kind: EventKind::Started, reason: "begun".to_owned() });
}

#[test]
fn a_bad_world_is_refused_by_field_and_value() {
    let bad = |change: &dyn Fn(&mut v1::World), says: &str| {
        let mut message = v1::World::from(&world());
        change(&mut message);
        refused::<World>(message, says);
    };
    let pose = |message: &mut v1::World, x_m| message.agents[3].pose.as_mut().expect("has one").x_m = x_m;
    bad(&|m| pose(m, Some(f64::NAN)), "world.agents[3].pose.x_m is NaN");
    bad(&|m| pose(m, Some(f64::INFINITY)), "world.agents[3].pose.x_m is inf");
    bad(&|m| pose(m, None), "world.agents[3].pose.x_m is missing");
    bad(&|m| m.agents[2].pose = None, "world.agents[2].pose is missing");
    bad(&|m| m.agents[1].agent_class = 99, "world.agents[1].agent_class is 99, no known value");
    bad(&|m| m.agents[1].agent_class = 0, "world.agents[1].agent_class is unspecified");
    bad(&|m| m.agents[1].id = 0, "world.agents[1].id is 0, after 0");
    bad(&|m| m.agents[0].size.as_mut().expect("has one").width_m = Some(-2.0), "width_m is -2, below 0");
    bad(&|m| m.lights = vec![1, -7], "world.lights[1] is -7, no known value");
    bad(&|m| m.before = Bytes::from_static(&[1; 31]), "world.before has 31 bytes, a digest has 32");
    bad(&|m| m.ego = None, "world.ego is missing");
    bad(&|m| m.snapshot = Some(vec![0; (4 << 20) + 1].into()), "world.snapshot has 4194305 bytes");
}

#[test]
fn a_bad_image_is_refused_before_its_pixels_are_made() {
    let bad = |change: &dyn Fn(&mut v1::Image), says: &str| {
        let mut message = v1::Frame::from(&frame());
        change(message.image.as_mut().expect("has one"));
        refused::<Frame>(message, says);
        let mut message = v1::Layout::from(&layout());
        change(message.image.as_mut().expect("has one"));
        assert!(Layout::from_bytes(&prost::Message::encode_to_vec(&message)).is_err(), "layout took it: {says:?}");
    };
    bad(&|m| m.width_px = u32::MAX, "frame.image.width_px is 4294967295, must be 1 to 8192");
    bad(&|m| m.height_px = 0, "frame.image.height_px is 0");
    bad(&|m| (m.width_px, m.height_px) = (8192, 8192), "the limit is 10485760 pixels");
    bad(&|m| m.width_px = 9, "frame.image.data is refused");
    bad(&|m| m.encoding = 3, "frame.image.encoding is JPEG, which is lossy");
    bad(&|m| m.encoding = 0, "frame.image.encoding is unspecified");
    bad(&|m| m.encoding = 44, "frame.image.encoding is 44");
    bad(&|m| m.data = m.data.slice(..m.data.len() / 2), "frame.image.data is refused");
    bad(&|m| m.data = Bytes::new(), "frame.image.data is refused");
    // Stated and encoded size agree on something huge: the header of the PNG is rewritten, checksums and all.
    bad(
        &|m| {
            (m.encoding, m.width_px, m.height_px) = (2, 8000, 1000);
            m.data = png_header(8000, 1000);
        },
        "frame.image.data is refused",
    );
}

/// The first bytes of a PNG of some size, without its pixels.
fn png_header(width_px: u32, height_px: u32) -> Bytes {
    let mut bytes = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
    bytes.extend(width_px.to_be_bytes());
    bytes.extend(height_px.to_be_bytes());
    bytes.extend([8, 2, 0, 0, 0, 0, 0, 0, 0]);
    bytes.into()
}

#[test]
fn a_bad_geometry_is_refused_by_field_and_value() {
    let bad = |change: &dyn Fn(&mut v1::LayoutGeometry), says: &str| {
        let mut message = v1::Layout::from(&layout());
        change(message.geometry.as_mut().expect("has one"));
        refused::<Layout>(message, says);
    };
    let depths = |m: &mut v1::LayoutGeometry, bytes: usize| m.inverse_depths = vec![0; bytes].into();
    bad(&|m| depths(m, 62), "layout.geometry.inverse_depths are 31, the picture has 32 pixels");
    bad(&|m| depths(m, 63), "layout.geometry.inverse_depths has an odd number of bytes");
    bad(&|m| m.movers[0].pose = None, "layout.geometry.movers[0].pose is missing");
    bad(&|m| m.movers[0].z_m = Some(f64::NAN), "layout.geometry.movers[0].z_m is NaN");
    bad(&|m| m.movers = vec![m.movers[0]; 4097], "layout.geometry.movers");
}

#[test]
fn a_bad_plan_or_order_is_refused_by_field_and_value() {
    let bad = |change: &dyn Fn(&mut v1::Trajectory), says: &str| {
        let mut message = v1::Plan::from(&plan());
        change(message.trajectory.as_mut().expect("has one"));
        refused::<Plan>(message, &format!("plan.trajectory{says}"));
        let mut message = v1::Plan::from(&plan());
        change(message.proposals[0].trajectory.as_mut().expect("has one"));
        refused::<Plan>(message, &format!("plan.proposals[0].trajectory{says}"));
    };
    let pose = |m: &mut v1::Trajectory, x_m| m.poses[2].pose.as_mut().expect("has one").x_m = Some(x_m);
    bad(&|m| pose(m, f64::NAN), ".poses[2].pose.x_m is NaN");
    bad(&|m| pose(m, 1e9), " is refused: field \"poses[2]\" lies");
    bad(&|m| m.poses.clear(), " is refused: trajectory has no points");
    bad(&|m| m.poses[1].after_ns = 0, " is refused: field \"poses[1].after\" is 0 s");
    bad(&|m| m.poses[3].after_ns = i64::MAX, " is refused: field \"poses[3].after\"");
    bad(&|m| m.poses[0].pose = None, ".poses[0].pose is missing");
    let mut long = v1::Plan::from(&plan());
    long.trajectory.as_mut().expect("has one").poses = vec![v1::TrajectoryPoint::default(); 300];
    refused::<Plan>(long, "plan.trajectory.poses has more than 256 elements");

    let order = |change: &dyn Fn(&mut v1::Advance), says: &str| {
        let mut message = v1::Advance::from(&advance());
        change(&mut message);
        refused::<Advance>(message, says);
    };
    let owner = |role| v1::Owner { role, instance: "x".to_owned(), epoch: 1 };
    order(&|m| m.motion = None, "advance.motion is missing");
    order(&|m| m.last_tick = 0, "advance.last_tick is 0, before first_tick 1");
    order(&|m| m.border = Bytes::new(), "advance.border has 0 bytes");
    order(&|m| m.owners = vec![owner(1), owner(1)], "advance.owners[1].role is sim, which has an owner already");
    order(&|m| m.owners = vec![owner(9)], "advance.owners[0].role is 9");
    order(&|m| m.owners = vec![v1::Owner { instance: "a/**".to_owned(), ..owner(1) }], "advance.owners[0].instance");
    order(&|m| m.owners = vec![v1::Owner::default(); 5], "advance.owners has more than 4 elements");
}

#[test]
fn a_bad_cache_or_score_is_refused_by_field_and_value() {
    let bad = |change: &dyn Fn(&mut v1::Tensor), says: &str| {
        let mut message = v1::Cache::from(&cache());
        change(message.clean.as_mut().expect("has one"));
        refused::<Cache>(message, says);
    };
    bad(&|m| m.shape = vec![u32::MAX; 8], "cache.clean.shape is [4294967295");
    bad(&|m| m.shape = vec![1; 9], "cache.clean.shape has 9 axes");
    bad(&|m| m.shape = vec![], "cache.clean.values has 4 elements, shape [] needs 0");
    bad(&|m| m.values.truncate(3), "cache.clean.values has 3 elements, shape [2, 2] needs 4");
    bad(&|m| m.values[1] = f32::NAN, "cache.clean.values[1] is NaN");
    let score = |name: &str, value, says: &str| {
        let entry = v1::ScoreValue { name: name.to_owned(), value };
        refused::<Score>(v1::Score { header: None, values: vec![entry] }, says);
    };
    score("", Some(0.5), "score.values[0].name is \"\"");
    score("progress", Some(1.5), "score.values[0].value is 1.5, must be 0 to 1");
    score("progress", Some(f64::NAN), "score.values[0].value is NaN");
    score(&"x".repeat(65), None, "score.values[0].name has 65 bytes");
}

#[test]
fn a_bad_scene_is_refused_by_field_and_value() {
    let bad = |change: &dyn Fn(&mut v1::Scenario), says: &str| {
        let mut message = v1::Scene::from(&scene());
        change(message.scenario.as_mut().expect("has one"));
        refused::<SceneMessage>(message, says);
    };
    let lane = |m: &mut v1::Scenario| -> v1::Lane { m.map.as_mut().expect("has one").lanes.remove(0) };
    bad(&|m| m.dt_ns = 0, "scene.scenario.dt_ns is 0");
    bad(&|m| m.ego_log.clear(), "scene.scenario.ego_log is empty");
    bad(&|m| m.cameras.clear(), "scene.scenario.cameras is empty");
    bad(&|m| m.cameras[0].id = "../x".to_owned(), "scene.scenario.cameras[0].id is refused");
    bad(&|m| m.cameras[0].rig_from_camera.as_mut().expect("has one").qw = Some(9.0), "quaternion of length");
    bad(&|m| m.prompt = "x".repeat(5000), "scene.scenario.prompt has 5000 bytes");
    bad(
        &|m| {
            let lane = v1::Lane { left: Some(7), ..lane(m) };
            m.map.as_mut().expect("has one").lanes.push(lane);
        },
        "scene.scenario.map.lanes[0].left names lane 7, there are 1",
    );
    bad(
        &|m| {
            let line = v1::Polyline { x_m: vec![0.0, f64::NAN], y_m: vec![0.0, 1.0] };
            let lane = v1::Lane { centre_line: Some(line), ..lane(m) };
            m.map.as_mut().expect("has one").lanes.push(lane);
        },
        "scene.scenario.map.lanes[0].centre_line.x_m[1] is NaN",
    );
    bad(&|m| m.tracks[0].ticks = vec![v1::TrackTick::default(); 20_001], "scene.scenario.tracks[0].ticks has 20001");
    bad(&|m| m.tracks[0].ticks[0].seen = Some(v1::TrackPoint::default()), "tracks[0].ticks[0].seen.pose is missing");
}

#[test]
fn lists_of_empty_elements_are_counted_before_they_are_made() {
    let agents = [0x2a, 0x00].repeat(1_000_000);
    let error = World::from_bytes(&agents).expect_err("too many").to_string();
    assert_eq!(error, "world.agents has more than 4096 elements");
    let ticks = field(3, &field(9, &[0x22, 0x00].repeat(1_100_000)));
    let error = SceneMessage::from_bytes(&ticks).expect_err("too many").to_string();
    assert_eq!(error, "scene.scenario.tracks.ticks has more than 1000000 elements");
    let proposals = [0x1a, 0x00].repeat(100_000);
    let error = PolicyPlan::from_bytes(&proposals).expect_err("too many").to_string();
    assert_eq!(error, "plan.proposals has more than 64 elements");
}

#[test]
fn bad_headers_are_refused() {
    let slot = Slot::new(Topic::Ego, 3);
    let check = |change: &dyn Fn(&mut v1::Header), says: &str| {
        let mut header = v1::Header {
            episode: "e".to_owned(),
            publisher: "p".to_owned(),
            schema_version: 1,
            slot: Some(v1::Slot { topic: 4, index: slot.index, camera: 0 }),
            content: vec![0; 32].into(),
            ..v1::Header::default()
        };
        assert!(split(field(1, &prost::Message::encode_to_vec(&header)).into()).is_ok());
        change(&mut header);
        let bytes = field(1, &prost::Message::encode_to_vec(&header));
        let error = split(bytes.into()).expect_err(says).to_string();
        assert!(error.contains(says), "{error:?} does not say {says:?}");
    };
    check(&|h| h.episode = "a/b".to_owned(), "header.episode is refused");
    check(&|h| h.episode = String::new(), "header.episode is refused: episode id is empty");
    check(&|h| h.publisher = "*".to_owned(), "header.publisher is refused");
    check(&|h| h.schema_version = 0, "header.schema_version is 0");
    check(&|h| h.slot = None, "header.slot is missing");
    check(&|h| h.slot.as_mut().expect("has one").topic = 77, "header.slot.topic is 77");
    check(&|h| h.slot.as_mut().expect("has one").camera = 1, "header.slot.camera is 1, must be 0 to 0");
    check(&|h| h.content = vec![0; 31].into(), "header.content has 31 bytes");
    check(&|h| h.content = Bytes::new(), "ego.estimate is missing");
    check(&|h| h.trace = "x".repeat(300), "header.trace has 300 bytes");
    check(&|h| h.trace = "x".repeat(3000), "header has");
    for bytes in [&b""[..], b"\x0a", b"\x0a\xff\xff\xff\xff\x0f", b"\x12\x00", b"\x0a\x05\x01"] {
        let error = split(Bytes::copy_from_slice(bytes)).expect_err("no header").to_string();
        assert!(error.starts_with("header"), "{error:?}");
    }
    let mut long = field(1, &[]);
    long.extend(vec![0; 100]);
    assert!(split(long.into()).is_err());
}

#[test]
fn a_context_is_whole_tokens_of_finite_numbers() {
    let read = |channels: u32, values: Vec<f32>| {
        let sound = PolicyPlan { for_sequence: 1, plan: plan() }.to_bytes();
        let mut message: ds_wire::policy_v1::PolicyPlan = prost::Message::decode(sound).expect("as written");
        message.context = Some(ds_wire::policy_v1::PlanContext { channels, values });
        PolicyPlan::from_bytes(&prost::Message::encode_to_vec(&message))
    };
    let sound = read(3, vec![0.5; 6]).expect("two tokens").plan.context.expect("it tells");
    assert_eq!((sound.shape, sound.values), (vec![2, 3], vec![0.5; 6]));
    for (channels, values, says) in [
        (4, vec![0.0; 6], "plan.context.values has 6 elements, no multiple of 4 channels"),
        (0, vec![0.0; 6], "plan.context.channels is 0"),
        (1, vec![], "plan.context.values has 0 elements, 1 to 4096"),
        (1, vec![0.0; 4097], "plan.context.values has 4097 elements, 1 to 4096"),
        (2, vec![0.0, 0.0, 0.0, f32::NAN], "plan.context.values[3] is NaN"),
    ] {
        let error = read(channels, values).expect_err(says).to_string();
        assert!(error.contains(says), "{error:?} does not say {says:?}");
    }
    let mut message = v1::Plan::from(&plan());
    message.context = Some(v1::Tensor { shape: vec![6], values: vec![0.0; 6] });
    refused::<Plan>(message, "plan.context.shape is [6]");
}

#[test]
fn a_guest_can_not_hurt_the_bridge() {
    let sound = PolicyPlan { for_sequence: 1, plan: plan() }.to_bytes();
    assert!(PolicyPlan::from_bytes(&sound).is_ok());
    let hostile: [&[u8]; 6] =
        [&sound[..sound.len() - 1], &[0xff; 20], &vec![0x12; 2 << 20], &[0x13; 300], &[0x12, 0xff, 0xff, 0x7f], b""];
    for bytes in hostile {
        let error = PolicyPlan::from_bytes(bytes).expect_err("refused").to_string();
        assert!(error.starts_with("plan"), "{error:?}");
    }
    assert!(
        PolicyHello::from_bytes(&[0x08, 0x02]).expect_err("another version").to_string().contains("ready.version is 2")
    );
    assert!(Observation::from_bytes(&[0x1a; 64]).is_err());
}
