//! The tests of this package in one program: what it links is linked once.

mod baseline;
mod fast;
mod fleets;
mod mutated;
#[path = "../../../../tests/mutation.rs"]
mod mutation;
mod neutral;
mod one_car;
mod own_world;
mod practice;
mod quirks;
mod recovery;
mod rows;
mod spoiled;
mod traces;
mod watch;
