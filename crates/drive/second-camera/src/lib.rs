//! A second world, for evaluation only: what a model trained on the reference camera has never seen.
//!
//! Other bodies of cars, people, houses and trees, other materials, road styles, sky, sun, tone curve and camera
//! rig; the same scenes and conditions. Nothing of it is shared with the reference camera but the rasteriser and the trait
//! that both implement, so that agreement of results in both worlds is no accident of one renderer. Never used for
//! training; a source of frames for runs and studies.

mod body;
mod camera;
mod cells;
mod material;
mod mesh;
mod motor;
pub mod roads;
mod shadow;
mod sky;
mod street;
mod town;
mod weather;
mod world;

pub use camera::SecondCamera;
pub use world::SecondWorld;
