//! Houses and trees beside the road: placed by draws keyed with the scene's digest, never on or near the road.
//!
//! A grid of distances to the road (and to every recorded track and the ego's own drive) says where there is room;
//! houses stand back from the road and face it, trees line it. World frame, metres.

use ds_space::{DVec2, DVec3, Draws, PoseSe2};
use ds_world::Scene;

use crate::distance::DistanceGrid;
use crate::solid::{Builder, Facet, Skin, Slab};
use crate::surface::{Material, PixelClass, Rgb, Surface};

/// How far from the drive things are placed.
const REACH_M: f64 = 150.0;
const HOUSE_CELL_M: f64 = 15.0;
const TREE_CELL_M: f64 = 8.0;
const WALLS: [Rgb; 8] = [
    [196, 178, 150],
    [158, 92, 74],
    [178, 176, 170],
    [214, 206, 190],
    [128, 122, 116],
    [186, 150, 112],
    [150, 160, 168],
    [206, 188, 128],
];
const LEAVES: [Rgb; 5] = [[62, 96, 42], [80, 112, 46], [50, 84, 48], [104, 116, 50], [44, 72, 40]];

/// Something that stands beside the road.
#[derive(Debug, Clone)]
pub(crate) struct Standing {
    pub(crate) middle: DVec3,
    pub(crate) radius_m: f64,
    pub(crate) facets: Vec<Facet>,
    /// Outline on the ground and the height at which it is as wide: what casts the shadow.
    pub(crate) shadow_base: Vec<DVec2>,
    pub(crate) shadow_from_m: f64,
    pub(crate) shadow_to_m: f64,
}

/// Places houses and trees.
pub(crate) fn place(scene: &Scene, palette_seed: u64) -> Vec<Standing> {
    let Some(grid) = DistanceGrid::new(scene, REACH_M) else { return Vec::new() };
    let theme = Draws::new(&scene.digest, "surroundings", &[palette_seed]);
    let (houses, trees) = (theme.range(0, 0.15, 0.8), theme.range(1, 0.25, 0.7));
    let mut placed = Vec::new();
    for (x, y) in cells(&grid, HOUSE_CELL_M) {
        let draws = Draws::new(&scene.digest, "house", &[key(x), key(y), palette_seed]);
        if draws.uniform(0) < houses {
            placed.extend(house(&grid, jittered(x, y, HOUSE_CELL_M, &draws), &draws));
        }
    }
    for (x, y) in cells(&grid, TREE_CELL_M) {
        let draws = Draws::new(&scene.digest, "tree", &[key(x), key(y), palette_seed]);
        let at = jittered(x, y, TREE_CELL_M, &draws);
        let room_m = grid.at(at);
        let near = (3.4..12.0).contains(&room_m) && draws.uniform(0) < trees;
        let far = (12.0..60.0).contains(&room_m) && draws.uniform(0) < 0.25 * trees;
        if near || far {
            placed.push(tree(at, room_m, &draws));
        }
    }
    placed
}

/// Returns all cells of a width that lie in the grid.
fn cells(grid: &DistanceGrid, cell_m: f64) -> impl Iterator<Item = (i64, i64)> + use<> {
    #[expect(clippy::cast_possible_truncation, reason = "the grid is bounded to some thousand metres")]
    let index = |at: f64| (at / cell_m).floor() as i64;
    let (low, high) = grid.bounds();
    let (columns, rows) = (index(low.x)..=index(high.x), index(low.y)..=index(high.y));
    columns.flat_map(move |x| rows.clone().map(move |y| (x, y)))
}

fn key(cell: i64) -> u64 {
    u64::from_le_bytes(cell.to_le_bytes())
}

fn jittered(x: i64, y: i64, cell_m: f64, draws: &Draws) -> DVec2 {
    DVec2::new(x as f64 + draws.range(1, 0.15, 0.85), y as f64 + draws.range(2, 0.15, 0.85)) * cell_m
}

fn pick(draws: &Draws, index: u64, colours: &[Rgb]) -> Rgb {
    colours[usize::try_from(draws.below(index, colours.len() as u64)).unwrap_or(0)]
}

fn varied(colour: Rgb, draws: &Draws, index: u64) -> Rgb {
    let factor = draws.range(index, 0.85, 1.12);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
    let scaled = colour.map(|c| (f64::from(c) * factor).clamp(0.0, 255.0) as u8);
    scaled
}

