//! The tests of this package in one program: what it links is linked once.

mod bodies;
mod graphics;
#[path = "made/clips.rs"]
mod made;
mod steps;
