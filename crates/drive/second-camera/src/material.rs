//! What faces are made of, and the albedo and gloss of each material at a place.

use ds_raster::PixelClass;
use ds_space::{DVec3, Vec2, Vec3};

use crate::cells::{around, bumps, floor, unit};

/// A material.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stuff {
    Sky,
    /// Earth and gravel beside the road.
    Gravel,
    /// Concrete slabs.
    Slabs,
    /// Small stones in rows, beside the road.
    Cobbles,
    Marking,
    Plain,
    Lacquer,
    Pane,
    /// Walls of plaster with bands of windows.
    Plaster,
    /// Walls of bricks with single windows.
    Brick,
    Leaves,
    Glow,
}

impl Stuff {
    pub(crate) fn is_ground(self) -> bool {
        matches!(self, Self::Gravel | Self::Slabs | Self::Cobbles | Self::Marking)
    }

    pub(crate) fn is_road(self) -> bool {
        matches!(self, Self::Slabs | Self::Marking)
    }
}

/// What a pixel shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Paint {
    pub(crate) stuff: Stuff,
    pub(crate) class: PixelClass,
    /// sRGB.
    pub(crate) tint: [u8; 3],
    /// Outward normal times 100.
    pub(crate) normal: [i8; 3],
}

impl Paint {
    pub(crate) const SKY: Self = Self { stuff: Stuff::Sky, class: PixelClass::Sky, tint: [0; 3], normal: [0, 0, 100] };

    pub(crate) const fn new(stuff: Stuff, class: PixelClass, tint: [u8; 3]) -> Self {
        Self { stuff, class, tint, normal: [0, 0, 100] }
    }

    pub(crate) fn facing(self, normal: DVec3) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "components of a unit vector times 100 fit")]
        let normal = (normal * 100.0).round().to_array().map(|n| n as i8);
        Self { normal, ..self }
    }

    pub(crate) fn normal(&self) -> Vec3 {
        Vec3::from_array(self.normal.map(f32::from)).normalize_or(Vec3::Z)
    }
}

/// Returns the linear light of an sRGB colour, by the standard's own curve.
pub(crate) fn linear(tint: [u8; 3]) -> Vec3 {
    let channel = |c: u8| {
        let c = f32::from(c) / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    };
    Vec3::new(channel(tint[0]), channel(tint[1]), channel(tint[2]))
}

/// How a place reflects.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Finish {
    pub(crate) albedo: Vec3,
    /// Share of mirrored light.
    pub(crate) gloss: f32,
    /// Shines by itself at night.
    pub(crate) lit: bool,
}

/// Returns how much of a detail is left at a pixel's size.
fn kept(detail_m: f32, pixel_m: f32) -> f32 {
    (1.6 - pixel_m / detail_m).clamp(0.0, 1.0)
}

