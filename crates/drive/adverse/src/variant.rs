//! The variants of a scenario: for each class the likeliest valid one, and how many candidates fell to which reason.

use std::collections::BTreeMap;
use std::sync::Arc;

use ds_space::{AgentId, DVec2, Digest, DigestWriter, Draws, Tick};
use ds_vehicle::Rolling;
use ds_world::{Adversary, AdversaryMode, AgentClass, Budget, CrashClass, Scene, Track, TrackPoint};

use crate::beam::{self, Drive};
use crate::collision::{AFTER_TICKS, FIRST_TICKS, LAST_TICKS, Target, Targets};
use crate::measure::{Measures, measured};
use crate::model::{MotionModel, STEP_TICKS};
use crate::reacting::keeps_clear;
use crate::road::Way;
use crate::solve::{Solution, Trial};
use crate::stage::Stage;
use crate::validity::{Candidate, OTHERS_M, Rejection, check_contact, check_drive};

/// Ticks after hand-over that are scored, fewer where the log ends before: contact lies within.
const SCORED_TICKS: u32 = LAST_TICKS + AFTER_TICKS;
const LEAST_WAY_M: f64 = 20.0;
/// The attack begins so long before the contact.
const ATTACK_TICKS: u32 = 30;
/// So many of the likeliest candidates are tried in the simulator.
const MOST_FINISHED: usize = 12;
const DRIVES_PER_STATE: usize = 2;
/// The longest name of a variant: what the names of scenario files may have.
const LONGEST_NAME: usize = 80;

/// What may be chosen about a search.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The tick at which the policy takes over.
    pub hand_over: Tick,
    /// Collision states tried for each class.
    pub states: usize,
    /// Seed of the draws, beside the scenario's digest.
    pub seed: u64,
    /// Classes searched.
    pub classes: Vec<CrashClass>,
    /// What the adversaries do about an ego that leaves its log.
    pub mode: AdversaryMode,
    /// What they may spend on it.
    pub budget: Budget,
    /// Whether an expert has to find a drive without contact.
    pub solve: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            hand_over: Tick(20),
            states: 24,
            seed: 0,
            classes: CrashClass::ALL.to_vec(),
            mode: AdversaryMode::Reactive,
            budget: Budget::default(),
            solve: true,
        }
    }
}

/// Why a scenario has no variants at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// Its ticks are not 0.1 s apart.
    #[error("field \"dt_secs\" is {dt_secs}, variants need 0.1")]
    TimeStep {
        /// The scenario's, in seconds.
        dt_secs: f64,
    },
    /// It ends before a contact could be planned.
    #[error("the log ends at tick {last}, variants need {needed} ticks")]
    Short {
        /// The last tick.
        last: u32,
        /// The tick that must be there.
        needed: u32,
    },
    /// The logged ego hardly moves while it is scored.
    #[error("the logged ego drives {driven_m:.1} m while scored, variants need {LEAST_WAY_M} m")]
    Standing {
        /// How far it drives, in metres.
        driven_m: f64,
    },
}

/// A scenario with an adversary.
#[derive(Debug, Clone)]
pub struct Variant {
    /// The scene, named `BASE__CLASS`; its family is the class.
    pub scene: Scene,
    /// The adversary's track.
    pub agent: AgentId,
    /// The class.
    pub class: CrashClass,
    /// The tick at which contact is planned.
    pub planned: Tick,
    /// Mean of −ln of the forward and backward chance of its steps.
    pub surprise: f64,
    /// What is recorded of it.
    pub measures: Measures,
    /// The tick at which nothing is left of what an ego reaches that reacts 0.5 s after the threat tick: nobody gets away from what
    /// is planned. None where that is not proven, as for all that an expert solves.
    pub emptied: Option<Tick>,
    /// The expert's drive that meets nobody; none only where it was not asked for.
    pub solution: Option<Solution>,
    /// Ticks from the threat tick to the last one from which the expert still finds a drive; none where it finds none, or was
    /// not asked for.
    pub margin_ticks: Option<u32>,
    /// Whether a driver who only brakes meets nobody.
    pub careful: bool,
}

/// What came of a search.
#[derive(Debug, Clone, Default)]
pub struct Built {
    /// At most one variant for each class, in the order of the classes.
    pub variants: Vec<Variant>,
    /// How many candidates fell to which reason, by class.
    pub rejected: BTreeMap<(CrashClass, Rejection), usize>,
    /// Candidates that were driven forwards, by class.
    pub candidates: BTreeMap<CrashClass, usize>,
    /// Of those, how many satisfied all rules, by class.
    pub valid: BTreeMap<CrashClass, usize>,
}

