//! Scores a drive as its states come: one [`TickScore`] per state, the [`EpisodeScore`] so far at any time.

use ds_space::Tick;
use ds_world::{Scene, WorldState};

use self::collision::Collision;
use self::drivable_area::DrivableArea;
use self::odometer::{Expert, Odometer};

mod area;
mod collision;
mod drivable_area;
mod odometer;
mod progress;
mod route_completion;

/// The sub-scores of one state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickScore {
    /// The tick of the state.
    pub tick: Tick,
    /// 0 if the ego is in a contact by its own fault in this state, else 1.
    pub collision: f64,
    /// 1 if all corners of the ego are on drivable surface in this state, else 0.
    pub drivable_area: Option<f64>,
    /// Distance along the route ÷ the expert's, since the first state.
    pub progress: Option<f64>,
    /// Share of the route from the first state to the end of the log.
    pub route_completion: Option<f64>,
}

/// The scores of a drive up to its last observed state.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EpisodeScore {
    /// How many states were observed.
    pub ticks: u32,
    /// 1 unless there was a contact by the ego's own fault; `None` before the first state.
    pub collision: Option<f64>,
    /// Share of states in which all corners of the ego were on drivable surface.
    pub drivable_area: Option<f64>,
    /// Distance along the route ÷ the expert's over the same ticks.
    pub progress: Option<f64>,
    /// Share of the route from the first state to the end of the log.
    pub route_completion: Option<f64>,
    /// Always `None`: the exact score is that of [`DriveScorer`](crate::DriveScorer).
    pub driving_score: Option<f64>,
    /// The first tick with any contact.
    pub first_contact: Option<Tick>,
    /// The first tick with a contact by the ego's own fault.
    pub first_at_fault_contact: Option<Tick>,
}

/// Scores one drive through one scene.
#[derive(Debug, Clone)]
pub struct ScoreTracker {
    expert: Option<Expert>,
    travel: Option<Travel>,
    collision: Collision,
    drivable_area: DrivableArea,
    ticks: u32,
}

/// How far the ego and the expert have come since the first state.
#[derive(Debug, Clone, Copy)]
struct Travel {
    odometer: Odometer,
    ego_start_m: f64,
    expert_start_m: f64,
    ego_m: f64,
    expert_m: f64,
    left_route: bool,
    /// As `ego_m`, held from the moment on at which the ego left the route.
    completed_m: f64,
}

impl ScoreTracker {
    /// Prepares to score a drive through a scene.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        Self {
            expert: Expert::of(scene),
            travel: None,
            collision: Collision::default(),
            drivable_area: DrivableArea::new(&scene.map, scene.vehicle),
            ticks: 0,
        }
    }

    /// Takes the next state; the first one is where the drive is measured from. Each tick comes once and in order.
    pub fn observe(&mut self, world: &WorldState) -> TickScore {
        self.ticks += 1;
        self.travel = self.expert.as_ref().map(|expert| travelled(expert, self.travel, world));
        TickScore {
            tick: world.tick,
            collision: self.collision.observe(world),
            drivable_area: self.drivable_area.observe(&world.ego),
            progress: self.progress(),
            route_completion: self.route_completion(),
        }
    }

    fn progress(&self) -> Option<f64> {
        self.travel.and_then(|travel| progress::score(travel.ego_m, travel.expert_m))
    }

    fn route_completion(&self) -> Option<f64> {
        let whole_m = self.expert.as_ref()?.end_m() - self.travel?.expert_start_m;
        route_completion::score(self.travel?.completed_m, whole_m)
    }

    /// Returns the scores of all states observed so far.
    #[must_use]
    pub fn finish(&self) -> EpisodeScore {
        EpisodeScore {
            ticks: self.ticks,
            collision: (self.ticks > 0).then(|| self.collision.score()),
            drivable_area: self.drivable_area.score(),
            progress: self.progress(),
            route_completion: self.route_completion(),
            driving_score: None,
            first_contact: self.collision.first_contact,
            first_at_fault_contact: self.collision.first_at_fault,
        }
    }
}

fn travelled(expert: &Expert, before: Option<Travel>, world: &WorldState) -> Travel {
    let expert_along_m = expert.along_m(world.tick);
    let mut odometer = before.map_or(Odometer::new(expert_along_m), |travel| travel.odometer);
    let along_m = odometer.read(&expert.route, world.ego.pose.position);
    let ego_start_m = before.map_or(along_m, |travel| travel.ego_start_m);
    let expert_start_m = before.map_or(expert_along_m, |travel| travel.expert_start_m);
    let left_route = before.is_some_and(|travel| travel.left_route) || odometer.beside_m > route_completion::LEFT_AT_M;
    let completed_m = match before {
        Some(travel) if left_route => travel.completed_m,
        _ => along_m - ego_start_m,
    };
    Travel {
        odometer,
        ego_start_m,
        expert_start_m,
        ego_m: along_m - ego_start_m,
        expert_m: expert_along_m - expert_start_m,
        left_route,
        completed_m,
    }
}

#[cfg(test)]
mod tests;
