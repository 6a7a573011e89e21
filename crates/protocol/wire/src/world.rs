//! Topic `world`: ego, agents, lights, contacts and the simulator's snapshot.

use ds_space::{AgentId, SimTime, Tick};
use ds_topic::{Verdict, World};
use ds_world::{AgentClass, AgentState, Contact, ContactKind, LightState, Reading, WorldState};

use crate::error::FieldError;
use crate::field::{choice, choices, digest, enumeration, list, number, part};
use crate::plan::MAX_PROPOSALS;
use crate::v1;

/// The most agents, lights or contacts of a state.
pub const MAX_AGENTS: usize = 4_096;
/// What a car may record of itself in one tick.
pub(crate) const MAX_READINGS: usize = 256;
/// The longest snapshot, in bytes.
pub const MAX_SNAPSHOT_BYTES: usize = 4 << 20;

enumeration!(v1::AgentClass, AgentClass, {
    Vehicle = Vehicle, Pedestrian = Pedestrian, Cyclist = Cyclist, Cone = Cone, Barrier = Barrier,
});
enumeration!(v1::LightState, LightState, { Unknown = Unknown, Red = Red, Yellow = Yellow, Green = Green });
enumeration!(v1::ContactKind, ContactKind, { Front = Front, Side = Side, Rear = Rear });

impl From<&AgentState> for v1::AgentState {
    fn from(value: &AgentState) -> Self {
        Self {
            id: value.id.0,
            agent_class: v1::AgentClass::from(value.class).into(),
            size: Some((&value.size).into()),
            pose: Some((&value.pose).into()),
            z_m: Some(value.z_m),
            velocity_mps: Some(value.velocity_mps.into()),
        }
    }
}

impl TryFrom<v1::AgentState> for AgentState {
    type Error = FieldError;
    fn try_from(message: v1::AgentState) -> Result<Self, FieldError> {
        Ok(Self {
            id: AgentId(message.id),
            class: choice::<v1::AgentClass, _>("agent_class", message.agent_class)?,
            size: part("size", message.size)?,
            pose: part("pose", message.pose)?,
            z_m: number("z_m", message.z_m)?,
            velocity_mps: part("velocity_mps", message.velocity_mps)?,
        })
    }
}

impl From<&Contact> for v1::Contact {
    fn from(value: &Contact) -> Self {
        Self {
            agent: value.agent.0,
            kind: v1::ContactKind::from(value.kind).into(),
            at_fault: value.at_fault,
            closing_speed_mps: Some(value.closing_speed_mps),
        }
    }
}

impl TryFrom<v1::Contact> for Contact {
    type Error = FieldError;
    fn try_from(message: v1::Contact) -> Result<Self, FieldError> {
        Ok(Self {
            agent: AgentId(message.agent),
            kind: choice::<v1::ContactKind, _>("kind", message.kind)?,
            at_fault: message.at_fault,
            closing_speed_mps: number("closing_speed_mps", message.closing_speed_mps)?,
        })
    }
}

impl From<&World> for v1::World {
    fn from(value: &World) -> Self {
        let state = &value.state;
        Self {
            header: None,
            tick: state.tick.0,
            time_ns: state.time.0,
            ego: Some((&state.ego).into()),
            agents: state.agents.iter().map(Into::into).collect(),
            lights: state.lights.iter().map(|light| v1::LightState::from(*light).into()).collect(),
            contacts: state.contacts.iter().map(Into::into).collect(),
            before: value.before.0.to_vec().into(),
            snapshot: value.snapshot.clone().map(Into::into),
            verdict: value.verdict.as_ref().map(|verdict| v1::Verdict {
                chosen: verdict.chosen,
                scores: verdict.scores.clone(),
                reference: Some(verdict.reference),
            }),
            readings: value.readings.iter().map(Into::into).collect(),
        }
    }
}

