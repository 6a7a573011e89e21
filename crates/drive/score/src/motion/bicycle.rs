//! One explicit Euler step of the kinematic bicycle with lagged commands (PDM `batch_kinematic_bicycle.py:33-51,75-184`).

use ds_space::angle::wrap;
use ds_vehicle::Command;

use super::VehicleState;
use crate::constants::bicycle::{ACCELERATION_LAG_S, MAX_STEERING_RAD, STEERING_LAG_S};
use crate::constants::horizon::DT_S;

pub(crate) fn step(state: &VehicleState, command: Command, wheel_base_m: f64) -> VehicleState {
    let acceleration = state.ax_mps2 + DT_S / (DT_S + ACCELERATION_LAG_S) * (command.acceleration_mps2 - state.ax_mps2);
    let steering_rate = DT_S / (DT_S + STEERING_LAG_S) * command.steering_rate_radps;
    let (sin, cos) = state.heading_rad.sin_cos();
    let speed = state.vx_mps + acceleration * DT_S;
    let steering = (state.steering_rad + steering_rate * DT_S).clamp(-MAX_STEERING_RAD, MAX_STEERING_RAD);
    let yaw_rate = speed * steering.tan() / wheel_base_m;
    let turn = state.vx_mps * state.steering_rad.tan() / wheel_base_m * DT_S;
    VehicleState {
        x_m: state.x_m + state.vx_mps * cos * DT_S,
        y_m: state.y_m + state.vx_mps * sin * DT_S,
        heading_rad: wrap(state.heading_rad + turn),
        vx_mps: speed,
        vy_mps: 0.0,
        ax_mps2: acceleration,
        ay_mps2: 0.0,
        steering_rad: steering,
        steering_rate_radps: steering_rate,
        yaw_rate_radps: yaw_rate,
        yaw_acceleration_radps2: (yaw_rate - state.yaw_rate_radps) / DT_S,
    }
}
