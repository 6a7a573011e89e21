//! What stands beside the roads of this world: blocks of flats, brick houses, columnar and layered trees, lamp posts.
//!
//! Places follow a low-discrepancy sequence around the drive and are kept where nothing drives, walks or crosses; all
//! choices are drawn from the scene's digest. World frame, metres.

use std::collections::BTreeMap;

use ds_raster::PixelClass;
use ds_raster::shape;
use ds_space::{DVec2, DVec3, Draws, PoseSe2};
use ds_world::Scene;

use crate::material::{Paint, Stuff};
use crate::mesh::{Face, Mould};

const REACH_M: f64 = 130.0;
const BUCKET_M: f64 = 12.0;
const CANDIDATES: u32 = 2_600;

/// Something that stands.
#[derive(Debug, Clone)]
pub(crate) struct Stand {
    pub(crate) middle: DVec3,
    pub(crate) radius_m: f64,
    pub(crate) faces: Vec<Face>,
}

/// Where something drives, walks or is driven on, by square.
struct Busy {
    squares: BTreeMap<(i64, i64), Vec<DVec2>>,
}

fn square(at: DVec2) -> (i64, i64) {
    #[expect(clippy::cast_possible_truncation, reason = "float casts saturate")]
    let index = |x: f64| (x / BUCKET_M).floor() as i64;
    (index(at.x), index(at.y))
}

impl Busy {
    fn of(scene: &Scene, low: DVec2, high: DVec2) -> Self {
        let mut busy = Self { squares: BTreeMap::new() };
        let mut note = |at: DVec2| {
            if at.is_finite() && at.cmpge(low).all() && at.cmple(high).all() {
                busy.squares.entry(square(at)).or_default().push(at);
            }
        };
        let map = &scene.map;
        for polygon in map.drivable.iter().chain(&map.junctions).chain(map.lanes.iter().map(|lane| &lane.polygon)) {
            for [a, b, c] in shape::triangulate(polygon) {
                // Points no more than 2 m apart all over the triangle.
                let steps = (a.distance(b).max(a.distance(c)) / 2.0).ceil().clamp(1.0, 200.0);
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded above")]
                let steps = steps as u32;
                for i in 0..=steps {
                    for j in 0..=steps - i {
                        let share = |k: u32| f64::from(k) / f64::from(steps);
                        note(a + (b - a) * share(i) + (c - a) * share(j));
                    }
                }
            }
        }
        map.lanes.iter().flat_map(|lane| &lane.centre_line).for_each(|point| note(*point));
        scene.ego_log.iter().for_each(|ego| note(ego.pose.position));
        scene.tracks.iter().flat_map(|track| track.points.iter().flatten()).for_each(|p| note(p.pose.position));
        busy
    }

