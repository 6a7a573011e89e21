//! What the car records of itself: its past as sensors and clocks show it, with noise.
//!
//! Samples lie in the middle of equal parts of a tick, so that a command that changes at ticks is seen half a part
//! early or late, not always late. Noise of sample `k` is a function of key and `k` alone.

use ds_effect::plant::{Clock, Plant};
use ds_effect::{Channel, Port};
use ds_space::{Digest, Draws};
use ds_world::Reading;

use crate::actuation::{Known, Moment, Past};

/// Samples of the vehicle log per second, where a tick is a multiple of their distance.
pub const LOG_HZ: f64 = 20.0;

/// Standard deviations of the sensors: position, heading, speed, gyro, accelerometers, steering, wheel speed.
const NOISE: [f64; 7] = [0.012, 0.0018, 0.025, 0.0028, 0.09, 0.0006, 0.03];
/// No sample repeats one farther back.
const MOST_REPEATS: u64 = 20;

/// The sensors at the end of a tick.
pub(crate) struct Sensing<'a> {
    pub(crate) plant: &'a Plant,
    pub(crate) past: &'a Past,
    /// What is known of each law's terms, over the whole past.
    pub(crate) known: Known,
    pub(crate) now_secs: f64,
    pub(crate) step_secs: f64,
}

/// The sensors' view of one instant, without noise.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    pub(crate) pose: Moment,
    /// Position with the lever arm of the reference point.
    pub(crate) at_m: [f64; 2],
    pub(crate) yaw_rate_radps: f64,
    pub(crate) force_mps2: [f64; 2],
    pub(crate) steering_rad: f64,
    pub(crate) wheel_mps: f64,
}

impl Sensing<'_> {
    fn moment(&self, secs: f64) -> Moment {
        self.past.ago((self.now_secs - secs) / self.step_secs)
    }

    /// Returns what the sensors show at a time, each with its own age.
    pub(crate) fn view(&self, secs: f64) -> View {
        let Plant { sensors, clock, .. } = self.plant;
        let pose = self.moment(secs - clock.pose_latency_secs - clock.pose_drift * secs);
        let inertial = self.moment(secs - clock.imu_latency_secs);
        let (wheel, steering) =
            (self.moment(secs - clock.wheel_latency_secs), self.moment(secs - clock.encoder_latency_secs));
        let added = |channel: Channel, age_secs: f64, moment: &Moment| -> f64 {
            let ago = (self.now_secs - secs + age_secs) / self.step_secs;
            let here = self.plant.laws.iter().zip(&self.known).filter(|(law, _)| law.port() == Port::Sensor(channel));
            here.map(|(law, known)| law.at(|term| at(&known[term], ago), &moment.felt())).sum()
        };
        let (sin, cos) = sensors.misalignment_rad.sin_cos();
        let (ax, ay) = (inertial.ax_mps2, inertial.ay_mps2 * sensors.roll_factor);
        let ahead = sensors.lever_arm_m;
        let pose_age = clock.pose_latency_secs + clock.pose_drift * secs;
        let of_imu = |channel: Channel| added(channel, clock.imu_latency_secs, &inertial);
        let at_m = [
            pose.x_m + ahead * pose.heading_rad.cos() + added(Channel::Dx, pose_age, &pose),
            pose.y_m + ahead * pose.heading_rad.sin() + added(Channel::Dy, pose_age, &pose),
        ];
        let heading_rad = pose.heading_rad + added(Channel::Dyaw, pose_age, &pose);
        let speed_mps = pose.speed_mps + added(Channel::Speed, pose_age, &pose);
        let wheel_mps = wheel.speed_mps * sensors.wheel_factor * (1.0 + sensors.wheel_slip_s2_m * wheel.drive_mps2);
        View {
            pose: Moment { heading_rad, speed_mps, ..pose },
            at_m,
            yaw_rate_radps: inertial.yaw_rate_radps * sensors.gyro_factor
                + sensors.gyro_bias_rad_s
                + of_imu(Channel::YawRate),
            force_mps2: [
                cos * ax + sin * ay + sensors.ax_bias_mps2 + of_imu(Channel::Ax),
                cos * ay - sin * ax + sensors.ay_bias_mps2 + of_imu(Channel::Ay),
            ],
            steering_rad: steering.sensed_rad + added(Channel::SteerMeas, clock.encoder_latency_secs, &steering),
            wheel_mps: wheel_mps + added(Channel::WheelSpeed, clock.wheel_latency_secs, &wheel),
        }
    }

    /// Returns the readings of the last tick, which lasted `tick_secs` and ended as tick number `tick`.
    pub(crate) fn readings(&self, key: &Digest, tick: u32, tick_secs: f64) -> Vec<Reading> {
        let count = (tick_secs * LOG_HZ).round().max(1.0);
        let part_secs = tick_secs / count;
        (0..count as u64)
            .map(|part| {
                let ago = count - part as f64 - 0.5;
                let number = u64::from(tick) * count as u64 + part;
                self.reading(key, number, self.now_secs - ago * part_secs, part_secs)
            })
            .collect()
    }

    fn reading(&self, key: &Digest, number: u64, secs: f64, part_secs: f64) -> Reading {
        let clock = &self.plant.clock;
        let mut fresh = number;
        while fresh > 0 && number - fresh < MOST_REPEATS && repeats(key, fresh, clock) {
            fresh -= 1;
        }
        let draws = Draws::new(key, "vehicle log", &[fresh]);
        let noise = |index: usize, sd: f64| sd * draws.normal(index as u64);
        let seen_at = secs - (number - fresh) as f64 * part_secs + noise(8, clock.jitter_secs);
        let view = self.view(seen_at.min(self.now_secs));
        let sent = self.past.sent_ago((self.now_secs - secs) / self.step_secs);
        let [position, heading, speed, gyro, force, steering, wheel] = NOISE;
        Reading {
            secs,
            cmd_steer_rad: sent.steer_rad,
            cmd_accel_mps2: sent.accel_mps2,
            x_m: view.at_m[0] + noise(0, position),
            y_m: view.at_m[1] + noise(1, position),
            yaw_rad: view.pose.heading_rad + noise(2, heading),
            speed_mps: view.pose.speed_mps + noise(3, speed),
            yaw_rate_radps: view.yaw_rate_radps + noise(4, gyro),
            ax_mps2: view.force_mps2[0] + noise(5, force),
            ay_mps2: view.force_mps2[1] + noise(6, force),
            steering_rad: view.steering_rad + noise(7, steering),
            wheel_speed_mps: view.wheel_mps + noise(9, wheel),
        }
    }
}

/// Returns the entry `ago` sub-steps before the last one; 1 where a term has none.
fn at(known: &[f64], ago: f64) -> f64 {
    let last = known.len().saturating_sub(1);
    known.get((last as f64 - ago).round().clamp(0.0, last as f64) as usize).copied().unwrap_or(1.0)
}

fn repeats(key: &Digest, number: u64, clock: &Clock) -> bool {
    clock.repeated_share > 0.0 && Draws::new(key, "repeated sample", &[number]).uniform(0) < clock.repeated_share
}
