//! The doctor names each wrong wrapping of a policy by its cause, and finds nothing wrong with a sound one.

use ds_nn::Array;
use ds_policy::camera::eye::known_camera;
use ds_policy::doctor::{Fixture, examine, remarks};
use ds_policy::plan::evenly_spaced;
use ds_policy::{Context, EgoView, Observation, Policy, PolicyAnswer, PolicyError, PrivilegedView, Restart};
use ds_raster::RgbImage;
use ds_space::{CameraModel, Draws, PoseSe2, SimTime};
use ds_world::{Proposal, RouteCommand};

const DT: SimTime = SimTime(100_000_000);
const TICKS: u32 = 40;

fn arc(speed_mps: f64, curvature: f64) -> Vec<PoseSe2> {
    let step_m = speed_mps * DT.secs();
    let turn = curvature * step_m;
    let chord = PoseSe2::new(step_m * (0.5 * turn).cos(), step_m * (0.5 * turn).sin(), turn);
    let mut pose = PoseSe2::default();
    let mut driven = Vec::new();
    for _ in 0..TICKS {
        pose = pose.compose(&chord);
        driven.push(pose);
    }
    driven
}

/// Fixtures whose one pixel shows the curvature in red, and none in blue.
fn fixtures() -> Vec<Fixture> {
    let shown =
        [("straight", 8.0, 128), ("left", 6.0, 218), ("right", 6.0, 38), ("curve", 9.0, 158), ("red", 0.0, 128)];
    let of = |(name, speed_mps, red): (&str, f64, u8)| Fixture {
        name: name.to_owned(),
        observation: Observation {
            frames: vec![vec![RgbImage::filled(1, 1, [red, 0, 128])]],
            cameras: vec![known_camera()],
            ego: EgoView { speed_mps, ..EgoView::default() },
            command: RouteCommand::Straight,
            stamps: vec![SimTime(0)],
            horizon_ticks: TICKS,
            dt: DT,
            draw: Draws::from_seed(0, "doctor"),
        },
        expert: arc(speed_mps, curvature(red)),
    };
    shown.map(of).to_vec()
}

fn each(plan: &[PoseSe2], change: impl Fn(f64, f64, f64) -> (f64, f64, f64)) -> Vec<PoseSe2> {
    let changed = |pose: &PoseSe2| {
        let (x, y, heading_rad) = change(pose.position.x, pose.position.y, pose.heading_rad);
        PoseSe2::new(x, y, heading_rad)
    };
    plan.iter().map(changed).collect()
}

/// Spreads a tick over half a second, with straight lines between.
fn stretched(plan: &[PoseSe2]) -> Vec<PoseSe2> {
    let at = |index: usize| if index == 0 { PoseSe2::default() } else { plan[index - 1] };
    let between = |tick: usize| {
        let (from, to, share) = (at(tick / 5), at(tick / 5 + 1), (tick % 5) as f64 / 5.0);
        let position = from.position.lerp(to.position, share);
        PoseSe2::new(position.x, position.y, from.heading_rad + share * (to.heading_rad - from.heading_rad))
    };
    (1..plan.len()).map(between).collect()
}

fn curvature(red: u8) -> f64 {
    (f64::from(red) - 128.0) / 1000.0
}

/// A network that would drive as the expert does, and what its wrapping does to the answer.
struct Wrapped {
    channel: usize,
    calls: u32,
    wrong: fn(u32, Vec<PoseSe2>) -> Vec<PoseSe2>,
}

impl Policy for Wrapped {
    fn name(&self) -> &str {
        "wrapped"
    }

    fn privileged(&self) -> bool {
        false
    }

