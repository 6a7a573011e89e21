//! Folders of pictures of the same states, compared as recorded drives are: the first set is the real one.
//!
//! Pictures are paired by name. Each folder within a set is a drive, drawn anew as a whole; a set without folders is cut into drives
//! of one picture, or of as many as the network of FVD sees at once, and what is left over is not looked at.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::config::{Recorded, StudyConfig};
use super::drives::{RecordedDrive, drives};
use super::given;
use super::outcome::Outcome;
use super::panel::Guests;
use super::recorded::Pictures;
use crate::Progress;
use crate::error::EvaluationError;

/// The pictures of a drive with its name.
type Drive = (String, Vec<PathBuf>);

/// Compares sets of pictures with the first one. Of the configuration count panel, networks that were given, and draws.
///
/// # Errors
/// If a set's calibration is none, its pictures are not those of the first by name or cannot be read, or as of [`drives`].
pub fn pictures(
    config: &StudyConfig,
    guests: &Guests<'_>,
    sets: &[Recorded],
    progress: &mut dyn Progress,
) -> Result<Outcome, EvaluationError> {
    let names: Vec<String> = sets.iter().map(|set| set.name.clone()).collect();
    if sets.len() < 2 {
        return Err(EvaluationError::config(
            "recorded",
            "must name two sets: the real one, and one that is measured from it",
        ));
    }
    if let Some(twice) = (1..names.len()).find(|at| names[..*at].contains(&names[*at])) {
        return Err(EvaluationError::config("recorded", format!("{:?} stands twice", names[twice])));
    }
    if let Some((set, rule)) = sets.iter().find_map(|set| Some((set, set.wrong()?))) {
        return Err(EvaluationError::config(format!("recorded.{}", set.name), rule));
    }
    let folders = |set: &Recorded| set.pictures(&config.path(&set.frames));
    let listed: Vec<Pictures> = sets.iter().map(folders).collect::<Result<_, _>>()?;
    for (set, pictures) in sets.iter().zip(&listed).skip(1) {
        paired(&sets[0].name, &listed[0], set, pictures)?;
    }
    let clip = given::load(config)?.iter().map(given::Given::frames).max().unwrap_or(1);
    let flat = listed[0].keys().all(String::is_empty);
    let cut: Vec<Vec<Drive>> = listed.into_iter().map(|pictures| cut(pictures, clip)).collect();
    let mut drive = |set: usize, index: usize| {
        let (name, paths) = &cut[set][index];
        let frames = sets[set].frames(paths)?;
        let camera = sets[set].camera(&frames[0]);
        Ok(RecordedDrive { name: name.clone(), camera, frames, every: 1, places: Vec::new() })
    };
    let mut found = drives(config, guests, &names, cut[0].len(), &mut drive, progress)?;
    found.kind = format!("from the pictures of {}", names[0]);
    if flat {
        found.kind += ", each drawn by itself: intervals are too narrow where pictures follow each other";
    }
    Ok(found)
}

/// Cuts a set into drives.
fn cut(pictures: Pictures, clip: usize) -> Vec<Drive> {
    let drives = pictures.into_iter().flat_map(|(folder, pictures)| {
        let each = if folder.is_empty() { clip } else { pictures.len() };
        let all: Vec<(String, PathBuf)> = pictures.into_iter().collect();
        let one = |part: &[(String, PathBuf)]| {
            let name = if folder.is_empty() { &part[0].0 } else { &folder };
            (name.clone(), part.iter().map(|(_, path)| path.clone()).collect())
        };
        all.chunks_exact(each).map(one).collect::<Vec<Drive>>()
    });
    drives.collect()
}

/// Checks that a set has the pictures of the real one, by folder and name.
fn paired(real: &str, first: &Pictures, set: &Recorded, pictures: &Pictures) -> Result<(), EvaluationError> {
    let names = |pictures: &Pictures| -> BTreeSet<String> {
        let named = pictures.iter().flat_map(|(folder, pictures)| pictures.keys().map(move |name| (folder, name)));
        named.map(|(folder, name)| if folder.is_empty() { name.clone() } else { format!("{folder}/{name}") }).collect()
    };
    let (wanted, found) = (names(first), names(pictures));
    for (one, whose, other) in [(&wanted, real, &found), (&found, &set.name, &wanted)] {
        if let Some(name) = one.difference(other).next() {
            let rule = format!("{name:?} is a picture of {whose:?} alone: sets hold the same states by the same names");
            return Err(EvaluationError::config(format!("recorded.{}", set.name), rule));
        }
    }
    Ok(())
}
