//! Privileged: drives as `idm`, and brakes hard where a collision comes nearer.
//!
//! It acts on the world of 0.8 s ago. If what `idm` would have driven from there touches anybody ahead within 2.8 s, all others
//! keeping speed and turn rate, it brakes by 12.65 m/s³ to 7.59 m/s², the model driver of UN R157; it never steers aside.

use ds_space::plane::OrientedBox;
use ds_space::{DVec2, PoseSe2, angle};
use ds_world::{AgentState, Anchor, EgoState, Scene, WorldState};

use crate::driver::{Driver, Kept, ticks_in};
use crate::error::PolicyError;
use crate::observation::{Observation, PrivilegedView};
use crate::plan::PolicyAnswer;
use crate::{Policy, Restart};

/// The policy's name.
pub const NAME: &str = Anchor::Careful.name();

/// How late it acts, in ticks.
const REACTION_TICKS: u32 = 8;
/// How far ahead a collision is feared, in seconds: 2 s from when it acts, the time to collision of a real danger in UN R157.
const FEARED_SECS: f64 = 2.8;
/// Jerk and deceleration of its braking, in m/s³ and m/s².
const BRAKING: (f64, f64) = (12.65, 7.59);

/// Brakes late, but hard.
#[derive(Debug, Default)]
pub struct Careful {
    driver: Kept,
}

impl Policy for Careful {
    fn name(&self) -> &str {
        NAME
    }

    fn privileged(&self) -> bool {
        true
    }

    fn plan(
        &mut self,
        observation: &Observation,
        privileged: Option<&PrivilegedView>,
    ) -> Result<PolicyAnswer, PolicyError> {
        observation.check()?;
        let view = privileged.ok_or(PolicyError::NeedsPrivilege { name: NAME })?;
        let (live, now) = view.live(NAME)?;
        let (driver, steps) = (self.driver.of(&view.scene), observation.horizon_ticks);
        let noticed = live.states.iter().rev().find(|state| state.tick.plus(REACTION_TICKS) <= view.tick);
        let feared = noticed
            .zip(live.states.first())
            .is_some_and(|(noticed, before)| collides(driver, &view.scene, before, noticed));
        let driven =
            if feared { driver.brake(&view.ego, BRAKING, steps) } else { driver.drive_live(now, &view.ego, steps) };
        view.answer(NAME, &driven, observation.dt)
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

/// Says whether what `idm` would drive from a state touches anybody ahead; turn rates are those since an earlier state.
fn collides(driver: &Driver, scene: &Scene, before: &WorldState, state: &WorldState) -> bool {
    let dt_secs = scene.dt.secs();
    let steps = ticks_in(FEARED_SECS, dt_secs);
    let way = driver.drive_live(state, &state.ego, steps);
    let size = scene.vehicle.size;
    let body = |pose: PoseSe2| {
        let ego = EgoState { pose, ..state.ego };
        OrientedBox::new(&ego.centre(&scene.vehicle), size.length_m, size.width_m)
    };
    let (here, since_secs) = (body(state.ego.pose), dt_secs * f64::from(state.tick.0 - before.tick.0));
    let others = state.agents.iter().filter(|agent| {
        let ahead = state.ego.centre(&scene.vehicle).to_local(agent.pose.position).x > -0.5 * size.length_m;
        ahead && !here.touches(&OrientedBox::new(&agent.pose, agent.size.length_m, agent.size.width_m))
    });
    for agent in others {
        let was = before.agents.iter().find(|was| was.id == agent.id && since_secs > 0.0);
        let turn_radps = was.map_or(0.0, |was| angle::turn(was.pose.heading_rad, agent.pose.heading_rad) / since_secs);
        for (pose, step) in way.iter().zip(1u32..) {
            if body(*pose).touches(&later(agent, turn_radps, f64::from(step) * dt_secs)) {
                return true;
            }
        }
    }
    false
}

/// Returns the box of an agent that keeps its speed and turn rate for a time.
fn later(agent: &AgentState, turn_radps: f64, secs: f64) -> OrientedBox {
    let turned = turn_radps * secs;
    // The mean direction of an arc is that of its chord, which is shorter than the arc.
    let chord = if turned.abs() < 1e-6 { 1.0 } else { (0.5 * turned).sin() / (0.5 * turned) };
    let position = agent.pose.position + DVec2::from_angle(0.5 * turned).rotate(agent.velocity_mps) * (secs * chord);
    let pose = PoseSe2 { position, heading_rad: angle::wrap(agent.pose.heading_rad + turned) };
    OrientedBox::new(&pose, agent.size.length_m, agent.size.width_m)
}
