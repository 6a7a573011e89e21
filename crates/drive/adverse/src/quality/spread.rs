//! How different the variants of a scenario are: how far apart their adversaries start, from how many sides of the ego they
//! come and meet it.

use std::collections::BTreeSet;
use std::f64::consts::TAU;

use ds_space::{DVec2, PoseSe2, Tick, angle};
use ds_stats::upper_median;
use ds_world::Scene;

use super::track;
use crate::variant::Variant;

/// Sides of the ego.
const SECTORS: f64 = 8.0;

/// How different variants are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Pairs of variants of one scenario.
    pub pairs: usize,
    /// Median distance of their adversaries at the first tick, in metres.
    pub starts_apart_m: Option<f64>,
    /// Eighths of the circle around the ego in which adversaries are at the first tick.
    pub start_sectors: usize,
    /// Eighths in which their centres are at the contact.
    pub contact_sectors: usize,
}

/// Measures how different the variants of scenarios are.
pub(super) fn spread(found: &[(&Scene, &[Variant])]) -> Spread {
    let mut distances_m = Vec::new();
    for (_, variants) in found {
        let starts: Vec<DVec2> =
            variants.iter().filter_map(|variant| Some(place(variant, Tick(0))?.position)).collect();
        for (k, a) in starts.iter().enumerate() {
            distances_m.extend(starts[k + 1..].iter().map(|b| a.distance(*b)));
        }
    }
    let sectors = |tick: fn(&Variant) -> Tick| {
        let all = found.iter().flat_map(|(_, variants)| variants.iter());
        all.filter_map(|variant| sector(variant, tick(variant))).collect::<BTreeSet<u32>>().len()
    };
    Spread {
        pairs: distances_m.len(),
        starts_apart_m: upper_median(&mut distances_m),
        start_sectors: sectors(|_| Tick(0)),
        contact_sectors: sectors(|variant| variant.measures.met.tick),
    }
}

fn place(variant: &Variant, tick: Tick) -> Option<PoseSe2> {
    Some(track(variant).at(tick)?.pose)
}

/// Returns the eighth of the circle around the logged ego in which the adversary is; the first is straight ahead.
fn sector(variant: &Variant, tick: Tick) -> Option<u32> {
    let scene = &variant.scene;
    let ego = scene.logged_ego(tick).centre(&scene.vehicle);
    let towards_rad = (place(variant, tick)?.position - ego.position).to_angle();
    let turned = angle::turn(ego.heading_rad, towards_rad).rem_euclid(TAU) / TAU * SECTORS;
    Some((turned + 0.5).rem_euclid(SECTORS) as u32)
}
