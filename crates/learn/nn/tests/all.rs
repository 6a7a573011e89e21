//! The tests of this package in one program: what it links is linked once.

mod checkpoints;
#[path = "made/files.rs"]
mod files;
mod spoiled_weights;
