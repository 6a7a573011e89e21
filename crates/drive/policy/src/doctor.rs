//! Asks a policy about states whose good answer is known, and names what its wrapping gets wrong.
//!
//! A plan is held against the expert's of the same state. It is not asked to be as good: an error is named where one
//! wrong convention (axes, unit, rate, origin, colour order) explains most of the distance between the two, that is,
//! where undoing it leaves less than [`EXPLAINED`] of it. Poses are in the rig frame of now, metres and radians.

use ds_nn::Array;
use ds_raster::RgbImage;
use ds_space::{DVec2, PoseSe2, SimTime};
use ds_world::{Trajectory, TrajectoryError};

use crate::error::PolicyError;
use crate::observation::Observation;
use crate::{Policy, Restart};

/// A convention is named if undoing it leaves less than this share of the distance to the expert.
pub const EXPLAINED: f64 = 0.4;
/// Plans nearer to the expert than this need no explanation, in metres.
const NEAR_M: f64 = 0.05;
/// How far the centre of a car is before its rear axle, in metres.
const CENTRE_M: f64 = 1.4;
/// How often each fixture is asked.
const ROUNDS: u32 = 24;

/// A state with the expert's answer.
#[derive(Debug, Clone)]
pub struct Fixture {
    /// What it shows, such as `left`.
    pub name: String,
    /// What the policy is handed.
    pub observation: Observation,
    /// The expert's poses one, two, … ticks from now, in the rig frame of now.
    pub expert: Vec<PoseSe2>,
}

/// One thing that is wrong with how a policy is wrapped.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The check that failed, such as `axes`.
    pub check: &'static str,
    /// The field, the value and the likely cause.
    pub says: String,
}

/// Asks a policy for plans of all fixtures, several times over, and returns what is wrong; nothing if all is well.
#[must_use]
pub fn examine(policy: &mut dyn Policy, fixtures: &[Fixture]) -> Vec<Finding> {
    let mut findings = Vec::new();
    let first = match answers(policy, fixtures, 0) {
        Ok(plans) => plans,
        Err(finding) => return vec![finding],
    };
    for round in 1..ROUNDS {
        match answers(policy, fixtures, round) {
            Err(finding) => return vec![finding],
            Ok(again) if policy.restart() == Restart::Stateless => {
                if let Some(finding) = stateful(fixtures, &first, &again, round) {
                    return vec![finding];
                }
            }
            Ok(_) => {}
        }
    }
    findings.extend(convention(fixtures, &first));
    if findings.is_empty() {
        findings.extend(colours(policy, fixtures, &first));
    }
    findings.extend(proposals(policy, fixtures));
    findings.extend(feature(policy, fixtures));
    findings
}

/// Returns what is no error but worth knowing: plans that end early, and plans that do not depend on the frames.
///
/// Nothing is said of a policy that does not answer; [`examine`] does.
#[must_use]
pub fn remarks(policy: &mut dyn Policy, fixtures: &[Fixture]) -> Vec<Finding> {
    let Ok(plans) = answers(policy, fixtures, 0) else { return Vec::new() };
    let mut remarks = Vec::new();
    let covered = fixtures.iter().zip(&plans).find(|(fixture, plan)| plan.len() < fixture.expert.len());
    if let Some((fixture, plan)) = covered {
        let secs = |ticks: usize| SimTime(fixture.observation.dt.0 * ticks as i64).secs();
        let (covers, asked) = (secs(plan.len()), secs(fixture.expert.len()));
        let says = format!(
            "fixture {:?}: the plan covers {covers:.1} s of {asked:.1} s, then its last pose is held",
            fixture.name
        );
        remarks.push(Finding { check: "horizon", says });
    }
    // Each state with the frames of the next one.
    let mut exchanged = fixtures.to_vec();
    for (index, fixture) in exchanged.iter_mut().enumerate() {
        fixture.observation.frames.clone_from(&fixtures[(index + 1) % fixtures.len()].observation.frames);
    }
    let Ok(others) = answers(policy, &exchanged, 0) else { return remarks };
    if fixtures.len() > 1 && plans.iter().zip(&others).all(|(one, other)| distance_m(one, other) < 1e-6) {
        let says = "plans are the same with the frames of another fixture: the policy does not look at them".to_owned();
        remarks.push(Finding { check: "image", says });
    }
    remarks
}

/// Says whether a policy's answer is missing among its proposals.
fn proposals(policy: &mut dyn Policy, fixtures: &[Fixture]) -> Option<Finding> {
    fixtures.iter().find_map(|fixture| {
        let answer = policy.plan(&fixture.observation, None).ok().filter(|answer| !answer.proposals.is_empty())?;
        let poses = |trajectory: &Trajectory| trajectory.points().iter().map(|point| point.pose).collect::<Vec<_>>();
        let given = poses(&answer.trajectory);
        let apart = answer.proposals.iter().map(|proposal| distance_m(&given, &poses(&proposal.trajectory)));
        let nearest_m = apart.fold(f64::INFINITY, f64::min);
        let number = answer.proposals.len();
        (nearest_m > NEAR_M).then(|| Finding {
            check: "proposals",
            says: format!(
                "fixture {:?}: the answer is none of its {number} proposals, the nearest is {nearest_m:.2} m away",
                fixture.name
            ),
        })
    })
}

