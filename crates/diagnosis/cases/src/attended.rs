//! Policies look at the frames of a case: how near simulated frames are to real ones for them, before and after the
//! effects of a diagnosis are added.
//!
//! The metric is |φ − φ̃|² / Tr Σ averaged over frames ([`ds_diagnosis::attended`]); its floor is what effect-free frames
//! leave: the twin of aligned streams, effect-free pairs of a generator where there are some, else 0. The camera is taken to
//! be mounted as the one that the policies know, at the height that the case says.

use std::path::{Path, PathBuf};

use ds_diagnosis::Diagnosis;
use ds_diagnosis::attended::{Attended, Difference, METRIC};
use ds_diagnosis::schema::Shrink;
use ds_effect::picture::Picture;
use ds_fidelity::{Compared, Features, TokenSpread, mean_pooled, token_squares};
use ds_frames::{FrameCase, Shown, Streams};
use ds_policy::builtin::{Builtin, builtin};
use ds_policy::camera::eye::known_camera;
use ds_policy::{Grid, Learned, Own, Policy};
use ds_raster::RgbImage;
use ds_space::{CameraModel, DVec3, Digest, DigestWriter, Draws, Intrinsics};
use ds_stats::bootstrap::resamples;
use ds_stats::mean;
use nalgebra::DMatrix;

use crate::error::{CasesError, at};
use crate::folder::folders;

/// Resamples of an interval.
const DRAWS: u64 = 400;
/// Fewest scenes that are drawn as wholes; with fewer, frames are.
const FEWEST_SCENES: usize = 5;

/// The policies that look at frames.
#[derive(Debug, Clone, Default)]
pub struct Panel {
    /// Policies by name, or the manifests of networks.
    pub policies: Vec<String>,
    /// The weights file of the `camera` policy; those of the panel lie in `panel` beside it.
    pub weights: PathBuf,
    /// Effect-free pairs of the generator.
    pub effect_free: Option<PathBuf>,
}

impl Panel {
    /// Returns the digest of who they are.
    ///
    /// # Errors
    /// If a policy is not there or has no features of frames.
    pub fn digest(&self) -> Result<Digest, CasesError> {
        let mut writer = DigestWriter::new();
        for name in &self.policies {
            writer.text(name);
            match (Own::named(name), Learned::of(name)) {
                (Some(manifest), _) => writer.digest(Own::read(&manifest)?.digest()),
                (None, Some(learned)) => {
                    let file = learned.weights_file(&self.weights);
                    learned.trained(&file)?;
                    writer.digest(&Digest::of(&std::fs::read(&file).map_err(at(&file))?))
                }
                (None, None) => return Err(CasesError::TellsNothing { policy: name.clone() }),
            };
        }
        Ok(writer.finish())
    }
}

/// Returns the mean square of some frames in a state.
fn mean_square(rows: &[Row], state: usize) -> f64 {
    mean(rows.iter().map(|row| row.squares[state])).unwrap_or(f64::NAN)
}

/// What one frame of the two streams is to a policy, in the squares of its features.
#[derive(Debug, Clone, Copy)]
struct Row {
    /// Its scene.
    scene: usize,
    /// Nominal, with the ordinary mismatch, corrected, twin.
    squares: [f64; 4],
}

/// What a policy saw of a case.
#[derive(Default)]
struct Seen {
    scenes: Vec<String>,
    rows: Vec<Row>,
    /// What it attends to on all real frames.
    real: Vec<Vec<f64>>,
    grid: Option<Grid>,
    /// All its tokens on all real frames.
    tokens: TokenSpread,
    channels: usize,
    /// Per place, sums of squares before and after.
    places: Vec<[f64; 2]>,
}

/// What policies tell of a case.
#[derive(Debug, Default)]
pub struct Told {
    /// The metric of each.
    pub shrinks: Vec<Shrink>,
    /// What each attends to.
    pub attended: Vec<Attended>,
    /// What is not known.
    pub unknown: Vec<String>,
}

