//! A simulator of somebody else as the vehicle itself: what it does is what happened.
//!
//! Command path, actuators, sensors and clocks stay those of the plant; its vehicle and road are told to the simulator as in a
//! diagnosis where they differ from nominal.

use std::sync::{Mutex, PoisonError};

use ds_diagnosis::meta::Nominal;
use ds_dynamics::ego::{Actuated, Instant};
use ds_dynamics::motion::{Motion, Window};
use ds_effect::Plant;

use crate::drive::{Rollout, car_of};
use crate::error::SimulatorError;
use crate::process::Process;

/// A running simulator that drives whole logs.
pub struct Reality {
    process: Mutex<Process>,
    nominal: Nominal,
    failure: Mutex<Option<SimulatorError>>,
}

impl Reality {
    /// Starts a simulator.
    ///
    /// # Errors
    /// If it cannot be started, does not answer, or is none that drives.
    pub fn start(command: &str, nominal: &Nominal) -> Result<Self, SimulatorError> {
        let process = Mutex::new(Process::start(command)?);
        Ok(Self { process, nominal: nominal.clone(), failure: Mutex::new(None) })
    }

    /// Takes the last failure, if there was one.
    pub fn failure(&self) -> Option<SimulatorError> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

impl Motion for Reality {
    fn roll(&self, windows: &[Window], actuated: &Actuated, plant: &Plant) -> Vec<Vec<Instant>> {
        let mut process = self.process.lock().unwrap_or_else(PoisonError::into_inner);
        let (reference, hello) = (car_of(&self.nominal.plant(), &self.nominal), process.hello.clone());
        let mut one = |window: &Window| {
            let (start, nominal) = (&window.start, &self.nominal);
            let rollout = Rollout { start, actuated, plant, reference: &reference, nominal, seed: 1 };
            rollout.run(&mut *process, &hello).unwrap_or_else(|error| {
                *self.failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                vec![Instant { x: f64::NAN, ..Instant::default() }]
            })
        };
        windows.iter().map(&mut one).collect()
    }
}
