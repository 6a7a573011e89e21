//! The tests of this package in one program: what it links is linked once.

mod bags;
mod logs;
mod suggested;
