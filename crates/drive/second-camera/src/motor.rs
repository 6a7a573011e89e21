//! Motor vehicles of this world: bodies lofted over cross-sections, cars with round shoulders, box vans, coaches.

use ds_raster::PixelClass;
use ds_space::{DVec2, DVec3, Draws};
use ds_world::AgentState;

use crate::material::{Paint, Stuff};
use crate::mesh::{Face, Mould};

const LACQUERS: [[u8; 3]; 10] = [
    [214, 216, 210],
    [74, 78, 84],
    [24, 26, 30],
    [142, 30, 42],
    [22, 76, 92],
    [88, 104, 70],
    [178, 96, 44],
    [58, 60, 110],
    [194, 186, 164],
    [120, 134, 146],
];

fn part(stuff: Stuff, tint: [u8; 3]) -> Paint {
    Paint::new(stuff, PixelClass::Vehicle, tint)
}

/// What the lamps show.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Signals {
    pub(crate) lit: bool,
    pub(crate) braking: bool,
}

/// Half of a cross-section: (share of half width, share of height) from the sill to the roof.
type Section = [(f64, f64); 5];

/// Mirrors a half section into a ring at a place along the body.
fn ring(x: f64, half_width: f64, height: f64, section: &Section) -> Vec<DVec3> {
    let left = section.iter().map(|(w, h)| DVec3::new(x, w * half_width, h * height));
    let right = section.iter().rev().map(|(w, h)| DVec3::new(x, -w * half_width, h * height));
    left.chain(right).collect()
}

/// Adds a vehicle.
pub(crate) fn add(agent: &AgentState, draws: &Draws, signals: Signals, faces: &mut Vec<Face>) {
    let size = agent.size;
    let (l, w, h) = (size.length_m, 0.5 * size.width_m, size.height_m);
    let tint = LACQUERS[usize::try_from(draws.below(3, LACQUERS.len() as u64)).unwrap_or(0)];
    let lacquer = part(Stuff::Lacquer, tint);
    let pane = part(Stuff::Pane, [22, 26, 30]);
    let rubber = part(Stuff::Plain, [26, 25, 24]);
    let mut mould = Mould { pose: agent.pose, bottom_m: agent.z_m, faces };
    let large = h > 2.4 || l > 6.5;
    if large {
        let coach = draws.uniform(4) < 0.5;
        body(&mut mould, [l, w, h], &BOX, |_, side| {
            // Sides three and six of the ring are the window bands.
            if coach && matches!(side, 2 | 6) { pane } else { lacquer }
        });
        mould.cuboid(DVec3::new(0.49 * l, -0.86 * w, 0.45 * h), DVec3::new(0.502 * l, 0.86 * w, 0.74 * h), pane);
        mould.cuboid(DVec3::new(-0.502 * l, -0.8 * w, 0.5 * h), DVec3::new(-0.49 * l, 0.8 * w, 0.72 * h), pane);
    } else {
        // Segments of the rear and the front screen; upright rears have a pane instead.
        let (stations, rear, front) = if h > 1.68 { (&OFF_ROAD, None, 3) } else { (&SALOON, Some(1), 3) };
        body(&mut mould, [l, w, h], stations, |segment, side| {
            let window = matches!(side, 2 | 6) && segment >= rear.unwrap_or(1) && segment <= front;
            let screen = matches!(side, 3..=5) && (Some(segment) == rear || segment == front);
            if window || screen { pane } else { lacquer }
        });
        if rear.is_none() {
            mould.cuboid(DVec3::new(-0.507 * l, -0.7 * w, 0.62 * h), DVec3::new(-0.49 * l, 0.7 * w, 0.9 * h), pane);
        }
    }
    for x in [-0.31 * l, 0.31 * l] {
        for y in [-0.94 * w, 0.94 * w] {
            let radius = (0.21 * h).clamp(0.27, 0.52);
            let disc = |y: f64| -> Vec<DVec3> {
                let rim = |i: u32| DVec2::from_angle(f64::from(i) * std::f64::consts::TAU / 10.0) * radius;
                (0..10).map(|i| DVec3::new(x + rim(i).x, y, radius + rim(i).y)).collect()
            };
            let cap = part(Stuff::Plain, [150, 150, 148]);
            mould.loft(&[disc(0.82 * y), disc(1.06 * y)], cap, |_, _| rubber);
        }
    }
    lamps(&mut mould, [l, w, h], signals);
}

