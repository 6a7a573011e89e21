//! Every number of the scores, named and cited. SI units, radians.
//!
//! `NAV` autonomousvision/navsim 0a380a9 (v2), `NV1` the same at v1.1 3e8291b, `NUP` motional/nuplan-devkit v1.2,
//! `BS` VAIL-UCLA/BridgeSim 8998fa2, `MD` MetaDrive; `PDM` is `navsim/planning/simulation/planner/pdm_planner`.

/// The version of [`crate::navsim_v2`]; goes into every result.
pub const NAVSIM_V2_VERSION: &str = "navsim_v2/1 (navsim 0a380a9)";
/// The version of [`crate::navsim_v1`]; goes into every result.
pub const NAVSIM_V1_VERSION: &str = "navsim_v1/1 (navsim 3e8291b)";
/// The version of the closed-loop score; a result adds its profile's name.
pub const CLOSED_LOOP_VERSION: &str = "closed_loop/1 (BridgeSim 8998fa2)";

/// Time, horizon and sampling (NAV `default_common.yaml:29-33`).
pub mod horizon {
    /// Time between scored states, in seconds.
    pub const DT_S: f64 = 0.1;
    /// Simulated steps of a plan.
    pub const STEPS: usize = 40;
    /// States of an executed plan, the first being now.
    pub const STATES: usize = STEPS + 1;
    /// Steps for which agents are needed by v1 (NV1: TTC looks 0.9 s beyond the last state).
    pub const V1_AGENT_STEPS: usize = 51;
    /// Microseconds in a second: sample times are whole microseconds (NAV `evaluate/pdm_score.py:70-76`).
    pub const MICROS: f64 = 1e6;
}

/// The NAVSIM car (NUP `vehicle_parameters.py:79,129-136`).
pub mod navsim_car {
    /// Width, in metres.
    pub const WIDTH_M: f64 = 1.1485 * 2.0;
    /// Rear axle to front, in metres.
    pub const AXLE_TO_FRONT_M: f64 = 4.049;
    /// Rear axle to rear, in metres.
    pub const AXLE_TO_REAR_M: f64 = 1.127;
    /// Rear axle to the centre of the box, in metres.
    pub const AXLE_TO_CENTRE_M: f64 = 1.461;
    /// Length, in metres.
    pub const LENGTH_M: f64 = AXLE_TO_FRONT_M + AXLE_TO_REAR_M;
    /// Wheelbase, in metres.
    pub const WHEEL_BASE_M: f64 = 3.089;
}

/// The profiles that the LQR tracker follows (PDM `batch_lqr_utils.py:73-240`); the rest of it is `ds_vehicle::lqr`.
pub mod profile {
    /// Penalty on accelerations; documented as one on jerk, see `scoring.md` §2.
    pub const ACCELERATION_PENALTY: f64 = 1e-4;
    /// Penalty on the first curvature (`batch_lqr_utils.py:13`).
    pub const FIRST_CURVATURE_PENALTY: f64 = 1e-10;
    /// Penalty on curvature rates.
    pub const CURVATURE_RATE_PENALTY: f64 = 1e-2;
}

/// The kinematic bicycle (PDM `simulation/batch_kinematic_bicycle.py:33-51`).
pub mod bicycle {
    /// Time constant of the acceleration, in seconds.
    pub const ACCELERATION_LAG_S: f64 = 0.2;
    /// Time constant of the steering rate, in seconds.
    pub const STEERING_LAG_S: f64 = 0.05;
    /// Largest steering angle, in radians.
    pub const MAX_STEERING_RAD: f64 = std::f64::consts::FRAC_PI_3;
}

