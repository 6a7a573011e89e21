//! Privileged: drives as `idm`, and brakes hard where a collision comes nearer.
//!
//! It acts on the world of 0.8 s ago. If what `idm` would have driven from there touches anybody ahead within 2.8 s, all others
//! keeping speed and turn rate, it brakes by 12.65 m/s³ to 7.59 m/s², the model driver of UN R157; it never steers aside.

use ds_space::plane::OrientedBox;
use ds_space::{DVec2, PoseSe2, angle};
use ds_world::{AgentState, Anchor, EgoState, Scene, WorldState};

use crate::anchor::Anchored;
use crate::driver::{Driver, Kept, ticks_in};
use crate::error::PolicyError;
use crate::observation::PrivilegedView;

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

impl Anchored for Careful {
    const NAME: &'static str = Anchor::Careful.name();

    fn driven(&mut self, view: &PrivilegedView, horizon_ticks: u32) -> Result<Vec<PoseSe2>, PolicyError> {
        let (live, now) = view.live(Self::NAME)?;
        let driver = self.driver.of(&view.scene);
        let noticed = live.states.iter().rev().find(|state| state.tick.plus(REACTION_TICKS) <= view.tick);
        let feared = noticed
            .zip(live.states.first())
            .is_some_and(|(noticed, before)| collides(driver, &view.scene, before, noticed));
        Ok(if feared {
            driver.brake(&view.ego, BRAKING, horizon_ticks)
        } else {
            driver.drive_live(now, &view.ego, horizon_ticks)
        })
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
        scene.vehicle.size.footprint(&ego.centre(&scene.vehicle))
    };
    let (here, since_secs) = (body(state.ego.pose), dt_secs * f64::from(state.tick.0 - before.tick.0));
    let others = state.agents.iter().filter(|agent| {
        let ahead = state.ego.centre(&scene.vehicle).to_local(agent.pose.position).x > -0.5 * size.length_m;
        ahead && !here.touches(&agent.footprint())
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
    agent.size.footprint(&pose)
}

#[cfg(test)]
mod tests {
    use ds_space::{AgentId, SimTime, Tick};
    use ds_world::{AgentClass, Map, Size};

    use super::*;
    use crate::driver::tests::scene;

    fn ego() -> EgoState {
        EgoState { velocity_mps: DVec2::new(10.0, 0.0), ..EgoState::default() }
    }

    fn world(tick: u32, pose: PoseSe2, speed_mps: f64) -> WorldState {
        let size = Size { length_m: 4.5, width_m: 1.9, height_m: 1.5 };
        let velocity_mps = pose.forward() * speed_mps;
        let agent = AgentState { id: AgentId(0), class: AgentClass::Vehicle, size, pose, z_m: 0.0, velocity_mps };
        WorldState {
            tick: Tick(tick),
            time: SimTime::from_secs(0.1 * f64::from(tick)),
            ego: ego(),
            agents: vec![agent],
            lights: vec![],
            contacts: vec![],
        }
    }

    #[test]
    fn fears_whose_path_crosses_its_own_soon_and_nobody_else() {
        let scene = scene(vec![], Map::default());
        let driver = Driver::new(&scene);
        let (east, west, north) = (0.0, std::f64::consts::PI, std::f64::consts::FRAC_PI_2);
        for (said, pose, speed_mps, turned_rad, feared) in [
            ("crosses when the ego is there", PoseSe2::new(22.0, -10.0, north), 6.0, 0.0, true),
            ("crosses after it", PoseSe2::new(22.0, -30.0, north), 6.0, 0.0, false),
            ("comes towards it in its lane", PoseSe2::new(40.0, 0.0, west), 10.0, 0.0, true),
            ("comes beside its lane", PoseSe2::new(40.0, 3.5, west), 10.0, 0.0, false),
            ("comes beside its lane and turns into it", PoseSe2::new(36.0, 3.5, west), 10.0, 0.03, true),
            ("comes towards it from far away", PoseSe2::new(90.0, 0.0, west), 10.0, 0.0, false),
            ("drives on before it", PoseSe2::new(20.0, 0.0, east), 10.0, 0.0, false),
            ("stands beside its lane", PoseSe2::new(15.0, 3.0, east), 0.0, 0.0, false),
            ("drives up behind it", PoseSe2::new(-12.0, 0.0, east), 20.0, 0.0, false),
        ] {
            let was = PoseSe2 { heading_rad: pose.heading_rad - turned_rad, ..pose };
            let (before, state) = (world(10, was, speed_mps), world(12, pose, speed_mps));
            assert_eq!(collides(&driver, &scene, &before, &state), feared, "one who {said}");
        }
    }
}