/// A station along the body: share of the length from the middle, share of the width, its section.
type Station = (f64, f64, Section);

const LOW: Section = [(0.92, 0.14), (1.0, 0.34), (0.96, 0.5), (0.7, 0.55), (0.3, 0.57)];
const CABIN: Section = [(0.94, 0.14), (1.0, 0.36), (0.96, 0.56), (0.72, 0.95), (0.3, 1.0)];
const TALL: Section = [(0.94, 0.2), (1.0, 0.4), (0.98, 0.6), (0.84, 0.96), (0.4, 1.0)];
const NOSE: Section = [(0.9, 0.18), (0.98, 0.3), (0.94, 0.42), (0.66, 0.46), (0.3, 0.47)];
const CASE: Section = [(0.98, 0.12), (1.0, 0.44), (1.0, 0.78), (0.98, 0.97), (0.6, 1.0)];

const SALOON: [Station; 7] = [
    (-0.5, 0.9, LOW),
    (-0.36, 1.0, LOW),
    (-0.2, 1.0, CABIN),
    (0.04, 1.0, CABIN),
    (0.22, 1.0, LOW),
    (0.44, 0.97, NOSE),
    (0.5, 0.84, NOSE),
];
const OFF_ROAD: [Station; 7] = [
    (-0.5, 0.95, TALL),
    (-0.46, 1.0, TALL),
    (-0.2, 1.0, TALL),
    (0.1, 1.0, TALL),
    (0.24, 1.0, LOW),
    (0.46, 0.98, LOW),
    (0.5, 0.9, NOSE),
];
const BOX: [Station; 4] = [(-0.5, 1.0, CASE), (-0.1, 1.0, CASE), (0.44, 1.0, CASE), (0.5, 0.96, CASE)];

fn body(mould: &mut Mould, [l, w, h]: [f64; 3], stations: &[Station], paint: impl Fn(usize, usize) -> Paint) {
    let rings: Vec<Vec<DVec3>> = stations.iter().map(|(x, wide, section)| ring(x * l, wide * w, h, section)).collect();
    let cap = paint(0, 0);
    mould.loft(&rings, cap, paint);
}

fn lamps(mould: &mut Mould, [l, w, h]: [f64; 3], signals: Signals) {
    let low = h.min(1.9);
    let tail = match signals {
        Signals { braking: true, .. } => part(Stuff::Glow, [255, 30, 34]),
        Signals { lit: true, .. } => part(Stuff::Glow, [190, 16, 24]),
        _ => part(Stuff::Lacquer, [120, 12, 20]),
    };
    let head = part(if signals.lit { Stuff::Glow } else { Stuff::Lacquer }, [236, 240, 255]);
    let plate = part(Stuff::Plain, [232, 226, 150]);
    // A band of light across the rear, two slits in front.
    mould.cuboid(DVec3::new(-0.508 * l, -0.86 * w, 0.47 * low), DVec3::new(-0.49 * l, -0.42 * w, 0.55 * low), tail);
    mould.cuboid(DVec3::new(-0.508 * l, 0.42 * w, 0.47 * low), DVec3::new(-0.49 * l, 0.86 * w, 0.55 * low), tail);
    mould.cuboid(DVec3::new(-0.506 * l, -0.24, 0.28 * low), DVec3::new(-0.49 * l, 0.24, 0.36 * low), plate);
    for y in [-0.62 * w, 0.62 * w] {
        mould.cuboid(
            DVec3::new(0.485 * l, y - 0.2 * w, 0.36 * low),
            DVec3::new(0.507 * l, y + 0.2 * w, 0.42 * low),
            head,
        );
    }
}