impl TryFrom<v1::World> for World {
    type Error = FieldError;
    fn try_from(message: v1::World) -> Result<Self, FieldError> {
        let state = WorldState {
            tick: Tick(message.tick),
            time: SimTime(message.time_ns),
            ego: part("ego", message.ego)?,
            agents: list("agents", message.agents, MAX_AGENTS)?,
            lights: choices::<v1::LightState, _>("lights", &message.lights, MAX_AGENTS)?,
            contacts: list("contacts", message.contacts, MAX_AGENTS)?,
        };
        rising("agents", "id", state.agents.iter().map(|agent| agent.id), |before, id| before < id)?;
        rising("contacts", "agent", state.contacts.iter().map(|contact| contact.agent), |before, id| before <= id)?;
        if let Some(bytes) = message.snapshot.as_ref().map(bytes::Bytes::len).filter(|len| *len > MAX_SNAPSHOT_BYTES) {
            return Err(FieldError::new("snapshot", format!("has {bytes} bytes, the limit is {MAX_SNAPSHOT_BYTES}")));
        }
        Ok(Self {
            state,
            before: digest("before", &message.before)?,
            snapshot: message.snapshot.map(Into::into),
            verdict: message.verdict.map(verdict).transpose().map_err(|error| error.below("verdict"))?,
            readings: list("readings", message.readings, MAX_READINGS)?,
        })
    }
}

impl From<&Reading> for v1::Reading {
    fn from(value: &Reading) -> Self {
        Self {
            secs: Some(value.secs),
            cmd_steer_rad: Some(value.cmd_steer_rad),
            cmd_accel_mps2: Some(value.cmd_accel_mps2),
            x_m: Some(value.x_m),
            y_m: Some(value.y_m),
            yaw_rad: Some(value.yaw_rad),
            speed_mps: Some(value.speed_mps),
            yaw_rate_radps: Some(value.yaw_rate_radps),
            ax_mps2: Some(value.ax_mps2),
            ay_mps2: Some(value.ay_mps2),
            steering_rad: Some(value.steering_rad),
            wheel_speed_mps: Some(value.wheel_speed_mps),
        }
    }
}

impl TryFrom<v1::Reading> for Reading {
    type Error = FieldError;
    fn try_from(message: v1::Reading) -> Result<Self, FieldError> {
        Ok(Self {
            secs: number("secs", message.secs)?,
            cmd_steer_rad: number("cmd_steer_rad", message.cmd_steer_rad)?,
            cmd_accel_mps2: number("cmd_accel_mps2", message.cmd_accel_mps2)?,
            x_m: number("x_m", message.x_m)?,
            y_m: number("y_m", message.y_m)?,
            yaw_rad: number("yaw_rad", message.yaw_rad)?,
            speed_mps: number("speed_mps", message.speed_mps)?,
            yaw_rate_radps: number("yaw_rate_radps", message.yaw_rate_radps)?,
            ax_mps2: number("ax_mps2", message.ax_mps2)?,
            ay_mps2: number("ay_mps2", message.ay_mps2)?,
            steering_rad: number("steering_rad", message.steering_rad)?,
            wheel_speed_mps: number("wheel_speed_mps", message.wheel_speed_mps)?,
        })
    }
}

fn verdict(message: v1::Verdict) -> Result<Verdict, FieldError> {
    if message.scores.len() > MAX_PROPOSALS || message.scores.len() <= message.chosen as usize {
        let problem = format!("is {} of {} scores, at most {MAX_PROPOSALS}", message.chosen, message.scores.len());
        return Err(FieldError::new("chosen", problem));
    }
    for (index, score) in message.scores.iter().enumerate() {
        if !(0.0..=1.0).contains(score) {
            return Err(FieldError::new(&format!("scores[{index}]"), format!("is {score}, not 0 to 1")));
        }
    }
    Ok(Verdict { chosen: message.chosen, scores: message.scores, reference: number("reference", message.reference)? })
}

/// Refuses a list whose ids are out of order.
fn rising(
    list: &str,
    field: &str,
    ids: impl Iterator<Item = AgentId>,
    in_order: fn(AgentId, AgentId) -> bool,
) -> Result<(), FieldError> {
    let mut before: Option<AgentId> = None;
    for (index, id) in ids.enumerate() {
        if let Some(before) = before.filter(|before| !in_order(*before, id)) {
            return Err(FieldError::new(field, format!("is {id}, after {before}")).within(list, index));
        }
        before = Some(id);
    }
    Ok(())
}
