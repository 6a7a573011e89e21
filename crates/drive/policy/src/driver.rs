//! A careful privileged driver: steers back to the route and keeps its speed by the intelligent driver model.
//!
//! Steering: a point on the rear axle at offset e and angle ψ to a route of curvature κ follows κ − 2e/L² − 2 sin ψ / L,
//! which takes both to zero without overshoot over the length L (0.8 s of way). Speed: IDM (Treiber et al. 2000) behind
//! whoever is, or by its recorded track will be, in the way when the ego gets there; before red lights; within a lateral
//! acceleration in curves. It serves as the `route-follower` policy and as the teacher of the `camera` policy; these take
//! others from their recorded tracks and do not know how reactive agents will move. The `idm` and `careful` policies take
//! them as they are now, and look at those alone who are in the way.

use ds_space::{DVec2, Digest, PoseSe2, Tick};
use ds_world::{
    AgentState, EgoState, LightState, Scene, Size, TrackPoint, TrafficLight, VehicleParameters, WorldState,
};

use crate::route::{Projection, Route};

const COMFORT_ACCELERATION_MPS2: f64 = 1.8;
const COMFORT_DECELERATION_MPS2: f64 = 2.5;
const HARDEST_DECELERATION_MPS2: f64 = 7.0;
const HEADWAY_SECS: f64 = 1.3;
const STANDSTILL_GAP_M: f64 = 2.5;
const CURVE_ACCELERATION_MPS2: f64 = 2.5;
const SIDE_MARGIN_M: f64 = 0.25;
/// How far ahead, and in which steps, the tracks of others are looked at, in seconds.
const OUTLOOK_SECS: &[f64] = &[0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0];
/// Others are in conflict if they are in the way within this time of the ego's arrival, in seconds.
const CONFLICT_SECS: f64 = 1.2;
const SLOWEST_CRUISE_MPS: f64 = 5.0;

/// Something in the way at a tick, as an interval along the route.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Obstacle {
    rear_m: f64,
    front_m: f64,
    speed_mps: f64,
}

/// Who is in the way when.
#[derive(Debug, Clone)]
struct Traffic {
    /// The tick of the first entry.
    from: Tick,
    by_tick: Vec<Vec<Obstacle>>,
    /// How far ahead others are looked at, in seconds.
    outlook_secs: &'static [f64],
}

/// A driver that is kept between requests because preparing is dear; it holds no state of the drive.
#[derive(Debug, Default)]
pub struct Kept(Option<Driver>);

impl Kept {
    /// Returns the driver of a scenario, prepared if another one was kept.
    pub fn of(&mut self, scene: &Scene) -> &Driver {
        let prepared = self.0.take().filter(|driver| driver.scenario() == scene.digest);
        self.0.insert(prepared.unwrap_or_else(|| Driver::new(scene)))
    }
}

/// A stop line on the route with its light.
#[derive(Debug, Clone)]
struct Signal {
    along_m: f64,
    light: TrafficLight,
}

/// A scenario prepared for driving along its route.
#[derive(Debug, Clone)]
pub struct Driver {
    scenario: Digest,
    route: Route,
    vehicle: VehicleParameters,
    dt_secs: f64,
    /// Speed allowed by curves, one entry per metre of the route.
    curve_limit_mps: Vec<f64>,
    cruise_mps: f64,
    /// Half of what the car needs of the road's width, in metres.
    half_width_m: f64,
    /// The recorded traffic.
    recorded: Traffic,
    signals: Vec<Signal>,
}

