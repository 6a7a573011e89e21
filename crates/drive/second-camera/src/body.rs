//! People on foot and on bicycles, cones and barriers of this world: turned and lofted figures, some with coats, bags, hats.

use ds_raster::PixelClass;
use ds_space::{DVec2, DVec3, Draws};
use ds_world::AgentState;

use crate::material::{Paint, Stuff};
use crate::mesh::{Face, Mould};

const COATS: [[u8; 3]; 7] =
    [[60, 66, 92], [150, 52, 60], [198, 190, 170], [52, 92, 84], [220, 132, 60], [96, 78, 110], [36, 36, 40]];
const LEGS: [[u8; 3]; 3] = [[52, 54, 60], [112, 98, 80], [40, 52, 80]];
const FACES: [[u8; 3]; 3] = [[222, 180, 150], [160, 112, 84], [104, 72, 54]];

fn person(tint: [u8; 3]) -> Paint {
    Paint::new(Stuff::Plain, PixelClass::Person, tint)
}

fn thing(tint: [u8; 3]) -> Paint {
    Paint::new(Stuff::Plain, PixelClass::Other, tint)
}

fn pick(draws: &Draws, index: u64, tints: &[[u8; 3]]) -> Paint {
    person(tints[usize::try_from(draws.below(index, tints.len() as u64)).unwrap_or(0)])
}

/// Phase of the step, -1 to 1, from where someone is.
fn stride(agent: &AgentState, length_m: f64) -> f64 {
    let moving = agent.velocity_mps.length() > 0.25;
    let along = agent.pose.position.dot(agent.pose.forward()) / length_m;
    if moving { 2.0 * (2.0 * (along - along.floor()) - 1.0).abs() - 1.0 } else { 0.0 }
}

/// Adds a person on foot: legs, a coat that widens downwards, arms, a head, perhaps a hat or a bag.
pub(crate) fn walker(agent: &AgentState, draws: &Draws, faces: &mut Vec<Face>) {
    let h = agent.size.height_m;
    let wide = (0.5 * agent.size.width_m).clamp(0.17, 0.28);
    let (coat, legs, face) = (pick(draws, 11, &COATS), pick(draws, 12, &LEGS), pick(draws, 13, &FACES));
    let step = 0.2 * h * stride(agent, 1.4);
    let mut mould = Mould { pose: agent.pose, bottom_m: agent.z_m, faces };
    for side in [1.0, -1.0] {
        let hip = DVec3::new(0.0, 0.45 * side * wide, 0.5 * h);
        mould.limb(hip, DVec3::new(side * step, 0.5 * side * wide, 0.04), 0.085, legs);
        let shoulder = DVec3::new(0.0, side * wide, 0.79 * h);
        mould.limb(shoulder, DVec3::new(-0.7 * side * step, 1.15 * side * wide, 0.48 * h), 0.06, coat);
    }
    let hem = if draws.uniform(14) < 0.5 { 0.33 } else { 0.46 };
    mould.turned(
        DVec2::ZERO,
        7,
        &[(hem * h, 0.95 * wide), (0.6 * h, 0.75 * wide), (0.8 * h, wide), (0.84 * h, 0.07)],
        coat,
    );
    let ball = [(0.84 * h, 0.04), (0.87 * h, 0.085), (0.93 * h, 0.105), (0.98 * h, 0.07), (h, 0.02)];
    mould.turned(DVec2::new(0.02, 0.0), 8, &ball, face);
    if draws.uniform(15) < 0.4 {
        let hat = pick(draws, 16, &COATS);
        mould.turned(DVec2::ZERO, 8, &[(0.95 * h, 0.17), (0.96 * h, 0.11), (1.01 * h, 0.08)], hat);
    }
    if draws.uniform(17) < 0.4 {
        let bag = pick(draws, 18, &COATS);
        mould.cuboid(DVec3::new(-0.34, -0.14, 0.55 * h), DVec3::new(-0.12, 0.14, 0.8 * h), bag);
    }
}

