//! Topic `advance`: the work order and the owners of the roles.

use std::collections::BTreeMap;

use ds_space::{InstanceId, Tick};
use ds_topic::{Advance, Motion, Owner, Role};

use crate::error::FieldError;
use crate::field::{checked, choice, digest, enumeration, list};
use crate::plan::MAX_PROPOSALS;
use crate::v1;

enumeration!(v1::Role, Role, { Sim = Sim, Layout = Layout, Video = Video, Policy = Policy });

impl From<&Advance> for v1::Advance {
    fn from(value: &Advance) -> Self {
        let owner = |(role, owner): (&Role, &Owner)| v1::Owner {
            role: v1::Role::from(*role).into(),
            instance: owner.instance.as_str().to_owned(),
            epoch: owner.epoch,
        };
        let motion = match &value.motion {
            Motion::Initial => v1::advance::Motion::Initial(v1::InitialMotion {}),
            Motion::Log => v1::advance::Motion::Log(v1::LogMotion {}),
            Motion::Plan(plan) => v1::advance::Motion::Plan(plan.into()),
            Motion::Choice(proposals) => {
                v1::advance::Motion::Choice(v1::Choice { proposals: proposals.iter().map(Into::into).collect() })
            }
        };
        Self {
            header: None,
            iteration: value.iteration,
            first_tick: value.first.0,
            last_tick: value.last.0,
            motion: Some(motion),
            border: value.border.0.to_vec().into(),
            plan_due: value.plan_due,
            owners: value.owners.iter().map(owner).collect(),
        }
    }
}

impl TryFrom<v1::Advance> for Advance {
    type Error = FieldError;
    fn try_from(message: v1::Advance) -> Result<Self, FieldError> {
        if message.last_tick < message.first_tick {
            let problem = format!("is {}, before first_tick {}", message.last_tick, message.first_tick);
            return Err(FieldError::new("last_tick", problem));
        }
        let motion = match message.motion {
            Some(v1::advance::Motion::Initial(_)) => Motion::Initial,
            Some(v1::advance::Motion::Log(_)) => Motion::Log,
            Some(v1::advance::Motion::Plan(plan)) => {
                Motion::Plan(plan.try_into().map_err(|error: FieldError| error.below("plan"))?)
            }
            Some(v1::advance::Motion::Choice(choice)) => {
                let proposals: Vec<ds_world::Proposal> =
                    list("proposals", choice.proposals, MAX_PROPOSALS).map_err(|error| error.below("choice"))?;
                if proposals.is_empty() {
                    return Err(FieldError::new("choice.proposals", "is empty"));
                }
                Motion::Choice(proposals)
            }
            None => return Err(FieldError::new("motion", "is missing")),
        };
        Ok(Self {
            iteration: message.iteration,
            first: Tick(message.first_tick),
            last: Tick(message.last_tick),
            motion,
            border: digest("border", &message.border)?,
            plan_due: message.plan_due,
            owners: owners(message.owners)?,
        })
    }
}

fn owners(messages: Vec<v1::Owner>) -> Result<BTreeMap<Role, Owner>, FieldError> {
    let mut owners = BTreeMap::new();
    for (index, message) in messages.into_iter().enumerate() {
        let place = |error: FieldError| error.within("owners", index);
        let role: Role = choice::<v1::Role, _>("role", message.role).map_err(place)?;
        let instance = checked("instance", InstanceId::new(&message.instance)).map_err(place)?;
        if owners.insert(role, Owner { instance, epoch: message.epoch }).is_some() {
            return Err(place(FieldError::new("role", format!("is {role}, which has an owner already"))));
        }
    }
    Ok(owners)
}
