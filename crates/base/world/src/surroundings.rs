//! What stands beside the road where a scene does not say: houses and trees, placed by draws keyed with the scene's digest.
//!
//! A grid of distances to the road (and to every recorded track and the ego's own drive) says where there is room; houses
//! stand back from the road and face it, trees line it. World frame, metres.

use ds_space::{DVec2, Draws, PoseSe2};

use crate::distance::DistanceGrid;
use crate::scene::Scene;
use crate::structure::{Structure, StructureKind};

/// How far from the drive things are placed.
const REACH_M: f64 = 150.0;
const HOUSE_CELL_M: f64 = 15.0;
const TREE_CELL_M: f64 = 8.0;

/// Places houses and trees.
#[must_use]
pub fn place(scene: &Scene, seed: u64) -> Vec<Structure> {
    let Some(grid) = DistanceGrid::new(scene, REACH_M) else { return Vec::new() };
    let theme = Draws::new(&scene.digest, "surroundings", &[seed]);
    let (houses, trees) = (theme.range(0, 0.15, 0.8), theme.range(1, 0.25, 0.7));
    let mut placed = Vec::new();
    for (x, y) in cells(&grid, HOUSE_CELL_M) {
        let draws = Draws::new(&scene.digest, "house", &[key(x), key(y), seed]);
        if draws.uniform(0) < houses {
            placed.extend(house(&grid, jittered(x, y, HOUSE_CELL_M, &draws), &draws));
        }
    }
    for (x, y) in cells(&grid, TREE_CELL_M) {
        let draws = Draws::new(&scene.digest, "tree", &[key(x), key(y), seed]);
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

fn house(grid: &DistanceGrid, at: DVec2, draws: &Draws) -> Option<Structure> {
    let (deep, wide) = (draws.range(3, 4.0, 7.0), draws.range(4, 4.5, 9.0));
    let room_m = grid.at(at);
    let away = grid.gradient(at)?;
    if room_m < DVec2::new(deep, wide).length() + 4.0 || room_m > 70.0 {
        return None;
    }
    let pose = PoseSe2 { position: at, heading_rad: (-away).to_angle() };
    let storeys = 1 + draws.below(5, if room_m > 25.0 { 7 } else { 4 });
    let eaves_m = 3.0 * storeys as f64 + draws.range(6, 0.6, 1.4);
    // The roof of a low house is a gable.
    let top_m = if storeys <= 2 { eaves_m + 0.55 * deep } else { eaves_m };
    Some(Structure::cuboid(StructureKind::Building, pose, [deep, wide], [0.0, top_m]))
}

fn tree(at: DVec2, room_m: f64, draws: &Draws) -> Structure {
    let reach = draws.range(5, 1.3, 2.6).min(0.75 * room_m);
    let trunk = draws.range(6, 1.8, 3.0);
    let heading = draws.range(7, 0.0, 6.3);
    let conifer = draws.uniform(8) < 0.2;
    let (radius, bottom_m, tall) = if conifer {
        (0.75 * reach, 0.5 * trunk, 2.8 * reach + 2.0)
    } else {
        (reach, trunk, 1.8 * reach * draws.range(9, 0.8, 1.3))
    };
    let corner = |i: u8| at + DVec2::from_angle(heading + f64::from(i) * std::f64::consts::FRAC_PI_3) * radius;
    Structure {
        kind: StructureKind::Vegetation,
        outline: (0..6).map(corner).collect(),
        bottom_m,
        top_m: bottom_m + tall,
    }
}
