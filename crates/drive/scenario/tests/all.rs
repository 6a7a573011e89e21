//! The tests of this package in one program: what it links is linked once.

mod adversary;
mod mutated;
#[path = "../../../../tests/mutation.rs"]
mod mutation;