/// Thresholds of the NAVSIM sub-metrics (PDM `scoring/pdm_scorer.py:41-73`).
pub mod navsim {
    /// Map elements are taken from around the ego up to this distance, in metres (`pdm_occupancy_map.py:129-186`).
    pub const MAP_RADIUS_M: f64 = 100.0;
    /// At most this speed, in metres per second, is standing still in a collision (`pdm_scorer_utils.py`).
    pub const STOPPED_MPS: f64 = 5e-2;
    /// Below this speed, in metres per second, there is no time to collision.
    pub const TTC_STOPPED_MPS: f64 = 5e-3;
    /// Look-ahead steps of the time to collision.
    pub const TTC_AHEAD: [usize; 4] = [0, 3, 6, 9];
    /// First steps that v2 tests for time to collision: 0..32.
    pub const V2_TTC_STEPS: usize = super::horizon::STATES - 9;
    /// First steps that v1 tests for time to collision: 0..41.
    pub const V1_TTC_STEPS: usize = super::horizon::STATES;
    /// An agent is ahead below this angle, in degrees (NUP `idm/utils.py:20-52`).
    pub const AHEAD_DEG: f64 = 30.0;
    /// An agent is behind above this angle, in degrees (NUP `idm/utils.py:191-202`).
    pub const BEHIND_DEG: f64 = 150.0;
    /// Value of an at-fault collision with a static object.
    pub const STATIC_COLLISION: f64 = 0.5;
    /// Steps before the present one over which wrong-way travel adds up (1 s).
    pub const DIRECTION_STEPS: usize = 10;
    /// Wrong-way travel below this, in metres, is compliant.
    pub const DIRECTION_COMPLIANT_M: f64 = 2.0;
    /// Wrong-way travel below this, in metres, scores ½.
    pub const DIRECTION_VIOLATED_M: f64 = 6.0;
    /// Value between the two.
    pub const DIRECTION_PARTLY: f64 = 0.5;
    /// Progress is compared only if the best is above this, in metres.
    pub const PROGRESS_LEAST_M: f64 = 5.0;
    /// Farther than this from the centreline, in metres, is beside it.
    pub const LANE_OFFSET_M: f64 = 0.5;
    /// Consecutive steps beside the centreline that fail lane keeping (2 s).
    pub const LANE_STEPS: u32 = 20;
    /// Weights of EP, TTC, LK, HC, EC in v2, and of EP, TTC, C in v1 (NV1 `pdm_scorer.py:38-49`).
    pub const PROGRESS_WEIGHT: f64 = 5.0;
    /// See [`PROGRESS_WEIGHT`].
    pub const TTC_WEIGHT: f64 = 5.0;
    /// See [`PROGRESS_WEIGHT`].
    pub const LANE_WEIGHT: f64 = 2.0;
    /// See [`PROGRESS_WEIGHT`].
    pub const COMFORT_WEIGHT: f64 = 2.0;
    /// See [`PROGRESS_WEIGHT`].
    pub const EXTENDED_COMFORT_WEIGHT: f64 = 2.0;
}

/// Comfort limits and filters (PDM `scoring/pdm_comfort_metrics.py:15-154,178-219`).
pub mod comfort {
    /// Longitudinal acceleration, in metres per second squared.
    pub const LON_ACCELERATION: (f64, f64) = (-4.05, 2.40);
    /// Lateral acceleration, in metres per second squared.
    pub const LAT_ACCELERATION: f64 = 4.89;
    /// Change of the acceleration's magnitude, in metres per second cubed.
    pub const JERK_MAGNITUDE: f64 = 8.37;
    /// Longitudinal jerk, in metres per second cubed.
    pub const LON_JERK: f64 = 4.13;
    /// Yaw acceleration, in radians per second squared.
    pub const YAW_ACCELERATION: f64 = 1.93;
    /// Yaw rate, in radians per second.
    pub const YAW_RATE: f64 = 0.95;
    /// Filter windows, in samples: accelerations, jerk, heading.
    pub const ACCELERATION_WINDOW: usize = 8;
    /// See [`ACCELERATION_WINDOW`].
    pub const JERK_WINDOW: usize = 15;
    /// See [`ACCELERATION_WINDOW`].
    pub const HEADING_WINDOW: usize = 5;
    /// Filtered values are rounded to this many decimals: 10 to the power 8.
    pub const ROUNDING: f64 = 1e8;
    /// Sample times of the past before the executed states, in tenths of a second before now (`pdm_scorer.py:656-700`;
    /// −0.1 s is dropped by the reference).
    pub const PAST_TENTHS: std::ops::RangeInclusive<i32> = -15..=-2;
}

/// Extended comfort between two frames (PDM `scoring/pdm_comfort_metrics.py:35-39,397-467`, `scene_aggregator.py:49-77`).
pub mod extended_comfort {
    /// Largest root-mean-square difference of acceleration, in metres per second squared.
    pub const ACCELERATION: f64 = 0.7;
    /// The same of jerk, in metres per second cubed.
    pub const JERK: f64 = 0.5;
    /// The same of yaw rate, in radians per second.
    pub const YAW_RATE: f64 = 0.1;
    /// The same of yaw acceleration, in radians per second squared.
    pub const YAW_ACCELERATION: f64 = 0.1;
    /// Two frames belong together if they are less than this apart, in seconds.
    pub const FARTHEST_S: f64 = 0.55;
}

/// Two-stage aggregation (PDM `scoring/scene_aggregator.py:20-124`).
pub mod two_stage {
    /// Variance of the Gaussian weights, in square metres.
    pub const SIGMA_SQUARED: f64 = 0.1;
    /// A sum of weights at most this is none (`numpy.isclose` to 0).
    pub const NO_WEIGHT: f64 = 1e-8;
}

