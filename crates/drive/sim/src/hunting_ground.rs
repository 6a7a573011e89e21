//! What an adversary goes by: its plan, its corridor, the road, what its car can do, and what a choice would cost.
//!
//! Made once of a scene and shared by all copies of a simulation. World frame, SI units.

use ds_space::plane::{Grid, IndexedPolygon, Line, OrientedBox, Path};
use ds_space::{DVec2, PoseSe2, Tick, angle};
use ds_vehicle::{Control, Rolling};
use ds_world::{Adversary, AgentState, Scene, TrackPoint, VehicleParameters, WorldState};

use crate::escape::TICKS as FORECAST_TICKS;

const LATERALS: [f64; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];
const ACCELERATIONS_MPS2: [f64; 9] = [-6.0, -4.0, -2.5, -1.2, 0.0, 0.7, 1.4, 2.1, 2.8];
const MOST_LATERAL_MPS2: f64 = 3.6;
const MOST_CURVATURE_PM: f64 = 0.19;
const MOST_STEERING_RADPS: f64 = 0.7;
const MOST_JERK_MPS3: f64 = 12.0;
const SPEEDING: f64 = 1.3;
const UNKNOWN_LIMIT_MPS: f64 = 25.0 / SPEEDING;
const SETTLING_SECS: f64 = 0.8;
/// Of its length: from the rear axle to the centre, and the wheel base.
const ARM: f64 = 0.282;
const WHEEL_BASE: f64 = 0.597;
/// An ego this near to its log keeps to it, in metres.
const AS_LOGGED_M: f64 = 0.5;
/// Closer than this to others is no choice, in metres.
const BESIDE_OTHERS_M: f64 = 0.2;
/// Metres of missed contact that an effort of 1 m/s² for a second is worth.
const EFFORT_WEIGHT: f64 = 0.15;

/// What never changes during an episode; shared by all copies.
#[derive(Debug)]
pub(crate) struct Ground {
    pub(crate) adversary: Adversary,
    pub(crate) vehicle: VehicleParameters,
    pub(crate) points: Vec<TrackPoint>,
    /// Where the ego was logged: the plan is made for that.
    logged: Vec<DVec2>,
    /// Where the ego is to go.
    pub(crate) route: Option<Path>,
    length_m: f64,
    width_m: f64,
    corridor: Line,
    drivable: Vec<IndexedPolygon>,
    grid: Grid,
    most_mps: f64,
    pub(crate) dt_secs: f64,
}

/// What it aims at: an offset from the corridor and an acceleration.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Aim {
    pub(crate) left_m: f64,
    pub(crate) acceleration_mps2: f64,
}

impl Ground {
    /// Prepares the adversary of a scene; nothing without a line or where its track has gaps.
    pub(crate) fn of(scene: &Scene, adversary: &Adversary) -> Option<Self> {
        let track = scene.tracks.get(adversary.track.0 as usize)?;
        let points: Vec<TrackPoint> = track.points.iter().copied().collect::<Option<_>>()?;
        let drivable: Vec<IndexedPolygon> =
            scene.map.drivable.iter().filter_map(|area| IndexedPolygon::new(area, &[])).collect();
        let bounds: Vec<_> = drivable.iter().map(|area| *area.bounds()).collect();
        let near = |lane: &&ds_world::Lane| {
            let at = points[adversary.contact.0 as usize % points.len()].pose.position;
            Line::new(&lane.centre_line).is_some_and(|line| line.nearest(at).distance_squared < 25.0)
        };
        let limits = scene.map.lanes.iter().filter(near).filter_map(|lane| lane.speed_limit_mps);
        let planned = points.iter().map(|point| point.velocity_mps.length()).fold(0.0, f64::max);
        let limit_mps = limits.reduce(f64::max).unwrap_or(UNKNOWN_LIMIT_MPS);
        points.first()?;
        Some(Self {
            adversary: adversary.clone(),
            vehicle: scene.vehicle,
            logged: scene.ego_log.iter().map(|ego| ego.pose.position).collect(),
            route: Path::new(&scene.route),
            length_m: track.size.length_m,
            width_m: track.size.width_m,
            corridor: Line::new(&adversary.corridor)?,
            grid: Grid::new(&bounds),
            drivable,
            most_mps: (SPEEDING * limit_mps).max(planned),
            dt_secs: scene.dt.secs(),
            points,
        })
    }

    pub(crate) fn point(&self, tick: Tick) -> &TrackPoint {
        &self.points[(tick.0 as usize).min(self.points.len() - 1)]
    }

