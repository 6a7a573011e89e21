//! The study `drives`: FDπ between sets of recorded drives, as the same policies see their frames.
//!
//! The first set is the real one. Sets hold the same drives and the same moments of each, so frames are paired by drive and moment; they
//! show the same state only where the car went the same way, as it does when whoever drove saw no frames. How far apart the cars of
//! pairs stand is stated beside the distances.

use std::collections::BTreeMap;
use std::error::Error;

use ds_fidelity::{Features, Unit, recentred};
use ds_raster::RgbImage;
use ds_space::{CameraModel, DVec2};
use ds_stats::mean;

use super::config::StudyConfig;
use super::engine::measure;
use super::features::{Rows, matrix, pooled};
use super::found::{Measured, Sets, fd_pi};
use super::given::{self, Given};
use super::outcome::{Figure, Outcome};
use super::panel::{self, Guests, Member};
use crate::Progress;
use crate::error::EvaluationError;

/// One drive as one set recorded it, at the moments that all sets hold.
pub struct RecordedDrive {
    /// Its name, for errors.
    pub name: String,
    /// The camera that saw it.
    pub camera: CameraModel,
    /// Its frames.
    pub frames: Vec<RgbImage>,
    /// The last of every so many is looked at; all are what clips are made of.
    pub every: usize,
    /// Where the car stood in each that is looked at, in metres; empty where that is not known.
    pub places: Vec<DVec2>,
}

impl RecordedDrive {
    /// Returns the frames that are looked at.
    fn looked(&self) -> Vec<&RgbImage> {
        self.frames.chunks_exact(self.every).filter_map(<[RgbImage]>::last).collect()
    }
}

/// Makes the drive of an index as the set of an index recorded it.
pub type DriveOf<'a> = dyn FnMut(usize, usize) -> Result<RecordedDrive, Box<dyn Error + Send + Sync>> + 'a;

/// Features of one policy by set, then drive: means over tokens, and of four groups of them.
type Seen = Vec<Vec<[Rows; 2]>>;

/// Looks at so many drives of named sets, of which the first is the real one, and measures. Of the configuration count panel,
/// networks that were given, and draws.
///
/// # Errors
/// If weights cannot be used, a drive cannot be made, or features cannot be compared.
pub fn drives(
    config: &StudyConfig,
    guests: &Guests<'_>,
    names: &[String],
    count: usize,
    drive: &mut DriveOf<'_>,
    progress: &mut dyn Progress,
) -> Result<Outcome, EvaluationError> {
    config.check_apart()?;
    let mut panel = panel::load(config, guests)?;
    let given = given::load(config)?;
    let mut seen: Vec<Seen> = vec![vec![Vec::new(); names.len()]; panel.len()];
    let mut seen_given: Vec<Vec<Vec<Rows>>> = vec![vec![Vec::new(); names.len()]; given.len()];
    let mut apart_m = vec![Vec::new(); names.len()];
    progress.ahead((count * names.len()) as u64);
    for index in 0..count {
        let mut real_places = Vec::new();
        for (set, name) in names.iter().enumerate() {
            let shown = drive(set, index).map_err(|source| EvaluationError::Rollout {
                arm: name.clone(),
                drive: format!("drive {index}"),
                source,
            })?;
            if index == 0 && set == 0 {
                greet(&mut panel, &shown)?;
            }
            let looked = shown.looked();
            for (member, seen) in panel.iter_mut().zip(&mut seen) {
                seen[set].push(pooled(member, &shown.camera, looked.iter().copied(), &shown.name)?);
            }
            for (given, seen) in given.iter().zip(&mut seen_given) {
                seen[set].push(given.rows(&looked, &shown.frames, &shown.name)?);
            }
            if set == 0 {
                real_places.clone_from(&shown.places);
            }
            apart_m[set].extend(shown.places.iter().zip(&real_places).map(|(one, real)| one.distance(*real)));
            progress.done(&format!("{name} of {}", shown.name), false);
        }
    }
    let sources: Vec<&str> = names[1..].iter().map(String::as_str).collect();
    let measured = panel.iter().zip(seen).map(|(member, seen)| measure(&sets(member, seen), &sources, config.draws));
    let measured: Vec<Measured> = measured.collect::<Result<_, _>>()?;
    let plain = given.iter().zip(seen_given).map(|(given, seen)| measure(&plain(given, seen), &sources, config.draws));
    let plain: Vec<Measured> = plain.collect::<Result<_, _>>()?;
    let figure = |(at, name): (usize, &&str)| {
        let (value, drawn) = fd_pi(&measured, name, at);
        ((*name).to_owned(), Figure::of(recentred(value, drawn), 1.0))
    };
    let tables = |measured: Vec<Measured>| -> BTreeMap<_, _> {
        measured.into_iter().map(|measured| (measured.name, measured.table)).collect()
    };
    let apart_m = names.iter().zip(&apart_m).skip(1);
    Ok(Outcome {
        study: "drives".to_owned(),
        kind: format!("from the recorded drives of {}", names[0]),
        scenarios: count,
        fd_pi: sources.iter().enumerate().map(figure).collect(),
        apart_m: apart_m.filter_map(|(name, all)| Some((name.clone(), mean(all.iter().copied())?))).collect(),
        policies: tables(measured),
        given: tables(plain),
        ..Outcome::default()
    })
}

fn greet(panel: &mut [Member], shown: &RecordedDrive) -> Result<(), EvaluationError> {
    for guest in panel.iter_mut().filter(|member| member.guest) {
        guest.greet(&shown.camera, &shown.frames[0], &shown.name)?;
    }
    Ok(())
}

fn sets(member: &Member, seen: Seen) -> Sets {
    let of = |which: usize| {
        let set = |drives: &Vec<[Rows; 2]>| Features(drives.iter().map(|rows| matrix(&rows[which])).collect());
        let mut all: Vec<Features> = seen.iter().map(set).collect();
        (all.remove(0), all)
    };
    let ((real, others), placed) = (of(0), Some(of(1)));
    let (name, control, digest) = (member.name.clone(), member.control, member.digest);
    Sets { name, control, digest, real, others, placed, unit: Unit::Variance }
}

/// Sorts the features of a network that was given, by set and drive; drives that hold no clip do not count.
fn plain(given: &Given, seen: Vec<Vec<Rows>>) -> Sets {
    let set = |drives: &Vec<Rows>| Features(drives.iter().filter(|rows| !rows.is_empty()).map(matrix).collect());
    let mut others: Vec<Features> = seen.iter().map(set).collect();
    let (name, digest, real) = (given.name.to_owned(), given.digest(), others.remove(0));
    Sets { name, control: true, digest, real, others, placed: None, unit: Unit::Features }
}