/// The closed-loop score (BS `evaluation/utils/epdms_scorer_md.py`).
pub mod bridgesim {
    /// Ego box (`:11-12`), in metres.
    pub const EGO_LENGTH_M: f64 = 4.515;
    /// See [`EGO_LENGTH_M`].
    pub const EGO_WIDTH_M: f64 = 1.852;
    /// Below this speed, in metres per second, the ego stands still.
    pub const STOPPED_MPS: f64 = 5e-2;
    /// An object whose centre lies farther behind the ego's than this, in metres, met it from behind (`:570-598`).
    pub const BEHIND_M: f64 = 1.0;
    /// Look-ahead of the time to collision: this many steps (`:600-647`)
    pub const TTC_STEPS: u32 = 5;
    /// of this length, in seconds.
    pub const TTC_STEP_S: f64 = 1.0 / TTC_STEPS as f64;
    /// Lanes near by for drivable area and direction, lane keeping, and lights: bounds within, in metres.
    pub const AREA_RADIUS_M: f64 = 15.0;
    /// See [`AREA_RADIUS_M`].
    pub const KEEPING_RADIUS_M: f64 = 10.0;
    /// See [`AREA_RADIUS_M`].
    pub const LIGHT_RADIUS_M: f64 = 5.0;
    /// Below this speed, in metres per second, any lane may be the best; above it direction and lights count.
    pub const SLOW_MPS: f64 = 1.0;
    /// Farther than this from the lane's centre line, in metres, is beside it.
    pub const LANE_OFFSET_M: f64 = 0.5;
    /// Longer than this beside it, in seconds, fails.
    pub const LANE_WINDOW_S: f64 = 2.0;
    /// A red lane shorter than this, in metres, is the junction itself (`:697-733`).
    pub const SHORT_LANE_M: f64 = 10.0;
    /// Nearer than this to the end of a red lane, in metres, is at its stop line.
    pub const STOP_LINE_M: f64 = 5.0;
    /// Comfort limits: acceleration, jerk, yaw rate (`:758-803`).
    pub const ACCELERATION: f64 = 4.89;
    /// See [`ACCELERATION`].
    pub const JERK: f64 = 8.37;
    /// See [`ACCELERATION`].
    pub const YAW_RATE: f64 = 0.95;
    /// A lane's line is resampled to segments longer than this, in metres (MD `utils/interpolating_line.py:24-60`).
    pub const RESAMPLED_M: f64 = 1.0;
    /// Shorter segments than this, in metres, are none.
    pub const NO_SEGMENT_M: f64 = 1e-6;
    /// The length given to a line without any segment, in metres.
    pub const STATIC_LINE_M: f64 = 0.1;
    /// The expert's path is completed above this share (MD `scenario_env.py:84,90-98`).
    pub const ARRIVED_SHARE: f64 = 0.95;
    /// The route is left farther from it than this, in metres.
    pub const LEFT_ROUTE_M: f64 = 4.0;
    /// The ego drove backwards below this share.
    pub const BACKWARDS_SHARE: f64 = -0.1;
}

/// Numbers of the `strict` profile that come from neither implementation.
pub mod strict {
    /// States of history over which comfort is judged: 1.5 s and now, as the past of HC.
    pub const COMFORT_STATES: usize = 16;
    /// A lane is on the route if at least this share of its centre line near the route lies along it.
    pub const ROUTE_SHARE: f64 = 0.7;
    /// Centre-line points farther from the route than this, in metres, do not lie along it.
    pub const ROUTE_OFFSET_M: f64 = 2.0;
    /// Lanes are sampled at this distance, in metres, when compared with the route.
    pub const ROUTE_SAMPLE_M: f64 = 1.0;
    /// Width, in metres, of a lane whose surface the map does not give.
    pub const LANE_WIDTH_M: f64 = 3.5;
    /// An expert path shorter than this, in metres, measures nothing.
    pub const SHORTEST_EXPERT_M: f64 = 1.0;
}

/// The reference planner (parameters of PDM-Closed, NAV `pdm_closed_planner.yaml`; PDM `proposal/batch_idm_policy.py`).
pub mod planner {
    use ds_vehicle::{Above, Exponent, Form, IdmParameters, Shortest};

    /// Shares of the speed limit that are proposed.
    pub const SPEED_FRACTIONS: [f64; 5] = [0.2, 0.4, 0.6, 0.8, 1.0];
    /// Offsets from the centreline that are proposed, in metres, left positive.
    pub const LATERAL_OFFSETS_M: [f64; 3] = [0.0, 1.0, -1.0];
    /// Speed limit where the map has none, in metres per second.
    pub const FALLBACK_LIMIT_MPS: f64 = 15.0;
    /// Least gap to a leader, in metres; a shorter one counts as this.
    const LEAST_GAP_M: f64 = 1.0;
    /// Largest deceleration, in metres per second squared; comfortable at the same time.
    const DECELERATION_MPS2: f64 = 3.0;
    /// How leaders are followed.
    pub const FOLLOWER: IdmParameters = IdmParameters {
        desired_speed_mps: None,
        minimum_gap_m: LEAST_GAP_M,
        headway_secs: 1.5,
        acceleration_mps2: 1.5,
        deceleration_mps2: DECELERATION_MPS2,
        emergency_deceleration_mps2: DECELERATION_MPS2,
    };
    /// The form of the model.
    pub const FORM: Form = Form {
        exponent: Exponent::Whole(10),
        above: Above::Original,
        shortest: Shortest::Nothing,
        closest_m: LEAST_GAP_M,
    };
    /// Own: time in which the offset is taken up, in seconds.
    pub const EASE_S: f64 = 2.0;
    /// Own: what is nearer to the path's side than this, in metres, is on it.
    pub const SIDE_CLEARANCE_M: f64 = 0.2;
}
