//! People on foot and on bicycles, cones and barriers, as figures of several parts.
//!
//! The stride follows from where a person is, not from a clock: the picture is a function of the state alone.

use ds_space::{DVec3, Draws};
use ds_world::AgentState;

use crate::solid::{Builder, Facet, Skin, Slab};
use crate::surface::{Material, PixelClass, Rgb, Surface};

const SHIRTS: [Rgb; 8] = [
    [184, 40, 40],
    [40, 76, 150],
    [220, 220, 214],
    [44, 46, 52],
    [206, 160, 40],
    [60, 122, 74],
    [132, 84, 140],
    [110, 116, 124],
];
const TROUSERS: [Rgb; 4] = [[36, 42, 64], [40, 38, 36], [92, 84, 70], [70, 74, 82]];
const SKINS: [Rgb; 4] = [[232, 190, 160], [196, 146, 112], [140, 96, 68], [92, 62, 46]];

const fn part(colour: Rgb) -> Surface {
    Surface::solid(Material::Matte, PixelClass::Person, colour)
}

const fn thing(colour: Rgb) -> Surface {
    Surface::solid(Material::Matte, PixelClass::Other, colour)
}

struct Clothes {
    shirt: Surface,
    trousers: Surface,
    skin: Surface,
    hair: Surface,
}

impl Clothes {
    fn drawn(draws: &Draws) -> Self {
        let pick = |index: u64, colours: &[Rgb]| {
            let at = usize::try_from(draws.below(index, colours.len() as u64)).unwrap_or(0);
            part(colours[at])
        };
        let hair = [[34, 26, 20], [84, 56, 32], [150, 120, 70], [120, 120, 120]];
        Self { shirt: pick(0, &SHIRTS), trousers: pick(1, &TROUSERS), skin: pick(2, &SKINS), hair: pick(3, &hair) }
    }
}

/// Returns the swing of legs and arms, -1 to 1, of someone who moves.
fn swing(agent: &AgentState, stride_m: f64) -> f64 {
    if agent.velocity_mps.length() < 0.2 {
        return 0.0;
    }
    let along_m = agent.pose.position.dot(agent.pose.forward());
    (along_m / stride_m * std::f64::consts::TAU).sin()
}

/// Adds a person on foot.
pub(crate) fn pedestrian(agent: &AgentState, draws: &Draws, facets: &mut Vec<Facet>) {
    let clothes = Clothes::drawn(draws);
    let h = agent.size.height_m;
    let wide = (0.5 * agent.size.width_m).clamp(0.16, 0.27);
    let step = 0.22 * h * swing(agent, 1.5);
    let mut builder = Builder::new(agent.pose, agent.z_m, facets);
    for (left, step) in [(0.5 * wide, step), (-0.5 * wide, -step)] {
        let foot = Slab::new(0.0, step - 0.09, step + 0.13, 0.07).moved_left(left);
        let hip = Slab::new(0.5 * h, -0.1, 0.1, 0.09).moved_left(left);
        builder.frustum(foot, hip, &Skin::all(clothes.trousers));
        let shoulder = DVec3::new(0.0, 2.1 * left, 0.8 * h);
        builder.bar(shoulder, DVec3::new(-0.8 * step, 2.3 * left, 0.47 * h), 0.05, clothes.shirt);
    }
    builder.frustum(
        Slab::new(0.48 * h, -0.11, 0.12, 0.85 * wide),
        Slab::new(0.83 * h, -0.1, 0.1, wide),
        &Skin::all(clothes.shirt),
    );
    head(&mut builder, &clothes, DVec3::new(0.01, 0.0, 0.915 * h), 0.075 * h);
}

fn head(builder: &mut Builder, clothes: &Clothes, centre: DVec3, radius: f64) {
    builder.ball(centre, DVec3::new(radius, 0.85 * radius, 1.15 * radius), clothes.skin);
    builder.ball(centre + DVec3::new(-0.25 * radius, 0.0, 0.4 * radius), DVec3::splat(0.92 * radius), clothes.hair);
}