    pub(crate) fn car(&self, point: &TrackPoint) -> Rolling {
        let pose = PoseSe2 { position: point.pose.position - point.pose.forward() * self.arm_m(), ..point.pose };
        Rolling { pose, speed_mps: point.velocity_mps.dot(point.pose.forward()).max(0.0) }
    }

    pub(crate) fn arm_m(&self) -> f64 {
        ARM * self.length_m
    }

    pub(crate) fn centre(&self, car: &Rolling) -> PoseSe2 {
        PoseSe2 { position: car.pose.position + car.pose.forward() * self.arm_m(), ..car.pose }
    }

    pub(crate) fn body(&self, car: &Rolling) -> OrientedBox {
        OrientedBox::new(&self.centre(car), self.length_m, self.width_m)
    }

    pub(crate) fn bend(&self, car: &Rolling, next: &Rolling) -> f64 {
        let way_m = 0.5 * (car.speed_mps + next.speed_mps) * self.dt_secs;
        let turn_rad = angle::turn(car.pose.heading_rad, next.pose.heading_rad);
        if way_m < 0.02 { 0.0 } else { (turn_rad / way_m).clamp(-MOST_CURVATURE_PM, MOST_CURVATURE_PM) }
    }

    /// Says whether a car is where the plan has it.
    pub(crate) fn follows(&self, tick: Tick, car: &Rolling) -> bool {
        self.car(self.point(tick)).pose.position.distance(car.pose.position) < 0.01
    }

    /// Says whether the ego is where its log has it, so that the plan still holds.
    pub(crate) fn as_logged(&self, world: &WorldState) -> bool {
        let at = (world.tick.0 as usize).min(self.logged.len() - 1);
        world.ego.pose.position.distance(self.logged[at]) < AS_LOGGED_M
    }

    pub(crate) fn planned_mps2(&self, tick: Tick) -> f64 {
        (self.point(tick.plus(1)).velocity_mps.length() - self.point(tick).velocity_mps.length()) / self.dt_secs
    }

    pub(crate) fn planned_ahead(&self, tick: Tick) -> Vec<OrientedBox> {
        (1..=FORECAST_TICKS as u32).map(|i| self.body(&self.car(self.point(tick.plus(i))))).collect()
    }

    /// Returns all that it may aim at.
    pub(crate) fn aims(&self) -> Vec<Aim> {
        let aside_m = self.adversary.budget.aside_m;
        LATERALS
            .iter()
            .flat_map(|side| {
                ACCELERATIONS_MPS2.map(|acceleration_mps2| Aim { left_m: side * aside_m, acceleration_mps2 })
            })
            .collect()
    }

    /// Returns the control of a tick towards an aim, within the limits of a car.
    pub(crate) fn steer(&self, car: &Rolling, before: Control, aim: Aim) -> Control {
        let near = self.corridor.nearest(car.pose.position);
        let direction = self.corridor.direction(near.segment);
        let left_m = direction.perp_dot(car.pose.position - self.corridor.points()[near.segment]);
        let ahead = self.corridor.direction_at(near.along_m + 0.5 * car.speed_mps);
        let lane_rad = ahead.to_angle();
        let error_rad = angle::turn(lane_rad, car.pose.heading_rad);
        let wanted_rad = (0.08 * (10.0 / car.speed_mps.max(5.0)) * (aim.left_m - left_m)).clamp(-0.25, 0.25);
        let wish_pm = (wanted_rad - error_rad) / (car.speed_mps.max(2.0) * SETTLING_SECS);
        let most_pm = MOST_CURVATURE_PM.min(MOST_LATERAL_MPS2 / car.speed_mps.max(1.0).powi(2));
        let base_m = WHEEL_BASE * self.length_m;
        let wheel = |curvature_pm: f64| (base_m * curvature_pm).atan();
        let most_rad = MOST_STEERING_RADPS * self.dt_secs;
        let turned = (wheel(wish_pm.clamp(-most_pm, most_pm)) - wheel(before.curvature_pm)).clamp(-most_rad, most_rad);
        let curvature_pm = (wheel(before.curvature_pm) + turned).tan() / base_m;
        let most_change = MOST_JERK_MPS3 * self.dt_secs;
        let wish = aim.acceleration_mps2.min((self.most_mps - car.speed_mps) / self.dt_secs);
        let change = (wish - before.acceleration_mps2).clamp(-most_change, most_change);
        Control { acceleration_mps2: before.acceleration_mps2 + change, curvature_pm }
    }

