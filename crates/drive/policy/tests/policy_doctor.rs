//! The doctor names each wrong wrapping of a policy by its cause, and finds nothing wrong with a sound one.

use ds_nn::Array;
use ds_policy::camera::eye::known_camera;
use ds_policy::doctor::{Examination, Fixture, determinism};
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

/// Fixtures whose first pixel of four shows the curvature in red; blue and the others show none.
fn fixtures() -> Vec<Fixture> {
    let shown =
        [("straight", 8.0, 128), ("left", 6.0, 218), ("right", 6.0, 38), ("curve", 9.0, 158), ("red", 0.0, 128)];
    let of = |(name, speed_mps, red): (&str, f64, u8)| Fixture {
        name: name.to_owned(),
        observation: Observation {
            frames: vec![vec![shows(red)]],
            cameras: vec![known_camera()],
            ego: EgoView { speed_mps, ..EgoView::default() },
            command: RouteCommand::Straight,
            stamps: vec![SimTime(0)],
            horizon_ticks: TICKS,
            dt: DT,
            draw: Draws::from_seed(0, "doctor"),
        },
        expert: arc(speed_mps, curvature(red)),
        twin: None,
    };
    shown.map(of).to_vec()
}

fn shows(red: u8) -> RgbImage {
    let mut image = RgbImage::filled(2, 2, [128, 0, 128]);
    image.rgb_mut()[0] = red;
    image
}

fn examine(policy: &mut dyn Policy, fixtures: &[Fixture]) -> Examination {
    ds_policy::doctor::examine(policy, fixtures, &|| ())
}

fn each(plan: &[PoseSe2], change: impl Fn(f64, f64, f64) -> (f64, f64, f64)) -> Vec<PoseSe2> {
    let changed = |pose: &PoseSe2| {
        let (x, y, heading_rad) = change(pose.position.x, pose.position.y, pose.heading_rad);
        PoseSe2::new(x, y, heading_rad)
    };
    plan.iter().map(changed).collect()
}

/// Spreads a tick over so many, with straight lines between.
fn stretched(plan: &[PoseSe2], ticks: f64) -> Vec<PoseSe2> {
    let at = |index: usize| if index == 0 { PoseSe2::default() } else { plan[index - 1] };
    let between = |tick: usize| {
        let place = tick as f64 / ticks;
        let (from, to, share) = (at(place as usize), at(place as usize + 1), place.fract());
        let position = from.position.lerp(to.position, share);
        PoseSe2::new(position.x, position.y, from.heading_rad + share * (to.heading_rad - from.heading_rad))
    };
    (1..=39).take_while(|tick| *tick as f64 / ticks < 40.0).map(between).collect()
}

fn curvature(red: u8) -> f64 {
    (f64::from(red) - 128.0) / 1000.0
}

