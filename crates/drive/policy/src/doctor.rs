//! Asks a policy about states whose good answer is known, and names what its wrapping gets wrong.
//!
//! A plan is held against the expert's of the same state. It is not asked to be as good: an error is named where one
//! wrong convention (axes, unit, rate, origin, colours or sides of the frame) explains most of the distance between the two, that is,
//! where undoing it leaves less than [`EXPLAINED`] of it. Poses are in the rig frame of now, metres and radians.

mod feature;

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
/// A cause that shrinks or stretches plans must leave less than this share of the distance between the expert and a car that stands
/// still: any plan that leads far off comes near standing still where it is shrunk.
const STILL: f64 = 0.5;
/// Kilometres per hour of a metre per second.
const KMH_PER_MPS: f64 = 3.6;
/// How far the centre of a car is before its rear axle, in metres.
const CENTRE_M: f64 = 1.4;
/// How often each fixture is asked.
pub const ROUNDS: u32 = 24;
/// Plans that lie closer together are the same but for rounding, in metres.
const SAME_M: f64 = 1e-4;
/// With another camera a plan may be so much farther from the expert's without a remark, in metres.
const OTHER_CAMERA_M: f64 = 1.0;
/// How many are asked at once.
const BATCHES: [usize; 2] = [2, 8];

/// A state with the expert's answer.
#[derive(Debug, Clone)]
pub struct Fixture {
    /// What it shows, such as `left`.
    pub name: String,
    /// What the policy is handed.
    pub observation: Observation,
    /// The expert's poses one, two, … ticks from now, in the rig frame of now.
    pub expert: Vec<PoseSe2>,
    /// The place of the same state as the car's own camera sees it, where this one is seen by another camera.
    pub twin: Option<usize>,
}

/// One thing that is wrong with how a policy is wrapped.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The check that failed, such as `axes`.
    pub check: &'static str,
    /// The field, the value and the likely cause.
    pub says: String,
}

/// What the doctor says of a policy.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Examination {
    /// What is wrong; empty if all is well.
    pub findings: Vec<Finding>,
    /// What is no error but worth knowing.
    pub remarks: Vec<Finding>,
    /// The plans of the fixtures at the expert's stamps; empty if the policy does not answer.
    pub plans: Vec<Vec<PoseSe2>>,
    /// Tokens and channels of what the policy tells that it attends to of each frame; none if it tells nothing, or not soundly.
    pub feature: Option<[usize; 2]>,
}

/// Asks a policy for plans of all fixtures, several times over, and says what is wrong; `asked` is called after each answer.
#[must_use]
pub fn examine(policy: &mut dyn Policy, fixtures: &[Fixture], asked: &dyn Fn()) -> Examination {
    let fatal = |finding| Examination { findings: vec![finding], ..Examination::default() };
    let first = match answers(policy, fixtures, 0, asked) {
        Ok(plans) => plans,
        Err(finding) => return fatal(finding),
    };
    for round in 1..ROUNDS {
        match answers(policy, fixtures, round, asked) {
            Err(finding) => return fatal(finding),
            Ok(again) if policy.restart() == Restart::Stateless => {
                let how = format!("in round {round}");
                if let Some((finding, true)) = differing("state", fixtures, [&first, &again], &how) {
                    return fatal(finding);
                }
            }
            Ok(_) => {}
        }
    }
    let mut found = Examination::default();
    found.findings.extend(convention(fixtures, &first));
    if found.findings.is_empty() {
        found.findings.extend(image(policy, fixtures, &first));
    }
    found.findings.extend(proposals(policy, fixtures));
    match feature::of(policy, fixtures) {
        Ok(told) => found.feature = told,
        Err(finding) => found.findings.push(finding),
    }
    match batch(policy, fixtures, &first) {
        Ok(remark) => found.remarks.extend(remark),
        Err(finding) => found.findings.push(finding),
    }
    found.remarks.extend(horizon(fixtures, &first));
    found.remarks.extend(blind(policy, fixtures, &first));
    found.remarks.extend(calibration(fixtures, &first));
    Examination { plans: first, ..found }
}

