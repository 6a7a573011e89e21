//! Training of the camera policy and of the video model: autoencoder, prior, teacher and student in three stages.
//!
//! The stages of the video model, in order: [`autoencoder`], [`teacher::prior`] (stage 0), [`teacher::teacher`]
//! (stage 1), [`trajectories`] and [`ode`] (stage 2), [`self_forcing`] (stage 3), [`decoder`], [`ship`].
//! Each stage is a function of a configuration that reads and writes files in one folder: it resumes from its last
//! checkpoint, which is replaced atomically, and reports progress through a callback. All randomness is keyed by the
//! configured seed and the step, so that an interrupted run ends as an uninterrupted one.

pub mod autoencoder;
mod batch;
pub mod checkpoint;
pub mod colour;
pub mod condition;
pub mod config;
pub mod cost;
pub mod decoder;
mod emphasis;
mod error;
pub mod evaluate;
pub mod first_frame;
mod frames;
pub mod guidance;
mod lineage;
mod nested;
pub mod ode;
pub mod page;
pub mod policy;
mod recipe;
pub mod self_forcing;
mod sets;
pub mod sheet;
pub mod ship;
pub mod teacher;
#[cfg(test)]
mod tests;
pub mod trajectories;
mod unroll;

pub use config::TrainConfig;
pub use error::TrainError;
pub use recipe::Stage;

/// What a stage tells while it runs.
pub trait Progress {
    /// A step was made: its number (from 1), how many there are, the loss and named figures.
    fn step(&mut self, step: u32, total: u32, loss: f32, figures: &[(&str, f32)]);
    /// Something worth a line happened.
    fn note(&mut self, text: &str);
    /// Says whether to stop after this step; the stage then stores its state and ends.
    fn stop(&self) -> bool {
        false
    }
}

/// Says nothing.
pub struct Silent;

impl Progress for Silent {
    fn step(&mut self, _step: u32, _total: u32, _loss: f32, _figures: &[(&str, f32)]) {}
    fn note(&mut self, _text: &str) {}
}

/// How a stage ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Updates made in all, earlier runs included.
    pub steps: u32,
    /// Mean loss of the last steps.
    pub loss: f32,
    /// Named figures of the evaluation.
    pub figures: Vec<(String, f32)>,
    /// Where the weights are.
    pub weights: std::path::PathBuf,
}