/// Adds a cyclist with the bicycle.
pub(crate) fn cyclist(agent: &AgentState, draws: &Draws, facets: &mut Vec<Facet>) {
    let clothes = Clothes::drawn(draws);
    let (l, h) = (agent.size.length_m.max(1.2), agent.size.height_m.max(1.2));
    let frame = part([[150, 30, 30], [30, 60, 120], [40, 40, 44]][usize::try_from(draws.below(4, 3)).unwrap_or(0)]);
    let tyre = part([24, 24, 26]);
    let wheel = (0.19 * l).clamp(0.26, 0.36);
    let (back, front) = (-0.5 * l + wheel, 0.5 * l - wheel);
    let swing = swing(agent, 3.0);
    let mut builder = Builder::new(agent.pose, agent.z_m, facets);
    for x in [back, front] {
        builder.ring_y(DVec3::new(x, 0.0, wheel), wheel, tyre);
        builder.block(Slab::new(0.0, x - 0.5 * wheel, x + 0.5 * wheel, 0.03), 0.3 * wheel, tyre);
        builder.block(Slab::new(wheel, x - 0.06, x + 0.06, 0.035), 0.9 * wheel, tyre);
    }
    let saddle = DVec3::new(0.35 * back, 0.0, 0.53 * h);
    let bar_top = DVec3::new(0.8 * front, 0.0, 0.6 * h);
    let crank = DVec3::new(0.1 * l, 0.0, wheel);
    for (from, to) in [(saddle, crank), (saddle, bar_top), (crank, bar_top), (DVec3::new(back, 0.0, wheel), saddle)] {
        builder.bar(from, to, 0.03, frame);
    }
    builder.bar(bar_top, DVec3::new(front, 0.0, wheel), 0.03, frame);
    builder.bar(bar_top - DVec3::Y * 0.25, bar_top + DVec3::Y * 0.25, 0.025, tyre);
    let hip = saddle + DVec3::Z * 0.08;
    let shoulder = DVec3::new(0.28 * l, 0.0, 0.82 * h);
    for side in [1.0, -1.0] {
        let foot = crank + DVec3::new(0.0, 0.1 * side, -0.1 + 0.13 * swing * side);
        let knee = DVec3::new(0.2 * l, 0.12 * side, 0.45 * h + 0.08 * swing * side);
        builder.bar(hip + DVec3::Y * (0.1 * side), knee, 0.08, clothes.trousers);
        builder.bar(knee, foot, 0.06, clothes.trousers);
        builder.bar(shoulder + DVec3::Y * (0.19 * side), bar_top + DVec3::Y * (0.2 * side), 0.05, clothes.skin);
    }
    let back_slab = Slab::new(hip.z - 0.05, hip.x - 0.12, hip.x + 0.13, 0.17);
    let chest = Slab::new(shoulder.z, shoulder.x - 0.14, shoulder.x + 0.1, 0.22);
    builder.frustum(back_slab, chest, &Skin::all(clothes.shirt));
    head(&mut builder, &clothes, shoulder + DVec3::new(0.08, 0.0, 0.1 * h), 0.12);
}

/// Adds a traffic cone.
pub(crate) fn cone(agent: &AgentState, facets: &mut Vec<Facet>) {
    let h = agent.size.height_m.max(0.3);
    let wide = (0.5 * agent.size.width_m).clamp(0.12, 0.4);
    let mut builder = Builder::new(agent.pose, agent.z_m, facets);
    builder.block(Slab::new(0.0, -wide, wide, wide), 0.05 * h, thing([40, 40, 42]));
    builder.cone(DVec3::Z * (0.05 * h), 0.8 * wide, 0.95 * h, thing([240, 92, 20]));
    let (low, high) = (0.42 * h, 0.66 * h);
    let half = |z: f64| 0.8 * wide * (1.0 - (z - 0.05 * h) / (0.95 * h)) + 0.012;
    builder.frustum(
        Slab::new(low, -half(low), half(low), half(low)),
        Slab::new(high, -half(high), half(high), half(high)),
        &Skin::all(thing([238, 238, 234])),
    );
}

/// Adds a barrier: red and white boards on feet.
pub(crate) fn barrier(agent: &AgentState, facets: &mut Vec<Facet>) {
    let (l, w, h) = (agent.size.length_m, agent.size.width_m, agent.size.height_m);
    let mut builder = Builder::new(agent.pose, agent.z_m, facets);
    // The long side carries the stripes, whichever axis it is.
    let stripes = 6;
    for i in 0..stripes {
        let surface = if i % 2 == 0 { thing([206, 44, 36]) } else { thing([236, 236, 232]) };
        let (from, to) = (f64::from(i) / f64::from(stripes) - 0.5, f64::from(i + 1) / f64::from(stripes) - 0.5);
        let slab = if w >= l {
            Slab {
                z: 0.35 * h,
                back: -0.5 * l,
                front: 0.5 * l,
                left: 0.5 * (from + to) * w,
                half_width: 0.5 * (to - from) * w,
            }
        } else {
            Slab::new(0.35 * h, from * l, to * l, 0.5 * w)
        };
        builder.block(slab, 0.65 * h, surface);
    }
    builder.block(Slab::new(0.0, -0.42 * l, 0.42 * l, 0.42 * w), 0.35 * h, thing([90, 90, 92]));
}