/// Asks a policy for the plans of all fixtures once, at the expert's stamps.
///
/// # Errors
/// The finding that says which fixture is not answered, and why.
pub fn plans(policy: &mut dyn Policy, fixtures: &[Fixture]) -> Result<Vec<Vec<PoseSe2>>, Finding> {
    answers(policy, fixtures, 0, &|| ())
}

/// Says how far the plans of a policy that was asked elsewhere, such as `in a new process`, lie from those it gave here: a
/// finding, or a remark where they differ in rounding only.
#[must_use]
pub fn determinism(fixtures: &[Fixture], pair: [&[Vec<PoseSe2>]; 2], how: &str) -> Examination {
    let mut said = Examination::default();
    if let Some((finding, grave)) = differing("determinism", fixtures, pair, how) {
        if grave { &mut said.findings } else { &mut said.remarks }.push(finding);
    }
    said
}

/// Says whether a plan ends before the asked horizon.
fn horizon(fixtures: &[Fixture], plans: &[Vec<PoseSe2>]) -> Option<Finding> {
    let (fixture, plan) = fixtures.iter().zip(plans).find(|(fixture, plan)| plan.len() < fixture.expert.len())?;
    let secs = |ticks: usize| SimTime(fixture.observation.dt.0 * ticks as i64).secs();
    let (covers, asked) = (secs(plan.len()), secs(fixture.expert.len()));
    let says = format!(
        "fixture {:?}: the plan covers {covers:.1} s of {asked:.1} s, then its last pose is held",
        fixture.name
    );
    Some(Finding { check: "horizon", says })
}

/// Says whether plans stay the same with the frames of another fixture.
fn blind(policy: &mut dyn Policy, fixtures: &[Fixture], plans: &[Vec<PoseSe2>]) -> Option<Finding> {
    let mut exchanged = fixtures.to_vec();
    for (index, fixture) in exchanged.iter_mut().enumerate() {
        fixture.observation.frames.clone_from(&fixtures[(index + 1) % fixtures.len()].observation.frames);
    }
    let others = answers(policy, &exchanged, 0, &|| ()).ok()?;
    let same = fixtures.len() > 1 && plans.iter().zip(&others).all(|(one, other)| distance_m(one, other) < 1e-6);
    let says = "plans are the same with the frames of another fixture: the policy does not look at them".to_owned();
    same.then_some(Finding { check: "image", says })
}

/// Says how much farther from the expert a policy drives with another camera than its own.
fn calibration(fixtures: &[Fixture], plans: &[Vec<PoseSe2>]) -> Option<Finding> {
    let (index, twin) = fixtures.iter().enumerate().find_map(|(index, fixture)| Some((index, fixture.twin?)))?;
    let [other_m, own_m] = [index, twin].map(|place| distance_m(&plans[place], &fixtures[place].expert));
    (other_m > own_m + OTHER_CAMERA_M).then(|| Finding {
        check: "camera",
        says: format!(
            "fixture {:?}: {other_m:.2} m from the expert's plan, with the car's own camera {own_m:.2} m: the policy drives by \
             one camera and does not look at the calibration",
            fixtures[index].name
        ),
    })
}

