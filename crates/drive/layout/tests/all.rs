//! The tests of this package in one program: what it links is linked once.

mod images;
mod shaders;
#[path = "scenes/street.rs"]
#[expect(dead_code, reason = "the layout needs no whole scene")]
mod street;
