//! The camera policy around its network: what it looks at, what its numbers mean, what it refuses.

use std::path::Path;

use ds_nn::Initial;
use ds_space::{CameraId, DVec3, Digest, Draws, Intrinsics, PoseSe2, SimTime};
use ds_world::RouteCommand;

use super::eye::known_camera;
use super::proposals::{KNOTS, MODES, TARGETS, encode, poses_at_ticks};
use super::*;
use crate::Learned;
use crate::observation::EgoView;

fn weights() -> Weights {
    Weights::initialised(&SIZE.declared(), &Digest::of(b"camera policy"))
}

fn observation(camera: CameraModel, frame: RgbImage) -> Observation {
    Observation {
        frames: vec![vec![frame]],
        cameras: vec![camera],
        ego: EgoView { speed_mps: 8.0, ..EgoView::default() },
        command: RouteCommand::Straight,
        stamps: vec![SimTime(0)],
        horizon_ticks: 80,
        dt: SimTime::from_secs(0.1),
        draw: Draws::from_seed(0, "test"),
    }
}

fn pattern() -> RgbImage {
    let value = |i: u32| (i.wrapping_mul(2_654_435_761) >> 24) as u8;
    RgbImage::new(160, 96, (0..160 * 96 * 3).map(value).collect()).expect("the size fits")
}

#[test]
fn answers_eight_seconds_with_scored_proposals_the_best_first_in_score() {
    let mut policy = CameraPolicy::new(&weights()).expect("the weights fit");
    let observation = observation(known_camera(), pattern());
    let answer = policy.plan(&observation, None).expect("plans");
    assert_eq!((answer.trajectory.points().len(), answer.proposals.len()), (80, MODES));
    let best = answer.proposals.iter().map(|p| p.score).fold(f64::NEG_INFINITY, f64::max);
    let chosen = answer.proposals.iter().find(|p| p.trajectory == answer.trajectory).expect("the answer is proposed");
    assert!((chosen.score - best).abs() < 1e-12);
    assert!((answer.proposals.iter().map(|p| p.score).sum::<f64>() - 1.0).abs() < 1e-9);
    let mut other = CameraPolicy::new(&weights()).expect("the weights fit");
    assert_eq!(other.plan(&observation, None).expect("plans"), answer);
}

#[test]
fn the_known_camera_gives_its_own_pixels_back() {
    assert_eq!(Eye::default().look(&known_camera(), &pattern()), pattern());
}

#[test]
fn a_higher_wider_camera_shows_the_road_in_the_same_place() {
    let id = CameraId::new("roof").expect("a plain word is an id");
    let lens = Intrinsics::centred(400, 240, 1.6);
    let roof = CameraModel::mounted(id, lens, DVec3::new(1.2, 0.1, 2.2), 0.03, 0.1);
    let mark = DVec3::new(14.0, -1.5, 0.0);
    let pixel = |camera: &CameraModel| {
        camera.intrinsics.project(camera.rig_from_camera.inverse() * mark).expect("the mark is ahead")
    };
    let mut frame = RgbImage::filled(400, 240, [0; 3]);
    let at = pixel(&roof);
    for (dx, dy) in (-3i32..=3).flat_map(|dx| (-3i32..=3).map(move |dy| (dx, dy))) {
        frame.set_pixel((at.x as i32 + dx) as u32, (at.y as i32 + dy) as u32, [255; 3]);
    }
    let seen = Eye::default().look(&roof, &frame);
    let expected = pixel(&known_camera());
    assert!(seen.pixel(expected.x as u32, expected.y as u32)[0] > 200, "the mark is not at {expected:?}");
    assert_eq!(seen.pixel(expected.x as u32 + 12, expected.y as u32)[0], 0);
}

