//! Procedural textures: what asphalt, paving, verge, foliage and house fronts look like at a place.
//!
//! Each returns a linear albedo (or a factor) from world position, seed and the size of a pixel on the surface in metres
//! (`grain_m`), with which details finer than the pixel fade away.

use ds_space::{Vec2, Vec3};

use crate::noise::{cell, smooth};
use crate::surface::Rgb;

/// Returns the linear albedo of an sRGB colour (gamma 2).
pub(crate) fn linear(colour: Rgb) -> Vec3 {
    let c = colour.map(|c| f32::from(c) * (1.0 / 255.0));
    Vec3::new(c[0] * c[0], c[1] * c[1], c[2] * c[2])
}

/// Returns how much of a detail of some size is left at a pixel size.
fn left(detail_m: f32, grain_m: f32) -> f32 {
    (1.4 * detail_m / grain_m - 0.4).clamp(0.0, 1.0)
}

/// Floors to a lattice index.
fn lattice(at: f32) -> i32 {
    #[expect(clippy::cast_possible_truncation, reason = "float casts saturate")]
    let index = at.floor() as i32;
    index
}

/// Asphalt: broad tone, stains, repaired patches, cracks and grain.
pub(crate) fn asphalt(albedo: Vec3, p: Vec2, grain_m: f32, seed: u32) -> Vec3 {
    let broad = smooth(p.x / 11.0, p.y / 11.0, seed) - 0.5;
    let stains = smooth(p.x / 2.3, p.y / 2.3, seed ^ 11) - 0.5;
    let mut tone = 1.0 + 0.30 * broad + 0.24 * stains * left(2.3, grain_m);
    let fine = left(0.22, grain_m);
    if fine > 0.0 {
        tone += 0.32 * fine * (smooth(p.x / 0.22, p.y / 0.22, seed ^ 12) - 0.5);
    }
    let (cx, cy) = (lattice(p.x / 9.0), lattice(p.y / 9.0));
    if cell(cx, cy, seed ^ 13) < 0.22 {
        let (u, v) = (p.x / 9.0 - cx as f32, p.y / 9.0 - cy as f32);
        let (w, h) = (0.25 + 0.6 * cell(cx, cy, seed ^ 14), 0.2 + 0.3 * cell(cx, cy, seed ^ 15));
        if u > 0.1 && u < 0.1 + w && v > 0.2 && v < 0.2 + h {
            tone *= if cell(cx, cy, seed ^ 16) < 0.7 { 0.76 } else { 1.16 };
        }
    }
    let crack = left(0.5, grain_m);
    if crack > 0.0 {
        let ridge = (smooth(p.x / 3.7, p.y / 3.7, seed ^ 17) - 0.5).abs();
        if ridge < 0.012 {
            tone *= 1.0 - 0.35 * crack;
        }
    }
    albedo * tone
}

/// Returns how much paint is left on the road, 0 to 1.
pub(crate) fn paint_left(p: Vec2, grain_m: f32, seed: u32) -> f32 {
    let worn = smooth(p.x / 1.3, p.y / 1.3, seed ^ 21) * 0.6
        + smooth(p.x / 0.17, p.y / 0.17, seed ^ 22) * 0.4 * left(0.17, grain_m);
    (1.12 - 0.75 * worn * worn).clamp(0.35, 0.95)
}

/// Paving slabs with joints.
pub(crate) fn paving(albedo: Vec3, p: Vec2, grain_m: f32, seed: u32) -> Vec3 {
    let size = 1.2;
    let (cx, cy) = (lattice(p.x / size), lattice(p.y / size));
    let slab = left(size, grain_m);
    let (u, v) = (p.x / size - cx as f32, p.y / size - cy as f32);
    let joint = if u < 0.05 || v < 0.05 { 0.25 * left(0.5, grain_m) } else { 0.0 };
    albedo
        * (1.0 + 0.16 * slab * (cell(cx, cy, seed ^ 31) - 0.5) + 0.2 * (smooth(p.x / 6.0, p.y / 6.0, seed ^ 32) - 0.5)
            - joint)
}

/// Grass with dry patches.
pub(crate) fn verge(p: Vec2, grain_m: f32, seed: u32) -> Vec3 {
    let dry = smooth(p.x / 9.0, p.y / 9.0, seed ^ 41);
    let green = linear([78, 104, 50]);
    let straw = linear([136, 124, 78]);
    let blend = ((dry - 0.45) * 2.2).clamp(0.0, 1.0);
    let tone = 1.0
        + 0.4 * (smooth(p.x / 2.1, p.y / 2.1, seed ^ 42) - 0.5) * left(2.1, grain_m)
        + 0.5 * (smooth(p.x / 0.3, p.y / 0.3, seed ^ 43) - 0.5) * left(0.3, grain_m);
    (green + (straw - green) * blend) * tone
}

/// Leaves: dark gaps and light tips.
pub(crate) fn foliage(albedo: Vec3, p: Vec3, grain_m: f32, seed: u32) -> Vec3 {
    let (u, v) = (p.x + 0.7 * p.z, p.y - 0.6 * p.z);
    let coarse = smooth(u / 0.9, v / 0.9, seed ^ 51) - 0.5;
    let fine = (smooth(u / 0.3, v / 0.3 + p.z, seed ^ 52) - 0.5) * left(0.3, grain_m);
    albedo * (1.0 + 0.9 * coarse + 0.7 * fine).max(0.2)
}

/// What a house front shows at a place.
pub(crate) enum Front {
    /// Wall with this albedo.
    Wall(Vec3),
    /// A window; lit from inside at night or not.
    Window {
        /// Whether someone is at home.
        lit: bool,
    },
}

/// A house front: rows of windows, a plinth, a cornice. `u` runs along the wall, `z` upwards.
pub(crate) fn facade(albedo: Vec3, u: f32, z: f32, grain_m: f32, seed: u32) -> Front {
    let (column, storey) = (lattice(u / 2.6), lattice(z / 3.0));
    let (a, b) = (u / 2.6 - column as f32, z / 3.0 - storey as f32);
    let shop = storey == 0 && cell(lattice(u / 9.0), 7, seed ^ 61) < 0.4;
    let inside =
        if shop { a > 0.06 && a < 0.94 && b > 0.12 && b < 0.8 } else { a > 0.28 && a < 0.74 && b > 0.32 && b < 0.8 };
    if inside && grain_m < 1.6 {
        return Front::Window { lit: cell(column, storey, seed ^ 62) < 0.45 };
    }
    let tone = 1.0 + 0.16 * (smooth(u / 3.1, z / 2.3, seed ^ 63) - 0.5);
    let band = if z < 0.6 || b > 0.95 { 0.8 } else { 1.0 };
    // Where windows are finer than a pixel, the wall is as dark as both together.
    let blurred = if grain_m < 1.6 { 1.0 } else { 0.8 };
    Front::Wall(albedo * (tone * band * blurred))
}