/// Searches the variants of a scenario.
///
/// # Errors
/// [`Refusal`] if the scenario is too short, too coarse in time, or its ego stands.
pub fn variants(scene: &Scene, model: &MotionModel, options: &Options) -> Result<Built, Refusal> {
    let last = scored_until(scene, options)?;
    let mut built = Built::default();
    for class in &options.classes {
        search(scene, model, options, last, *class, &mut built);
    }
    Ok(built)
}

/// Returns the digest over a scene's adversary: class, mode, ticks, corridor, body and track; nothing if it has none.
#[must_use]
pub fn adversary_digest(scene: &Scene) -> Option<Digest> {
    let adversary = scene.adversary.as_ref()?;
    let track = scene.tracks.get(adversary.track.0 as usize)?;
    let mut writer = DigestWriter::new();
    writer.text(adversary.class.name()).text(adversary.mode.name());
    writer.u32(adversary.attack.0).u32(adversary.contact.0).u64(adversary.corridor.len() as u64);
    adversary.corridor.iter().for_each(|point| {
        writer.f64s(&[point.x, point.y]);
    });
    writer.f64s(&[track.size.length_m, track.size.width_m]).u64(track.points.len() as u64);
    for point in track.points.iter().flatten() {
        writer.f64s(&[point.pose.position.x, point.pose.position.y, point.pose.heading_rad]);
        writer.f64s(&[point.velocity_mps.x, point.velocity_mps.y]);
    }
    Some(writer.finish())
}

/// Checks that a scenario may have variants and returns the last tick that is scored.
pub(crate) fn scored_until(scene: &Scene, options: &Options) -> Result<Tick, Refusal> {
    let dt_secs = scene.dt.secs();
    if (dt_secs - 0.1).abs() > 1e-9 {
        return Err(Refusal::TimeStep { dt_secs });
    }
    let (last, needed) = (scene.last_tick(), options.hand_over.plus(FIRST_TICKS + AFTER_TICKS));
    if last < needed {
        return Err(Refusal::Short { last: last.0, needed: needed.0 });
    }
    let last = last.min(options.hand_over.plus(SCORED_TICKS));
    let log = &scene.ego_log[options.hand_over.0 as usize..=last.0 as usize];
    let driven_m: f64 = log.windows(2).map(|pair| pair[0].pose.position.distance(pair[1].pose.position)).sum();
    if driven_m < LEAST_WAY_M { Err(Refusal::Standing { driven_m }) } else { Ok(last) }
}

/// A drive with its target, not yet checked against the simulator.
struct Found<'a> {
    target: &'a Target,
    way: &'a Way,
    states: Vec<Rolling>,
    surprise: f64,
}

fn search(scene: &Scene, model: &MotionModel, options: &Options, last: Tick, class: CrashClass, built: &mut Built) {
    let draws = Draws::new(&scene.digest, "adversary", &[options.seed, class as u64]);
    let stage = Stage::new(scene, model, &Draws::new(&scene.digest, "adversary body", &[options.seed]));
    let targets = Targets::draw(&stage, class, options.hand_over, last, options.states, &draws);
    if targets.states.is_empty() {
        *built.rejected.entry((class, Rejection::NoTarget)).or_default() += 1;
        return;
    }
    let mut found = Vec::new();
    for target in &targets.states {
        let way = &targets.ways[target.way];
        let drives = beam::search(&stage, way, target, DRIVES_PER_STATE);
        if drives.is_empty() {
            *built.rejected.entry((class, Rejection::NoDrive)).or_default() += 1;
        }
        for drive in drives {
            *built.candidates.entry(class).or_default() += 1;
            match complete(&stage, way, target, &drive, options.hand_over) {
                Ok(states) => found.push(Found { target, way, states, surprise: drive.surprise }),
                Err(reason) => *built.rejected.entry((class, reason)).or_default() += 1,
            }
        }
    }
    found.sort_by(|a, b| a.surprise.total_cmp(&b.surprise));
    for candidate in found.iter().take(MOST_FINISHED) {
        match finish(&stage, candidate, class, options, last) {
            Ok(variant) => {
                *built.valid.entry(class).or_default() += 1;
                built.variants.push(variant);
                break;
            }
            Err(reason) => *built.rejected.entry((class, reason)).or_default() += 1,
        }
    }
}