#[test]
fn encoded_poses_are_decoded_and_continued_on_their_circle() {
    let (speed_mps, rate_radps) = (8.0, 0.2);
    let on_circle = |secs: f64| {
        let (angle, radius) = (rate_radps * secs, speed_mps / rate_radps);
        PoseSe2::new(radius * angle.sin(), radius * (1.0 - angle.cos()), angle)
    };
    let knots: [PoseSe2; KNOTS] = std::array::from_fn(|k| on_circle(0.5 * (k + 1) as f64));
    let mut outputs = vec![0.0; OUTPUTS];
    outputs[TARGETS..2 * TARGETS].copy_from_slice(&encode(speed_mps, &knots));
    outputs[MODES * TARGETS + 1] = 5.0;
    let candidates = decode(speed_mps, &outputs);
    assert!(candidates[1].score > 0.97);
    let poses = poses_at_ticks(speed_mps, &candidates[1].knots, 80, SimTime::from_secs(0.1));
    for (pose, tick) in poses.iter().zip(1..) {
        let expected = on_circle(0.1 * f64::from(tick));
        assert!(pose.position.distance(expected.position) < 0.15, "tick {tick}: {pose:?}, expected {expected:?}");
    }
    let still = poses_at_ticks(0.0, &decode(0.0, &vec![0.0; OUTPUTS])[0].knots, 80, SimTime::from_secs(0.1));
    assert!(still.iter().all(|pose| *pose == PoseSe2::default()));
}

#[test]
fn refuses_what_it_cannot_use_by_name() {
    let mut policy = CameraPolicy::new(&weights()).expect("the weights fit");
    let id = CameraId::new("rear").expect("a plain word is an id");
    let rear = CameraModel::mounted(id, known_camera().intrinsics, DVec3::ZERO, std::f64::consts::PI, 0.0);
    let mut blind = observation(known_camera(), pattern());
    blind.frames[0].clear();
    let mut none = observation(known_camera(), pattern());
    (none.frames, none.cameras) = (vec![], vec![]);
    for (observation, says) in [(observation(rear, pattern()), "rear"), (blind, "front"), (none, "cameras")] {
        let error = policy.plan(&observation, None).expect_err(says).to_string();
        assert!(error.contains(says), "{error:?} does not say {says:?}");
    }
    let error = Learned::Camera.load(Path::new("no/such.safetensors")).err().expect("the file is absent").to_string();
    assert!(error.contains("no/such.safetensors"), "{error}");
    let mut short = weights();
    short.insert("hidden1.bias", ds_nn::Array::zeros(&[1]));
    assert!(CameraPolicy::new(&short).err().expect("the shape is wrong").to_string().contains("hidden1.bias"));
    assert!(SIZE.declared().iter().all(|weight| weight.initial != Initial::Constant(f32::NAN)));
}

#[test]
fn the_shipped_weights_are_this_networks() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../configs/models/camera_policy.safetensors"));
    if !path.exists() {
        eprintln!("skipped: {} is not there", path.display());
        return;
    }
    let mut policy = Learned::Camera.load(path).expect("the shipped weights fit");
    let answer = policy.plan(&observation(known_camera(), pattern()), None).expect("plans");
    assert_eq!(answer.trajectory.points().len(), 80);
    assert!(std::fs::metadata(path).expect("the file is there").len() < 5 << 20, "weights over 5 MB");
}

#[test]
fn the_context_is_of_the_frame_alone() {
    let mut policy = CameraPolicy::new(&weights()).expect("the weights fit");
    let context = |policy: &mut CameraPolicy, frame: RgbImage| {
        policy.context(&[known_camera()], &[frame]).expect("a frame").expect("the policy has a context")
    };
    let before = context(&mut policy, pattern());
    assert_eq!((before.tokens.shape(), before.grid), ([60, 24].as_slice(), Some(crate::Grid::Picture([6, 10]))));
    // Whatever it is told of state and command in between, the same frame has the same context.
    let mut told = observation(known_camera(), pattern());
    (told.ego.speed_mps, told.command) = (0.0, RouteCommand::Left);
    policy.plan(&told, None).expect("plans");
    assert_eq!(context(&mut policy, pattern()), before);
    assert_ne!(context(&mut policy, RgbImage::filled(160, 96, [90; 3])), before);
    assert!(policy.context(&[], &[]).is_err());
}