/// A network that would drive as the expert does, and what its wrapping does to the answer.
struct Wrapped {
    /// Which byte of the frame it goes by.
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
    let rows: [(&str, usize, Wrong, &str, &str); 17] = [
        ("sound", 0, sound, "", ""),
        ("axes swapped", 0, |_, plan| each(&plan, |x, y, h| (y, x, h)), "axes", "x and y swapped"),
        ("y right", 0, |_, plan| each(&plan, |x, y, h| (x, -y, -h)), "axes", "y points right"),
        ("degrees", 0, |_, plan| each(&plan, |x, y, h| (x, y, h.to_degrees())), "units", "degrees"),
        ("2 Hz as 10 Hz", 0, |_, plan| plan.into_iter().skip(4).step_by(5).collect(), "rate", "0.5 s apart"),
        ("5 Hz as 10 Hz", 0, |_, plan| plan.into_iter().skip(1).step_by(2).collect(), "rate", "twice as far apart"),
        // Eight poses of 4 s, the last of which is held.
        (
            "2 Hz as 20 Hz",
            0,
            |_, plan| (1..=40).map(|tick| plan[(10 * tick).min(plan.len()) - 1]).collect(),
            "rate",
            "0.5 s apart but declared 0.05 s",
        ),
        ("10 Hz as 2 Hz", 0, |_, plan| stretched(&plan, 5.0), "rate", "0.1 s apart but declared 0.5 s"),
        ("feet", 0, |_, plan| each(&plan, |x, y, h| (x / 0.3048, y / 0.3048, h)), "units", "feet"),
        ("near", 0, |_, plan| each(&plan, |x, y, h| (x / 3.6, y / 3.6, h)), "units", "3.6 times too near"),
        ("far", 0, |_, plan| each(&plan, |x, y, h| (3.6 * x, 3.6 * y, h)), "units", "3.6 times too far"),
        ("m/s as km/h", 0, |_, plan| stretched(&plan, 3.6), "units", "divided by 3.6"),
        ("km/h as m/s", 0, |_, plan| stretched(&plan, 1.0 / 3.6), "units", "taken 3.6 times"),
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
        let found = examine(&mut Wrapped { channel, calls: 0, wrong }, &fixtures()).findings;
        if check.is_empty() {
            assert_eq!(found, [], "{name}");
        } else {
            assert!(found.len() == 1 && found[0].check == check && found[0].says.contains(says), "{name}: {found:?}");
        }
    }
    for (channel, says) in [(2, "BGR"), (3, "mirrored"), (6, "upside down")] {
        let found = examine(&mut Wrapped { channel, calls: 0, wrong: sound }, &fixtures()).findings;
        assert!(found.len() == 1 && found[0].check == "image" && found[0].says.contains(says), "{found:?}");
    }
}

/// A sound policy with proposals and a feature, and what is wrong with them.
struct Flawed {
    sideways_m: f64,
    feature: fn(u8) -> Vec<f32>,
    /// What it tells with its answers.
    told: fn(&Observation) -> f32,
    ticks: usize,
    looks: bool,
}

impl Policy for Flawed {
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
        let values = vec![(self.told)(seen)];
        let context = Some(Context { tokens: Array::new(&[1, values.len()], values), grid: None });
        Ok(PolicyAnswer { trajectory, proposals: vec![Proposal { trajectory: beside, score: 1.0 }], context })
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
    let sound = || Flawed {
        sideways_m: 0.0,
        feature: |red| vec![f32::from(red), 1.0],
        told: |seen| f32::from(seen.frames[0][0].rgb()[0]),
        ticks: 40,
        looks: true,
    };
    let Examination { findings, remarks, plans, feature } = examine(&mut sound(), &fixtures());
    assert_eq!((findings, remarks, plans.len(), feature), (vec![], vec![], 5, Some([1, 2])));
    let rows: [(Flawed, &str, &str); 5] = [
        (Flawed { told: |seen| seen.ego.speed_mps as f32, ..sound() }, "feature", "changes with the car's motion"),
        (Flawed { sideways_m: 2.0, ..sound() }, "proposals", "nearest is 2.00 m away"),
        (Flawed { feature: |_| vec![1.0], ..sound() }, "feature", "same for every frame"),
        (Flawed { feature: |red| vec![1.0; usize::from(red)], ..sound() }, "feature", "has shape [1, 128]"),
        (Flawed { feature: |_| vec![f32::NAN], ..sound() }, "feature", "not finite"),
    ];
    for (mut policy, check, says) in rows {
        let Examination { findings: found, feature, .. } = examine(&mut policy, &fixtures());
        assert!(found.len() == 1 && found[0].check == check && found[0].says.contains(says), "{check}: {found:?}");
        assert_eq!(feature.is_some(), check != "feature");
    }
    for (mut policy, check, says) in [
        (Flawed { ticks: 20, ..sound() }, "horizon", "covers 2.0 s of 4.0 s"),
        (Flawed { looks: false, ..sound() }, "image", "does not look at them"),
    ] {
        let found = examine(&mut policy, &fixtures()).remarks;
        assert!(found.len() == 1 && found[0].check == check && found[0].says.contains(says), "{check}: {found:?}");
    }
}