/// Adds someone on a bicycle, upright on a step-through frame with a basket.
pub(crate) fn rider(agent: &AgentState, draws: &Draws, faces: &mut Vec<Face>) {
    let (l, h) = (agent.size.length_m.max(1.3), agent.size.height_m.max(1.3));
    let (coat, legs, face) = (pick(draws, 11, &COATS), pick(draws, 12, &LEGS), pick(draws, 13, &FACES));
    let frame = pick(draws, 19, &[[30, 90, 110], [150, 140, 60], [70, 20, 30]]);
    let tyre = person([34, 33, 32]);
    let radius = (0.2 * l).clamp(0.28, 0.37);
    let (rear, front) = (DVec3::new(radius - 0.5 * l, 0.0, radius), DVec3::new(0.5 * l - radius, 0.0, radius));
    let mut mould = Mould { pose: agent.pose, bottom_m: agent.z_m, faces };
    for hub in [rear, front] {
        let rim = |i: u32| {
            let (s, c) = (f64::from(i) * std::f64::consts::TAU / 9.0).sin_cos();
            hub + DVec3::new(c, 0.0, s) * radius
        };
        for i in 0..9 {
            mould.limb(rim(i), rim((i + 1) % 9), 0.035, tyre);
            mould.limb(hub, rim(i), 0.012, tyre);
        }
    }
    let crank = DVec3::new(-0.02 * l, 0.0, 0.9 * radius);
    let seat = DVec3::new(-0.14 * l, 0.0, 0.52 * h);
    let grip = DVec3::new(0.24 * l, 0.0, 0.62 * h);
    for (from, to) in [(rear, crank), (crank, seat), (crank, grip), (grip, front), (rear, seat)] {
        mould.limb(from, to, 0.035, frame);
    }
    mould.cuboid(grip + DVec3::new(0.02, -0.16, -0.2), grip + DVec3::new(0.3, 0.16, 0.02), person([120, 92, 60]));
    let turn = stride(agent, 2.6);
    for side in [1.0, -1.0] {
        let knee = DVec3::new(0.1 * l, 0.13 * side, 0.44 * h + 0.09 * side * turn);
        mould.limb(seat + DVec3::Y * (0.1 * side), knee, 0.085, legs);
        mould.limb(knee, crank + DVec3::new(0.0, 0.12 * side, -0.12 + 0.14 * side * turn), 0.065, legs);
        mould.limb(DVec3::new(-0.08 * l, 0.2 * side, 0.8 * h), grip + DVec3::Y * (0.22 * side), 0.055, coat);
    }
    let lean = DVec2::new(-0.11 * l, 0.0);
    mould.turned(lean, 7, &[(0.52 * h, 0.17), (0.66 * h, 0.18), (0.82 * h, 0.22), (0.86 * h, 0.06)], coat);
    let head = DVec2::new(-0.08 * l, 0.0);
    mould.turned(head, 8, &[(0.86 * h, 0.04), (0.9 * h, 0.1), (0.96 * h, 0.1), (h, 0.03)], face);
}

/// Adds a traffic cone: a slim pillar with two light bands.
pub(crate) fn pillar(agent: &AgentState, faces: &mut Vec<Face>) {
    let h = agent.size.height_m.max(0.3);
    let r = (0.5 * agent.size.width_m).clamp(0.1, 0.4);
    let (red, light) = (thing([214, 60, 36]), thing([226, 230, 214]));
    let mut mould = Mould { pose: agent.pose, bottom_m: agent.z_m, faces };
    mould.turned(DVec2::ZERO, 6, &[(0.0, r), (0.07 * h, r)], thing([54, 52, 50]));
    for (from, to, paint) in
        [(0.07, 0.35, red), (0.35, 0.5, light), (0.5, 0.7, red), (0.7, 0.83, light), (0.83, 1.0, red)]
    {
        let radius = |z: f64| 0.62 * r * (1.05 - 0.7 * z);
        mould.turned(DVec2::ZERO, 8, &[(from * h, radius(from)), (to * h, radius(to))], paint);
    }
}

/// Adds a barrier: a concrete wedge with a yellow stripe.
pub(crate) fn wedge(agent: &AgentState, faces: &mut Vec<Face>) {
    let (l, w, h) = (0.5 * agent.size.length_m, 0.5 * agent.size.width_m, agent.size.height_m);
    let mut mould = Mould { pose: agent.pose, bottom_m: agent.z_m, faces };
    let ring = |z: f64, share: f64| {
        let (x, y) = if l >= w { (l, share * w) } else { (share * l, w) };
        vec![DVec3::new(x, y, z), DVec3::new(-x, y, z), DVec3::new(-x, -y, z), DVec3::new(x, -y, z)]
    };
    let (concrete, yellow) = (thing([168, 164, 154]), thing([224, 178, 40]));
    let rings = [ring(0.0, 1.0), ring(0.3 * h, 0.8), ring(0.55 * h, 0.5), ring(0.8 * h, 0.42), ring(h, 0.38)];
    mould.loft(&rings, concrete, |i, _| if i == 2 { yellow } else { concrete });
}
