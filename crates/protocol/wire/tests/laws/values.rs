//! Arbitrary values of every topic, within the bounds of the contract.

use std::collections::BTreeMap;
use std::sync::Arc;

use ds_raster::{Encoding, Mover, RgbImage};
use ds_space::{
    AgentId, CameraId, CameraModel, DVec2, DVec3, Digest, EpisodeId, InstanceId, Intrinsics, PoseSe2, SimTime, Tick,
};
use ds_topic::body::Tensor;
use ds_topic::{
    Advance, Answered, Cache, DiagnosedEffect, Diagnosis, Ego, EpisodeSpec, Frame, GapCell, Layout, LayoutGeometry,
    Motion, ObservationSource, Owner, Plan, ProposalScorer, ReplanAlignment, Role, SceneMessage, Score, ScoreProfile,
    SwitchedEffect, Verdict, World,
};
use ds_wire::policy::{CameraView, Observation, StampedEgo, StampedImage};
use ds_world::{
    AgentClass, AgentMode, AgentState, Contact, ContactKind, Crosswalk, EgoState, Lane, LaneId, LaneKind,
    LayoutBackend, LightState, LineColour, LineKind, LineMarking, Map, Origin, Proposal, Reading, RoadEdge,
    RouteCommand, Scene, Size, StopLine, Structure, StructureKind, Track, TrackPoint, TrackerKind, TrafficLight,
    Trajectory, TrajectoryPoint, VehicleParameters, WorldState,
};
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;

/// Any finite number, zeros of both signs and subnormals included.
fn finite() -> impl Strategy<Value = f64> + Clone {
    use proptest::num::f64::{NEGATIVE, NORMAL, POSITIVE, SUBNORMAL, ZERO};
    NORMAL | SUBNORMAL | ZERO | POSITIVE | NEGATIVE
}

fn length() -> impl Strategy<Value = f64> {
    0.0..50.0
}

fn vector() -> impl Strategy<Value = DVec2> + Clone {
    (finite(), finite()).prop_map(|(x, y)| DVec2::new(x, y))
}

fn pose() -> impl Strategy<Value = PoseSe2> {
    (vector(), finite()).prop_map(|(position, heading_rad)| PoseSe2 { position, heading_rad })
}

fn digest() -> impl Strategy<Value = Digest> {
    any::<[u8; 32]>().prop_map(Digest)
}

fn size() -> impl Strategy<Value = Size> {
    (length(), length(), length()).prop_map(|(length_m, width_m, height_m)| Size { length_m, width_m, height_m })
}

fn ego_state() -> impl Strategy<Value = EgoState> {
    (pose(), vector(), finite(), vector(), finite(), finite()).prop_map(
        |(pose, velocity_mps, yaw_rate_radps, acceleration_mps2, steering_rad, steering_rate_radps)| EgoState {
            pose,
            velocity_mps,
            yaw_rate_radps,
            acceleration_mps2,
            steering_rad,
            steering_rate_radps,
        },
    )
}

fn command() -> impl Strategy<Value = RouteCommand> {
    prop_oneof![Just(RouteCommand::Straight), Just(RouteCommand::Left), Just(RouteCommand::Right)]
}

pub(crate) fn ego() -> impl Strategy<Value = Ego> {
    (ego_state(), command()).prop_map(|(estimate, command)| Ego { estimate, command })
}

fn image() -> impl Strategy<Value = RgbImage> {
    (1_u32..12, 1_u32..9).prop_flat_map(|(w, h)| {
        vec(any::<u8>(), (w * h * 3) as usize).prop_map(move |rgb| RgbImage::new(w, h, rgb).expect("the size fits"))
    })
}

fn encoding() -> impl Strategy<Value = Encoding> {
    prop_oneof![Just(Encoding::None), Just(Encoding::Png)]
}

pub(crate) fn layout() -> impl Strategy<Value = Layout> {
    (image(), encoding(), pose(), option::of((any::<u16>(), vec(mover(), 0..4)))).prop_map(
        |(image, encoding, ego_in_world, told)| {
            let inverse_depths =
                |first: u16| (0..image.rgb().len() / 3).map(|at| first.wrapping_add(at as u16)).collect();
            let geometry = |(first, movers)| LayoutGeometry { inverse_depths: inverse_depths(first), movers };
            let geometry = told.map(geometry);
            Layout { image, encoding, ego_in_world, geometry }
        },
    )
}

