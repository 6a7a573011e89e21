//! The adversary of a scene: it drives as planned until its attack, then re-aims at where the ego is going.
//!
//! Phases: *prior* (the planned track), *attack* (every 5 ticks it picks one of 5 lateral offsets × 9 accelerations in its
//! corridor that meets an ego forecast from its executed state alone), *spent* (its budget is used, or it has met the
//! ego: it brakes), *normal* (it missed and follows its corridor). The shield allows only choices after which the ego can
//! still get away from 0.5 s on; once nothing does, the last choice is held. No draws, no plan of the ego. World frame.

use std::sync::Arc;

use ds_space::plane::OrientedBox;
use ds_space::{PoseSe2, Tick};
use ds_vehicle::{Control, Rolling};
use ds_world::{AdversaryMode, Contact, Scene, TrackPoint, WorldState};

use crate::escape::{Escapes, forecast_ego};
use crate::hunting_ground::{Aim, Ground};

const REPLAN_TICKS: u32 = 5;
/// Ticks after the least distance at which a miss is a miss.
const MISSED_TICKS: u32 = 10;

/// What it is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Phase {
    Prior,
    Attack,
    Spent,
    Normal,
}

/// Back to the corridor, to a stand.
const STOP: Aim = Aim { left_m: 0.0, acceleration_mps2: -4.0 };

/// The state of the adversary.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct State {
    pub(crate) phase: Phase,
    car: Rolling,
    control: Control,
    aim: Aim,
    /// Whether the aim is the plan's own.
    planned: bool,
    since: u32,
    effort_mps: f64,
    reaims: u32,
    nearest_m: f64,
    nearest_tick: u32,
}

/// The numbers of a [`State`] in a snapshot.
pub(crate) const NUMBERS: usize = 14;

/// An adversary at work.
#[derive(Debug, Clone)]
pub(crate) struct Hunter {
    ground: Arc<Ground>,
    state: State,
}

impl Hunter {
    /// Returns the adversary of a scene unless it only replays its track, or cannot: without a line or in other ticks
    /// than its track's.
    pub(crate) fn of(scene: &Scene) -> Option<Self> {
        let adversary = scene.adversary.as_ref().filter(|one| one.mode != AdversaryMode::Replay)?;
        let ground = Ground::of(scene, adversary)?;
        let car = ground.car(ground.point(Tick(0)));
        let state = State {
            phase: Phase::Prior,
            car,
            control: Control::default(),
            aim: Aim::default(),
            planned: true,
            since: 0,
            effort_mps: 0.0,
            reaims: 0,
            nearest_m: 1e6,
            nearest_tick: 0,
        };
        Some(Self { ground: Arc::new(ground), state })
    }

    /// Returns the index of its track.
    pub(crate) fn track(&self) -> usize {
        self.ground.adversary.track.0 as usize
    }

    /// Returns where it is; nothing while it drives as planned.
    pub(crate) fn place(&self) -> Option<TrackPoint> {
        (self.state.phase != Phase::Prior).then(|| TrackPoint {
            pose: self.ground.centre(&self.state.car),
            z_m: self.ground.points[0].z_m,
            velocity_mps: self.state.car.pose.forward() * self.state.car.speed_mps,
        })
    }

    /// Moves it one tick on from a world state.
    pub(crate) fn advance(&mut self, world: &WorldState) {
        let ground = Arc::clone(&self.ground);
        let tick = world.tick;
        if self.state.phase == Phase::Prior && tick >= ground.adversary.attack {
            self.begin(&ground, tick);
        }
        if self.state.phase == Phase::Attack {
            self.judge(&ground, world);
        }
        if self.state.phase == Phase::Attack && tick.0.saturating_sub(self.state.since).is_multiple_of(REPLAN_TICKS) {
            self.replan(&ground, world);
        }
        let state = &mut self.state;
        match state.phase {
            Phase::Prior => return,
            Phase::Attack => {}
            Phase::Spent => state.aim = STOP,
            Phase::Normal => {
                state.aim = Aim { left_m: 0.0, acceleration_mps2: ground.cruise(world, &state.car) };
            }
        }
        let planned = state.phase == Phase::Attack && state.planned && ground.follows(tick, &state.car);
        if planned {
            let next = ground.car(ground.point(tick.plus(1)));
            state.control = Control {
                acceleration_mps2: (next.speed_mps - state.car.speed_mps) / ground.dt_secs,
                curvature_pm: ground.bend(&state.car, &next),
            };
            state.car = next;
            return;
        }
        state.control = ground.steer(&state.car, state.control, state.aim);
        if state.phase == Phase::Attack {
            let planned_mps2 = ground.planned_mps2(tick);
            state.effort_mps += (state.control.acceleration_mps2 - planned_mps2).abs() * ground.dt_secs;
        }
        state.car = state.car.forwards(state.control, ground.dt_secs);
    }

    /// Takes over from the track.
    fn begin(&mut self, ground: &Ground, tick: Tick) {
        let (now, next) = (ground.car(ground.point(tick)), ground.car(ground.point(tick.plus(1))));
        let state = &mut self.state;
        state.phase = Phase::Attack;
        state.car = now;
        state.since = tick.0;
        state.control = Control {
            acceleration_mps2: (next.speed_mps - now.speed_mps) / ground.dt_secs,
            curvature_pm: ground.bend(&now, &next),
        };
    }