fn house(grid: &DistanceGrid, at: DVec2, draws: &Draws) -> Option<Standing> {
    let (deep, wide) = (draws.range(3, 4.0, 7.0), draws.range(4, 4.5, 9.0));
    let room_m = grid.at(at);
    let away = grid.gradient(at)?;
    if room_m < DVec2::new(deep, wide).length() + 4.0 || room_m > 70.0 {
        return None;
    }
    let pose = PoseSe2 { position: at, heading_rad: (-away).to_angle() };
    let storeys = 1 + draws.below(5, if room_m > 25.0 { 7 } else { 4 });
    let height = 3.0 * storeys as f64 + draws.range(6, 0.6, 1.4);
    let wall = varied(pick(draws, 7, &WALLS), draws, 8);
    let facade = Surface::solid(Material::Facade, PixelClass::Other, wall);
    let roof = Surface::solid(
        Material::Matte,
        PixelClass::Other,
        pick(draws, 9, &[[120, 62, 48], [84, 80, 78], [104, 96, 90]]),
    );
    let mut facets = Vec::new();
    let mut builder = Builder::new(pose, 0.0, &mut facets);
    let base = Slab::new(0.0, -deep, deep, wide);
    builder.frustum(base, Slab { z: height, ..base }, &Skin { top: roof, ..Skin::all(facade) });
    if storeys <= 3 {
        let eaves = Slab::new(height, -deep - 0.4, deep + 0.4, wide + 0.4);
        let ridge = Slab::new(height + 0.55 * deep, -0.15, 0.15, wide - 0.3);
        builder.frustum(eaves, ridge, &Skin { side: facade_plain(wall), ..Skin::all(roof) });
    }
    Some(Standing {
        middle: at.extend(0.5 * height),
        radius_m: DVec3::new(deep + 1.0, wide + 1.0, 0.8 * height).length(),
        facets,
        shadow_base: [(deep, wide), (-deep, wide), (-deep, -wide), (deep, -wide)]
            .map(|(x, y)| pose.to_outer(DVec2::new(x, y)))
            .to_vec(),
        shadow_from_m: 0.0,
        shadow_to_m: height,
    })
}

fn facade_plain(colour: Rgb) -> Surface {
    Surface::solid(Material::Matte, PixelClass::Other, colour)
}

fn tree(at: DVec2, room_m: f64, draws: &Draws) -> Standing {
    let bark = Surface::solid(Material::Matte, PixelClass::Other, [86, 68, 52]);
    let leaves = Surface::solid(Material::Foliage, PixelClass::Other, varied(pick(draws, 3, &LEAVES), draws, 4));
    let reach = draws.range(5, 1.3, 2.6).min(0.75 * room_m);
    let trunk = draws.range(6, 1.8, 3.0);
    let pose = PoseSe2 { position: at, heading_rad: draws.range(7, 0.0, 6.3) };
    let mut facets = Vec::new();
    let mut builder = Builder::new(pose, 0.0, &mut facets);
    let conifer = draws.uniform(8) < 0.2;
    builder.frustum(Slab::new(0.0, -0.2, 0.2, 0.2), Slab::new(trunk + 0.8, -0.11, 0.11, 0.11), &Skin::all(bark));
    let top = if conifer {
        let height = 2.8 * reach + 2.0;
        builder.cone(DVec3::Z * (0.5 * trunk), 0.75 * reach, 0.7 * height, leaves);
        builder.cone(DVec3::Z * (0.5 * trunk + 0.4 * height), 0.55 * reach, 0.6 * height, leaves);
        0.5 * trunk + height
    } else {
        let tall = reach * draws.range(9, 0.8, 1.3);
        builder.ball(DVec3::Z * (trunk + 0.8 * tall), DVec3::new(reach, reach, tall), leaves);
        let side = DVec3::new(0.55 * reach, 0.2 * reach, trunk + 0.5 * tall);
        builder.ball(side, DVec3::splat(0.62 * reach), leaves);
        builder.ball(DVec3::new(-0.5 * reach, 0.35 * reach, trunk + 0.7 * tall), DVec3::splat(0.6 * reach), leaves);
        trunk + 1.8 * tall
    };
    let ring = |i: u8| DVec2::from_angle(f64::from(i) * 0.785) * (0.9 * reach);
    Standing {
        middle: at.extend(0.5 * top),
        radius_m: 0.5 * top + reach,
        facets,
        shadow_base: (0..8).map(|i| at + ring(i)).collect(),
        shadow_from_m: trunk,
        shadow_to_m: top - 0.4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::street;

    #[test]
    fn houses_and_trees_stand_beside_the_road_and_the_same_ones_each_time() {
        let scene = street::scene();
        let grid = DistanceGrid::new(&scene, REACH_M).expect("the scene has a drive");
        let placed = place(&scene, 3);
        assert!(placed.len() > 50, "only {} things stand", placed.len());
        for standing in &placed {
            let low = standing.facets.iter().flat_map(|(corners, _)| corners).filter(|corner| corner.z < 0.1);
            for corner in low {
                assert!(grid.at(corner.truncate()) > 2.0, "{corner:?} stands on or near the road");
            }
        }
        let middles = |placed: &[Standing]| placed.iter().map(|standing| standing.middle).collect::<Vec<_>>();
        assert_eq!(middles(&placed), middles(&place(&scene, 3)));
        assert_ne!(middles(&placed), middles(&place(&scene, 4)));
    }
}
