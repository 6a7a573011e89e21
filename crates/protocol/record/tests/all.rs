//! The tests of this package in one program: what it links is linked once.

#[path = "fixture/drive.rs"]
mod drive;
mod independent_reader;
mod journal;
mod mutated;
#[path = "../../../../tests/mutation.rs"]
mod mutation;
mod showing;
