//! The tests of this package in one program: what it links is linked once.

mod clips;
mod generated;
mod mutated;
#[path = "../../../../tests/mutation.rs"]
mod mutation;
mod pair;
mod practice;
mod recovery;
mod spoiled;