/// Says what is wrong with answers to several fixtures at once, or how far they lie from those to each alone.
fn batch(policy: &mut dyn Policy, fixtures: &[Fixture], alone: &[Vec<PoseSe2>]) -> Result<Option<Finding>, Finding> {
    let (mut most_m, mut taken): (f64, Vec<String>) = (0.0, Vec::new());
    for size in BATCHES {
        for start in (0..fixtures.len()).step_by(size) {
            let places: Vec<usize> = (start..start + size).map(|place| place % fixtures.len()).collect();
            let shown: Vec<&Observation> = places.iter().map(|place| &fixtures[*place].observation).collect();
            let wrong = |says: String| Finding { check: "batch", says: format!("{size} at once: {says}") };
            let answers = policy.plan_together(&shown).map_err(|error| wrong(error.to_string()))?;
            let Some(answers) = answers else { break };
            for (answer, place) in answers.iter().zip(&places) {
                let fixture = &fixtures[*place];
                let apart_m = distance_m(&sampled(fixture, &answer.trajectory), &alone[*place]);
                most_m = most_m.max(apart_m);
                if apart_m > SAME_M {
                    return Err(wrong(format!(
                        "fixture {:?} is answered {apart_m:.3} m from its answer alone: rows of a batch are mixed",
                        fixture.name
                    )));
                }
            }
            if start == 0 {
                taken.push(size.to_string());
            }
        }
    }
    let apart = if most_m > 0.0 { format!("lie within {most_m:.1e} m of") } else { "are".to_owned() };
    let says = format!("answers to {} at once {apart} those alone", taken.join(" and "));
    Ok((!taken.is_empty()).then_some(Finding { check: "batch", says }))
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

/// Returns the plans of all fixtures, in their order or backwards in odd rounds, each at the expert's stamps.
fn answers(
    policy: &mut dyn Policy,
    fixtures: &[Fixture],
    round: u32,
    after_each: &dyn Fn(),
) -> Result<Vec<Vec<PoseSe2>>, Finding> {
    let mut plans = vec![Vec::new(); fixtures.len()];
    let mut order: Vec<usize> = (0..fixtures.len()).collect();
    if round % 2 == 1 {
        order.reverse();
    }
    for (asked, index) in (0u32..).zip(order) {
        let fixture = &fixtures[index];
        let answer = policy.plan(&fixture.observation, None).map_err(|error| {
            let call = round as usize * fixtures.len() + asked as usize + 1;
            let (check, cause) = cause(&error);
            Finding { check, says: format!("call {call}, fixture {:?}: {error}{cause}", fixture.name) }
        })?;
        plans[index] = sampled(fixture, &answer.trajectory);
        after_each();
    }
    Ok(plans)
}

/// Returns the check that an answer fails, and the likely cause.
fn cause(error: &PolicyError) -> (&'static str, String) {
    let far = "poses are absolute, or not in metres";
    match error {
        PolicyError::Plan { source: source @ TrajectoryError::TooFar { .. }, .. } => {
            ("origin", format!(": {source}: {far}"))
        }
        PolicyError::Plan { source, .. } => ("finite", format!(": {source}")),
        // Another process says it in its own words.
        PolicyError::Outside { detail, .. } => {
            let detail = detail.to_lowercase();
            if ["is nan", "is inf", "is -inf"].iter().any(|words| detail.contains(words)) {
                ("finite", String::new())
            } else if detail.contains("m away, limit") {
                ("origin", format!(": {far}"))
            } else {
                ("answer", String::new())
            }
        }
        _ => ("answer", String::new()),
    }
}

/// Returns a plan at the expert's stamps, until it ends.
fn sampled(fixture: &Fixture, trajectory: &Trajectory) -> Vec<PoseSe2> {
    let dt = fixture.observation.dt;
    let stamps = (1i64..).map(|k| SimTime(dt.0 * k)).take_while(|after| *after <= trajectory.horizon());
    // As given where there is a point: between points headings are wrapped, which would hide degrees.
    let points = trajectory.points();
    let pose = |after| match points.binary_search_by_key(&after, |point| point.after) {
        Ok(found) => points[found].pose,
        Err(_) => trajectory.at(after),
    };
    stamps.take(fixture.expert.len()).map(pose).collect()
}

/// Says which fixture's two answers differ most, if any do, and whether by more than rounding.
fn differing(
    check: &'static str,
    fixtures: &[Fixture],
    [first, again]: [&[Vec<PoseSe2>]; 2],
    how: &str,
) -> Option<(Finding, bool)> {
    let pairs = fixtures.iter().zip(first.iter().zip(again));
    let (name, apart_m) = pairs
        .map(|(fixture, (one, other))| (&fixture.name, distance_m(one, other)))
        .reduce(|most, next| if next.1 > most.1 { next } else { most })?;
    let grave = apart_m > SAME_M;
    let cause = if grave { "the policy keeps state, or draws outside its seed" } else { "rounding" };
    let says = format!("fixture {name:?} {how} is answered {apart_m:.1e} m from its first answer: {cause}");
    (apart_m > 0.0).then_some((Finding { check, says }, grave))
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
type Convention = (&'static str, &'static str, Undo);

const CONVENTIONS: [Convention; 5] = [
    ("axes", "y points right: a left turn has y < 0", |plan| each(plan, |x, y, h| (x, -y, -h))),
    ("axes", "x and y swapped", |plan| each(plan, |x, y, h| (y, x, h))),
    ("units", "headings are degrees, not radians", |plan| each(plan, |x, y, h| (x, y, h.to_radians()))),
    ("origin", "poses are of the car's centre, not its rear axle (1.4 m)", |plan| {
        each(plan, |x, y, h| (x - CENTRE_M * (h.cos() - 1.0), y - CENTRE_M * h.sin(), h))
    }),
    ("origin", "poses are absolute, not in the rig of now", relative),
];

/// Those that shrink or stretch plans.
const SCALES: [Convention; 10] = [
    ("units", "positions are centimetres, not metres", |plan| each(plan, |x, y, h| (0.01 * x, 0.01 * y, h))),
    ("units", "positions are feet, not metres", |plan| each(plan, |x, y, h| (0.3048 * x, 0.3048 * y, h))),
    ("units", "positions are 3.6 times too far: km/h for m/s", |plan| {
        each(plan, |x, y, h| (x / KMH_PER_MPS, y / KMH_PER_MPS, h))
    }),
    ("units", "positions are 3.6 times too near: m/s for km/h", |plan| {
        each(plan, |x, y, h| (KMH_PER_MPS * x, KMH_PER_MPS * y, h))
    }),
    ("units", "the speed is taken 3.6 times: km/h for m/s", |plan| slower(plan, KMH_PER_MPS)),
    ("units", "the speed is divided by 3.6: m/s for km/h", |plan| slower(plan, 1.0 / KMH_PER_MPS)),
    ("rate", "poses are twice as far apart as declared, such as 0.2 s for 0.1 s", |plan| slower(plan, 2.0)),
    ("rate", "poses are 0.5 s apart but declared 0.1 s apart", |plan| slower(plan, 5.0)),
    ("rate", "poses are 0.5 s apart but declared 0.05 s apart", |plan| slower(plan, 10.0)),
    ("rate", "poses are 0.1 s apart but declared 0.5 s apart", |plan| slower(plan, 0.2)),
];

fn each(plan: &[PoseSe2], undo: impl Fn(f64, f64, f64) -> (f64, f64, f64)) -> Vec<PoseSe2> {
    let undone = |pose: &PoseSe2| {
        let (x, y, heading_rad) = undo(pose.position.x, pose.position.y, pose.heading_rad);
        PoseSe2::new(x, y, heading_rad)
    };
    plan.iter().map(undone).collect()
}

/// Reads every tick as so many, on straight lines between poses, until the plan ends or as long as it is.
fn slower(plan: &[PoseSe2], ticks: f64) -> Vec<PoseSe2> {
    let at = |index: usize| if index == 0 { PoseSe2::default() } else { plan[index.min(plan.len()) - 1] };
    let between = |tick: usize| {
        let place = tick as f64 / ticks;
        let (from, to, share) = (at(place as usize), at(place as usize + 1), place.fract());
        let position = from.position.lerp(to.position, share);
        PoseSe2::new(position.x, position.y, from.heading_rad + share * (to.heading_rad - from.heading_rad))
    };
    let number = (plan.len() as f64 * ticks.min(1.0)) as usize;
    (1..=number).map(between).collect()
}

/// Reads the first pose as where the car is.
fn relative(plan: &[PoseSe2]) -> Vec<PoseSe2> {
    plan.iter().map(|pose| plan[0].relative(pose)).collect()
}

/// Returns the fixtures that the car's own camera sees, with their plans.
fn own_camera<'a>(
    fixtures: &'a [Fixture],
    plans: &'a [Vec<PoseSe2>],
) -> impl Iterator<Item = (&'a Fixture, &'a Vec<PoseSe2>)> {
    fixtures.iter().zip(plans).filter(|(fixture, _)| fixture.twin.is_none())
}

fn convention(fixtures: &[Fixture], plans: &[Vec<PoseSe2>]) -> Option<Finding> {
    // As given and undone, over the time that both cover.
    let apart = |undo: Undo| {
        let each = own_camera(fixtures, plans).map(|(fixture, plan)| {
            let undone = undo(plan);
            let given = &plan[..undone.len().min(plan.len())];
            [distance_m(given, &fixture.expert), distance_m(&undone, &fixture.expert)]
        });
        let number = own_camera(fixtures, plans).count().max(1) as f64;
        each.fold([0.0; 2], |[given, undone], [g, u]| [given + g, undone + u]).map(|m| m / number)
    };
    let [_, still_m] = apart(|plan| vec![PoseSe2::default(); plan.len()]);
    let bounded =
        CONVENTIONS.iter().map(|one| (one, f64::INFINITY)).chain(SCALES.iter().map(|one| (one, STILL * still_m)));
    let named = bounded.map(|((check, cause, undo), most_m)| (check, cause, apart(*undo), most_m)).filter(
        |(_, _, [given_m, undone_m], most_m)| *given_m > NEAR_M && *undone_m < EXPLAINED * given_m && undone_m < most_m,
    );
    let best = named.reduce(|best, next| if next.2[1] * best.2[0] < best.2[1] * next.2[0] { next } else { best });
    best.map(|(check, cause, [given_m, undone_m], _)| Finding {
        check,
        says: format!("{cause}: plans are {given_m:.2} m from the expert's, {undone_m:.2} m without that"),
    })
}

/// What a wrapping does to a frame, what it is called where a plan is better without it, and how it is undone.
type Unsee = (&'static str, &'static str, fn(&mut RgbImage));

const SEEN_WRONGLY: [Unsee; 3] = [
    ("colour order is BGR, not RGB", "red and blue swapped", |image| {
        image.rgb_mut().chunks_exact_mut(3).for_each(|pixel| pixel.swap(0, 2));
    }),
    ("frames are mirrored: left is right", "columns reversed", |image| {
        let row = 3 * image.width_px() as usize;
        image.rgb_mut().chunks_exact_mut(row).for_each(reversed);
    }),
    ("frames are upside down", "rows reversed", |image| {
        let row = 3 * image.width_px() as usize;
        reversed(image.rgb_mut());
        image.rgb_mut().chunks_exact_mut(row).for_each(reversed);
    }),
];

/// Reverses the order of pixels.
fn reversed(pixels: &mut [u8]) {
    pixels.reverse();
    pixels.chunks_exact_mut(3).for_each(|pixel| pixel.swap(0, 2));
}

/// Says which wrong way of handing frames over explains most of the distance to the expert, if one does.
fn image(policy: &mut dyn Policy, fixtures: &[Fixture], plans: &[Vec<PoseSe2>]) -> Option<Finding> {
    let apart = |plans: &[Vec<PoseSe2>]| {
        let each = own_camera(fixtures, plans).map(|(fixture, plan)| distance_m(plan, &fixture.expert));
        each.sum::<f64>() / own_camera(fixtures, plans).count().max(1) as f64
    };
    let given_m = apart(plans);
    if given_m <= NEAR_M {
        return None;
    }
    let mut undone = |unsee: fn(&mut RgbImage)| {
        let mut other = fixtures.to_vec();
        other.iter_mut().flat_map(|fixture| fixture.observation.frames.iter_mut().flatten()).for_each(unsee);
        answers(policy, &other, 0, &|| ()).ok().map(|plans| apart(&plans))
    };
    let all = SEEN_WRONGLY.into_iter().filter_map(|(cause, undo, unsee)| Some((cause, undo, undone(unsee)?)));
    let (cause, undo, left_m) = all.min_by(|one, other| one.2.total_cmp(&other.2))?;
    (left_m < EXPLAINED * given_m).then(|| Finding {
        check: "image",
        says: format!("{cause}: plans are {given_m:.2} m from the expert's, {left_m:.2} m with {undo}"),
    })
}
