//! The built-in scenario families and their seeded generator.
//!
//! `generate(family, seed)` builds roads, places traffic, and lets an expert with full knowledge drive 15 s at 10 Hz
//! (kinematic, within comfort bounds, without contact, on the road). A layout in which that fails is drawn anew.
//! All numbers come from counter-based draws: the same family and seed give the same scene.

use std::fmt;
use std::path::{Path as FilePath, PathBuf};
use std::str::FromStr;

use ds_space::{Draws, PoseSe2};
use ds_world::{Origin, Scene, surroundings};

mod check;
mod crossings;
mod dice;
mod junction;
mod roads;
mod stage;
mod streets;
mod traffic;

use crate::content;
use crate::store::{ScenarioError, save};
use dice::Dice;
use stage::Stage;

/// How many layouts are tried for one seed before vehicles are left out.
const ATTEMPTS: u64 = 48;

/// A kind of situation that scenarios can be generated for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Family {
    /// A free road with bends.
    FreeCurve,
    /// A lead vehicle that brakes.
    LeadBraking,
    /// A vehicle that moves in close ahead.
    CutIn,
    /// A junction with lights and crossing traffic.
    SignalisedCrossing,
    /// A left turn through oncoming traffic.
    UnprotectedLeft,
    /// People on a crosswalk.
    PedestrianCrossing,
    /// Parked cars that narrow the road.
    ParkedNarrowing,
    /// A roundabout.
    Roundabout,
}

/// Says that there is no family of a name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no scenario family {name:?}; the families are {}", Family::ALL.map(Family::name).join(", "))]
pub struct UnknownFamily {
    /// The name that was asked for.
    pub name: String,
}

impl Family {
    /// All families, in the order of the shipped scenarios.
    pub const ALL: [Self; 8] = [
        Self::FreeCurve,
        Self::LeadBraking,
        Self::CutIn,
        Self::SignalisedCrossing,
        Self::UnprotectedLeft,
        Self::PedestrianCrossing,
        Self::ParkedNarrowing,
        Self::Roundabout,
    ];

    /// Returns the name as written in files and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::FreeCurve => "free-curve",
            Self::LeadBraking => "lead-braking",
            Self::CutIn => "cut-in",
            Self::SignalisedCrossing => "signalised-crossing",
            Self::UnprotectedLeft => "unprotected-left",
            Self::PedestrianCrossing => "pedestrian-crossing",
            Self::ParkedNarrowing => "parked-narrowing",
            Self::Roundabout => "roundabout",
        }
    }

    fn stage(self, dice: &mut Dice) -> Stage {
        match self {
            Self::FreeCurve => streets::free_curve(dice),
            Self::LeadBraking => streets::lead_braking(dice),
            Self::CutIn => streets::cut_in(dice),
            Self::SignalisedCrossing => crossings::signalised_crossing(dice),
            Self::UnprotectedLeft => crossings::unprotected_left(dice),
            Self::PedestrianCrossing => streets::pedestrian_crossing(dice),
            Self::ParkedNarrowing => streets::parked_narrowing(dice),
            Self::Roundabout => crossings::roundabout_family(dice),
        }
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Family {
    type Err = UnknownFamily;

    fn from_str(name: &str) -> Result<Self, UnknownFamily> {
        Self::ALL
            .into_iter()
            .find(|family| family.name() == name)
            .ok_or_else(|| UnknownFamily { name: name.to_owned() })
    }
}

/// Plays one layout of a family and seed.
fn attempt(family: Family, seed: u64, attempt: u64) -> Scene {
    let key = Draws::from_seed(seed, family.name());
    let mut dice = Dice::new(Draws::from_seed(key.u64(attempt), "scenario"));
    let stage = family.stage(&mut dice);
    let turn = dice.range(-std::f64::consts::PI, std::f64::consts::PI);
    let world_from_stage = PoseSe2::new(dice.range(-400.0, 400.0), dice.range(-400.0, 400.0), turn);
    let mut scene = stage::play(stage, &mut dice, world_from_stage);
    scene.name = format!("{}-{seed}", family.name());
    scene.family = family.name().to_owned();
    scene.origin = Origin {
        source: format!("dreamstream generator 1, family {}, seed {seed}", family.name()),
        licence: "Apache-2.0".to_owned(),
        attribution: "The DreamStream authors".to_owned(),
    };
    scene
}

/// Generates the scenario of a family and seed: 151 ticks at 10 Hz with an expert log.
///
/// # Panics
/// Only if not one of the layouts tried lets the expert keep to the road alone, which no seed is known to do.
#[must_use]
pub fn generate(family: Family, seed: u64) -> Scene {
    let mut scenes = (0..ATTEMPTS).map(|n| attempt(family, seed, n));
    let scene = scenes.find(|scene| check::fault(scene).is_none());
    surrounded(scene.unwrap_or_else(|| emptied(family, seed)))
}

/// Returns the scene with what stands beside its roads.
fn surrounded(mut scene: Scene) -> Scene {
    content::seal(&mut scene);
    scene.map.structures = surroundings::place(&scene, 0);
    content::seal(&mut scene);
    scene
}

/// Plays layouts of a family and seed with vehicles left out.
fn emptied(family: Family, seed: u64) -> Scene {
    let emptied = (0..ATTEMPTS).map(|n| attempt(family, seed, n)).map(|mut scene| {
        check::thin_out(&mut scene);
        scene
    });
    emptied
        .into_iter()
        .find(|scene| check::fault(scene).is_none())
        .expect("one of many layouts lets the expert drive alone")
}

/// The seeds of the shipped scenarios.
pub const SHIPPED: [(Family, u64); 8] = [
    (Family::FreeCurve, 1),
    (Family::LeadBraking, 1),
    (Family::CutIn, 1),
    (Family::SignalisedCrossing, 1),
    (Family::UnprotectedLeft, 1),
    (Family::PedestrianCrossing, 1),
    (Family::ParkedNarrowing, 1),
    (Family::Roundabout, 1),
];

/// Returns a shipped scenario: as generated, named after its family alone.
#[must_use]
pub fn shipped(family: Family, seed: u64) -> Scene {
    let mut scene = generate(family, seed);
    scene.name = family.name().to_owned();
    content::seal(&mut scene);
    scene
}

/// Returns the small scenario for tests: a free road without traffic and structures, 3 s.
#[must_use]
pub fn tiny() -> Scene {
    let mut scene = generate(Family::FreeCurve, 2);
    scene.name = "straight".to_owned();
    scene.map.structures.clear();
    scene.ego_log.truncate(31);
    scene.tracks.truncate(1);
    for track in &mut scene.tracks {
        track.points.truncate(31);
    }
    scene.tracks.retain(|track| track.points.iter().any(Option::is_some));
    content::seal(&mut scene);
    scene
}

/// Generates `count` scenarios from `seed` on, one file each, and returns their paths; all families in turn if `None`.
///
/// # Errors
/// [`ScenarioError`] if a file cannot be written.
pub fn generate_set(
    family: Option<Family>,
    seed: u64,
    count: u32,
    out_dir: &FilePath,
) -> Result<Vec<PathBuf>, ScenarioError> {
    let mut paths = Vec::new();
    for i in 0..u64::from(count) {
        let (family, seed) = match family {
            Some(family) => (family, seed.wrapping_add(i)),
            None => (Family::ALL[(i % 8) as usize], seed.wrapping_add(i / 8)),
        };
        let scene = generate(family, seed);
        let path = out_dir.join(format!("{}.scenario.json", scene.name));
        save(&scene, &path)?;
        paths.push(path);
    }
    Ok(paths)
}

#[cfg(test)]
mod tests;