    /// Ends the attack on a contact, when the budget is used or the ego is missed.
    fn judge(&mut self, ground: &Ground, world: &WorldState) {
        let state = &mut self.state;
        let mine = |contact: &Contact| contact.agent == ground.adversary.track;
        let budget = &ground.adversary.budget;
        let secs = f64::from(world.tick.0.saturating_sub(state.since)) * ground.dt_secs;
        if world.contacts.iter().any(mine) || secs >= budget.attack_secs || state.effort_mps >= budget.effort_mps {
            state.phase = Phase::Spent;
            return;
        }
        let away_m = ground.centre(&state.car).position.distance(world.ego.centre(&ground.vehicle).position);
        if away_m < state.nearest_m {
            (state.nearest_m, state.nearest_tick) = (away_m, world.tick.0);
        } else if world.tick.0 >= state.nearest_tick + MISSED_TICKS && world.tick >= ground.adversary.contact {
            state.phase = Phase::Normal;
        }
    }

    /// Aims anew where that meets the ego sooner or closer than going on does.
    fn replan(&mut self, ground: &Ground, world: &WorldState) {
        if self.state.planned && ground.as_logged(world) {
            return;
        }
        let ego = forecast_ego(world, &ground.vehicle, ground.dt_secs, ground.route.as_ref());
        let others = ground.forecast_others(world);
        let aims = ground.aims();
        let now = Aim { acceleration_mps2: self.state.control.acceleration_mps2, ..self.state.aim };
        let moving = (self.state.car, self.state.control);
        let held = if self.state.planned { ground.planned_ahead(world.tick) } else { ground.driven(moving, now) };
        let held_is_sound = self.state.planned || ground.sound(&held, &others);
        let cost = |boxes: &[OrientedBox], effort: f64| ground.cost(boxes, &ego, world.tick, effort);
        // What it last chose left the ego a way out. If none is left now, the ego has let it pass: it goes on.
        let shield = (ground.adversary.mode == AdversaryMode::Reactive)
            .then(|| Escapes::of(world, &ground.vehicle, &others, &|body| ground.on_road(body)));
        let allowed = |boxes: &[OrientedBox]| shield.as_ref().is_none_or(|escapes| escapes.remain(boxes));
        let due = allowed(&held);
        let mut choices: Vec<(f64, Option<Aim>, Vec<OrientedBox>)> = vec![(cost(&held, 0.0), None, held)];
        if self.state.reaims < ground.adversary.budget.reaims {
            for aim in aims {
                let boxes = ground.driven(moving, aim);
                if ground.sound(&boxes, &others) {
                    let effort = (aim.acceleration_mps2 - ground.planned_mps2(world.tick)).abs();
                    choices.push((cost(&boxes, effort), Some(aim), boxes));
                }
            }
        }
        // Sorting is stable: going on as before goes first among equals.
        choices.sort_by(|a, b| a.0.total_cmp(&b.0));
        let chosen = choices.iter().find(|(.., boxes)| due && allowed(boxes));
        if let Some((_, Some(aim), _)) = chosen {
            self.state.aim = *aim;
            self.state.planned = false;
            self.state.reaims += 1;
        } else if !held_is_sound {
            self.state.aim = STOP;
        }
    }

    /// Returns the state as numbers.
    pub(crate) fn numbers(&self) -> [f64; NUMBERS] {
        let state = &self.state;
        let phase = match state.phase {
            Phase::Prior => 0.0,
            Phase::Attack => 1.0,
            Phase::Spent => 2.0,
            Phase::Normal => 3.0,
        };
        [
            phase,
            state.car.pose.position.x,
            state.car.pose.position.y,
            state.car.pose.heading_rad,
            state.car.speed_mps,
            state.control.acceleration_mps2,
            state.control.curvature_pm,
            state.aim.left_m,
            state.aim.acceleration_mps2,
            if state.planned { 1.0 } else { 0.0 },
            f64::from(state.since),
            state.effort_mps,
            f64::from(state.reaims) * 1e6 + f64::from(state.nearest_tick),
            state.nearest_m,
        ]
    }

    /// Takes over the state of a snapshot, or names the number that is none.
    pub(crate) fn set_numbers(&mut self, numbers: &[f64; NUMBERS]) -> Result<(), (&'static str, f64)> {
        let [
            phase,
            x,
            y,
            heading_rad,
            speed_mps,
            a,
            curvature_pm,
            left_m,
            aim,
            planned,
            since,
            effort,
            counts,
            nearest,
        ] = *numbers;
        let phase = match phase {
            0.0 => Phase::Prior,
            1.0 => Phase::Attack,
            2.0 => Phase::Spent,
            3.0 => Phase::Normal,
            other => return Err(("adversary.phase", other)),
        };
        let whole = |field, value: f64, most: f64| {
            if value >= 0.0 && value <= most && value.fract() == 0.0 { Ok(value) } else { Err((field, value)) }
        };
        if !(0.0..=1e3).contains(&speed_mps) {
            return Err(("adversary.speed_mps", speed_mps));
        }
        if curvature_pm.abs() > 1.0 {
            return Err(("adversary.curvature_pm", curvature_pm));
        }
        let counts = whole("adversary.reaims", counts, 1e9)?;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole numbers within the type")]
        let (since, reaims, nearest_tick) =
            (whole("adversary.since", since, 1e8)? as u32, (counts / 1e6).floor() as u32, (counts % 1e6) as u32);
        self.state = State {
            phase,
            car: Rolling { pose: PoseSe2::new(x, y, heading_rad), speed_mps },
            control: Control { acceleration_mps2: a, curvature_pm },
            aim: Aim { left_m, acceleration_mps2: aim },
            planned: whole("adversary.planned", planned, 1.0)? > 0.5,
            since,
            effort_mps: effort,
            reaims,
            nearest_m: nearest,
            nearest_tick,
        };
        Ok(())
    }
}
