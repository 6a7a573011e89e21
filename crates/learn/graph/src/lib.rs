//! Networks on the machine-learning framework (burn): the only crate that names it.
//!
//! Arrays and weights go in and come out as the plain values of `ds_nn`. Here are the framework's bodies of the patch
//! diffusion transformer ([`dit`]) and the tiny streaming autoencoder ([`tiny_ae`]) with one training step of each
//! ([`step`]), the small networks of perception and policy, and what published models are made of ([`published`]). Training and
//! inference on the processor run on the `flex` back end; [`device`] chooses a graphics processor instead.

mod attention;
pub mod classifier;
pub mod device;
pub mod dit;
mod graph;
pub mod panel;
pub mod planner;
pub mod published;
pub mod segmenter;
pub mod step;
pub mod tiny_ae;

pub use graph::Product;
