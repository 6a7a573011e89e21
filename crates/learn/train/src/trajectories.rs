//! The teacher's guided trajectories: for each condition the states at the student's levels, and where they end.
//!
//! Conditions are first frames, prompts and layouts of the clip sets; an edited first frame over an unchanged layout
//! (a `diverse` set) is how the student learns looks that its layouts never came with (diverse-scene distillation).
//! Trajectories that lose the look of their first frame are put aside, in the place of the paper's manual review.
//!
//! One file of equal records (`trajectories.bin`), appended in order, so that an interrupted run goes on: how far the
//! look moved, then S + 1 states [F − 1, tokens, 4, z], f32. `trajectories.json` holds the recipe; another recipe in
//! the same folder is refused.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::PathBuf;

use ds_nn::Array;
use ds_nn::step::{ClipBatch, Joins};
use ds_nn::team::Team;
use ds_space::{Digest, DigestWriter, Draws};
use ds_video::ModelConfig;

use crate::Progress;
use crate::batch::joined;
use crate::condition::noise;
use crate::config::{TrainConfig, TrajectoryConfig};
use crate::error::TrainError;
use crate::guidance::{Guidance, Teacher};
use crate::lineage;
use crate::sets::{ClipRef, Sets, Span};
use crate::teacher::later;

const FILE: &str = "trajectories.bin";
/// Latent frames at the end of a trajectory whose look is compared with the first frame's.
const LATE_FRAMES: usize = 2;

/// Trajectories on disk and their conditions.
pub(crate) struct Trajectories {
    path: PathBuf,
    recipe: TrajectoryConfig,
    states: usize,
    frames: usize,
    frame: usize,
    /// Indices of the records that are used.
    kept: Vec<u64>,
}

/// One trajectory.
pub(crate) struct Trajectory {
    /// The condition; its clean latents are the trajectory's end.
    pub(crate) batch: ClipBatch,
    /// States at the student's levels, noisiest first, then the end; each [1, F − 1, tokens, 4, z].
    pub(crate) states: Vec<Array>,
}

/// Makes the configured trajectories, going on where an earlier run stopped.
///
/// # Errors
/// If there is no teacher, a file cannot be used or the folder holds trajectories of another recipe.
pub fn run(config: &TrainConfig, progress: &mut dyn Progress) -> Result<(), TrainError> {
    let recipe = config.trajectories.as_ref().ok_or_else(|| TrainError::no_stage("trajectories"))?;
    let model = config.model()?;
    let steps = model.sampler.steps;
    if !recipe.steps.is_multiple_of(steps) {
        let rule = format!("steps must be a multiple of the sampler's {steps}");
        return Err(TrainError::Config { field: "trajectories", rule });
    }
    let weights = config.weights_of("teacher")?;
    let sets = Sets::open(config, &recipe.sets, progress)?;
    claim(config, recipe, &weights.digest())?;
    let file = Trajectories::layout(config.folder.join(FILE), &model, recipe);
    let teacher = Teacher::new_on(config.backend, &model, &weights, config.unconditional)?;
    let seed = DigestWriter::new().text("trajectories").u64(config.seed).finish();
    let (total, team) = (recipe.count * recipe.sets.len() as u64, Team::of_all_cores());
    let io = || TrainError::io("trajectories", &file.path);
    let mut output = OpenOptions::new().create(true).append(true).open(&file.path).map_err(io())?;
    output.set_len(file.count() * file.record_bytes()).map_err(io())?;
    let indices: Vec<u64> = (file.count()..total).collect();
    let sampler = Sampler { config, recipe, sets: &sets, teacher: &teacher, seed };
    for part in indices.chunks(if config.backend.joins() { 32 } else { 8 }) {
        let drawn = team.run(part.len(), |at| sampler.draw(at, part[at])).into_iter().collect::<Result<Vec<_>, _>>()?;
        let records = if config.backend.joins() {
            sampler.records(drawn)
        } else {
            team.run(drawn.len(), |at| sampler.sampled(&drawn[at])).into_iter().flatten().collect()
        };
        for record in records {
            output.write_all(&record).map_err(io())?;
        }
        let made = part.last().map_or(0, |index| index + 1);
        progress.step(made.min(u64::from(u32::MAX)) as u32, total as u32, 0.0, &[]);
        if progress.stop() {
            return Ok(());
        }
    }
    for (set, name) in (0u64..).zip(&recipe.sets) {
        let indices = (set..total).step_by(recipe.sets.len());
        let moved =
            indices.map(|index| Ok(file.values_of(index, 0, 1)?[0])).collect::<Result<Vec<f32>, TrainError>>()?;
        #[expect(clippy::cast_precision_loss, reason = "a count of trajectories")]
        let mean = moved.iter().sum::<f32>() / moved.len() as f32;
        progress.note(&format!("{name}: the look moved by {mean:.3} from the first frame, mean of {}", moved.len()));
    }
    Ok(())
}

