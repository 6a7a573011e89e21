//! Physical effects that a simulator may leave out, each a typed operator inserted at one point of the loop.
//!
//! An effect says which values are usual, where it can show and how it changes the plain values of a [`Plant`]; at its
//! neutral value it leaves them untouched, bit for bit. To add one: write a file with one [`Effect`] and name it in
//! [`library`], or one [`FrameEffect`] and [`frame_library`] for effects on pictures. Nothing is fitted or read here.

mod actuator;
mod agent;
mod camera;
pub mod chain;
mod clock;
mod command;
mod follower;
pub mod frame;
pub mod law;
mod map;
mod parameter;
pub mod picture;
pub mod plant;
mod road;
mod sensor;
mod setting;
pub mod signal;
mod vehicle;
mod verdict;
mod video;

pub use frame::{FrameChain, FrameEffect};
pub use law::{Law, LawError, Port};
pub use parameter::{Channel, Insertion, Nuisance, Parameter, Scale};
pub use plant::Plant;
pub use setting::{Setting, SettingError, acts_on_the_world, check};
pub use verdict::Verdict;

/// One effect: what is known of it beforehand and what it does to the simulator.
pub struct Effect {
    /// Name in labels and reports.
    pub id: &'static str,
    /// Point of the loop at which it acts.
    pub insertion: Insertion,
    /// Its parameters; the first is the one that is reported as its value.
    pub parameters: &'static [Parameter],
    /// Channels in which it can show.
    pub channels: &'static [Channel],
    /// Whether a diagnosis may accuse it; a mismatch that every vehicle has is fitted but never accused.
    pub suspect: bool,
    /// Edits the simulator; takes one value per parameter, in reported units.
    pub apply: fn(&[f64], &mut Plant),
}

impl Effect {
    /// Tells whether only a recording with a scene can show the effect: what others decide, and the map.
    #[must_use]
    pub fn needs_scene(&self) -> bool {
        self.insertion == Insertion::Map || self.channels.iter().any(|channel| channel.of_scene())
    }

    /// Returns the values at which the effect is absent, in reported units.
    #[must_use]
    pub fn neutral(&self) -> Vec<f64> {
        self.parameters.iter().map(|p| p.reported(p.neutral, 1.0)).collect()
    }
}

/// Returns every effect that acts on vehicle, road, sensors, clocks, other road users and the map, in a fixed order.
#[must_use]
pub fn library() -> &'static [&'static Effect] {
    LIBRARY
}

/// Returns every effect that acts on frames, in the order in which a chain applies them.
#[must_use]
pub fn frame_library() -> &'static [&'static FrameEffect] {
    FRAME_LIBRARY
}

/// Returns the effect on frames of a name.
#[must_use]
pub fn find_frame(id: &str) -> Option<&'static FrameEffect> {
    FRAME_LIBRARY.iter().copied().find(|effect| effect.id == id)
}

/// Returns the effect of a name.
#[must_use]
pub fn find(id: &str) -> Option<&'static Effect> {
    LIBRARY.iter().copied().find(|effect| effect.id == id)
}