    /// Returns the nearest busy point within two squares and its distance.
    fn nearest(&self, at: DVec2) -> Option<(f64, DVec2)> {
        let (x, y) = square(at);
        let near = (x - 2..=x + 2).flat_map(|i| (y - 2..=y + 2).map(move |j| (i, j)));
        let points = near.filter_map(|key| self.squares.get(&key)).flatten();
        points.map(|point| (point.distance(at), *point)).min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

/// The van der Corput sequence of a base.
fn halton(mut index: u32, base: u32) -> f64 {
    let (mut share, mut value) = (1.0, 0.0);
    while index > 0 {
        share /= f64::from(base);
        value += share * f64::from(index % base);
        index /= base;
    }
    value
}

/// Places everything.
pub(crate) fn place(scene: &Scene, seed: u64) -> Vec<Stand> {
    let path = || scene.ego_log.iter().map(|ego| ego.pose.position).filter(|p| p.is_finite());
    let (Some(low), Some(high)) = (path().reduce(DVec2::min), path().reduce(DVec2::max)) else { return Vec::new() };
    let (low, high) = (low - REACH_M, high + REACH_M);
    if (high - low).max_element() > 4_000.0 {
        return Vec::new();
    }
    let busy = Busy::of(scene, low - 40.0, high + 40.0);
    let theme = Draws::new(&scene.digest, "abroad-town", &[seed]);
    let (houses, trees) = (theme.range(0, 0.3, 0.9), theme.range(1, 0.2, 0.8));
    let mut taken: Vec<(DVec2, f64)> = Vec::new();
    let mut stands = Vec::new();
    for i in 1..CANDIDATES {
        let at = low + (high - low) * DVec2::new(halton(i, 2), halton(i, 3));
        let draws = Draws::new(&scene.digest, "abroad-stand", &[u64::from(i), seed]);
        let Some((room_m, road)) = busy.nearest(at) else { continue };
        let kind = draws.uniform(0);
        let stand = if room_m > 9.0 && kind < houses {
            let reach = (room_m - 4.5).min(11.0);
            let facing = (road - at).to_angle();
            Some((house(at, facing, reach, &draws), reach + 1.0))
        } else if room_m > 3.2 && kind < houses + trees * (1.0 - houses) {
            Some((tree(at, (room_m - 1.6).min(2.6), &draws), 2.4))
        } else if room_m > 1.6 && room_m < 3.2 && kind > 0.5 {
            Some((lamp(at, (road - at).to_angle()), 1.0))
        } else {
            None
        };
        let Some((stand, radius_m)) = stand else { continue };
        if taken.iter().all(|(other, reach)| other.distance(at) > reach + radius_m) {
            taken.push((at, radius_m));
            stands.push(stand);
        }
    }
    stands
}

fn thing(stuff: Stuff, tint: [u8; 3]) -> Paint {
    Paint::new(stuff, PixelClass::Other, tint)
}

fn pick(draws: &Draws, index: u64, tints: &[[u8; 3]]) -> [u8; 3] {
    tints[usize::try_from(draws.below(index, tints.len() as u64)).unwrap_or(0)]
}

fn house(at: DVec2, facing_rad: f64, reach_m: f64, draws: &Draws) -> Stand {
    let (deep, wide) = (0.6 * reach_m * draws.range(2, 0.8, 1.0), 0.75 * reach_m * draws.range(3, 0.7, 1.0));
    let mut faces = Vec::new();
    let mut mould = Mould { pose: PoseSe2 { position: at, heading_rad: facing_rad }, bottom_m: 0.0, faces: &mut faces };
    let ring = |x: f64, y: f64, z: f64| {
        vec![DVec3::new(x, y, z), DVec3::new(-x, y, z), DVec3::new(-x, -y, z), DVec3::new(x, -y, z)]
    };
    let roof = thing(Stuff::Plain, pick(draws, 4, &[[74, 84, 92], [96, 62, 52], [132, 128, 118]]));
    let height = if draws.uniform(5) < 0.55 {
        // A block of flats: flat roof with a parapet, balconies in front.
        let height = 3.4 * draws.range(6, 2.0, 6.0).floor();
        let wall = thing(
            Stuff::Plaster,
            pick(draws, 7, &[[206, 204, 198], [184, 160, 136], [150, 170, 172], [120, 124, 134]]),
        );
        mould.loft(&[ring(deep, wide, 0.0), ring(deep, wide, height)], roof, |_, _| wall);
        let slab = thing(Stuff::Plain, [176, 176, 172]);
        let mut z = 3.4;
        while z < height {
            mould.cuboid(DVec3::new(deep, -0.7 * wide, z - 0.1), DVec3::new(deep + 1.2, 0.7 * wide, z + 0.1), slab);
            z += 3.4;
        }
        mould.cuboid(DVec3::new(-deep, -wide, height), DVec3::new(deep, wide, height + 0.5), slab);
        height
    } else {
        // A brick house with a hipped roof and a chimney.
        let height = 3.4 * draws.range(6, 1.0, 3.0).floor();
        let wall =
            thing(Stuff::Brick, pick(draws, 7, &[[150, 78, 60], [170, 108, 78], [126, 84, 74], [190, 170, 140]]));
        mould.loft(&[ring(deep, wide, 0.0), ring(deep, wide, height)], roof, |_, _| wall);
        let top = height + 0.7 * deep.min(wide);
        mould.loft(&[ring(deep + 0.5, wide + 0.5, height), ring(0.1, 0.4 * wide, top)], roof, |_, _| roof);
        let chimney = thing(Stuff::Plain, [120, 66, 52]);
        mould.cuboid(
            DVec3::new(-0.4 * deep, 0.2 * wide, height),
            DVec3::new(-0.2 * deep, 0.4 * wide, top + 0.7),
            chimney,
        );
        top
    };
    Stand {
        middle: at.extend(0.5 * height),
        radius_m: DVec3::new(deep + 1.2, wide, 0.5 * height + 1.0).length(),
        faces,
    }
}

fn tree(at: DVec2, reach_m: f64, draws: &Draws) -> Stand {
    let mut faces = Vec::new();
    let pose = PoseSe2 { position: at, heading_rad: draws.range(2, 0.0, 6.0) };
    let mut mould = Mould { pose, bottom_m: 0.0, faces: &mut faces };
    let bark = thing(Stuff::Plain, [110, 96, 82]);
    let leaves = thing(Stuff::Leaves, pick(draws, 3, &[[74, 96, 74], [112, 126, 60], [150, 118, 52], [60, 84, 46]]));
    let r = reach_m.max(0.8);
    let top = if draws.uniform(4) < 0.45 {
        // A slim column.
        let h = draws.range(5, 5.0, 9.0);
        mould.turned(DVec2::ZERO, 5, &[(0.0, 0.14), (1.0, 0.12)], bark);
        let profile = [(0.8, 0.3 * r), (0.25 * h, 0.55 * r), (0.6 * h, 0.45 * r), (0.9 * h, 0.2 * r), (h, 0.02)];
        mould.turned(DVec2::ZERO, 7, &profile, leaves);
        h
    } else {
        // A tall stem with layers of leaves.
        let stem = draws.range(5, 2.4, 4.2);
        mould.turned(DVec2::ZERO, 6, &[(0.0, 0.2), (stem + 1.0, 0.1)], bark);
        for (k, share) in [(0.0, 1.0), (1.0, 0.8), (2.0, 0.5)] {
            let z = stem + 0.95 * k;
            let shift = DVec2::from_angle(2.1 * k) * (0.2 * r);
            mould.turned(
                shift,
                8,
                &[(z, 0.2 * r), (z + 0.35, share * r), (z + 0.8, 0.75 * share * r), (z + 1.1, 0.05)],
                leaves,
            );
        }
        stem + 3.1
    };
    Stand { middle: at.extend(0.5 * top), radius_m: 0.5 * top + r, faces }
}

fn lamp(at: DVec2, facing_rad: f64) -> Stand {
    let mut faces = Vec::new();
    let mut mould = Mould { pose: PoseSe2 { position: at, heading_rad: facing_rad }, bottom_m: 0.0, faces: &mut faces };
    let steel = thing(Stuff::Plain, [70, 84, 80]);
    mould.turned(DVec2::ZERO, 5, &[(0.0, 0.12), (0.6, 0.09), (6.2, 0.06)], steel);
    mould.limb(DVec3::new(0.0, 0.0, 6.1), DVec3::new(1.4, 0.0, 6.4), 0.05, steel);
    mould.cuboid(DVec3::new(1.1, -0.12, 6.32), DVec3::new(1.7, 0.12, 6.42), steel);
    Stand { middle: at.extend(3.2), radius_m: 3.8, faces }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sequence_fills_the_square_evenly() {
        let low = (1..257).filter(|i| halton(*i, 2) < 0.5 && halton(*i, 3) < 0.5).count();
        assert!((60..=68).contains(&low), "{low} of 256 in a quarter");
    }
}