/// Returns the condition of a trajectory: the sets in turn, each set's clips by draw without order.
fn condition(sets: &Sets, recipe: &TrajectoryConfig, index: u64) -> ClipRef {
    let set = (index % recipe.sets.len() as u64) as usize;
    ClipRef { set, clip: (index / recipe.sets.len() as u64) as usize % sets.count(set).max(1) }
}

/// What trajectories begin with.
struct Start {
    /// Where their records stand among those that are made together.
    places: Vec<usize>,
    batch: ClipBatch,
    noise: Array,
    guidance: Guidance,
}

impl Joins for Start {
    fn joins(&self, other: &Self) -> bool {
        self.guidance == other.guidance && self.noise.shape() == other.noise.shape()
    }

    fn joined(parts: &[Self]) -> Self {
        Self {
            places: parts.iter().flat_map(|start| start.places.iter().copied()).collect(),
            batch: ClipBatch::joined(parts.iter().map(|start| &start.batch)),
            noise: Array::joined(parts.iter().map(|start| &start.noise)),
            guidance: parts[0].guidance,
        }
    }
}

struct Sampler<'a> {
    config: &'a TrainConfig,
    recipe: &'a TrajectoryConfig,
    sets: &'a Sets,
    teacher: &'a Teacher,
    seed: Digest,
}

impl Sampler<'_> {
    fn draw(&self, place: usize, index: u64) -> Result<Start, TrainError> {
        let at = condition(self.sets, self.recipe, index);
        let count = self.recipe.latents.min(self.sets.latents(at));
        let batch = self.sets.batch(at, Span { from: 0, count })?;
        let noise = noise(&self.seed, "noise", &[index], &later(&batch));
        let places = vec![place];
        Ok(Start { places, batch, noise, guidance: self.sets.guidance(self.config, self.recipe.guidance, at) })
    }

    /// Samples the trajectories of starts, those that join at once; in their order.
    fn records(&self, starts: Vec<Start>) -> Vec<Vec<u8>> {
        let mut records = vec![Vec::new(); starts.len()];
        for (_, start) in joined(starts) {
            start.places.iter().zip(self.sampled(&start)).for_each(|(place, record)| records[*place] = record);
        }
        records
    }

    /// Samples and writes out each clip's record.
    fn sampled(&self, Start { batch, noise, guidance, .. }: &Start) -> Vec<Vec<u8>> {
        let (steps, z) = (self.recipe.steps, self.teacher.model.vae.z);
        let every = steps / self.teacher.model.sampler.steps;
        let mut states = Vec::new();
        let end = self.teacher.sample(batch, noise, steps, *guidance, &mut |step, state| {
            if step % every == 0 {
                states.push(state.clone());
            }
        });
        states.push(end);
        let clips = batch.layout_on.len();
        let part = |array: &Array, clip: usize| {
            let size = array.values().len() / clips;
            array.values()[clip * size..(clip + 1) * size].to_vec()
        };
        let record = |clip: usize| {
            let states: Vec<Vec<f32>> = states.iter().map(|state| part(state, clip)).collect();
            let moved = moved(&part(&batch.start, clip), states.last().expect("the end is among them"), z);
            std::iter::once(moved).chain(states.into_iter().flatten()).flat_map(f32::to_le_bytes).collect()
        };
        (0..clips).map(record).collect()
    }
}

/// Returns how far the mean of each latent channel moved from the first frame to the last ones, root mean square.
fn moved(first: &[f32], rest: &[f32], z: usize) -> f32 {
    let mean = |values: &[f32]| {
        let mut sums = vec![0.0f32; z];
        values.chunks_exact(z).for_each(|pixel| sums.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += value));
        #[expect(clippy::cast_precision_loss, reason = "a frame has few pixels")]
        let count = (values.len() / z) as f32;
        sums.iter_mut().for_each(|sum| *sum /= count);
        sums
    };
    let late = &rest[rest.len() - (LATE_FRAMES * first.len()).min(rest.len())..];
    let squares: f32 = mean(first).iter().zip(mean(late)).map(|(a, b)| (a - b).powi(2)).sum();
    #[expect(clippy::cast_precision_loss, reason = "there are few channels")]
    let root = (squares / z as f32).sqrt();
    root
}

