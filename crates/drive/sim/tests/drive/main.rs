//! Drives whole simulations over scenes made by formula: tracking, traffic, resuming, odd scenes.

mod behaviour;
mod effects;
mod odd;
mod resume;
mod street;
mod town;
mod tracking;
mod traffic;
