//! Plans executed by the tracker on NAVSIM's kinematic bicycle, against states that NAVSIM's own code gave (8 decimals).

use ds_space::angle::wrap;
use ds_space::{DVec2, PoseSe2, SimTime};
use ds_world::{EgoState, TrackerKind, Trajectory, TrajectoryPoint};

use super::*;
use crate::{Profile, Reference};

const WHEEL_BASE_M: f64 = 3.089;
const DT_SECS: f64 = 0.1;

/// One explicit Euler step of 0.1 s with the lags of the published bicycle; returns the new acceleration.
fn euler(ego: &mut EgoState, acceleration_mps2: f64, command: Command) -> f64 {
    let acceleration_mps2 =
        acceleration_mps2 + DT_SECS / (DT_SECS + 0.2) * (command.acceleration_mps2 - acceleration_mps2);
    let speed_mps = ego.speed_mps();
    ego.pose.position += ego.pose.forward() * speed_mps * DT_SECS;
    ego.pose.heading_rad = wrap(ego.pose.heading_rad + speed_mps * ego.steering_rad.tan() / WHEEL_BASE_M * DT_SECS);
    ego.velocity_mps.x += acceleration_mps2 * DT_SECS;
    ego.steering_rad += DT_SECS / (DT_SECS + 0.05) * command.steering_rate_radps * DT_SECS;
    acceleration_mps2
}

/// Executes a plan of 4 s; `expected` holds x, y, heading, speed, steering after 2 s and 4 s.
fn check(start: (PoseSe2, f64), poses: [[f64; 3]; 8], expected: [[f64; 5]; 2]) {
    let points = (1..=8)
        .zip(poses)
        .map(|(i, [x_m, y_m, heading_rad])| TrajectoryPoint {
            after: SimTime::from_secs(0.5 * f64::from(i)),
            pose: PoseSe2::new(x_m, y_m, heading_rad),
        })
        .collect();
    let plan = Trajectory::new(points).expect("the plan is sound");
    let reference = Reference::new(&plan, start.0, SimTime::from_secs(DT_SECS));
    let profile = Profile::of(&reference);
    let mut ego = EgoState { pose: start.0, velocity_mps: DVec2::new(start.1, 0.0), ..EgoState::default() };
    let mut acceleration_mps2 = 0.0;
    for step in 0..40 {
        let now = Moment { reference: &reference, profile: &profile, step, ego: &ego, wheel_base_m: WHEEL_BASE_M };
        let asked = now.command(TrackerKind::Lqr);
        acceleration_mps2 = euler(&mut ego, acceleration_mps2, asked);
        if step % 20 == 19 {
            let position = ego.pose.position;
            let got = [position.x, position.y, ego.pose.heading_rad, ego.speed_mps(), ego.steering_rad];
            for (value, wanted) in got.into_iter().zip(expected[step / 20]) {
                assert!((value - wanted).abs() < 2e-8, "step {step}: {got:?}, expected {:?}", expected[step / 20]);
            }
        }
    }
}

#[test]
fn a_right_turn_is_executed_as_published() {
    check(
        (PoseSe2::new(106.330_537_21, -54.472_827_57, 0.7), 5.0),
        [
            [2.5, 0.0, 0.0],
            [5.0, 0.0, 0.0],
            [7.5, 0.0, 0.0],
            [9.987_333, -0.194_504, -0.195_122],
            [12.356_83, -0.972_04, -0.439_024],
            [14.468_428, -2.298_778, -0.682_927],
            [16.197_134, -4.096_18, -0.926_829],
            [17.440_617, -6.257_852, -1.170_732],
        ],
        [
            [114.145_936_27, -48.267_564_51, 0.541_708_34, 4.981_384_01, -0.184_599_7],
            [123.587_447_88, -47.299_952_45, -0.504_012_13, 4.976_870_75, -0.356_200_64],
        ],
    );
}

#[test]
fn a_fast_accelerating_curve_is_executed_as_published() {
    check(
        (PoseSe2::default(), 10.0),
        [
            [5.25, 0.0, 0.0],
            [11.0, 0.0, 0.0],
            [17.249_473, -0.042_183, -0.037_5],
            [23.966_288, -0.673_735, -0.15],
            [31.052_069, -2.187_103, -0.270_833],
            [38.365_101, -4.736_34, -0.4],
            [45.719_407, -8.460_52, -0.537_5],
            [52.882_886, -13.471_654, -0.683_333],
        ],
        [
            [23.303_016_3, -0.592_375_04, -0.118_716_38, 13.821_997_41, -0.047_778_72],
            [51.610_684_58, -12.547_294_4, -0.706_921_76, 17.002_131_68, -0.049_504_94],
        ],
    );
}

#[test]
fn a_stop_is_executed_as_published() {
    let along_m = [4.583_333, 8.333_333, 11.25, 13.333_333, 14.583_333, 15.0, 15.0, 15.0];
    check(
        (PoseSe2::default(), 10.0),
        along_m.map(|x_m| [x_m, 0.0, 0.0]),
        [[14.446_275_59, 0.0, 0.0, 3.619_828_34, 0.0], [17.499_901_49, 0.0, 0.0, 0.310_460_23, 0.0]],
    );
}
