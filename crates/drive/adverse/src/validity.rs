//! Whether a drive makes a valid variant, and why not: road, others, dynamics, start, contact and class.
//!
//! The contact is found by the simulator itself, with every agent as logged; nothing here knows what was intended but
//! the class and tick that are compared with what came out.

use std::fmt;
use std::sync::Arc;

use ds_sim::{SimConfig, Simulation};
use ds_space::{AgentId, Tick, angle};
use ds_vehicle::{Control, Rolling};
use ds_world::{Contact, ContactKind, CrashClass, Scene};

use crate::beam::BESIDE_OTHERS_M;
use crate::class::{classify, encounter};
use crate::limits::{self, Limits};
use crate::road::Way;
use crate::stage::{Stage, gap_m};

const START_GAP_M: f64 = 5.0;
const START_TTC_SECS: f64 = 3.0;
const START_TURNED_DEG: f64 = 30.0;
const LATE_TICKS: u32 = 3;
const CLOSING_MPS: f64 = 2.0;
/// Nearer than this to another road user is a hit.
pub(crate) const OTHERS_M: f64 = 0.2;
/// Where no lane says how fast.
const FASTEST_MPS: f64 = 25.0;

/// Why a candidate is no variant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rejection {
    /// The road offers no collision state of the class.
    NoTarget,
    /// No drive leads to the collision state.
    NoDrive,
    /// It leaves the drivable surface.
    OffRoad,
    /// It comes within 0.2 m of another road user before the contact.
    HitsOther,
    /// It goes beyond the limits of a car.
    Dynamics,
    /// It starts within 5 m or 3 s of the ego, or across its lane.
    Start,
    /// It does not touch the logged ego within 3 ticks of plan, or not at 2 m/s.
    NoContact,
    /// The contact is of another class.
    Class,
    /// No ego within the limits of the reachable set gets away: it is empty.
    Unavoidable,
    /// The expert does not find a drive without contact on the road, and nothing proves that there is none.
    Unsolved,
    /// The format refuses the variant's file.
    Format,
}

impl Rejection {
    /// Returns the name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::NoTarget => "no_target",
            Self::NoDrive => "no_drive",
            Self::OffRoad => "off_road",
            Self::HitsOther => "hits_other",
            Self::Dynamics => "dynamics",
            Self::Start => "start",
            Self::NoContact => "no_contact",
            Self::Class => "class",
            Self::Unavoidable => "unavoidable",
            Self::Unsolved => "unsolved",
            Self::Format => "format",
        }
    }
}

impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A drive from the first tick to the last, with what it is meant for.
pub(crate) struct Candidate<'a> {
    /// The way that it follows, if it follows one.
    pub way: Option<&'a Way>,
    pub states: &'a [Rolling],
    pub controls: &'a [Control],
    pub contact: u32,
}

/// Checks all that needs no simulation.
pub(crate) fn check_drive(stage: &Stage<'_>, candidate: &Candidate<'_>, hand_over: Tick) -> Result<(), Rejection> {
    for car in candidate.states {
        let centre = stage.body.centre(car);
        if !stage.road.holds(&stage.body.grown(&centre, 0.0).corners(), &centre) {
            return Err(Rejection::OffRoad);
        }
    }
    for (tick, car) in (0..=candidate.contact).zip(candidate.states) {
        if stage.meets_others(tick, &stage.body.grown(&stage.body.centre(car), OTHERS_M.min(BESIDE_OTHERS_M))) {
            return Err(Rejection::HitsOther);
        }
    }
    let most_mps = |car: &Rolling| {
        let limit_mps = |way: &Way| way.limit_mps(way.beside(car.pose.position, 0).station_m);
        candidate.way.map_or(FASTEST_MPS, |way| Limits::SPEEDING * limit_mps(way))
    };
    let base = (stage.body.wheel_base_m(), stage.dt_secs);
    if limits::beyond(candidate.states, candidate.controls, base.0, base.1, &most_mps).is_some() {
        return Err(Rejection::Dynamics);
    }
    starts_apart(stage, &candidate.states[hand_over.0 as usize], hand_over.0)
}

fn starts_apart(stage: &Stage<'_>, car: &Rolling, tick: u32) -> Result<(), Rejection> {
    let centre = stage.body.centre(car);
    let (ego, other) = (stage.ego(tick), stage.body.grown(&centre, 0.0));
    let relative_mps = car.pose.forward() * car.speed_mps - stage.ego_velocity(tick);
    let meets =
        (1..=(START_TTC_SECS / 0.1) as i32).any(|i| ego.touches(&other.moved(relative_mps * (f64::from(i) * 0.1))));
    let along = stage
        .road
        .lane_at(&centre)
        .is_some_and(|lane| angle::turn(lane.heading_rad, centre.heading_rad).abs().to_degrees() <= START_TURNED_DEG);
    if gap_m(ego, &other) < START_GAP_M || meets || !along { Err(Rejection::Start) } else { Ok(()) }
}

/// What came of the contact of a variant along the logged drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Met {
    /// The tick of first contact.
    pub tick: Tick,
    /// Which part of the ego was met.
    pub face: ContactKind,
    /// Speed of approach along the normal of the contact, in metres per second.
    pub closing_mps: f64,
    /// The class by the classifier.
    pub class: Option<CrashClass>,
}

/// Replays a variant beside the logged ego and returns its first contact with the adversary, if it comes before any
/// other contact and by a tick.
pub(crate) fn met(stage: &Stage<'_>, scene: &Arc<Scene>, agent: AgentId, last: Tick) -> Option<Met> {
    let config = SimConfig { agents: None, ..SimConfig::default() };
    let mut replayed = (**scene).clone();
    replayed.adversary = None;
    let mut simulation = Simulation::new(Arc::new(replayed), config, Tick(0)).ok()?;
    while simulation.state().contacts.is_empty() {
        if simulation.state().tick >= last {
            return None;
        }
        simulation.step();
    }
    let state = simulation.state();
    let Contact { kind, closing_speed_mps, .. } = *state.contacts.iter().find(|contact| contact.agent == agent)?;
    if state.contacts.len() > 1 {
        return None;
    }
    let class = encounter(scene, &stage.road, (agent, state.tick), kind).and_then(|it| classify(&it));
    Some(Met { tick: state.tick, face: kind, closing_mps: closing_speed_mps, class })
}

/// Checks the contact of a variant.
pub(crate) fn check_contact(
    stage: &Stage<'_>,
    scene: &Arc<Scene>,
    agent: AgentId,
    class: CrashClass,
    planned: Tick,
) -> Result<Met, Rejection> {
    let met = met(stage, scene, agent, planned.plus(LATE_TICKS)).ok_or(Rejection::NoContact)?;
    if met.tick.0.abs_diff(planned.0) > LATE_TICKS || met.closing_mps < CLOSING_MPS {
        return Err(Rejection::NoContact);
    }
    if met.class == Some(class) { Ok(met) } else { Err(Rejection::Class) }
}
