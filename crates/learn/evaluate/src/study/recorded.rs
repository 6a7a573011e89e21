//! Folders of frames that cameras recorded, with their calibration.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ds_raster::RgbImage;
use ds_space::{CameraId, CameraModel, DVec3, Intrinsics};
use serde::{Deserialize, Serialize};

use crate::error::EvaluationError;

/// Endings of pictures.
const PICTURES: [&str; 3] = ["jpg", "jpeg", "png"];

/// Pictures by the folder within a set (no name where there is none) and their name without ending.
pub(super) type Pictures = BTreeMap<String, BTreeMap<String, PathBuf>>;

/// Frames of one camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recorded {
    /// Name in tables.
    pub name: String,
    /// A folder of JPEG or PNG files of one size.
    pub frames: PathBuf,
    /// Focal lengths along x and y, in pixels.
    pub focal_px: [f64; 2],
    /// Principal point, in pixels from the upper left corner.
    pub centre_px: [f64; 2],
    /// Radial distortion, k1 and k2.
    #[serde(default)]
    pub distortion: [f64; 2],
    /// Metres before the rear axle.
    #[serde(default = "forward")]
    pub forward_m: f64,
    /// Metres above the road.
    #[serde(default = "height")]
    pub height_m: f64,
    /// Turned down, in radians.
    #[serde(default)]
    pub pitch_rad: f64,
}

fn forward() -> f64 {
    1.5
}

fn height() -> f64 {
    1.6
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    recorded: Vec<Recorded>,
}

impl Recorded {
    /// Reads a file of recorded sets; folders are relative to it.
    ///
    /// # Errors
    /// If it cannot be read or has other keys.
    pub fn load(path: &Path) -> Result<Vec<Self>, EvaluationError> {
        let text = std::fs::read_to_string(path).map_err(EvaluationError::io("the file of recorded sets", path))?;
        let base = std::path::absolute(path).map_err(EvaluationError::io("the file of recorded sets", path))?;
        let base = base.parent().unwrap_or(Path::new("/")).to_path_buf();
        let file: File = toml::from_str(&text)?;
        Ok(file.recorded.into_iter().map(|set| Self { frames: base.join(&set.frames), ..set }).collect())
    }

    /// Returns why its values make no camera.
    pub(super) fn wrong(&self) -> Option<&'static str> {
        let sound = |values: &[f64], from: f64, to: f64| values.iter().all(|value| (from..=to).contains(value));
        [
            ("focal_px must be 1 to 100000", sound(&self.focal_px, 1.0, 1e5)),
            ("centre_px must be −100000 to 100000", sound(&self.centre_px, -1e5, 1e5)),
            ("distortion must be −10 to 10", sound(&self.distortion, -10.0, 10.0)),
            ("forward_m must be −20 to 20", sound(&[self.forward_m], -20.0, 20.0)),
            ("height_m must be 0.1 to 20", sound(&[self.height_m], 0.1, 20.0)),
            ("pitch_rad must be −1 to 1", sound(&[self.pitch_rad], -1.0, 1.0)),
        ]
        .into_iter()
        .find_map(|(rule, held)| (!held).then_some(rule))
    }

    /// Returns the camera that made a frame.
    pub(super) fn camera(&self, frame: &RgbImage) -> CameraModel {
        let ([fx_px, fy_px], [cx_px, cy_px], [k1, k2]) = (self.focal_px, self.centre_px, self.distortion);
        let intrinsics =
            Intrinsics { width_px: frame.width_px(), height_px: frame.height_px(), fx_px, fy_px, cx_px, cy_px, k1, k2 };
        let id = CameraId::new("front").expect("a plain word is an id");
        CameraModel::mounted(id, intrinsics, DVec3::new(self.forward_m, 0.0, self.height_m), 0.0, self.pitch_rad)
    }

    /// Reads its frames, in the order of their names.
    ///
    /// # Errors
    /// If a file is no picture, has another size, or there are fewer than two.
    pub(super) fn read(&self, folder: &Path) -> Result<Vec<RgbImage>, EvaluationError> {
        let paths = listed(folder)?.into_iter().filter(|path| is_picture(path)).collect::<Vec<_>>();
        if paths.len() < 2 {
            let rule = format!("{} holds {} JPEG or PNG files, 2 are needed", folder.display(), paths.len());
            return Err(self.refuse(rule));
        }
        self.frames(&paths)
    }

    /// Lists its pictures: those of each folder within, or its own where no folder within holds any.
    ///
    /// # Errors
    /// If a folder cannot be read, two pictures differ by their endings alone, or there are fewer than two.
    pub(super) fn pictures(&self, folder: &Path) -> Result<Pictures, EvaluationError> {
        let mut found = Pictures::new();
        let inside = listed(folder)?;
        for path in inside.iter().filter(|path| path.is_dir()) {
            let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            found.insert(name, self.named(listed(path)?)?);
        }
        found.retain(|_, pictures| !pictures.is_empty());
        if found.is_empty() {
            found.insert(String::new(), self.named(inside)?);
        }
        let count: usize = found.values().map(BTreeMap::len).sum();
        if count < 2 {
            return Err(self.refuse(format!("{} holds {count} JPEG or PNG files, 2 are needed", folder.display())));
        }
        Ok(found)
    }

    /// Sorts the pictures among some files by their names without ending.
    fn named(&self, files: Vec<PathBuf>) -> Result<BTreeMap<String, PathBuf>, EvaluationError> {
        let mut found = BTreeMap::new();
        for path in files.into_iter().filter(|path| is_picture(path)) {
            let name = path.file_stem().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            if let Some(other) = found.insert(name, path.clone()) {
                return Err(self.refuse(format!("{} and {} have one name", other.display(), path.display())));
            }
        }
        Ok(found)
    }

    /// Reads pictures, in the order given.
    ///
    /// # Errors
    /// If a file is no picture or has another size than the first.
    pub(super) fn frames(&self, paths: &[PathBuf]) -> Result<Vec<RgbImage>, EvaluationError> {
        let mut frames: Vec<RgbImage> = Vec::new();
        for path in paths {
            let bytes = std::fs::read(path).map_err(EvaluationError::io("recorded frame", path))?;
            let frame = RgbImage::photo(&bytes).map_err(|error| self.refuse(format!("{}: {error}", path.display())))?;
            let (width, height) = (frame.width_px(), frame.height_px());
            if let Some(first) = frames.first().filter(|first| (first.width_px(), first.height_px()) != (width, height))
            {
                let size = format!("{}×{}", first.width_px(), first.height_px());
                return Err(self.refuse(format!("{} is {width}×{height}, the first frame is {size}", path.display())));
            }
            frames.push(frame);
        }
        Ok(frames)
    }

    fn refuse(&self, rule: String) -> EvaluationError {
        EvaluationError::config(format!("recorded.{}", self.name), rule)
    }
}

/// Lists what a folder holds, by name.
fn listed(folder: &Path) -> Result<Vec<PathBuf>, EvaluationError> {
    let entries = std::fs::read_dir(folder).map_err(EvaluationError::io("folder of recorded frames", folder))?;
    let paths = entries.map(|entry| entry.map(|entry| entry.path()));
    let mut paths =
        paths.collect::<Result<Vec<_>, _>>().map_err(EvaluationError::io("folder of recorded frames", folder))?;
    paths.sort();
    Ok(paths)
}

fn is_picture(path: &Path) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase);
    ending.is_some_and(|ending| PICTURES.contains(&ending.as_str()))
}
