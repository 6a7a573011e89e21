//! Traffic on fixed paths: every driver, the expert ego among them, follows its path with the intelligent driver
//! model (Treiber, Hennecke, Helbing 2000), slows for curves, and holds for lights, gaps and times.
//!
//! The rear axle is what runs along the path. All drivers step together, so that each reacts to the others; walkers
//! and standing objects are given. Accelerations and jerks are bounded. SI units.

use ds_space::plane::path::Path;
use ds_space::{DVec2, PoseSe2, Tick};
use ds_world::{AgentClass, LightState, Size, Track, TrackPoint, TrafficLight};

/// Until when a driver may not pass a stop.
#[derive(Debug, Clone)]
pub(crate) enum Until {
    /// The light of this index is green (or yellow and too near to stop).
    Green(usize),
    /// Nobody else whose path leads over the place reaches it within so many seconds.
    Gap(DVec2, f64),
    /// This tick.
    Tick(u32),
}

/// A stop on a driver's path: where its front bumper must halt, and until when.
#[derive(Debug, Clone)]
pub(crate) struct Hold {
    pub at_m: f64,
    pub until: Until,
}

/// A driver: its vehicle, its path and what it wants.
#[derive(Debug, Clone)]
pub(crate) struct Driver {
    pub class: AgentClass,
    pub size: Size,
    pub rear_axle_to_centre_m: f64,
    pub path: Path,
    /// Station of the rear axle at tick 0.
    pub station_m: f64,
    pub speed_mps: f64,
    /// Wanted speeds, each from its tick on; never empty.
    pub wishes: Vec<(u32, f64)>,
    /// How hard it brakes to a lower wish, in m/s².
    pub brake_mps2: f64,
    pub holds: Vec<Hold>,
    pub manner: Manner,
}

/// Bounds of a driver's behaviour.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Manner {
    pub headway_secs: f64,
    pub standstill_m: f64,
    pub max_acceleration_mps2: f64,
    pub max_deceleration_mps2: f64,
    pub max_jerk_mps3: f64,
    pub lateral_mps2: f64,
}

impl Manner {
    /// The expert: within the usual comfort bounds (−4.05 to 2.4 m/s², 4.13 m/s³).
    pub(crate) const EXPERT: Self = Self {
        headway_secs: 1.4,
        standstill_m: 2.5,
        max_acceleration_mps2: 1.8,
        max_deceleration_mps2: 3.9,
        max_jerk_mps3: 3.9,
        lateral_mps2: 2.0,
    };
    /// Everyone else.
    pub(crate) const OTHERS: Self = Self {
        headway_secs: 1.3,
        standstill_m: 2.0,
        max_acceleration_mps2: 1.9,
        max_deceleration_mps2: 6.0,
        max_jerk_mps3: 9.0,
        lateral_mps2: 2.4,
    };
}

/// How a driver moves at one tick.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion {
    pub station_m: f64,
    pub speed_mps: f64,
    pub acceleration_mps2: f64,
}

/// Who else is there at one tick: centre, velocity, size.
struct Body {
    centre: PoseSe2,
    velocity_mps: DVec2,
    size: Size,
    margin_m: f64,
}

impl Driver {
    pub(crate) fn front_m(&self) -> f64 {
        self.rear_axle_to_centre_m + 0.5 * self.size.length_m
    }

    /// Says whether the driver has come to the end of its path.
    pub(crate) fn is_gone(&self, motion: &Motion) -> bool {
        motion.station_m + self.front_m() > self.path.length_m()
    }

    /// Returns the centre and velocity of the body.
    pub(crate) fn point(&self, motion: &Motion) -> TrackPoint {
        let rear = self.path.pose(motion.station_m);
        let yaw_rate = motion.speed_mps * self.path.curvature_pm(motion.station_m);
        let pose = PoseSe2 { position: rear.to_outer(DVec2::new(self.rear_axle_to_centre_m, 0.0)), ..rear };
        let velocity_mps = rear.forward() * motion.speed_mps + rear.left() * (yaw_rate * self.rear_axle_to_centre_m);
        TrackPoint { pose, z_m: 0.0, velocity_mps }
    }

