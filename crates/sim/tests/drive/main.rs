//! Drives whole simulations over scenes made by formula: tracking, traffic, resuming, odd scenes.

mod effects;
mod odd;
mod resume;
mod street;
mod tracking;
mod traffic;