const LIBRARY: &[&Effect] = &[
    // command path
    &command::steer_delay::EFFECT,
    &command::accel_delay::EFFECT,
    &command::cmd_hold_rate::EFFECT,
    &command::deadzone_accel::EFFECT,
    // actuators
    &actuator::steer_lag::EFFECT,
    &actuator::steer_rate::EFFECT,
    &actuator::steer_saturation::EFFECT,
    &actuator::steer_backlash::EFFECT,
    &actuator::steer_gain::EFFECT,
    &actuator::steer_offset::EFFECT,
    &actuator::accel_lag::EFFECT,
    &actuator::accel_jerk_limit::EFFECT,
    &actuator::drive_gain::EFFECT,
    &actuator::brake_gain::EFFECT,
    &actuator::brake_fade::EFFECT,
    &actuator::power_limit::EFFECT,
    // vehicle
    &vehicle::payload::EFFECT,
    &vehicle::front_grip::EFFECT,
    &vehicle::rear_grip::EFFECT,
    &vehicle::mu::EFFECT,
    &vehicle::yaw_inertia::EFFECT,
    &vehicle::tyre_relaxation::EFFECT,
    &vehicle::cg_shift::EFFECT,
    &vehicle::drag_add::EFFECT,
    &vehicle::roll_add::EFFECT,
    &vehicle::kinematic_only::EFFECT,
    // road and air
    &road::grade::EFFECT,
    &road::bank::EFFECT,
    &road::wind_steady::EFFECT,
    // sensors
    &sensor::gyro_bias::EFFECT,
    &sensor::gyro_scale::EFFECT,
    &sensor::ax_bias::EFFECT,
    &sensor::ay_bias::EFFECT,
    &sensor::suspension_roll::EFFECT,
    &sensor::imu_misalignment::EFFECT,
    &sensor::wheel_scale::EFFECT,
    &sensor::lever_arm::EFFECT,
    // clocks and transport
    &clock::pose_latency::EFFECT,
    &clock::imu_latency::EFFECT,
    &clock::clock_drift::EFFECT,
    &clock::obs_latency::EFFECT,
    &clock::timestamp_jitter::EFFECT,
    &clock::dropped_frames::EFFECT,
    // following drivers
    &follower::tr_delay::EFFECT,
    &follower::tr_headway::EFFECT,
    &follower::tr_v0::EFFECT,
    &follower::tr_accel::EFFECT,
    &follower::tr_brake::EFFECT,
    &follower::tr_min_gap::EFFECT,
    // what other road users decide
    &agent::lane_change_politeness::EFFECT,
    &agent::non_yielding::EFFECT,
    &agent::pedestrian_behaviour::EFFECT,
    &agent::log_replay_not_reactive::EFFECT,
    // the map
    &map::lane_offset::EFFECT,
    &map::missing_lane::EFFECT,
    &map::missing_crosswalk::EFFECT,
    &map::stop_line_shift::EFFECT,
    // mismatch of every vehicle
    &actuator::servo_order::EFFECT,
    &clock::encoder_latency::EFFECT,
    &clock::wheel_latency::EFFECT,
    &sensor::wheel_slip::EFFECT,
    &vehicle::tyre_knee::EFFECT,
    &vehicle::drive_split::EFFECT,
    &vehicle::load_transfer::EFFECT,
    &follower::tr_lag::EFFECT,
];

const FRAME_LIBRARY: &[&FrameEffect] = &[
    // the video model
    &video::condition_delay::EFFECT,
    &video::object_dropout::EFFECT,
    &video::object_hallucination::EFFECT,
    &video::identity_switch::EFFECT,
    &video::layout_misalignment::EFFECT,
    &video::texture_washing::EFFECT,
    &video::rollout_drift::EFFECT,
    &video::temporal_flicker::EFFECT,
    // where the camera looks from
    &camera::mount_position::EFFECT,
    &camera::mount_pitch::EFFECT,
    &camera::mount_yaw::EFFECT,
    &camera::mount_roll::EFFECT,
    &camera::focal_error::EFFECT,
    &camera::radial_distortion::EFFECT,
    &camera::rolling_shutter::EFFECT,
    // air and light
    &camera::fog_haze::EFFECT,
    &camera::night_illumination::EFFECT,
    &camera::rain_streaks::EFFECT,
    // lens, shutter, exposure
    &camera::motion_blur::EFFECT,
    &camera::defocus::EFFECT,
    &camera::lens_dirt::EFFECT,
    &camera::vignetting::EFFECT,
    &camera::exposure_lag::EFFECT,
    &camera::white_balance::EFFECT,
    &camera::gamma::EFFECT,
    &camera::sensor_noise::EFFECT,
    // encoder and transport
    &camera::jpeg_loss::EFFECT,
    &camera::obs_latency::EFFECT,
    &video::dropped_frames::EFFECT,
];