    fn wish_mps(&self, tick: u32) -> f64 {
        self.wishes.iter().rev().find(|(from, _)| *from <= tick).map_or(self.wishes[0].1, |(_, mps)| *mps)
    }

    /// Returns the speeds, metre by metre, from which all curves ahead can be taken.
    fn curve_speeds(&self) -> Vec<f64> {
        let count = self.path.length_m().ceil() as usize + 1;
        let mut speeds = vec![0.0; count];
        let mut after = f64::INFINITY;
        for i in (0..count).rev() {
            let curvature = self.path.curvature_pm(i as f64).abs().max(1e-6);
            let here = (self.manner.lateral_mps2 / curvature).sqrt().min(0.7 / curvature);
            after = here.min((after * after + 2.0 * 1.3).sqrt());
            speeds[i] = after;
        }
        speeds
    }
}

/// Moves all drivers together over `ticks` states, `dt_secs` apart.
pub(crate) fn drive(drivers: &[Driver], tracks: &[Track], lights: &[TrafficLight], ticks: u32) -> Vec<Vec<Motion>> {
    let curves: Vec<Vec<f64>> = drivers.iter().map(Driver::curve_speeds).collect();
    let start =
        |driver: &Driver| Motion { station_m: driver.station_m, speed_mps: driver.speed_mps, acceleration_mps2: 0.0 };
    let mut now: Vec<Motion> = drivers.iter().map(start).collect();
    let mut all: Vec<Vec<Motion>> = now.iter().map(|motion| vec![*motion]).collect();
    for tick in 0..ticks.saturating_sub(1) {
        let bodies = bodies(drivers, &now, tracks, tick);
        let mut next = now.clone();
        for (i, driver) in drivers.iter().enumerate() {
            let curve = curves[i].get(now[i].station_m.max(0.0) as usize).copied().unwrap_or(f64::INFINITY);
            let mut wanted = free(driver, &now[i], tick, curve);
            for (j, body) in bodies.iter().enumerate() {
                if let (true, Some(body)) = (i != j, body) {
                    wanted = wanted.min(follow(driver, &now[i], body));
                }
            }
            for hold in &driver.holds {
                let distance_m = hold.at_m - now[i].station_m - driver.front_m();
                let others = (drivers, now.as_slice(), i);
                if distance_m > -0.5 && blocks(&hold.until, (tick, lights), distance_m, others) {
                    wanted = wanted.min(interact(driver, now[i].speed_mps, 0.0, distance_m + 0.5, 0.6));
                }
            }
            next[i] = step(driver, &now[i], wanted);
            all[i].push(next[i]);
        }
        now = next;
    }
    all
}

fn bodies(drivers: &[Driver], now: &[Motion], tracks: &[Track], tick: u32) -> Vec<Option<Body>> {
    let driven = drivers.iter().zip(now).map(|(driver, motion)| {
        let point = driver.point(motion);
        (!driver.is_gone(motion)).then_some(Body {
            centre: point.pose,
            velocity_mps: point.velocity_mps,
            size: driver.size,
            margin_m: 0.25,
        })
    });
    let given = tracks.iter().map(|track| {
        let margin_m = if track.class == AgentClass::Pedestrian { 0.7 } else { 0.2 };
        track.at(Tick(tick)).map(|point| Body {
            centre: point.pose,
            velocity_mps: point.velocity_mps,
            size: track.size,
            margin_m,
        })
    });
    driven.chain(given).collect()
}

/// Returns the acceleration with nobody ahead.
fn free(driver: &Driver, now: &Motion, tick: u32, curve_mps: f64) -> f64 {
    let wish = driver.wish_mps(tick);
    let target = wish.min(curve_mps).max(0.01);
    let speed = now.speed_mps;
    if speed <= target {
        driver.manner.max_acceleration_mps2 * (1.0 - (speed / target).powi(4))
    } else {
        let hardest = if target < wish { 2.6 } else { driver.brake_mps2 };
        -((speed - target) * 1.5).min(hardest)
    }
}