fn mover() -> impl Strategy<Value = Mover> {
    (any::<u32>(), pose(), finite(), [0.0..90.0, 0.0..9.0, 0.0..9.0]).prop_map(|(id, pose, bottom_m, size_m)| Mover {
        id,
        pose,
        bottom_m,
        size_m,
    })
}

pub(crate) fn frame() -> impl Strategy<Value = Frame> {
    (image(), encoding(), 0.0..255.0).prop_map(|(image, encoding, seam)| Frame { image, encoding, seam })
}

fn trajectory() -> impl Strategy<Value = Trajectory> {
    vec((1_i64..500_000_000, -900.0..900.0, -900.0..900.0, finite()), 1..20).prop_map(|steps| {
        let mut after = SimTime(0);
        let point = |(step, x_m, y_m, heading_rad): (i64, f64, f64, f64)| {
            after = SimTime(after.0 + step);
            TrajectoryPoint { after, pose: PoseSe2::new(x_m, y_m, heading_rad) }
        };
        Trajectory::new(steps.into_iter().map(point).collect()).expect("built within the limits")
    })
}

pub(crate) fn plan() -> impl Strategy<Value = Plan> {
    let proposal = (trajectory(), finite()).prop_map(|(trajectory, score)| Proposal { trajectory, score });
    let observed = option::of((0..i64::MAX).prop_map(SimTime));
    let answered = (vec(0_u64..3_600_000_000_000, 0..4), 0_u32..20_000)
        .prop_map(|(latency_nanos, iterations_late)| Answered { latency_nanos, iterations_late });
    let context = tensor().prop_map(|tensor| Some(tensor).filter(|tensor| !tensor.values.is_empty()));
    (trajectory(), vec(proposal, 0..4), observed, option::of(answered), context).prop_map(
        |(trajectory, proposals, observed, answered, context)| Plan {
            trajectory,
            proposals,
            observed,
            answered,
            context,
        },
    )
}

fn tensor() -> impl Strategy<Value = Tensor> {
    let filled = (0_u32..4, 1_u32..5).prop_flat_map(|(rows, columns)| {
        vec(-1e6_f32..1e6, (rows * columns) as usize)
            .prop_map(move |values| Tensor { shape: vec![rows, columns], values })
    });
    prop_oneof![Just(Tensor::default()), filled]
}

pub(crate) fn cache() -> impl Strategy<Value = Cache> {
    let tensors = (tensor(), tensor(), tensor());
    let digests = (digest(), digest(), digest(), digest());
    (any::<u32>(), any::<u32>(), 1_u32..9, tensors, digests, option::of(image())).prop_map(
        |(chunk, first, ticks, tensors, digests, frame)| Cache {
            chunk,
            first: Tick(first),
            ticks,
            cached_input: tensors.0,
            clean: tensors.1,
            control: tensors.2,
            conditioning: digests.0,
            cache_digest: digests.1,
            encoder_digest: digests.2,
            decoder_digest: digests.3,
            frame,
        },
    )
}

pub(crate) fn score() -> impl Strategy<Value = Score> {
    prop::collection::btree_map("[a-z_]{1,12}", option::of(0.0..=1.0), 0..6)
        .prop_map(|values| Score { values: values.into_iter().collect() })
}

fn diagnosed_effect() -> impl Strategy<Value = DiagnosedEffect> {
    let numbers = (0.0..=1.0, option::of(finite()), option::of(finite()), option::of(finite()));
    ("[a-z_]{1,12}", numbers, "[a-z/0-9]{0,6}", any::<bool>()).prop_map(
        |(id, (probability, value, low, high), unit, chosen)| DiagnosedEffect {
            id,
            probability,
            value,
            unit,
            interval90: [low, high],
            chosen,
        },
    )
}

