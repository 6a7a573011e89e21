//! The agents of a case: what their type says, and their boxes state by state.

use ds_score::{AgentTrack, MovingBox, ObjectClass};
use ds_space::{DVec2, PoseSe2};
use serde::Deserialize;

use crate::error::ScoreCaseError;

/// An agent with its size in metres and x, y, heading, vx, vy of each state in which it is there.
#[derive(Deserialize)]
pub(crate) struct AgentFile {
    #[serde(rename = "type")]
    kind: String,
    length: f64,
    width: f64,
    steps: Vec<Option<[f64; 5]>>,
}

/// Takes the field `agents` to tracks, numbered by place.
pub(crate) fn tracks(agents: &[AgentFile]) -> Result<Vec<AgentTrack>, ScoreCaseError> {
    let track = |(id, agent): (u32, &AgentFile)| {
        Ok(AgentTrack {
            id,
            class: class_of(&agent.kind, || format!("agents[{id}].type"))?,
            length_m: agent.length,
            width_m: agent.width,
            steps: agent.steps.iter().map(|step| step.map(moving_box)).collect(),
        })
    };
    (0u32..).zip(agents).map(track).collect()
}

fn moving_box([x, y, heading, vx, vy]: [f64; 5]) -> MovingBox {
    MovingBox { pose: PoseSe2::new(x, y, heading), velocity_mps: DVec2::new(vx, vy) }
}

/// Reads the type of an object.
pub(crate) fn class_of(kind: &str, field: impl FnOnce() -> String) -> Result<ObjectClass, ScoreCaseError> {
    match kind {
        "VEHICLE" | "PEDESTRIAN" | "BICYCLE" | "CYCLIST" | "EGO" => Ok(ObjectClass::Agent),
        "TRAFFIC_CONE" | "CONE" | "BARRIER" | "CZONE_SIGN" | "GENERIC_OBJECT" => Ok(ObjectClass::Static),
        other => Err(ScoreCaseError::Value { field: field(), value: other.to_owned() }),
    }
}
