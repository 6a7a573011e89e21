//! The tests of this package in one program: what it links is linked once.

mod driver;
mod due;
mod faults;
mod fleet;
mod stage;

mod faultsim {
    pub(crate) mod cluster;
    pub(crate) mod orchestrator;
    pub(crate) mod script;
    pub(crate) mod store;
    pub(crate) mod toy;
    pub(crate) mod worker;
}
