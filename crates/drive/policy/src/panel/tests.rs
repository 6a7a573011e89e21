//! Policies of the panel around their networks: scored proposals, a context of the frame alone, the total of sub-scores.

use ds_space::{DVec2, Digest, Draws, SimTime};

use super::*;
use crate::camera::eye::known_camera;

fn observation(grey: u8) -> Observation {
    Observation {
        frames: vec![vec![RgbImage::filled(160, 96, [grey, 90, 40])]],
        cameras: vec![known_camera()],
        ego: EgoView { speed_mps: 8.0, acceleration_mps2: DVec2::new(0.3, -0.2), ..EgoView::default() },
        command: RouteCommand::Left,
        stamps: vec![SimTime(0)],
        horizon_ticks: 80,
        dt: SimTime::from_secs(0.1),
        draw: Draws::from_seed(0, "test"),
    }
}

fn fresh(kind: Kind) -> Weights {
    Weights::initialised(&kind.declared(), &Digest::of(kind.name().as_bytes()))
}

#[test]
fn the_answer_is_the_proposal_with_the_highest_score() {
    for kind in Kind::ALL {
        let mut policy = PanelPolicy::new(kind, &fresh(kind)).expect("the weights fit");
        let answer = policy.plan(&observation(60), None).expect("plans");
        assert!((1..=64).contains(&answer.proposals.len()), "{}", kind.name());
        let best = answer.proposals.iter().map(|proposal| proposal.score).fold(f64::NEG_INFINITY, f64::max);
        let chosen = answer.proposals.iter().find(|proposal| proposal.trajectory == answer.trajectory);
        let is_share = kind.scoring() != Scoring::Confidence;
        assert!(best.is_finite() && (!is_share || (0.0..=1.0).contains(&best)), "{}: {best}", kind.name());
        assert!((chosen.expect("the answer is proposed").score - best).abs() < 1e-12);
        let again = PanelPolicy::new(kind, &fresh(kind)).expect("fits").plan(&observation(60), None).expect("plans");
        assert_eq!(answer, again, "{}", kind.name());
        assert_eq!(answer.trajectory.points().len(), 80);
    }
}

#[test]
fn noise_comes_from_the_draws_of_the_observation_and_from_nowhere_else() {
    for kind in Kind::ALL {
        let mut policy = PanelPolicy::new(kind, &fresh(kind)).expect("the weights fit");
        let mut plan = |seed| {
            let draw = Draws::new(&Digest::of(b"an episode"), "policy", &[seed]);
            policy.plan(&Observation { draw, ..observation(60) }, None).expect("plans")
        };
        let (first, other, again) = (plan(1), plan(2), plan(1));
        assert_eq!(first, again, "{}: same draws, same plans, whatever was asked between", kind.name());
        assert_eq!(first == other, kind.noise() == 0, "{}", kind.name());
        let again = PanelPolicy::new(kind, &fresh(kind)).expect("fits").plan(&observation(60), None).expect("plans");
        let policy = std::thread::spawn(move || {
            let mut policy = PanelPolicy::new(kind, &fresh(kind)).expect("fits");
            policy.plan(&observation(60), None).expect("plans")
        });
        assert_eq!(policy.join().expect("no panic"), again, "{}: on another thread", kind.name());
    }
}

#[test]
fn the_context_is_of_the_frame_alone() {
    for kind in Kind::ALL {
        let mut policy = PanelPolicy::new(kind, &fresh(kind)).expect("the weights fit");
        let seen = |policy: &mut PanelPolicy, grey| {
            let frames = observation(grey).frames.concat();
            policy.context(&[known_camera()], &frames).expect("a frame").expect("a context")
        };
        let before = seen(&mut policy, 60);
        policy.plan(&observation(60), None).expect("plans");
        assert_eq!(before, seen(&mut policy, 60), "{}", kind.name());
        assert_ne!(before, seen(&mut policy, 200), "{}", kind.name());
    }
}