/// Returns the acceleration that keeps a gap to something moving along the path at `lead_mps`.
fn interact(driver: &Driver, speed_mps: f64, lead_mps: f64, gap_m: f64, standstill_m: f64) -> f64 {
    let manner = &driver.manner;
    let closing = speed_mps * (speed_mps - lead_mps) / (2.0 * (manner.max_acceleration_mps2 * 2.0).sqrt());
    let wanted_m = standstill_m + (speed_mps * manner.headway_secs * f64::from(lead_mps > 0.3) + closing).max(0.0);
    let gap = gap_m.max(0.1);
    let pull = if gap > standstill_m + 0.5 { manner.max_acceleration_mps2 } else { 0.0 };
    pull - manner.max_acceleration_mps2 * (wanted_m / gap).powi(2)
}

fn follow(driver: &Driver, now: &Motion, body: &Body) -> f64 {
    const REACH_M: f64 = 80.0;
    let rear = driver.path.point(now.station_m);
    if rear.distance_squared(body.centre.position) > REACH_M * REACH_M {
        return f64::INFINITY;
    }
    let foot = driver.path.foot(body.centre.position, now.station_m, now.station_m + REACH_M);
    let heading = driver.path.heading_rad(foot.station_m);
    let (sin, cos) = (body.centre.heading_rad - heading).sin_cos();
    let half_across = 0.5 * (sin.abs() * body.size.length_m + cos.abs() * body.size.width_m);
    let half_along = 0.5 * (cos.abs() * body.size.length_m + sin.abs() * body.size.width_m);
    if foot.left_m.abs() - half_across > 0.5 * driver.size.width_m + body.margin_m {
        return f64::INFINITY;
    }
    if foot.station_m < now.station_m + driver.front_m() {
        return f64::INFINITY;
    }
    let gap_m = foot.station_m - half_along - now.station_m - driver.front_m();
    let lead_mps = body.velocity_mps.dot(DVec2::from_angle(heading));
    interact(driver, now.speed_mps, lead_mps, gap_m, driver.manner.standstill_m)
}

/// Says whether a stop holds at this tick.
fn blocks(until: &Until, at: (u32, &[TrafficLight]), distance_m: f64, others: (&[Driver], &[Motion], usize)) -> bool {
    let (drivers, now, me) = others;
    match until {
        Until::Tick(tick) => at.0 < *tick,
        Until::Green(light) => match at.1.get(*light).map(|light| light.at(Tick(at.0))) {
            Some(LightState::Green) | None => false,
            Some(LightState::Yellow) => now[me].speed_mps.powi(2) < 2.0 * 2.8 * distance_m.max(0.1),
            Some(_) => true,
        },
        Until::Gap(place, secs) => {
            distance_m < 25.0
                && drivers.iter().zip(now).enumerate().any(|(j, (other, motion))| {
                    let foot = other.path.nearest(*place);
                    let ahead_m = foot.station_m - motion.station_m - other.front_m();
                    j != me
                        && foot.left_m.abs() < 2.0
                        && !other.is_gone(motion)
                        && ahead_m > -(other.size.length_m + 2.0)
                        && ahead_m < motion.speed_mps.max(2.0) * secs
                })
        }
    }
}

fn step(driver: &Driver, now: &Motion, wanted_mps2: f64) -> Motion {
    const DT_SECS: f64 = 0.1;
    let manner = &driver.manner;
    // The brake is let go before the halt, so that the car does not jerk to a stand.
    let softest = -(2.0 * 0.35 * manner.max_jerk_mps3 * now.speed_mps).sqrt();
    let hardest = softest.max(-manner.max_deceleration_mps2);
    let bounded = wanted_mps2.min(manner.max_acceleration_mps2).max(hardest);
    let change = manner.max_jerk_mps3 * DT_SECS;
    let acceleration = now.acceleration_mps2 + (bounded - now.acceleration_mps2).clamp(-change, change);
    let reached = now.speed_mps + acceleration * DT_SECS;
    let speed_mps = if reached < 0.003 && acceleration <= 0.0 { 0.0 } else { reached.max(0.0) };
    let acceleration = (speed_mps - now.speed_mps) / DT_SECS;
    Motion {
        station_m: now.station_m + 0.5 * (now.speed_mps + speed_mps) * DT_SECS,
        speed_mps,
        acceleration_mps2: acceleration,
    }
}