    fn plan(&mut self, seen: &Observation, _: Option<&PrivilegedView>) -> Result<PolicyAnswer, PolicyError> {
        let plan = arc(seen.ego.speed_mps, curvature(seen.frames[0][0].rgb()[self.channel]));
        self.calls += 1;
        Ok(PolicyAnswer::single(evenly_spaced("wrapped", &(self.wrong)(self.calls, plan), DT)?))
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

#[test]
fn a_sound_wrapping_has_no_findings_and_each_wrong_one_is_named_by_its_cause() {
    type Wrong = fn(u32, Vec<PoseSe2>) -> Vec<PoseSe2>;
    let sound: Wrong = |_, plan| plan;
    let rows: [(&str, usize, Wrong, &str, &str); 10] = [
        ("sound", 0, sound, "", ""),
        ("axes swapped", 0, |_, plan| each(&plan, |x, y, h| (y, x, h)), "axes", "x and y swapped"),
        ("y right", 0, |_, plan| each(&plan, |x, y, h| (x, -y, -h)), "axes", "y points right"),
        ("degrees", 0, |_, plan| each(&plan, |x, y, h| (x, y, h.to_degrees())), "units", "degrees"),
        ("2 Hz as 10 Hz", 0, |_, plan| plan.into_iter().skip(4).step_by(5).collect(), "rate", "0.5 s apart"),
        ("10 Hz as 2 Hz", 0, |_, plan| stretched(&plan), "rate", "0.1 s apart but declared 0.5 s"),
        (
            "centre",
            0,
            |_, plan| each(&plan, |x, y, h| (x + 1.4 * (h.cos() - 1.0), y + 1.4 * h.sin(), h)),
            "origin",
            "centre",
        ),
        (
            "absolute",
            0,
            |_, plan| plan.iter().map(|pose| PoseSe2::new(31.0, -8.0, 0.7).compose(pose)).collect(),
            "origin",
            "absolute",
        ),
        (
            "stateful",
            0,
            |calls, plan| each(&plan, |x, y, h| (x, y + 0.01 * f64::from(calls), h)),
            "state",
            "keeps state",
        ),
        (
            "NaN",
            0,
            |calls, plan| each(&plan, |x, y, h| (x, if calls == 57 { f64::NAN } else { y }, h)),
            "finite",
            "call 57",
        ),
    ];
    for (name, channel, wrong, check, says) in rows {
        let found = examine(&mut Wrapped { channel, calls: 0, wrong }, &fixtures());
        if check.is_empty() {
            assert_eq!(found, [], "{name}");
        } else {
            assert!(found.len() == 1 && found[0].check == check && found[0].says.contains(says), "{name}: {found:?}");
        }
    }
    let found = examine(&mut Wrapped { channel: 2, calls: 0, wrong: sound }, &fixtures());
    assert!(found.len() == 1 && found[0].check == "image" && found[0].says.contains("BGR"), "{found:?}");
}

/// A sound policy with proposals and a feature, and what is wrong with them.
struct Told {
    sideways_m: f64,
    feature: fn(u8) -> Vec<f32>,
    ticks: usize,
    looks: bool,
}

impl Policy for Told {
    fn name(&self) -> &str {
        "told"
    }

    fn privileged(&self) -> bool {
        false
    }

    fn plan(&mut self, seen: &Observation, _: Option<&PrivilegedView>) -> Result<PolicyAnswer, PolicyError> {
        let red = if self.looks { seen.frames[0][0].rgb()[0] } else { 128 };
        let plan = &arc(seen.ego.speed_mps, curvature(red))[..self.ticks];
        let trajectory = evenly_spaced("told", plan, DT)?;
        let beside = evenly_spaced("told", &each(plan, |x, y, h| (x, y + self.sideways_m, h)), DT)?;
        Ok(PolicyAnswer { trajectory, proposals: vec![Proposal { trajectory: beside, score: 1.0 }] })
    }

    fn context(&mut self, _: &[CameraModel], frames: &[RgbImage]) -> Result<Option<Context>, PolicyError> {
        let values = (self.feature)(frames[0].rgb()[0]);
        Ok(Some(Context { tokens: Array::new(&[1, values.len()], values), grid: None }))
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

#[test]
fn proposals_features_and_what_is_worth_a_remark_are_told() {
    let sound = || Told { sideways_m: 0.0, feature: |red| vec![f32::from(red), 1.0], ticks: 40, looks: true };
    assert_eq!(examine(&mut sound(), &fixtures()), []);
    assert_eq!(remarks(&mut sound(), &fixtures()), []);
    let rows: [(Told, &str, &str); 4] = [
        (Told { sideways_m: 2.0, ..sound() }, "proposals", "nearest is 2.00 m away"),
        (Told { feature: |_| vec![1.0], ..sound() }, "feature", "same for every frame"),
        (Told { feature: |red| vec![1.0; usize::from(red)], ..sound() }, "feature", "has shape [1, 128]"),
        (Told { feature: |_| vec![f32::NAN], ..sound() }, "feature", "not finite"),
    ];
    for (mut policy, check, says) in rows {
        let found = examine(&mut policy, &fixtures());
        assert!(found.len() == 1 && found[0].check == check && found[0].says.contains(says), "{check}: {found:?}");
    }
    for (mut policy, check, says) in [
        (Told { ticks: 20, ..sound() }, "horizon", "covers 2.0 s of 4.0 s"),
        (Told { looks: false, ..sound() }, "image", "does not look at them"),
    ] {
        let found = remarks(&mut policy, &fixtures());
        assert!(found.len() == 1 && found[0].check == check && found[0].says.contains(says), "{check}: {found:?}");
    }
}
