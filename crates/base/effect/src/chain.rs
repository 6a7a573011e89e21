//! A command's way to the wheel: command path, first-order actuator, linkage, over a signal from its first sample on.

use crate::signal::{Context, Operator, Place, lag};

/// A signal behind the actuator: as its own sensor sees it, and as it reaches the wheel.
#[derive(Debug, Clone, PartialEq)]
pub struct Realised {
    /// At the actuator's sensor.
    pub sensed: Vec<f64>,
    /// Behind the linkage.
    pub wheel: Vec<f64>,
}

/// Passes a command through the operators of a chain and its first-order lag; evenly sampled, same length.
#[must_use]
pub fn realise(command: &[f64], lag_secs: f64, operators: &[(Place, Operator)], context: &Context<'_>) -> Realised {
    let run = |signal: &mut [f64], place: Place| {
        for (_, operator) in operators.iter().filter(|(at, _)| *at == place) {
            operator(signal, context);
        }
    };
    let mut sensed = command.to_vec();
    run(&mut sensed, Place::Command);
    lag(&mut sensed, context.step_secs, lag_secs);
    run(&mut sensed, Place::Actuator);
    let mut wheel = sensed.clone();
    run(&mut wheel, Place::Linkage);
    Realised { sensed, wheel }
}