/// Shows a case to policies.
///
/// # Errors
/// If a policy cannot be loaded, tells of nothing that it attends to, or pictures cannot be read.
pub fn attended(
    streams: &Streams,
    diagnosis: &Diagnosis,
    wanted: Option<&dyn Fn(u64) -> bool>,
    panel: &Panel,
) -> Result<Told, CasesError> {
    let data = if wanted.is_some() { "unseen" } else { "heldout" };
    let mut told = Told::default();
    for name in &panel.policies {
        let mut policy = load(name, &panel.weights)?;
        let seen = Seen::of(policy.as_mut(), streams, diagnosis, wanted)?;
        let spread = seen.spread(policy.as_ref())?;
        if seen.rows.is_empty() {
            continue;
        }
        let floor = match (&panel.effect_free, seen.twins()) {
            (_, true) => None,
            (Some(folder), false) => Some(effect_free(policy.as_mut(), folder)?),
            (None, false) => {
                told.unknown.push(format!(
                    "{METRIC}{}: how far effect-free frames lie apart for it is not known, 0 stands in (--nuisance)",
                    policy.name()
                ));
                Some(0.0)
            }
        };
        let (shrink, attended) = seen.summed(policy.name(), spread, floor, data);
        told.shrinks.push(shrink);
        told.attended.push(attended);
    }
    Ok(told)
}

/// Makes a policy that looks at frames.
fn load(name: &str, weights: &Path) -> Result<Box<dyn Policy>, CasesError> {
    Ok(match Own::named(name) {
        Some(manifest) => Box::new(Own::read(&manifest)?),
        None => builtin(name, &Builtin { weights: Some(weights.to_path_buf()) })?,
    })
}

/// Returns the mean square between effect-free pairs, each in units of its own real frames, over a folder of cases.
fn effect_free(policy: &mut dyn Policy, folder: &Path) -> Result<f64, CasesError> {
    let mut found = Vec::new();
    for case in folders(&[folder.to_path_buf()])? {
        let seen = Seen::of(policy, &Streams::read(&case)?, &Diagnosis::blank("effect-free"), Some(&|_| true))?;
        found.push(mean_square(&seen.rows, 0) / seen.spread(policy)?);
    }
    Ok(mean(found).expect("folders that hold no case are refused"))
}

impl Seen {
    fn of(
        policy: &mut dyn Policy,
        streams: &Streams,
        diagnosis: &Diagnosis,
        wanted: Option<&dyn Fn(u64) -> bool>,
    ) -> Result<Self, CasesError> {
        let mut seen = Self::default();
        streams.show(diagnosis, wanted, &mut |shown: Shown| seen.add(policy, &shown))?;
        Ok(seen)
    }

    fn add(&mut self, policy: &mut dyn Policy, shown: &Shown) -> Result<(), CasesError> {
        let camera = camera(&shown.case);
        let mut look = |picture: &Picture| tokens(policy, &camera, picture);
        for frame in shown.case.fit.iter().chain(&shown.case.held) {
            let (tokens, channels, _) = look(&frame.real)?;
            self.real.push(mean_pooled(&tokens, channels));
            self.tokens.add(&tokens);
            self.channels = channels;
        }
        let scene = self.scenes.len();
        self.scenes.push(shown.scene.clone());
        for (k, real) in shown.real.iter().enumerate() {
            let (real, channels, grid) = look(real)?;
            let pooled = mean_pooled(&real, channels);
            let mut squares = [f64::NAN; 4];
            let states = shown.simulated.iter().map(|state| &state[k]).chain(shown.twin.as_ref().map(|twin| &twin[k]));
            for (state, picture) in states.enumerate() {
                let (simulated, ..) = look(picture)?;
                squares[state] = square(&pooled, &mean_pooled(&simulated, channels));
                let side = match state {
                    0 => 0,
                    2 => 1,
                    _ => continue,
                };
                self.places.resize(real.len() / channels, [0.0; 2]);
                for (place, square) in self.places.iter_mut().zip(token_squares(&real, &simulated, channels)) {
                    place[side] += square;
                }
            }
            self.grid = grid;
            self.rows.push(Row { scene, squares });
        }
        Ok(())
    }

    /// Says whether effect-free twins were shown.
    fn twins(&self) -> bool {
        self.rows.iter().all(|row| row.squares[3].is_finite())
    }

    /// Returns Tr Σ over the real frames.
    ///
    /// # Errors
    /// If the policy sees the same in all of them.
    fn spread(&self, policy: &dyn Policy) -> Result<f64, CasesError> {
        let columns = self.real.first().map_or(0, Vec::len);
        let rows = DMatrix::from_fn(self.real.len(), columns, |row, column| self.real[row][column]);
        Ok(Compared::new(policy.name(), Features(vec![rows]))?.variance())
    }