fn gap_cell() -> impl Strategy<Value = GapCell> {
    let bins = prop::collection::btree_map("[a-z]{1,8}", "[a-z]{1,8}", 0..4);
    ("[a-z_]{1,12}", bins, length(), proptest::option::of(0.0..=1.0)).prop_map(
        |(channel, bins, effect_size, q_value)| GapCell {
            channel,
            bins: bins.into_iter().collect(),
            effect_size,
            q_value,
        },
    )
}

pub(crate) fn diagnosis() -> impl Strategy<Value = Diagnosis> {
    let lists = (vec(diagnosed_effect(), 0..4), vec(gap_cell(), 0..4), vec(("[a-z_]{1,9}", length()), 0..3));
    let verdict = prop::sample::select(ds_effect::Verdict::ALL.to_vec());
    let rest = (verdict, 0.0..=1.0, 0.0..=1.0, "[a-z. ]{0,20}");
    (any::<i32>(), any::<u16>(), rest, lists).prop_map(
        |(from, secs, (verdict, p_none, p_unknown, reference), (effects, cells, differences))| Diagnosis {
            window: (SimTime(from.into()), SimTime(i64::from(from) + i64::from(secs))),
            reference,
            verdict,
            p_none,
            p_unknown,
            effects,
            cells,
            differences,
        },
    )
}

fn choice() -> impl Strategy<Value = Motion> {
    let proposal = (trajectory(), finite()).prop_map(|(trajectory, score)| Proposal { trajectory, score });
    vec(proposal, 1..4).prop_map(Motion::Choice)
}

pub(crate) fn advance() -> impl Strategy<Value = Advance> {
    let motion = prop_oneof![Just(Motion::Initial), Just(Motion::Log), trajectory().prop_map(Motion::Plan), choice()];
    let owner = ("[a-z0-9-]{1,20}", any::<u64>());
    let owners = prop::collection::btree_map(prop::sample::select(Role::ALL.to_vec()), owner, 0..4);
    (any::<u32>(), 0_u32..99, 0_u32..9, motion, digest(), any::<bool>(), owners).prop_map(
        |(iteration, first, more, motion, border, plan_due, owners)| Advance {
            iteration,
            first: Tick(first),
            last: Tick(first + more),
            motion,
            border,
            plan_due,
            owners: owners
                .into_iter()
                .map(|(role, (name, epoch))| (role, owner_of(&name, epoch)))
                .collect::<BTreeMap<_, _>>(),
        },
    )
}

fn owner_of(name: &str, epoch: u64) -> Owner {
    Owner { instance: InstanceId::new(name).expect("plain letters are an id"), epoch }
}

fn class() -> impl Strategy<Value = AgentClass> {
    use AgentClass::{Barrier, Cone, Cyclist, Pedestrian, Vehicle};
    prop::sample::select(vec![Vehicle, Pedestrian, Cyclist, Cone, Barrier])
}

fn light() -> impl Strategy<Value = LightState> {
    use LightState::{Green, Red, Unknown, Yellow};
    prop::sample::select(vec![Unknown, Red, Yellow, Green])
}

fn agents() -> impl Strategy<Value = Vec<AgentState>> {
    prop::collection::btree_map(any::<u32>(), (class(), size(), pose(), finite(), vector()), 0..5).prop_map(|agents| {
        let agent = |(id, (class, size, pose, z_m, velocity_mps))| AgentState {
            id: AgentId(id),
            class,
            size,
            pose,
            z_m,
            velocity_mps,
        };
        agents.into_iter().map(agent).collect()
    })
}

