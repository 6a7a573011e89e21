//! The study `drives`: FDπ between sets of recorded drives, as the same policies see their frames.
//!
//! The first set is the real one. Sets hold the same drives and the same moments of each, so frames are paired by drive and moment; they
//! show the same state only where the car went the same way, as it does when whoever drove saw no frames. How far apart the cars of
//! pairs stand is stated beside the distances.

use std::collections::BTreeMap;
use std::error::Error;

use ds_fidelity::{Features, recentred};
use ds_raster::RgbImage;
use ds_space::{CameraModel, DVec2};

use super::config::StudyConfig;
use super::engine::measure;
use super::features::{Rows, matrix, pooled};
use super::found::{Measured, Sets, fd_pi};
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
    /// Where the car stood in each, in metres.
    pub places: Vec<DVec2>,
}

/// Makes the drive of an index as the set of an index recorded it.
pub type DriveOf<'a> = dyn FnMut(usize, usize) -> Result<RecordedDrive, Box<dyn Error + Send + Sync>> + 'a;

/// Features of one policy by set, then drive: means over tokens, and of four groups of them.
type Seen = Vec<Vec<[Rows; 2]>>;

/// Looks at so many drives of named sets, of which the first is the real one, and measures. Of the configuration count panel and draws.
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
    let mut seen: Vec<Seen> = vec![vec![Vec::new(); names.len()]; panel.len()];
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
            for (member, seen) in panel.iter_mut().zip(&mut seen) {
                seen[set].push(pooled(member, &shown.camera, shown.frames.iter(), &shown.name)?);
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
    let figure = |(at, name): (usize, &&str)| {
        let (value, drawn) = fd_pi(&measured, name, at);
        ((*name).to_owned(), Figure::of(recentred(value, drawn), 1.0))
    };
    let mean = |values: &Vec<f64>| values.iter().sum::<f64>() / values.len().max(1) as f64;
    Ok(Outcome {
        study: "drives".to_owned(),
        kind: format!("from the recorded drives of {}", names[0]),
        scenarios: count,
        fd_pi: sources.iter().enumerate().map(figure).collect(),
        apart_m: names.iter().zip(&apart_m).skip(1).map(|(name, values)| (name.clone(), mean(values))).collect(),
        policies: measured.into_iter().map(|measured| (measured.name, measured.table)).collect::<BTreeMap<_, _>>(),
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
    Sets { name: member.name.clone(), control: member.control, digest: member.digest, real, others, placed }
}