impl Driver {
    /// Measures the route and finds at which ticks whom is in its way.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let start = scene.ego_log.first().map(|state| state.pose).unwrap_or_default();
        let route = Route::new(&scene.route, &start);
        let fastest = scene.ego_log.iter().map(EgoState::speed_mps).fold(SLOWEST_CRUISE_MPS, f64::max);
        let half_width = 0.5 * scene.vehicle.size.width_m + SIDE_MARGIN_M;
        let ticks = scene.ego_log.len();
        let mut obstacles = vec![Vec::new(); ticks];
        for track in &scene.tracks {
            for (tick, found) in obstacles.iter_mut().enumerate() {
                let point = track.points.get(tick).and_then(Option::as_ref);
                found.extend(point.and_then(|point| in_the_way(&route, point, track.size, half_width)));
            }
        }
        Self {
            scenario: scene.digest,
            curve_limit_mps: curve_limits(&route, fastest),
            signals: signals(&route, scene),
            route,
            vehicle: scene.vehicle,
            dt_secs: scene.dt.secs(),
            cruise_mps: fastest,
            half_width_m: half_width,
            recorded: Traffic { from: Tick(0), by_tick: obstacles, outlook_secs: OUTLOOK_SECS },
        }
    }

    /// Returns the digest of the prepared scenario.
    #[must_use]
    pub fn scenario(&self) -> Digest {
        self.scenario
    }

    /// Returns the route.
    #[must_use]
    pub fn route(&self) -> &Route {
        &self.route
    }

    /// Returns who is in the way at the next `steps` ticks if all agents keep their velocity; later is not looked ahead.
    fn live(&self, agents: &[AgentState], tick: Tick, steps: u32) -> Traffic {
        let at = |step: u32| {
            let secs = f64::from(step) * self.dt_secs;
            let found = agents.iter().filter_map(|agent| {
                let position = agent.pose.position + agent.velocity_mps * secs;
                let pose = PoseSe2 { position, ..agent.pose };
                let point = TrackPoint { pose, z_m: agent.z_m, velocity_mps: agent.velocity_mps };
                in_the_way(&self.route, &point, agent.size, self.half_width_m)
            });
            found.collect()
        };
        Traffic { from: tick, by_tick: (0..steps).map(at).collect(), outlook_secs: &[0.0] }
    }

    /// Drives on among recorded traffic and returns the world poses after each of the next `steps` ticks.
    #[must_use]
    pub fn drive(&self, ego: &EgoState, tick: Tick, steps: u32) -> Vec<PoseSe2> {
        self.drive_among(&self.recorded, ego, tick, steps)
    }

    /// Drives on among the agents of a state, each of which keeps its velocity, as [`Driver::drive`].
    #[must_use]
    pub fn drive_live(&self, now: &WorldState, ego: &EgoState, steps: u32) -> Vec<PoseSe2> {
        self.drive_among(&self.live(&now.agents, now.tick, steps), ego, now.tick, steps)
    }

    fn drive_among(&self, traffic: &Traffic, ego: &EgoState, tick: Tick, steps: u32) -> Vec<PoseSe2> {
        self.go(ego, steps, |along_m, speed_mps, step| self.acceleration(traffic, along_m, speed_mps, tick.plus(step)))
    }

    /// Brakes on the way back to the route, from the present deceleration by a jerk to the hardest one (m/s³, m/s²).
    #[must_use]
    pub fn brake(&self, ego: &EgoState, (jerk_mps3, hardest_mps2): (f64, f64), steps: u32) -> Vec<PoseSe2> {
        let from_mps2 = ego.acceleration_mps2.x.min(0.0);
        self.go(ego, steps, |_, _, step| {
            (from_mps2 - jerk_mps3 * f64::from(step + 1) * self.dt_secs).max(-hardest_mps2)
        })
    }

    /// Drives on with an acceleration of the distance along the route, the speed and the step.
    fn go(&self, ego: &EgoState, steps: u32, acceleration: impl Fn(f64, f64, u32) -> f64) -> Vec<PoseSe2> {
        let mut pose = ego.pose;
        let mut speed_mps = ego.speed_mps().max(0.0);
        let mut at = self.route.project_pose(&pose);
        let mut driven = Vec::with_capacity(steps as usize);
        for step in 0..steps {
            let acceleration = acceleration(at.along_m, speed_mps, step);
            let curvature = self.steer(&pose, at, speed_mps);
            let next_mps = (speed_mps + acceleration * self.dt_secs).max(0.0);
            let way_m = 0.5 * (speed_mps + next_mps) * self.dt_secs;
            let turn = curvature * way_m;
            let chord = PoseSe2::new(way_m * (0.5 * turn).cos(), way_m * (0.5 * turn).sin(), turn);
            pose = pose.compose(&chord);
            speed_mps = next_mps;
            at = self.route.project_within(pose.position, at.along_m - 3.0, at.along_m + way_m + 3.0);
            driven.push(pose);
        }
        driven
    }

    fn steer(&self, pose: &PoseSe2, at: Projection, speed_mps: f64) -> f64 {
        let length = (0.8 * speed_mps + 2.0).clamp(4.0, 14.0);
        let heading_error = ds_space::angle::turn(self.route.heading_rad(at.along_m), pose.heading_rad);
        let offset = at.left_m.clamp(-0.4 * length, 0.4 * length);
        let wanted = self.route.curvature(at.along_m + 0.1 * speed_mps)
            - 2.0 * offset / (length * length)
            - 2.0 * heading_error.sin() / length;
        let most =
            (self.vehicle.max_steering_rad.tan() / self.vehicle.wheel_base_m).min(4.0 / speed_mps.powi(2).max(1.0));
        wanted.clamp(-most, most)
    }

    fn acceleration(&self, traffic: &Traffic, along_m: f64, speed_mps: f64, tick: Tick) -> f64 {
        let front_m = along_m + self.vehicle.rear_axle_to_centre_m + 0.5 * self.vehicle.size.length_m;
        let wanted_mps = self.curve_limit(along_m).min(self.cruise_mps);
        let free =
            (COMFORT_ACCELERATION_MPS2 * (1.0 - (speed_mps / wanted_mps).powi(4))).max(-COMFORT_DECELERATION_MPS2);
        let mut least = free;
        for (gap_m, leader_mps) in
            self.leaders(traffic, front_m, speed_mps, tick).into_iter().chain(self.red(front_m, speed_mps, tick))
        {
            let approach = speed_mps * (speed_mps - leader_mps)
                / (2.0 * (COMFORT_ACCELERATION_MPS2 * COMFORT_DECELERATION_MPS2).sqrt());
            let wanted_gap = STANDSTILL_GAP_M + (speed_mps * HEADWAY_SECS + approach).max(0.0);
            least = least.min(free.max(0.0) - COMFORT_ACCELERATION_MPS2 * (wanted_gap / gap_m.max(0.1)).powi(2));
        }
        least.max(-HARDEST_DECELERATION_MPS2)
    }

    /// Returns gap and speed of everyone in the way, now or when the ego gets there.
    fn leaders(&self, traffic: &Traffic, front_m: f64, speed_mps: f64, tick: Tick) -> Vec<(f64, f64)> {
        let mut leaders = Vec::new();
        for ahead_secs in traffic.outlook_secs.iter().copied() {
            let later = tick.plus(ticks_in(ahead_secs, self.dt_secs)).0.saturating_sub(traffic.from.0) as usize;
            let Some(found) = traffic.by_tick.get(later.min(traffic.by_tick.len().wrapping_sub(1))) else {
                continue;
            };
            for obstacle in found {
                if obstacle.front_m < front_m {
                    continue;
                }
                let gap_m = obstacle.rear_m - obstacle.speed_mps * ahead_secs - front_m;
                let arrival_secs = gap_m.max(0.0) / speed_mps.max(1.0);
                let meets = ahead_secs == 0.0 || (gap_m > 0.0 && (arrival_secs - ahead_secs).abs() < CONFLICT_SECS);
                if meets {
                    leaders.push((gap_m, obstacle.speed_mps));
                }
            }
        }
        leaders
    }

    /// Returns gap and speed of the lights before which to stop.
    fn red(&self, front_m: f64, speed_mps: f64, tick: Tick) -> Vec<(f64, f64)> {
        let stops = |signal: &&Signal| {
            let gap_m = signal.along_m - front_m;
            let needed_mps2 = match signal.light.at(tick) {
                LightState::Red => HARDEST_DECELERATION_MPS2,
                LightState::Yellow => COMFORT_DECELERATION_MPS2,
                LightState::Green | LightState::Unknown => return false,
            };
            gap_m > -1.0 && speed_mps * speed_mps < 2.0 * needed_mps2 * (gap_m + 1.0)
        };
        self.signals.iter().filter(stops).map(|signal| (signal.along_m - front_m + 1.5, 0.0)).collect()
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the table just before")]
    fn curve_limit(&self, along_m: f64) -> f64 {
        let last = self.curve_limit_mps.len() - 1;
        self.curve_limit_mps[along_m.clamp(0.0, last as f64) as usize]
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few seconds, never negative")]
pub(crate) fn ticks_in(secs: f64, dt_secs: f64) -> u32 {
    (secs / dt_secs).round() as u32
}

/// Returns the interval of the route that a body covers, if it is within the ego's width.
fn in_the_way(route: &Route, point: &TrackPoint, size: Size, half_width_m: f64) -> Option<Obstacle> {
    let at = route.project(point.pose.position);
    let reach = 0.5 * size.length_m.hypot(size.width_m);
    if at.left_m.abs() > half_width_m + reach || at.along_m < -reach || at.along_m > route.length_m() + 50.0 {
        return None;
    }
    let on_route = PoseSe2 { position: route.point(at.along_m), heading_rad: route.heading_rad(at.along_m) };
    let corners = ds_world::agent::corners(&point.pose, size.length_m, size.width_m);
    let local = corners.map(|corner| on_route.to_local(corner));
    let lowest = |pick: fn(&DVec2) -> f64| local.iter().map(pick).fold(f64::INFINITY, f64::min);
    let highest = |pick: fn(&DVec2) -> f64| local.iter().map(pick).fold(f64::NEG_INFINITY, f64::max);
    if lowest(|p| p.y) > half_width_m || highest(|p| p.y) < -half_width_m {
        return None;
    }
    Some(Obstacle {
        rear_m: at.along_m + lowest(|p| p.x),
        front_m: at.along_m + highest(|p| p.x),
        speed_mps: point.velocity_mps.dot(on_route.forward()).max(0.0),
    })
}

fn signals(route: &Route, scene: &Scene) -> Vec<Signal> {
    let lights = &scene.map.traffic_lights;
    let on_route = |line: &ds_world::StopLine| {
        let light = lights.get(line.light? as usize)?;
        Some(Signal { along_m: route.crossing(line.points[0], line.points[1])?, light: light.clone() })
    };
    scene.map.stop_lines.iter().filter_map(on_route).collect()
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the length of a route is positive and small"
)]
fn curve_limits(route: &Route, fastest_mps: f64) -> Vec<f64> {
    let metres = route.length_m().ceil() as usize + 1;
    let allowed = |m: usize| (CURVE_ACCELERATION_MPS2 / route.curvature(m as f64).abs().max(1e-4)).sqrt();
    let mut limits: Vec<f64> = (0..metres).map(|m| allowed(m).clamp(2.0, fastest_mps.max(2.0))).collect();
    for m in (0..metres - 1).rev() {
        let from_next = (limits[m + 1].powi(2) + 2.0 * 0.6 * COMFORT_DECELERATION_MPS2).sqrt();
        limits[m] = limits[m].min(from_next);
    }
    limits
}

#[cfg(test)]
pub(crate) mod tests;