pub(crate) fn world() -> impl Strategy<Value = World> {
    let kind = prop::sample::select(vec![ContactKind::Front, ContactKind::Side, ContactKind::Rear]);
    let contact = (kind, any::<bool>(), finite());
    let contacts = vec(contact, 0..3);
    let snapshot = option::of(vec(any::<u8>(), 0..40));
    (any::<u32>(), any::<i64>(), ego_state(), agents(), vec(light(), 0..4), contacts, digest(), snapshot).prop_map(
        |(tick, time, ego, agents, lights, contacts, before, snapshot)| {
            let contact = |(index, (kind, at_fault, closing_speed_mps))| Contact {
                agent: AgentId(index),
                kind,
                at_fault,
                closing_speed_mps,
            };
            let contacts = (0..).zip(contacts).map(contact).collect();
            let state = WorldState { tick: Tick(tick), time: SimTime(time), ego, agents, lights, contacts };
            let scores = [state.tick.0, 1].map(|value| 1.0 / f64::from(value % 9 + 1)).to_vec();
            let verdict = snapshot.is_some().then_some(Verdict { chosen: state.tick.0 % 2, scores, reference: 0.5 });
            let reading = |k: u32| Reading::from_array(std::array::from_fn(|i| f64::from(k) + i as f64));
            let readings = (0..state.tick.0 % 3).map(reading).collect();
            World { state, before, snapshot, verdict, readings }
        },
    )
}

pub(crate) fn camera() -> impl Strategy<Value = CameraModel> {
    ("[a-z][a-z0-9_]{0,8}", 1_u32..300, 1_u32..200, 0.3..2.0, -3.0..3.0, -0.5..0.5).prop_map(
        |(name, width_px, height_px, fov, yaw, pitch)| {
            let id = CameraId::new(&name).expect("plain letters are an id");
            let lens = Intrinsics::centred(width_px, height_px, fov);
            CameraModel::mounted(id, lens, DVec3::new(1.5, -0.0, 1.6), yaw, pitch)
        },
    )
}

fn line() -> impl Strategy<Value = Vec<DVec2>> {
    vec(vector(), 2..6)
}

fn lanes() -> impl Strategy<Value = Vec<Lane>> {
    vec(("[a-z0-9 ]{0,9}", any::<bool>(), line(), option::of(0.0..40.0), any::<[u8; 4]>()), 1..4).prop_map(|lanes| {
        let count = lanes.len() as u32;
        let id = |byte: u8| LaneId(u32::from(byte) % count);
        let lane = |(name, road, centre_line, speed_limit_mps, links): (_, bool, Vec<DVec2>, _, [u8; 4])| Lane {
            name,
            kind: if road { LaneKind::Road } else { LaneKind::Connector },
            polygon: centre_line.clone(),
            centre_line,
            speed_limit_mps,
            successors: vec![id(links[0])],
            predecessors: vec![id(links[1])],
            left: links[2].checked_sub(99).map(id),
            right: links[3].checked_sub(99).map(id),
        };
        lanes.into_iter().map(lane).collect()
    })
}

fn map() -> impl Strategy<Value = Map> {
    let head = (vector(), finite(), vec(light(), 0..5));
    (lanes(), vec(line(), 0..3), line(), vec(head, 0..3), vector()).prop_map(|(lanes, areas, points, heads, end)| {
        let head = |(position, facing_rad, states): (DVec2, f64, Vec<LightState>)| TrafficLight {
            position: position.extend(-0.0),
            facing_rad,
            lanes: vec![LaneId(0)],
            states,
        };
        let traffic_lights: Vec<TrafficLight> = heads.into_iter().map(head).collect();
        let light = (traffic_lights.len() as u32).checked_sub(1);
        let marking = |kind, colour| LineMarking { kind, colour, points: points.clone() };
        Map {
            lanes,
            drivable: areas.clone(),
            crosswalks: areas.iter().cloned().map(|polygon| Crosswalk { polygon }).collect(),
            junctions: areas.clone(),
            line_markings: vec![
                marking(LineKind::Solid, LineColour::White),
                marking(LineKind::Dashed, LineColour::Yellow),
                marking(LineKind::Double, LineColour::White),
            ],
            structures: structures(&areas),
            road_edges: vec![RoadEdge { points }],
            stop_lines: vec![StopLine { points: [end, -end], light }],
            traffic_lights,
        }
    })
}

/// Stands one structure of each kind on each area that is one.
fn structures(areas: &[Vec<DVec2>]) -> Vec<Structure> {
    let on = |outline: &Vec<DVec2>| {
        let stand = |kind| Structure { kind, outline: outline.clone(), bottom_m: 1.5, top_m: 4.0 };
        StructureKind::ALL.map(stand)
    };
    areas.iter().filter(|outline| outline.len() >= 3).flat_map(on).collect()
}