/// Writes the recipe beside the trajectories, or refuses a folder that holds those of another one.
fn claim(config: &TrainConfig, recipe: &TrajectoryConfig, teacher: &Digest) -> Result<(), TrainError> {
    let path = config.folder.join("trajectories.json");
    std::fs::create_dir_all(&config.folder).map_err(TrainError::io("work folder", &config.folder))?;
    // How many are made and how many are put aside may change later.
    let fixed = TrajectoryConfig { count: 0, reject: 0.0, ..recipe.clone() };
    let text = serde_json::json!({ "teacher": teacher.to_string(), "recipe": fixed, "unconditional": config.unconditional, "keep_look": config.keep_look, "guide_levels": config.guide_levels, "seed": config.seed }).to_string();
    match std::fs::read_to_string(&path) {
        Ok(found) if found == text => Ok(()),
        Ok(found) => {
            let differences = lineage::differences(&keys(&found), &keys(&text)).join(", ");
            let reason =
                format!("the folder holds trajectories of another recipe or teacher: {differences}; remove them first");
            Err(TrainError::Checkpoint { path: path.display().to_string(), reason })
        }
        Err(_) => std::fs::write(&path, text).map_err(TrainError::io("trajectories", &path)),
    }
}

/// Returns what a claim tells, key by key.
fn keys(text: &str) -> BTreeMap<String, String> {
    let mut keys = BTreeMap::new();
    lineage::flatten("", serde_json::from_str(text).unwrap_or_default(), &mut keys);
    keys
}

impl Trajectories {
    fn layout(path: PathBuf, model: &ModelConfig, recipe: &TrajectoryConfig) -> Self {
        Self {
            path,
            recipe: recipe.clone(),
            states: model.sampler.steps + 1,
            frames: recipe.latents - 1,
            frame: model.dit().tokens() * 4 * model.vae.z,
            kept: Vec::new(),
        }
    }

    fn values(&self) -> usize {
        1 + self.states * self.frames * self.frame
    }

    fn record_bytes(&self) -> u64 {
        4 * self.values() as u64
    }

    fn count(&self) -> u64 {
        std::fs::metadata(&self.path).map_or(0, |metadata| metadata.len() / self.record_bytes())
    }

    /// Opens the finished trajectories of some sets (of all without any name) and decides which are kept: per set, those
    /// whose look moved least.
    pub(crate) fn open(config: &TrainConfig, wanted: &[String]) -> Result<Self, TrainError> {
        let recipe = config.trajectories.as_ref().ok_or_else(|| TrainError::no_stage("trajectories"))?;
        let mut file = Self::layout(config.finished(FILE), &config.model()?, recipe);
        let sets = recipe.sets.len() as u64;
        let count = file.count().min(recipe.count * sets);
        if count == 0 {
            let (path, reason) = (file.path.display().to_string(), "no trajectory is made yet".to_owned());
            return Err(TrainError::Checkpoint { path, reason });
        }
        let counts = |set: u64| wanted.is_empty() || wanted.contains(&recipe.sets[set as usize]);
        for set in (0..sets).filter(|set| counts(*set)) {
            let mut moved = Vec::new();
            for index in (set..count).step_by(sets as usize) {
                moved.push((file.values_of(index, 0, 1)?[0], index));
            }
            moved.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a count")]
            let keep = (moved.len() as f64 * (1.0 - recipe.reject)).ceil() as usize;
            file.kept.extend(moved.into_iter().take(keep).map(|(_, index)| index));
        }
        if file.kept.is_empty() {
            return Err(TrainError::Config { field: "ode", rule: "no trajectory is of its sets".to_owned() });
        }
        file.kept.sort_unstable();
        Ok(file)
    }

    /// Returns the names of the sets that conditions come from.
    pub(crate) fn sets(&self) -> &[String] {
        &self.recipe.sets
    }

    fn values_of(&self, index: u64, from: usize, count: usize) -> Result<Vec<f32>, TrainError> {
        let io = || TrainError::io("trajectories", &self.path);
        let mut file = File::open(&self.path).map_err(io())?;
        let mut bytes = vec![0; 4 * count];
        let at = index * self.record_bytes() + 4 * from as u64;
        file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut bytes)).map_err(io())?;
        Ok(bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    }

    /// Draws a trajectory that is kept.
    pub(crate) fn draw(&self, sets: &Sets, draws: &Draws) -> Result<Trajectory, TrainError> {
        let index = self.kept[draws.below(0, self.kept.len() as u64) as usize];
        let at = condition(sets, &self.recipe, index);
        let mut batch = sets.batch(at, Span { from: 0, count: self.frames + 1 })?;
        let values = self.values_of(index, 1, self.values() - 1)?;
        let shape = later(&batch);
        let per_state = self.frames * self.frame;
        let states: Vec<Array> =
            values.chunks_exact(per_state).map(|state| Array::new(&shape, state.to_vec())).collect();
        let end = &values[values.len() - per_state..];
        batch.clean.values_mut()[self.frame..].copy_from_slice(end);
        Ok(Trajectory { batch, states })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_look_that_stays_has_not_moved() {
        let first = [1.0, -2.0, 1.0, -2.0];
        let same = first.repeat(5);
        assert!(moved(&first, &same, 2) < 1e-6);
        let mut later = same.clone();
        later[12..].iter_mut().step_by(2).for_each(|value| *value += 2.0);
        assert!((moved(&first, &later, 2) - 2.0f32.sqrt()).abs() < 1e-5);
    }
}
