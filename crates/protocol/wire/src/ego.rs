//! Topic `ego`, and the ego state that `world` and `scene` hold as well.

use ds_topic::Ego;
use ds_world::{EgoState, RouteCommand};

use crate::error::FieldError;
use crate::field::{choice, enumeration, number, part};
use crate::v1;

enumeration!(v1::RouteCommand, RouteCommand, { Straight = Straight, Left = Left, Right = Right });

impl From<&EgoState> for v1::EgoState {
    fn from(value: &EgoState) -> Self {
        Self {
            pose: Some((&value.pose).into()),
            velocity_mps: Some(value.velocity_mps.into()),
            yaw_rate_radps: Some(value.yaw_rate_radps),
            acceleration_mps2: Some(value.acceleration_mps2.into()),
            steering_rad: Some(value.steering_rad),
            steering_rate_radps: Some(value.steering_rate_radps),
        }
    }
}

impl TryFrom<v1::EgoState> for EgoState {
    type Error = FieldError;
    fn try_from(message: v1::EgoState) -> Result<Self, FieldError> {
        Ok(Self {
            pose: part("pose", message.pose)?,
            velocity_mps: part("velocity_mps", message.velocity_mps)?,
            yaw_rate_radps: number("yaw_rate_radps", message.yaw_rate_radps)?,
            acceleration_mps2: part("acceleration_mps2", message.acceleration_mps2)?,
            steering_rad: number("steering_rad", message.steering_rad)?,
            steering_rate_radps: number("steering_rate_radps", message.steering_rate_radps)?,
        })
    }
}

impl From<&Ego> for v1::Ego {
    fn from(value: &Ego) -> Self {
        Self {
            header: None,
            estimate: Some((&value.estimate).into()),
            command: v1::RouteCommand::from(value.command).into(),
        }
    }
}

impl TryFrom<v1::Ego> for Ego {
    type Error = FieldError;
    fn try_from(message: v1::Ego) -> Result<Self, FieldError> {
        Ok(Self {
            estimate: part("estimate", message.estimate)?,
            command: choice::<v1::RouteCommand, _>("command", message.command)?,
        })
    }
}