fn track() -> impl Strategy<Value = Track> {
    let point =
        (pose(), finite(), vector()).prop_map(|(pose, z_m, velocity_mps)| TrackPoint { pose, z_m, velocity_mps });
    ("[a-z0-9]{0,9}", class(), size(), vec(option::of(point), 0..5)).prop_map(|(name, class, size, points)| Track {
        name,
        class,
        size,
        points,
    })
}

fn spec() -> impl Strategy<Value = EpisodeSpec> {
    let modes = (
        prop::sample::select(ObservationSource::ALL.to_vec()),
        prop::sample::select(AgentMode::ALL.to_vec()),
        prop::sample::select(vec![ReplanAlignment::Rollback, ReplanAlignment::Exact]),
        prop::sample::select(ProposalScorer::ALL.to_vec()),
        prop::sample::select(ScoreProfile::ALL.to_vec()),
    );
    (digest(), any::<u64>(), 1_u32..9, 1_u32..99, modes).prop_map(|(digest, seed, small, large, modes)| EpisodeSpec {
        episode: EpisodeId::new("run-1.e7").expect("an id"),
        scenario: "cut-in".to_owned(),
        scenario_digest: digest,
        policy: "camera".to_owned(),
        observation: modes.0,
        appearance: "day".to_owned(),
        seed,
        replan_period: small,
        horizon: large,
        history: small,
        warm_up: small - 1,
        last_tick: Tick(large),
        agents: modes.1,
        tracker: TrackerKind::Lqr,
        layout_backend: LayoutBackend::Cpu,
        alignment: modes.2,
        chunk_ticks: small - 1,
        video_model: digest,
        policy_model: Digest::default(),
        configuration: digest,
        scorer: modes.3,
        score_profile: modes.4,
        effects: vec![SwitchedEffect { id: "steer_delay".to_owned(), values: vec![f64::from(small) * 0.01] }],
        vehicle_log: small % 2 == 1,
        wall_clock: small % 3 == 1,
        observation_delay: small,
        layout_memory_ticks: 3 * small,
        layout_geometry: small % 4 == 1,
        prompt: ["", "by day"][small as usize % 2].to_owned(),
    })
}

pub(crate) fn scene() -> impl Strategy<Value = SceneMessage> {
    let parts = (map(), vec(ego_state(), 1..4), line(), vec(track(), 0..3), vec(camera(), 1..3));
    (spec(), parts, vec(image(), 0..3), "\\PC{0,40}").prop_map(|(spec, parts, first_frames, prompt)| {
        let (map, ego_log, route, tracks, cameras) = parts;
        let scene = Scene {
            adversary: None,
            name: "cut-in-7".to_owned(),
            family: "cut-in".to_owned(),
            digest: spec.scenario_digest,
            dt: SimTime(100_000_000),
            map,
            vehicle: VehicleParameters::PACIFICA,
            ego_log,
            route,
            tracks,
            cameras,
            prompt,
            origin: Origin {
                source: "generated".to_owned(),
                licence: "Apache-2.0".to_owned(),
                attribution: String::new(),
            },
        };
        SceneMessage { spec, scene: Arc::new(scene), first_frames, originals: Vec::new() }
    })
}

pub(crate) fn observation() -> impl Strategy<Value = Observation> {
    let stamped = (any::<i64>(), image()).prop_map(|(time, image)| StampedImage { time: SimTime(time), image });
    let view = (camera(), vec(stamped, 1..3)).prop_map(|(camera, images)| CameraView { camera, images });
    let ego = (any::<i64>(), ego_state()).prop_map(|(time, state)| StampedEgo {
        time: SimTime(time),
        state: EgoState { steering_rate_radps: 0.0, ..state },
    });
    (any::<u64>(), vec(view, 1..3), vec(ego, 1..4), command(), encoding()).prop_map(
        |(sequence, cameras, ego, command, encoding)| Observation {
            sequence,
            time: SimTime(900_000_000),
            cameras,
            ego,
            command,
            horizon: SimTime(8_000_000_000),
            step: SimTime(100_000_000),
            deadline_millis: 2_000,
            encoding,
        },
    )
}