/// Drives a candidate to the end of the log and checks what needs no simulation.
fn complete(
    stage: &Stage<'_>,
    way: &Way,
    target: &Target,
    drive: &Drive,
    hand_over: Tick,
) -> Result<Vec<Rolling>, Rejection> {
    let mut states = beam::driven(stage, drive);
    let controls = beam::brake(stage, way, drive, &mut states);
    let candidate = Candidate { way: Some(way), states: &states, controls: &controls, contact: target.tick };
    check_drive(stage, &candidate, hand_over)?;
    Ok(states)
}

fn finish(
    stage: &Stage<'_>,
    found: &Found<'_>,
    class: CrashClass,
    options: &Options,
    last: Tick,
) -> Result<Variant, Rejection> {
    let attack = Attack { contact: found.target.tick, corridor: corridor(found), states: &found.states };
    let (scene, agent) = with_track(stage, &attack, class, options)?;
    let scene = Arc::new(scene);
    let planned = Tick(found.target.tick);
    let met = check_contact(stage, &scene, agent, class, planned)?;
    if !keeps_clear(&scene, agent, (options.hand_over, met.tick), OTHERS_M) {
        return Err(Rejection::HitsOther);
    }
    let measures = measured(stage, &found.states, met, options.hand_over);
    let trial = Trial { scene: &scene, road: &stage.road, threat: measures.threat, last };
    let solution = if options.solve { trial.expert() } else { None };
    // A drive is in the set: where the expert has one, it is not empty.
    let emptied = if solution.is_none() { trial.emptied(met.tick) } else { None };
    if options.solve && solution.is_none() {
        return Err(if emptied.is_some() { Rejection::Unavoidable } else { Rejection::Unsolved });
    }
    let margin_ticks = solution.as_ref().and_then(|_| trial.margin_ticks(met.tick));
    let careful = trial.careful();
    let (scene, surprise) = (Arc::unwrap_or_clone(scene), found.surprise);
    Ok(Variant { scene, agent, class, planned, surprise, measures, emptied, solution, margin_ticks, careful })
}

/// Returns the line along which the adversary attacks: its own drive, every half second, and the way beyond.
fn corridor(found: &Found<'_>) -> Vec<DVec2> {
    let mut points: Vec<DVec2> = Vec::new();
    let contact = found.target.tick as usize;
    for car in found.states[..=contact].iter().step_by(STEP_TICKS) {
        if points.last().is_none_or(|last| last.distance(car.pose.position) > 1.0) {
            points.push(car.pose.position);
        }
    }
    let last = found.states[contact].pose;
    let beside = found.way.beside(last.position, 0);
    let beyond = [10.0, 20.0, 30.0, 40.0, 50.0].map(|ahead_m| beside.station_m + ahead_m);
    let on_way = beyond.into_iter().filter(|station_m| *station_m < found.way.length_m());
    points.extend(on_way.map(|station_m| found.way.pose(station_m, beside.left_m).position));
    if points.len() < 2 {
        points.push(last.position + last.forward() * 10.0);
    }
    points
}

/// A drive that is to be an adversary's.
pub(crate) struct Attack<'a> {
    pub contact: u32,
    pub corridor: Vec<DVec2>,
    pub states: &'a [Rolling],
}

/// Adds the adversary to the scene as a track, as its file would be loaded.
pub(crate) fn with_track(
    stage: &Stage<'_>,
    attack: &Attack<'_>,
    class: CrashClass,
    options: &Options,
) -> Result<(Scene, AgentId), Rejection> {
    let mut scene = stage.scene.clone();
    let point = |car: &Rolling| {
        Some(TrackPoint { pose: stage.body.centre(car), z_m: 0.0, velocity_mps: car.pose.forward() * car.speed_mps })
    };
    let agent = AgentId(u32::try_from(scene.tracks.len()).map_err(|_| Rejection::Format)?);
    scene.tracks.push(Track {
        name: "adversary".to_owned(),
        class: AgentClass::Vehicle,
        size: stage.body.size,
        points: attack.states.iter().map(point).collect(),
    });
    scene.name = format!("{}__{}", scene.name, class.name());
    if scene.name.len() > LONGEST_NAME {
        return Err(Rejection::Format);
    }
    class.name().clone_into(&mut scene.family);
    scene.origin.source = format!("{}; adversary {}, seed {}", scene.origin.source, class.name(), options.seed);
    let contact = Tick(attack.contact);
    scene.adversary = Some(Adversary {
        track: agent,
        class,
        mode: options.mode,
        attack: Tick(contact.0.saturating_sub(ATTACK_TICKS).max(options.hand_over.0)),
        contact,
        budget: options.budget,
        corridor: attack.corridor.clone(),
    });
    let checked = ds_scenario::checked(&scene).map_err(|_| Rejection::Format)?;
    Ok((checked, agent))
}