/// Returns the finish of a paint at a place (metres from the scene's anchor) seen with a pixel's size.
pub(crate) fn finish(paint: &Paint, at: Vec3, pixel_m: f32, seed: u32) -> Finish {
    let base = linear(paint.tint);
    let p = at.truncate();
    let matte = |albedo: Vec3| Finish { albedo, gloss: 0.0, lit: false };
    match paint.stuff {
        Stuff::Gravel => {
            let patch = bumps(p / 6.0, seed);
            let stones = around(p / 0.35, seed ^ 3);
            let weeds = linear([96, 110, 62]);
            let earth = base + (weeds - base) * ((patch - 0.5) * 3.0).clamp(0.0, 1.0);
            matte(earth * (1.0 + 0.5 * (stones.tone - 0.5) * kept(0.35, pixel_m)))
        }
        Stuff::Slabs => matte(slabs(base, p, pixel_m, seed)),
        Stuff::Cobbles => {
            let row = floor(p.y / 0.28);
            let shifted = Vec2::new(p.x / 0.45 + 0.5 * (row & 1) as f32, p.y / 0.28);
            let (u, v) = (shifted.x - shifted.x.floor(), shifted.y - shifted.y.floor());
            let left = kept(0.45, pixel_m);
            let joint = if u < 0.1 || v < 0.14 { 0.4 * left } else { 0.0 };
            let tone = unit(floor(shifted.x), row, seed ^ 8) - 0.5;
            matte(base * (1.0 + 0.3 * tone * left - joint))
        }
        Stuff::Marking => {
            let worn = bumps(p / 0.8, seed ^ 12);
            let under = slabs(linear([138, 136, 130]), p, pixel_m, seed);
            matte(under + (base - under) * (1.25 - 0.7 * worn).clamp(0.5, 1.0))
        }
        Stuff::Lacquer => Finish { albedo: base, gloss: 0.10, lit: false },
        Stuff::Pane => Finish { albedo: base * 0.4, gloss: 0.32, lit: false },
        Stuff::Plaster | Stuff::Brick => wall(paint, base, at, pixel_m, seed),
        Stuff::Leaves => {
            let cell = around(Vec2::new(p.x + 1.3 * at.z, p.y - 0.8 * at.z) / 0.6, seed ^ 21);
            matte(base * (0.55 + 0.9 * cell.tone * kept(0.6, pixel_m) + 0.35 * (1.0 - cell.nearest)))
        }
        Stuff::Plain | Stuff::Glow | Stuff::Sky => matte(base),
    }
}

/// Concrete in slabs of 5 m with dark joints, each of its own tone, with oil stains in the middle.
fn slabs(base: Vec3, p: Vec2, pixel_m: f32, seed: u32) -> Vec3 {
    let (u, v) = (p.x / 5.0, p.y / 5.0);
    let tone = unit(floor(u), floor(v), seed ^ 5) - 0.5;
    let edge = |t: f32| {
        let t = t - t.floor();
        t.min(1.0 - t) * 5.0
    };
    let joint = if edge(u).min(edge(v)) < 0.05 { 0.45 * kept(0.3, pixel_m) } else { 0.0 };
    let stain = around(p / 7.0, seed ^ 6);
    let dark = if stain.nearest < 0.22 { 0.25 } else { 0.0 };
    let speckle = around(p / 0.12, seed ^ 7).tone - 0.5;
    base * (1.0 + 0.2 * tone + 0.25 * speckle * kept(0.12, pixel_m) - joint - dark)
}

/// A wall: bands of glass in plaster, or single tall windows in bricks; doors on the ground floor.
fn wall(paint: &Paint, base: Vec3, at: Vec3, pixel_m: f32, seed: u32) -> Finish {
    let normal = paint.normal();
    if normal.z.abs() > 0.6 {
        return Finish { albedo: linear([120, 122, 124]), gloss: 0.0, lit: false };
    }
    let along = at.x * -normal.y + at.y * normal.x;
    let storey = floor(at.z / 3.4);
    let up = at.z / 3.4 - storey as f32;
    let (column, glass) = if paint.stuff == Stuff::Plaster {
        (floor(along / 4.2), up > 0.38 && up < 0.78 && (along / 0.9 - (along / 0.9).floor()) > 0.07)
    } else {
        let column = along / 1.9;
        let u = column - column.floor();
        (floor(column), up > 0.22 && up < 0.86 && u > 0.33 && u < 0.71)
    };
    if glass && pixel_m < 2.0 {
        let lit = unit(column, storey, seed ^ 31) < 0.35;
        return Finish { albedo: Vec3::new(0.03, 0.035, 0.04), gloss: 0.22, lit };
    }
    let course = if paint.stuff == Stuff::Brick {
        let row = floor(at.z / 0.12);
        0.28 * (unit(floor(along / 0.3), row, seed ^ 32) - 0.5) * kept(0.12, pixel_m)
    } else {
        0.12 * (bumps(Vec2::new(along, at.z) / 3.0, seed ^ 33) - 0.5)
    };
    let shaded = if up > 0.94 { 0.7 } else { 1.0 };
    Finish { albedo: base * (1.0 + course) * shaded, gloss: 0.0, lit: false }
}