/// Says what is wrong with what a policy attends to, if it tells.
fn feature(policy: &mut dyn Policy, fixtures: &[Fixture]) -> Option<Finding> {
    let found = |says: String| Some(Finding { check: "feature", says });
    let mut first: Option<(&Fixture, Array)> = None;
    let mut varies = fixtures.len() < 2;
    for fixture in fixtures {
        let newest: Option<Vec<RgbImage>> =
            fixture.observation.frames.iter().map(|frames| frames.last().cloned()).collect();
        let tokens = match policy.context(&fixture.observation.cameras, &newest?) {
            Ok(context) => context?.tokens,
            Err(error) => return found(format!("fixture {:?}: {error}", fixture.name)),
        };
        if !tokens.is_finite() {
            return found(format!("fixture {:?}: a number of the feature is not finite", fixture.name));
        }
        match &first {
            Some((before, other)) if other.shape() != tokens.shape() => {
                let (one, two) = (other.shape(), tokens.shape());
                return found(format!("has shape {one:?} for {:?} and {two:?} for {:?}", before.name, fixture.name));
            }
            Some((_, other)) => varies |= *other != tokens,
            None => first = Some((fixture, tokens)),
        }
    }
    if varies {
        None
    } else {
        found("the feature is the same for every frame: FDπ would be 0 for any source".to_owned())
    }
}

/// Returns the plans of all fixtures, in their order or backwards in odd rounds, each at the expert's stamps.
fn answers(policy: &mut dyn Policy, fixtures: &[Fixture], round: u32) -> Result<Vec<Vec<PoseSe2>>, Finding> {
    let mut plans = vec![Vec::new(); fixtures.len()];
    let mut order: Vec<usize> = (0..fixtures.len()).collect();
    if round % 2 == 1 {
        order.reverse();
    }
    for (asked, index) in (0u32..).zip(order) {
        let fixture = &fixtures[index];
        let answer = policy.plan(&fixture.observation, None).map_err(|error| {
            let call = round as usize * fixtures.len() + asked as usize + 1;
            let (check, cause) = match &error {
                PolicyError::Plan { source: source @ TrajectoryError::TooFar { .. }, .. } => {
                    ("origin", format!(": {source}: poses are absolute, or not in metres"))
                }
                PolicyError::Plan { source, .. } => ("finite", format!(": {source}")),
                _ => ("answer", String::new()),
            };
            Finding { check, says: format!("call {call}, fixture {:?}: {error}{cause}", fixture.name) }
        })?;
        let dt = fixture.observation.dt;
        let ends = answer.trajectory.horizon();
        let stamps = (1i64..).map(|k| SimTime(dt.0 * k)).take_while(|after| *after <= ends);
        // As given where there is a point: between points headings are wrapped, which would hide degrees.
        let points = answer.trajectory.points();
        let pose = |after| match points.binary_search_by_key(&after, |point| point.after) {
            Ok(found) => points[found].pose,
            Err(_) => answer.trajectory.at(after),
        };
        plans[index] = stamps.take(fixture.expert.len()).map(pose).collect();
    }
    Ok(plans)
}

fn stateful(fixtures: &[Fixture], first: &[Vec<PoseSe2>], again: &[Vec<PoseSe2>], round: u32) -> Option<Finding> {
    let pairs = fixtures.iter().zip(first.iter().zip(again));
    let (name, apart_m) = pairs
        .map(|(fixture, (one, other))| (&fixture.name, distance_m(one, other)))
        .reduce(|most, next| if next.1 > most.1 { next } else { most })?;
    (apart_m > 1e-4).then(|| Finding {
        check: "state",
        says: format!(
            "fixture {name:?} in round {round} is answered {apart_m:.3} m from its first answer: the policy keeps state \
             or draws outside its seed, but says restart = \"stateless\""
        ),
    })
}

/// Returns the mean distance of the positions, and of the points 5 m ahead of them, so that headings count.
fn distance_m(one: &[PoseSe2], other: &[PoseSe2]) -> f64 {
    let ahead = |pose: &PoseSe2| pose.position + 5.0 * DVec2::from_angle(pose.heading_rad);
    let apart = |(a, b): (&PoseSe2, &PoseSe2)| a.position.distance(b.position) + ahead(a).distance(ahead(b));
    let pairs = one.len().min(other.len()).max(1) as f64;
    one.iter().zip(other).map(apart).sum::<f64>() / (2.0 * pairs)
}

/// Undoes one wrong convention of a plan.
type Undo = fn(&[PoseSe2]) -> Vec<PoseSe2>;

