//! `lane_change_politeness`: How much drivers weigh what their lane change costs others (MOBIL; Kesting, Treiber and Helbing 2007).
//! The neutral value leaves the simulator untouched.

use crate::plant::NOMINAL_POLITENESS;
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "lane_change_politeness",
    insertion: Insertion::Agent,
    parameters: &[Parameter::linear("politeness", "1", (0.0, 1.0)).absent_at(NOMINAL_POLITENESS)],
    channels: &[Channel::AgentLateral, Channel::AgentDecision],
    suspect: true,
    apply: |values, plant| {
        if (values[0] - NOMINAL_POLITENESS).abs() > 0.0 {
            plant.agents.changes_lanes = true;
            plant.agents.politeness = values[0];
        }
    },
};
