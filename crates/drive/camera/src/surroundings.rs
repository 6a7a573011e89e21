//! Houses, trees and what else stands beside the road: the scene says where and how large, colours and roofs are draws
//! keyed with its digest. World frame, metres.

use ds_raster::shape;
use ds_space::{DVec2, DVec3, Draws, PoseSe2};
use ds_world::{Scene, Structure, StructureKind, surroundings};

use crate::solid::{Builder, Facet, Skin, Slab};
use crate::surface::{Material, PixelClass, Rgb, Surface};

/// Lower rectangular buildings have gable roofs.
const GABLED_BELOW_M: f64 = 11.5;
/// Height over radius of a crown from which it is a conifer's.
const SLENDER: f64 = 2.8;
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

/// Dresses all that stands in a scene; where it names nothing, houses and trees are placed by draws.
pub(crate) fn dress(scene: &Scene, palette_seed: u64) -> Vec<Standing> {
    let dress = |structure: &Structure| {
        let [x, y] = structure.key();
        let draws = Draws::new(&scene.digest, "dress", &[x, y, palette_seed]);
        let (facets, shadow_from_m) = match structure.kind {
            StructureKind::Building => (building(structure, &draws), 0.0),
            StructureKind::Vegetation => (tree(structure, &draws), structure.bottom_m),
            StructureKind::Pole => (prism(structure, matte([112, 116, 118])), structure.bottom_m),
            StructureKind::Fence => (prism(structure, matte([134, 112, 84])), structure.bottom_m),
            StructureKind::Wall => (prism(structure, matte(pick(&draws, 7, &WALLS))), structure.bottom_m),
        };
        let (middle, radius_m) = structure.ball();
        Standing {
            middle,
            radius_m: radius_m + 1.0,
            facets,
            shadow_base: structure.outline.clone(),
            shadow_from_m,
            shadow_to_m: structure.top_m,
        }
    };
    scene.map.structures_or(|| surroundings::place(scene, palette_seed)).iter().map(dress).collect()
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

/// Returns an outline raised between two heights, without its bottom.
fn prism(structure: &Structure, surface: Surface) -> Vec<Facet> {
    walls(structure, structure.top_m, surface, surface)
}

fn walls(structure: &Structure, top_m: f64, wall: Surface, top: Surface) -> Vec<Facet> {
    let mut facets = Vec::new();
    let pose = PoseSe2 { position: structure.centre(), heading_rad: 0.0 };
    let outline: Vec<DVec2> = structure.outline.iter().map(|corner| pose.to_local(*corner)).collect();
    let mut builder = Builder::new(pose, 0.0, &mut facets);
    let turn = shape::signed_area(&outline).signum();
    for (i, a) in outline.iter().enumerate() {
        let b = outline[(i + 1) % outline.len()];
        let (low, high) = (structure.bottom_m, top_m);
        let quad = [a.extend(low), b.extend(low), b.extend(high), a.extend(high)];
        // Outward is to the right of an edge that goes round to the left.
        let inside = a.midpoint(b) + (b - *a).perp() * turn;
        builder.polygon(&quad, inside.extend(0.5 * (low + high)), wall);
    }
    for triangle in shape::triangulate(&outline) {
        builder.polygon(&triangle.map(|corner| corner.extend(top_m)), DVec3::ZERO, top);
    }
    facets
}

/// A low rectangular building has a gable roof within its height, any other a flat one.
fn building(structure: &Structure, draws: &Draws) -> Vec<Facet> {
    let wall = varied(pick(draws, 7, &WALLS), draws, 8);
    let facade = Surface::solid(Material::Facade, PixelClass::Other, wall);
    let roof = matte(pick(draws, 9, &[[120, 62, 48], [84, 80, 78], [104, 96, 90]]));
    let [a, b, c, _] = structure.outline[..] else { return walls(structure, structure.top_m, facade, roof) };
    let (wide, deep) = (0.5 * a.distance(b), 0.5 * b.distance(c));
    let eaves_m = structure.top_m - 0.55 * deep;
    if structure.top_m >= GABLED_BELOW_M || eaves_m < 2.2 {
        return walls(structure, structure.top_m, facade, roof);
    }
    let mut facets = walls(structure, eaves_m, facade, roof);
    let pose = PoseSe2 { position: structure.centre(), heading_rad: (b - c).to_angle() };
    let eaves = Slab::new(eaves_m, -deep - 0.4, deep + 0.4, wide + 0.4);
    let ridge = Slab::new(structure.top_m, -0.15, 0.15, wide - 0.3);
    Builder::new(pose, 0.0, &mut facets).frustum(eaves, ridge, &Skin { side: matte(wall), ..Skin::all(roof) });
    facets
}

fn matte(colour: Rgb) -> Surface {
    Surface::solid(Material::Matte, PixelClass::Other, colour)
}

/// A crown that is much taller than wide is a conifer's.
fn tree(structure: &Structure, draws: &Draws) -> Vec<Facet> {
    let bark = matte([86, 68, 52]);
    let leaves = Surface::solid(Material::Foliage, PixelClass::Other, varied(pick(draws, 3, &LEAVES), draws, 4));
    let (reach, trunk, tall) = (structure.reach_m(), structure.bottom_m, structure.top_m - structure.bottom_m);
    let pose = PoseSe2 { position: structure.centre(), heading_rad: draws.range(7, 0.0, 6.3) };
    let mut facets = Vec::new();
    let mut builder = Builder::new(pose, 0.0, &mut facets);
    builder.frustum(Slab::new(0.0, -0.2, 0.2, 0.2), Slab::new(trunk + 0.8, -0.11, 0.11, 0.11), &Skin::all(bark));
    if tall > SLENDER * reach {
        builder.cone(DVec3::Z * trunk, reach, 0.7 * tall, leaves);
        builder.cone(DVec3::Z * (trunk + 0.4 * tall), 0.73 * reach, 0.6 * tall, leaves);
    } else {
        let half = tall / 1.8;
        builder.ball(DVec3::Z * (trunk + 0.8 * half), DVec3::new(reach, reach, half), leaves);
        let side = DVec3::new(0.55 * reach, 0.2 * reach, trunk + 0.5 * half);
        let lump = DVec3::new(reach, reach, reach.min(half));
        builder.ball(side, 0.62 * lump, leaves);
        builder.ball(DVec3::new(-0.5 * reach, 0.35 * reach, trunk + 0.7 * half), 0.6 * lump, leaves);
    }
    facets
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::street;

    #[test]
    fn what_a_scene_names_stands_where_it_says_and_nothing_else_does() {
        let mut scene = street::scene();
        let placed = dress(&scene, 3);
        assert!(placed.len() > 50, "only {} things stand", placed.len());
        let outline = [(40.0, 20.0), (40.0, 30.0), (52.0, 30.0), (52.0, 20.0)].map(DVec2::from).to_vec();
        for (kind, top_m) in StructureKind::ALL.into_iter().flat_map(|kind| [(kind, 6.0), (kind, 20.0)]) {
            scene.map.structures = vec![Structure { kind, outline: outline.clone(), bottom_m: 0.0, top_m }];
            let named = dress(&scene, 3);
            assert_eq!(named.len(), 1);
            let corners = || named[0].facets.iter().flat_map(|(corners, _)| corners);
            let reach_m = 1.25 * scene.map.structures[0].reach_m();
            let away_m = |corner: &DVec3| corner.truncate().distance(DVec2::new(46.0, 25.0));
            assert!(corners().all(|corner| away_m(corner) < reach_m), "{kind:?} reaches too far");
            let top = corners().map(|corner| corner.z).fold(0.0, f64::max);
            assert!((top - top_m).abs() < 1e-9, "{kind:?} ends at {top} m");
            // Walls look outwards: each lies on the far side of its own normal.
            let middle = named[0].middle;
            let inward = named[0].facets.iter().filter(|(corners, surface)| {
                let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
                surface.normal[2] == 0 && DVec3::from(surface.normal.map(f64::from)).dot(centre - middle) < 0.0
            });
            assert!(kind == StructureKind::Vegetation || inward.count() == 0, "{kind:?}");
        }
    }
}