/// Check, cause, and how the convention is undone.
const CONVENTIONS: [(&str, &str, Undo); 9] = [
    ("axes", "y points right: a left turn has y < 0", |plan| each(plan, |x, y, h| (x, -y, -h))),
    ("axes", "x and y swapped", |plan| each(plan, |x, y, h| (y, x, h))),
    ("units", "headings are degrees, not radians", |plan| each(plan, |x, y, h| (x, y, h.to_radians()))),
    ("units", "positions are centimetres, not metres", |plan| each(plan, |x, y, h| (0.01 * x, 0.01 * y, h))),
    ("units", "positions are feet, not metres", |plan| each(plan, |x, y, h| (0.3048 * x, 0.3048 * y, h))),
    ("rate", "poses are 0.5 s apart but declared 0.1 s apart", slower),
    ("rate", "poses are 0.1 s apart but declared 0.5 s apart", |plan| {
        plan.iter().skip(4).step_by(5).copied().collect()
    }),
    ("origin", "poses are of the car's centre, not its rear axle (1.4 m)", |plan| {
        each(plan, |x, y, h| (x - CENTRE_M * (h.cos() - 1.0), y - CENTRE_M * h.sin(), h))
    }),
    ("origin", "poses are absolute, not in the rig of now", relative),
];

fn each(plan: &[PoseSe2], undo: impl Fn(f64, f64, f64) -> (f64, f64, f64)) -> Vec<PoseSe2> {
    let undone = |pose: &PoseSe2| {
        let (x, y, heading_rad) = undo(pose.position.x, pose.position.y, pose.heading_rad);
        PoseSe2::new(x, y, heading_rad)
    };
    plan.iter().map(undone).collect()
}

/// Reads every tick as half a second, with the ticks between on straight lines.
fn slower(plan: &[PoseSe2]) -> Vec<PoseSe2> {
    let at = |index: usize| if index == 0 { PoseSe2::default() } else { plan[index - 1] };
    let between = |tick: usize| {
        let (from, to, share) = (at(tick / 5), at((tick / 5 + 1).min(plan.len())), (tick % 5) as f64 / 5.0);
        let position = from.position.lerp(to.position, share);
        PoseSe2::new(position.x, position.y, from.heading_rad + share * (to.heading_rad - from.heading_rad))
    };
    (1..=plan.len()).map(between).collect()
}

/// Reads the first pose as where the car is.
fn relative(plan: &[PoseSe2]) -> Vec<PoseSe2> {
    plan.iter().map(|pose| plan[0].relative(pose)).collect()
}

fn convention(fixtures: &[Fixture], plans: &[Vec<PoseSe2>]) -> Option<Finding> {
    // As given and undone, over the time that both cover.
    let apart = |undo: Undo| {
        let each = fixtures.iter().zip(plans).map(|(fixture, plan)| {
            let undone = undo(plan);
            let given = &plan[..undone.len().min(plan.len())];
            [distance_m(given, &fixture.expert), distance_m(&undone, &fixture.expert)]
        });
        each.fold([0.0; 2], |[given, undone], [g, u]| [given + g, undone + u]).map(|m| m / fixtures.len().max(1) as f64)
    };
    let all = CONVENTIONS.iter().map(|(check, cause, undo)| (check, cause, apart(*undo)));
    let named = all.filter(|(_, _, [given_m, undone_m])| *given_m > NEAR_M && *undone_m < EXPLAINED * given_m);
    let best = named.reduce(|best, next| if next.2[1] * best.2[0] < best.2[1] * next.2[0] { next } else { best });
    best.map(|(check, cause, [given_m, undone_m])| Finding {
        check,
        says: format!("{cause}: plans are {given_m:.2} m from the expert's, {undone_m:.2} m without that"),
    })
}

/// Says whether the plans come nearer to the expert if red and blue change places in the frames.
fn colours(policy: &mut dyn Policy, fixtures: &[Fixture], plans: &[Vec<PoseSe2>]) -> Option<Finding> {
    let swapped: Vec<Fixture> = fixtures.iter().cloned().map(bgr).collect();
    let other = answers(policy, &swapped, 0).ok()?;
    let apart = |plans: &[Vec<PoseSe2>]| {
        let each = fixtures.iter().zip(plans).map(|(fixture, plan)| distance_m(plan, &fixture.expert));
        each.sum::<f64>() / fixtures.len().max(1) as f64
    };
    let (given_m, swapped_m) = (apart(plans), apart(&other));
    (given_m > NEAR_M && swapped_m < EXPLAINED * given_m).then(|| Finding {
        check: "image",
        says: format!("colour order is BGR, not RGB: plans are {given_m:.2} m from the expert's, {swapped_m:.2} m with red and blue swapped"),
    })
}

fn bgr(mut fixture: Fixture) -> Fixture {
    let images = fixture.observation.frames.iter_mut().flatten();
    images.for_each(|image| image.rgb_mut().chunks_exact_mut(3).for_each(|pixel| pixel.swap(0, 2)));
    fixture
}
