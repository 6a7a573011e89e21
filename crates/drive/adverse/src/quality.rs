//! How adversaries compare with the logged vehicles of the scenarios that they were put into: how they move, whether they can
//! be told apart, and from where they come.
//!
//! Logs are noisy, so both are seen through one keyhole: positions half a second apart, those of adversaries with the noise of
//! standing logged vehicles added, differenced alike. Nothing here decides about a variant.

mod motion;
mod resemblance;
mod spread;
mod telling;

use ds_space::{Draws, Tick};
use ds_world::{AgentClass, Scene, Track};

use self::motion::{Motion, Noise};
pub use self::resemblance::{Apart, Resemblance};
pub use self::spread::Spread;
pub use self::telling::Telling;
use crate::variant::Variant;

/// So long before the attack what an adversary drives still counts as ordinary.
const BEFORE_ATTACK_TICKS: u32 = 10;

/// What is measured of all variants of some scenarios together.
#[derive(Debug, Clone, PartialEq)]
pub struct Quality {
    /// Standard deviation of the position of standing logged vehicles, in metres.
    pub noise_m: f64,
    /// One for each quantity of motion.
    pub resemblances: Vec<Resemblance>,
    /// Whether adversaries can be told from logged vehicles.
    pub telling: Option<Telling>,
    /// From where they come.
    pub spread: Spread,
}

/// Compares variants with the logged vehicles of their scenarios; scenarios without variants give logged vehicles too.
#[must_use]
pub fn quality(found: &[(&Scene, &[Variant])]) -> Quality {
    let noise = Noise::of(found.iter().map(|(scene, _)| *scene));
    let [noisy, drawn] =
        ["noise", "parts"].map(|purpose| Draws::from_seed(0, &format!("quality of adversaries/{purpose}")));
    let everything = |track: &Track| Motion::of(track, (Tick(0), Tick(u32::MAX)), None);
    let logged: Vec<Motion> = found.iter().flat_map(|(scene, _)| moving(scene)).filter_map(everything).collect();
    let variants = || found.iter().flat_map(|(_, variants)| variants.iter()).enumerate();
    let phase = |ticks: fn(&Variant) -> Option<(Tick, Tick)>| -> Vec<Motion> {
        let one = |(index, variant): (usize, &Variant)| {
            Motion::of(track(variant), ticks(variant)?, Some((&noise, &noisy, index as u64)))
        };
        variants().filter_map(one).collect()
    };
    Quality {
        noise_m: noise.position_m,
        resemblances: resemblance::all(&logged, [&phase(ordinary), &phase(attacking)], &drawn),
        telling: telling::telling(found, &noise, &drawn),
        spread: spread::spread(found),
    }
}

/// Returns the track of a variant's adversary.
fn track(variant: &Variant) -> &Track {
    &variant.scene.tracks[variant.agent.0 as usize]
}

/// Returns the logged vehicles of a scene.
fn moving(scene: &Scene) -> impl Iterator<Item = &Track> {
    scene.tracks.iter().filter(|track| track.class == AgentClass::Vehicle)
}

fn ordinary(variant: &Variant) -> Option<(Tick, Tick)> {
    let attack = variant.scene.adversary.as_ref()?.attack;
    Some((Tick(0), Tick(attack.0.checked_sub(BEFORE_ATTACK_TICKS)?)))
}

fn attacking(variant: &Variant) -> Option<(Tick, Tick)> {
    let attack = variant.scene.adversary.as_ref()?.attack;
    Some((Tick(attack.0.saturating_sub(BEFORE_ATTACK_TICKS)), variant.measures.met.tick))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MotionModel, Options, variants};
    use ds_scenario::{Family, generate};

    #[test]
    fn adversaries_are_compared_with_the_vehicles_beside_them() {
        let scenes: Vec<Scene> =
            (1000..1003).flat_map(|seed| [Family::CutIn, Family::FreeCurve].map(|f| generate(f, seed))).collect();
        let options = Options { solve: false, ..Options::default() };
        let model = MotionModel::town();
        let built: Vec<_> =
            scenes.iter().map(|scene| variants(scene, &model, &options).expect("the ego drives")).collect();
        let found: Vec<(&Scene, &[Variant])> = scenes.iter().zip(&built).map(|(s, b)| (s, &b.variants[..])).collect();
        let quality = quality(&found);
        assert_eq!(quality.resemblances.len(), 4);
        let speed = &quality.resemblances[0];
        let before = speed.before.expect("it drives before it attacks");
        assert!(
            (0.0..=std::f64::consts::LN_2).contains(&before.divergence_nats) && before.floor_nats > 0.0,
            "{before:?}"
        );
        let telling = quality.telling.expect("several scenarios");
        assert!(telling.interval[0] <= telling.area && telling.area <= telling.interval[1], "{telling:?}");
        assert!(quality.spread.pairs > 0 && quality.spread.start_sectors <= 8, "{:?}", quality.spread);
    }

    #[test]
    fn logged_vehicles_resemble_themselves() {
        let scenes: Vec<Scene> = (1000..1008).map(|seed| generate(Family::CutIn, seed)).collect();
        let motions: Vec<Motion> =
            scenes.iter().flat_map(moving).filter_map(|track| Motion::of(track, (Tick(0), Tick(100)), None)).collect();
        let half: Vec<Motion> = motions.iter().step_by(2).cloned().collect();
        let found = resemblance::all(&motions, [&half, &half], &Draws::from_seed(1, "test"));
        let apart = found[0].before.expect("there are some");
        assert!(apart.divergence_nats <= apart.floor_nats, "{apart:?}");
    }
}
