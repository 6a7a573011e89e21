//! What is kept of one scenario as one source shows it: features of every policy and of the look network. Names of all records.

use ds_fidelity::{mean_pooled, placed};
use ds_perception::look::LookReader;
use ds_policy::{Context, Grid};
use ds_raster::RgbImage;
use ds_space::{CameraModel, Digest, DigestWriter};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use super::config::StudyConfig;
use super::frames::Take;
use super::given::Given;
use super::panel::Member;
use super::plans::Scorer;
use super::source::Source;
use crate::arm::Arm;
use crate::drive::Drive;
use crate::error::EvaluationError;

/// Rows of one feature matrix.
pub(crate) type Rows = Vec<Vec<f64>>;

/// Features of one scenario from one source.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Seen {
    /// Per policy: mean over tokens, a row per frame.
    pub(crate) mean: Vec<Rows>,
    /// Per policy: means of four groups of tokens.
    pub(crate) placed: Vec<Rows>,
    /// Features of the look network, a row per frame.
    pub(crate) look: Rows,
    /// Their mean and deviation over clips, a row per clip.
    pub(crate) clips: Rows,
    /// Features of each network that was given: of `fid` a row per frame, of `fvd` a row per clip.
    #[serde(default)]
    pub(crate) given: Vec<Rows>,
    /// Per policy: PDMS of its plan on each frame; empty where no plans were asked for.
    #[serde(default)]
    pub(crate) pdms: Vec<Vec<f64>>,
}

/// What is kept of every scenario as each source shows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kept {
    /// Features of the frames.
    Features,
    /// The same, and how good plans on them are.
    FeaturesAndPdms,
    /// Plans on them and on parts of them.
    Parts,
}

impl Kept {
    /// Returns the folder of its records.
    pub(crate) fn folder(self) -> &'static str {
        match self {
            Self::Features | Self::FeaturesAndPdms => "features",
            Self::Parts => "plans",
        }
    }

    /// Returns what its records are, with the version of how they are made.
    fn what(self) -> &'static str {
        match self {
            Self::Features | Self::FeaturesAndPdms => "study features 2",
            Self::Parts => "study parts 1",
        }
    }
}

/// The networks that look.
pub(crate) struct Lookers {
    pub(crate) panel: Vec<Member>,
    pub(crate) look: LookReader,
    pub(crate) given: Vec<Given>,
}

/// Returns the digest of all that what is kept of a scenario depends on.
pub(crate) fn key(
    config: &StudyConfig,
    kept: Kept,
    lookers: &Lookers,
    take: &Take,
    source: (&Source, Option<&Arm>),
    size_px: (u32, u32),
) -> Digest {
    let mut writer = DigestWriter::new();
    writer.text(kept.what()).digest(&take.scene.digest).text(&format!("{:?} {:?}", take.look, config.world));
    writer.f64s(&take.displaced).u32(size_px.0).u32(size_px.1).f64(config.pace).bool(kept == Kept::FeaturesAndPdms);
    writer.u32(config.frames).u32(config.clip);
    config.looked().iter().for_each(|frame| {
        writer.u32(*frame);
    });
    source.0.digest_into(&mut writer);
    if let Some(arm) = source.1.filter(|_| source.0.from.is_generated()) {
        writer.digest(&arm.digest());
    }
    for member in &lookers.panel {
        writer.digest(&member.digest);
    }
    writer.digest(&lookers.look.digest());
    for given in &lookers.given {
        writer.text(given.name).digest(&given.digest());
    }
    writer.finish()
}

/// Looks at the frames of a scenario.
///
/// # Errors
/// If a policy cannot look at a frame or tells of nothing that it attends to.
pub(crate) fn look(
    config: &StudyConfig,
    plans: bool,
    lookers: &mut Lookers,
    take: &Take,
    drive: &Drive,
    frames: &[RgbImage],
) -> Result<Seen, EvaluationError> {
    let looked: Vec<&RgbImage> = config.looked().iter().map(|at| &frames[*at as usize]).collect();
    let mut seen = Seen::default();
    let worlds = || config.looked().iter().map(|frame| take.world(drive, *frame)).collect();
    let scorer = plans.then(|| Scorer::new(&take.scene, worlds())).transpose()?;
    for member in &mut lookers.panel {
        let [mean, places] = pooled(member, &drive.model, looked.iter().copied(), &drive.name)?;
        seen.mean.push(mean);
        seen.placed.push(places);
        if let Some(scorer) = &scorer {
            seen.pdms.push(scorer.pdms(member, &drive.model, &looked)?);
        }
    }
    let rows: Rows = frames[1..].iter().map(|frame| wide(&lookers.look.read(frame).features)).collect();
    seen.look = config.looked().iter().map(|at| rows[*at as usize - 1].clone()).collect();
    seen.clips = rows.chunks_exact(config.clip as usize).map(clip).collect();
    for given in &lookers.given {
        seen.given.push(given.rows(&looked, &frames[1..], &drive.name)?);
    }
    Ok(seen)
}

/// Returns what a policy attends to in frames: means over tokens, and means of four groups of them.
///
/// # Errors
/// If it cannot look at a frame or tells of nothing that it attends to.
pub(super) fn pooled<'a>(
    member: &mut Member,
    camera: &CameraModel,
    frames: impl Iterator<Item = &'a RgbImage>,
    whose: &str,
) -> Result<[Rows; 2], EvaluationError> {
    let [mut mean, mut places] = [Rows::new(), Rows::new()];
    for context in contexts(member, camera, frames, whose)? {
        let channels = context.tokens.shape()[1];
        mean.push(mean_pooled(context.tokens.values(), channels));
        places.push(placed(context.tokens.values(), channels, context.grid.map(Grid::sides)));
    }
    Ok([mean, places])
}

/// Returns what a policy attends to in frames, token by token.
///
/// # Errors
/// As of [`pooled`].
pub(super) fn contexts<'a>(
    member: &mut Member,
    camera: &CameraModel,
    frames: impl Iterator<Item = &'a RgbImage>,
    whose: &str,
) -> Result<Vec<Context>, EvaluationError> {
    frames.map(|frame| member.context(camera, frame, whose)).collect()
}

/// Lays rows of features out as a matrix.
pub(super) fn matrix(rows: &Rows) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), rows.first().map_or(0, Vec::len), |row, column| rows[row][column])
}

fn wide(row: &[f32]) -> Vec<f64> {
    row.iter().map(|value| f64::from(*value)).collect()
}

/// Returns mean and deviation of every feature over the frames of a clip.
fn clip(rows: &[Vec<f64>]) -> Vec<f64> {
    let count = rows.len() as f64;
    let mean = |of: &dyn Fn(usize, f64) -> f64| -> Vec<f64> {
        (0..rows[0].len()).map(|at| rows.iter().map(|row| of(at, row[at])).sum::<f64>() / count).collect()
    };
    let means = mean(&|_, value| value);
    let squares = mean(&|at, value| (value - means[at]).powi(2));
    means.iter().copied().chain(squares.iter().map(|square| square.sqrt())).collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_clip_is_mean_and_deviation() {
        assert_eq!(super::clip(&[vec![1.0, 4.0], vec![3.0, 4.0]]), [2.0, 4.0, 1.0, 0.0]);
    }
}