/// Answers several at once, and lets the first row of a batch of many lean on the others.
struct Many {
    most: usize,
    leans_m: f64,
}

impl Policy for Many {
    fn name(&self) -> &str {
        "many"
    }

    fn privileged(&self) -> bool {
        false
    }

    fn plan(&mut self, seen: &Observation, _: Option<&PrivilegedView>) -> Result<PolicyAnswer, PolicyError> {
        Wrapped { channel: 0, calls: 0, wrong: |_, plan| plan }.plan(seen, None)
    }

    fn plan_together(&mut self, seen: &[&Observation]) -> Result<Option<Vec<PolicyAnswer>>, PolicyError> {
        if seen.len() > self.most {
            return Ok(None);
        }
        let mut answers = seen.iter().map(|one| self.plan(one, None)).collect::<Result<Vec<_>, _>>()?;
        let plan = arc(seen[0].ego.speed_mps, curvature(seen[0].frames[0][0].rgb()[0]));
        let leaning = each(&plan, |x, y, h| (x, y + self.leans_m, h));
        answers[0] = PolicyAnswer::single(evenly_spaced("many", &leaning, DT)?);
        Ok(Some(answers))
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

#[test]
fn batches_are_compared_with_answers_alone() {
    let of = |most, leans_m| examine(&mut Many { most, leans_m }, &fixtures());
    assert_eq!((of(1, 0.3).findings, of(1, 0.3).remarks), (vec![], vec![]), "takes no batch");
    let sound = of(8, 1e-6);
    assert_eq!(sound.findings, []);
    assert!(sound.remarks[0].says.contains("2 and 8 at once lie within 1.0e-6 m"), "{sound:?}");
    assert!(of(2, 0.0).remarks[0].says.contains("to 2 at once are those alone"));
    let mixed = of(8, 0.3).findings;
    assert!(mixed[0].check == "batch" && mixed[0].says.starts_with("2 at once: fixture \"straight\""), "{mixed:?}");
}

#[test]
fn answers_of_another_process_are_compared_and_rounding_is_a_remark() {
    let fixtures = fixtures();
    let plans = examine(&mut Many { most: 1, leans_m: 0.0 }, &fixtures).plans;
    let moved = |by_m: f64| -> Vec<_> { plans.iter().map(|plan| each(plan, |x, y, h| (x, y + by_m, h))).collect() };
    assert_eq!(determinism(&fixtures, [&plans, &plans], "in a new process"), Examination::default());
    let rounded = determinism(&fixtures, [&plans, &moved(1e-7)], "in a new process");
    assert!(rounded.findings.is_empty() && rounded.remarks[0].says.contains("in a new process"), "{rounded:?}");
    let other = determinism(&fixtures, [&plans, &moved(0.1)], "in a new process");
    assert!(other.remarks.is_empty() && other.findings[0].check == "determinism", "{other:?}");
}

#[test]
fn a_camera_that_the_policy_does_not_know_is_a_remark_and_hides_no_convention() {
    let mut fixtures = fixtures();
    // The same state, but the pixel means something else there.
    let mut other = fixtures[1].clone();
    other.name = "other camera".to_owned();
    other.observation.frames = vec![vec![RgbImage::filled(1, 1, [38, 0, 128])]];
    other.twin = Some(1);
    fixtures.push(other);
    let wrapped = |wrong| Wrapped { channel: 0, calls: 0, wrong };
    let found = examine(&mut wrapped(|_, plan| plan), &fixtures);
    assert!(found.findings.is_empty() && found.remarks[0].check == "camera", "{found:?}");
    let found = examine(&mut wrapped(|_, plan| each(&plan, |x, y, h| (x, -y, -h))), &fixtures);
    assert!(found.findings.len() == 1 && found.findings[0].says.contains("y points right"), "{found:?}");
}