    fn summed(&self, policy: &str, spread: f64, floor: Option<f64>, data: &str) -> (Shrink, Attended) {
        let figures = |rows: &[Row]| {
            let of = |state: usize| mean_square(rows, state) / spread;
            [of(0), of(1), of(2), floor.unwrap_or_else(|| of(3))]
        };
        let scenes: Vec<Vec<Row>> = (0..self.scenes.len())
            .map(|scene| self.rows.iter().filter(|row| row.scene == scene).copied().collect())
            .collect();
        let units: Vec<Vec<Row>> = if scenes.len() >= FEWEST_SCENES {
            scenes.clone()
        } else {
            self.rows.iter().map(|row| vec![*row]).collect()
        };
        let draws = Draws::from_seed(9, "frame_bootstrap");
        let drawn: Vec<[f64; 4]> = resamples(&draws, DRAWS, units.len())
            .map(|picks| figures(&picks.into_iter().flat_map(|unit| units[unit].iter().copied()).collect::<Vec<_>>()))
            .collect();
        let shrink = Shrink::new(&format!("{METRIC}{policy}"), figures(&self.rows), &drawn, data);
        let mut by_scene: Vec<Difference> = self
            .scenes
            .iter()
            .zip(&scenes)
            .filter(|(_, rows)| !rows.is_empty())
            .map(|(scene, rows)| {
                let [before, _, after, _] = figures(rows);
                Difference { scene: Some(scene.clone()), before, after }
            })
            .collect();
        by_scene.sort_by(|a, b| b.before.total_cmp(&a.before));
        let unit = self.tokens.of_a_token(self.channels) * self.rows.len() as f64;
        let place = |sums: &[f64; 2]| Difference { scene: None, before: sums[0] / unit, after: sums[1] / unit };
        let places = self.places.iter().map(place).collect();
        let (grid, ground) = (self.grid.map(Grid::sides), matches!(self.grid, Some(Grid::Ground(_))));
        (shrink, Attended { policy: policy.to_owned(), scenes: by_scene, grid, ground, places })
    }
}

/// What a policy attends to of one picture: tokens one behind the other, channels of each, the grid that they are places of.
type Tokens = (Vec<f32>, usize, Option<Grid>);

fn tokens(policy: &mut dyn Policy, camera: &CameraModel, picture: &Picture) -> Result<Tokens, CasesError> {
    let frame = frame(picture);
    let context = policy.context(std::slice::from_ref(camera), std::slice::from_ref(&frame))?;
    let context = context.ok_or_else(|| CasesError::TellsNothing { policy: policy.name().to_owned() })?;
    let channels = context.tokens.shape().last().copied().unwrap_or(1);
    Ok((context.tokens.into_values(), channels, context.grid))
}

/// Returns the camera of a case: its own lens, mounted as the one that the policies know.
fn camera(case: &FrameCase) -> CameraModel {
    let known = known_camera();
    let [width_px, height_px] = case.size.map(|side| u32::try_from(side).unwrap_or(u32::MAX));
    let lens = &case.camera;
    let intrinsics = Intrinsics {
        width_px,
        height_px,
        fx_px: lens.fx,
        fy_px: lens.fy,
        cx_px: lens.cx,
        cy_px: lens.cy,
        k1: 0.0,
        k2: 0.0,
    };
    let mut mounted = CameraModel { intrinsics, ..known };
    if let Some(height_m) = case.camera_height_m {
        let place = mounted.rig_from_camera.translation;
        mounted.rig_from_camera.translation = DVec3::new(place.x, place.y, height_m);
    }
    mounted
}

fn frame(picture: &Picture) -> RgbImage {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "held within 8 bits just before")]
    let byte = |value: &f32| value.round().clamp(0.0, 255.0) as u8;
    let rgb = match picture.channels {
        1 => picture.data.iter().flat_map(|value| [byte(value); 3]).collect(),
        _ => picture.data.iter().map(byte).collect(),
    };
    let side = |pixels: usize| u32::try_from(pixels).expect("a case's pictures have at most 8192 px a side");
    RgbImage::new(side(picture.width), side(picture.height), rgb).expect("a picture has three values for each pixel")
}

fn square(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

#[cfg(test)]
mod tests;
