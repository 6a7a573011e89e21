//! The anchor: frames that real cameras recorded, looked at by the same policies. Only beside it do distances from a rendered real
//! set say how near anything is to recordings.
//!
//! The unit is the distance of two recorded sets. Recorded frames are few, so covariances are shrunk towards their diagonals, all by the share that
//! the first recorded set asks for (`ds_stats::shrinkage`); such distances are not those of the other tables. The sets hold other moments, so
//! nothing is paired, and they have no intervals: a few consecutive frames are no sample of drives.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ds_fidelity::mean_pooled;
use ds_raster::RgbImage;
use ds_space::{CameraId, CameraModel, DVec3, Intrinsics};
use ds_stats::{Fitted, shrinkage};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use super::config::StudyConfig;
use super::engine::matrix;
use super::features::Rows;
use super::found::Found;
use super::outcome::{Anchor, AnchorOf};
use super::panel::Member;
use super::source::Source;
use crate::error::AppraisalError;

/// Distances below this share of a set's variance are rounding.
const LEAST_UNIT: f64 = 1e-9;
/// Endings of pictures.
const PICTURES: [&str; 3] = ["jpg", "jpeg", "png"];

/// Frames of one real camera.
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
    pub fn load(path: &Path) -> Result<Vec<Self>, AppraisalError> {
        let text = std::fs::read_to_string(path).map_err(AppraisalError::io("the file of recorded sets", path))?;
        let base = std::path::absolute(path).map_err(AppraisalError::io("the file of recorded sets", path))?;
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

    fn camera(&self, frame: &RgbImage) -> CameraModel {
        let ([fx_px, fy_px], [cx_px, cy_px], [k1, k2]) = (self.focal_px, self.centre_px, self.distortion);
        let intrinsics =
            Intrinsics { width_px: frame.width_px(), height_px: frame.height_px(), fx_px, fy_px, cx_px, cy_px, k1, k2 };
        let id = CameraId::new("front").expect("a plain word is an id");
        CameraModel::mounted(id, intrinsics, DVec3::new(self.forward_m, 0.0, self.height_m), 0.0, self.pitch_rad)
    }

    /// Reads its frames, in the order of their names.
    fn read(&self, folder: &Path) -> Result<Vec<RgbImage>, AppraisalError> {
        let refuse = |rule: String| AppraisalError::config(format!("recorded.{}", self.name), rule);
        let listed = std::fs::read_dir(folder).map_err(AppraisalError::io("folder of recorded frames", folder))?;
        let mut paths = Vec::new();
        for entry in listed {
            let path = entry.map_err(AppraisalError::io("folder of recorded frames", folder))?.path();
            let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase);
            paths.extend(ending.filter(|ending| PICTURES.contains(&ending.as_str())).map(|_| path));
        }
        paths.sort();
        let mut frames: Vec<RgbImage> = Vec::new();
        for path in &paths {
            let decoded = image::open(path).map_err(|error| refuse(format!("{}: {error}", path.display())))?;
            let (width, height) = (decoded.width(), decoded.height());
            let frame = RgbImage::new(width, height, decoded.into_rgb8().into_raw());
            let frame = frame.map_err(|error| refuse(format!("{}: {error}", path.display())))?;
            if let Some(first) = frames.first().filter(|first| (first.width_px(), first.height_px()) != (width, height))
            {
                let size = format!("{}×{}", first.width_px(), first.height_px());
                return Err(refuse(format!("{} is {width}×{height}, the first frame is {size}", path.display())));
            }
            frames.push(frame);
        }
        if frames.len() < 2 {
            return Err(refuse(format!("{} holds {} JPEG or PNG files, 2 are needed", folder.display(), frames.len())));
        }
        Ok(frames)
    }
}

/// Looks at all recorded sets: features by set and policy.
///
/// # Errors
/// If a frame cannot be read or a policy cannot look at it.
pub(super) fn look(config: &StudyConfig, panel: &mut [Member]) -> Result<Vec<Vec<DMatrix<f64>>>, AppraisalError> {
    let mut sets = Vec::new();
    for recorded in &config.recorded {
        let frames = recorded.read(&config.path(&recorded.frames))?;
        let camera = recorded.camera(&frames[0]);
        let mut found = Vec::new();
        for member in panel.iter_mut() {
            let mut rows: Rows = Vec::new();
            for frame in &frames {
                let refuse = |source| AppraisalError::Policy {
                    policy: member.name.clone(),
                    frames: recorded.name.clone(),
                    source,
                };
                let seen = member.policy.context(std::slice::from_ref(&camera), std::slice::from_ref(frame));
                let context = seen.map_err(refuse)?.ok_or_else(|| {
                    AppraisalError::config(format!("panel.{}", member.name), "the policy tells of no features")
                })?;
                rows.push(mean_pooled(context.tokens.values(), context.tokens.shape()[1]));
            }
            found.push(matrix(&rows));
        }
        sets.push(found);
    }
    Ok(sets)
}

/// Measures all sets from the first recorded one and from the study's real set, in units of the first two recorded ones.
///
/// # Errors
/// If features cannot be compared, or both recorded sets look the same.
pub(super) fn of(found: &Found<'_>, recorded: &[Vec<DMatrix<f64>>]) -> Result<Anchor, AppraisalError> {
    let config = found.config;
    let unit = [0, 1].map(|at: usize| config.recorded[at].name.clone());
    let mut policies = BTreeMap::new();
    for (k, sets) in found.sets.iter().take(found.policies).enumerate() {
        let share = shrinkage(&recorded[0][k]);
        let fit = |rows: &DMatrix<f64>| Fitted::of(rows, share);
        let (first, reference) = (fit(&recorded[0][k])?, fit(&sets.real.all())?);
        let apart = first.frechet(&fit(&recorded[1][k])?)?;
        if apart <= LEAST_UNIT * first.variance() {
            let rule = format!("{:?} and {:?} look the same to {}: no unit", unit[0], unit[1], sets.name);
            return Err(AppraisalError::config("recorded", rule));
        }
        let mut all = BTreeMap::from([(Source::reference().name().to_owned(), reference.clone())]);
        for (set, rows) in config.recorded.iter().zip(recorded).skip(1) {
            all.insert(set.name.clone(), fit(&rows[k])?);
        }
        for (source, rows) in config.sources.iter().zip(&sets.others) {
            all.insert(source.name().to_owned(), fit(&rows.all())?);
        }
        let from = |origin: &Fitted| -> Result<BTreeMap<String, f64>, AppraisalError> {
            all.iter().map(|(name, other)| Ok((name.clone(), origin.frechet(other)? / apart))).collect()
        };
        let table = AnchorOf {
            control: sets.control,
            features: recorded[0][k].ncols(),
            shrinkage: share,
            unit: apart / first.variance(),
            recorded_to: from(&first)?,
            reference_to: from(&reference)?,
        };
        policies.insert(sets.name.clone(), table);
    }
    let mean = |of: &dyn Fn(&AnchorOf) -> &BTreeMap<String, f64>| {
        let panel: Vec<_> = policies.values().filter(|table| !table.control).map(of).collect();
        let one = |name: &String| panel.iter().map(|table| table[name]).sum::<f64>() / panel.len() as f64;
        panel[0].keys().map(|name| (name.clone(), one(name))).collect()
    };
    let frames = config.recorded.iter().zip(recorded);
    Ok(Anchor {
        unit,
        frames: frames.map(|(set, rows)| (set.name.clone(), rows[0].nrows())).collect(),
        recorded_to: mean(&|table| &table.recorded_to),
        reference_to: mean(&|table| &table.reference_to),
        policies,
    })
}
