//! The tests of this package in one program: what it links is linked once.

mod carry;
mod edits;
mod evaluation;
mod given;
mod pairs;
mod parts;
mod rig;
mod study;
mod words;