    pub(crate) fn driven(&self, (car, control): (Rolling, Control), aim: Aim) -> Vec<OrientedBox> {
        let (mut car, mut control) = (car, control);
        let step = |_| {
            control = self.steer(&car, control, aim);
            car = car.forwards(control, self.dt_secs);
            self.body(&car)
        };
        (0..FORECAST_TICKS).map(step).collect()
    }

    pub(crate) fn on_road(&self, body: &OrientedBox) -> bool {
        let on = |point: &DVec2| self.grid.near(*point).iter().any(|id| self.drivable[*id as usize].holds(*point));
        self.drivable.is_empty() || body.corners().iter().all(on)
    }

    /// Says whether a drive stays on the road and away from others.
    pub(crate) fn sound(&self, boxes: &[OrientedBox], others: &[Vec<OrientedBox>]) -> bool {
        boxes.iter().zip(others).step_by(3).all(|(body, others)| {
            let grown = OrientedBox {
                half_length_m: body.half_length_m + BESIDE_OTHERS_M,
                half_width_m: body.half_width_m + BESIDE_OTHERS_M,
                ..*body
            };
            self.on_road(body) && !others.iter().any(|other| other.touches(&grown))
        })
    }

    pub(crate) fn forecast_others(&self, world: &WorldState) -> Vec<Vec<OrientedBox>> {
        let near = |agent: &&AgentState| {
            agent.id != self.adversary.track && agent.pose.position.distance(world.ego.pose.position) < 80.0
        };
        let agents: Vec<&AgentState> = world.agents.iter().filter(near).collect();
        let at = |i: usize| {
            let after = (i + 1) as f64 * self.dt_secs;
            let moved = |agent: &&AgentState| agent.footprint().moved(agent.velocity_mps * after);
            agents.iter().map(moved).collect()
        };
        (0..FORECAST_TICKS).map(at).collect()
    }

    /// Returns how much a drive misses the ego by, in metres; contact costs only its effort and how far from
    /// the planned time it comes.
    pub(crate) fn cost(&self, boxes: &[OrientedBox], ego: &[OrientedBox], now: Tick, effort_mps2: f64) -> f64 {
        let mut least = f64::INFINITY;
        for (i, (body, ego)) in boxes.iter().zip(ego).enumerate() {
            if body.touches(ego) {
                let planned = f64::from(self.adversary.contact.0) - f64::from(now.0);
                least = 0.02 * ((i + 1) as f64 - planned).abs() * self.dt_secs;
                break;
            }
            let reach = body.radius_squared().sqrt().min(ego.radius_squared().sqrt());
            least = least.min(1.0 + (body.centre.distance(ego.centre) - reach).max(0.0));
        }
        least + EFFORT_WEIGHT * effort_mps2
    }

    /// Returns the acceleration of an ordinary driver in the corridor: towards its planned speed, behind what is ahead.
    pub(crate) fn cruise(&self, world: &WorldState, car: &Rolling) -> f64 {
        let idm = ds_vehicle::IdmParameters::default();
        let centre = self.centre(car);
        let left_m = self.corridor.length_m() - self.corridor.nearest(centre.position).along_m;
        // Where its corridor ends it stands.
        let mut lead = Some(ds_vehicle::Lead { gap_m: left_m - 0.5 * self.length_m - 1.0, speed_mps: 0.0 });
        let ego = world.ego.centre(&self.vehicle);
        let ego_mps = world.ego.pose.forward() * world.ego.velocity_mps.x;
        let agents = world.agents.iter().filter(|agent| agent.id != self.adversary.track);
        let all = agents.map(|agent| (agent.pose.position, agent.velocity_mps, agent.size));
        for (position, velocity, size) in all.chain(std::iter::once((ego.position, ego_mps, self.vehicle.size))) {
            let local = centre.to_local(position);
            if local.x <= 0.0 || local.y.abs() > 0.5 * (size.width_m + self.width_m) + 0.3 {
                continue;
            }
            let gap_m = local.x - 0.5 * (size.length_m + self.length_m);
            if lead.is_none_or(|lead: ds_vehicle::Lead| gap_m < lead.gap_m) {
                lead = Some(ds_vehicle::Lead { gap_m, speed_mps: velocity.dot(centre.forward()) });
            }
        }
        idm.acceleration(car.speed_mps, self.most_mps / SPEEDING, lead)
    }
}
