//! Building blocks of everything that stands on the ground: frusta, discs and balls, placed by a planar pose.
//!
//! Local frame of a model: x forward, y left, z up from the model's bottom, in metres. Faces get outward normals.

use ds_space::{DVec2, DVec3, PoseSe2};

use crate::surface::Surface;

/// A world triangle with what it shows.
pub(crate) type Facet = ([DVec3; 3], Surface);

/// A rectangle at a height: from `back` to `front` along x, `half_width` to both sides of y = `left`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slab {
    pub(crate) z: f64,
    pub(crate) back: f64,
    pub(crate) front: f64,
    pub(crate) left: f64,
    pub(crate) half_width: f64,
}

impl Slab {
    /// A rectangle centred in y.
    pub(crate) fn new(z: f64, back: f64, front: f64, half_width: f64) -> Self {
        Self { z, back, front, left: 0.0, half_width }
    }

    pub(crate) fn moved_left(self, left: f64) -> Self {
        Self { left, ..self }
    }

    fn corners(&self) -> [DVec3; 4] {
        let (l, r) = (self.left + self.half_width, self.left - self.half_width);
        [(self.front, l), (self.back, l), (self.back, r), (self.front, r)].map(|(x, y)| DVec3::new(x, y, self.z))
    }
}

/// What the faces of a frustum show.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Skin {
    pub(crate) front: Surface,
    pub(crate) rear: Surface,
    pub(crate) side: Surface,
    pub(crate) top: Surface,
}

impl Skin {
    pub(crate) fn all(surface: Surface) -> Self {
        Self { front: surface, rear: surface, side: surface, top: surface }
    }
}

/// Adds models at one place to a list of facets.
pub(crate) struct Builder<'a> {
    pose: PoseSe2,
    bottom_m: f64,
    facets: &'a mut Vec<Facet>,
}

impl<'a> Builder<'a> {
    pub(crate) fn new(pose: PoseSe2, bottom_m: f64, facets: &'a mut Vec<Facet>) -> Self {
        Self { pose, bottom_m, facets }
    }

    fn to_world(&self, p: DVec3) -> DVec3 {
        self.pose.to_outer(p.truncate()).extend(self.bottom_m + p.z)
    }

    /// Adds a convex polygon whose normal points away from `inside` (local frame).
    pub(crate) fn polygon(&mut self, corners: &[DVec3], inside: DVec3, surface: Surface) {
        let Some(normal) = (corners[1] - corners[0]).cross(corners[2] - corners[0]).try_normalize() else { return };
        let outward = if normal.dot(corners[0] - inside) < 0.0 { -normal } else { normal };
        let turned = self.pose.forward() * outward.x + self.pose.left() * outward.y;
        let surface = surface.facing(turned.extend(outward.z));
        let first = self.to_world(corners[0]);
        for i in 2..corners.len() {
            self.facets.push(([first, self.to_world(corners[i - 1]), self.to_world(corners[i])], surface));
        }
    }

    /// Adds the solid between two rectangles, without its bottom.
    pub(crate) fn frustum(&mut self, bottom: Slab, top: Slab, skin: &Skin) {
        let (b, t) = (bottom.corners(), top.corners());
        let inside = (b.iter().sum::<DVec3>() + t.iter().sum::<DVec3>()) / 8.0;
        for (from, to, surface) in [(3, 0, skin.front), (0, 1, skin.side), (1, 2, skin.rear), (2, 3, skin.side)] {
            self.polygon(&[b[from], b[to], t[to], t[from]], inside, surface);
        }
        self.polygon(&t, inside, skin.top);
    }

    /// Adds an upright box.
    pub(crate) fn block(&mut self, bottom: Slab, height: f64, surface: Surface) {
        self.frustum(bottom, Slab { z: bottom.z + height, ..bottom }, &Skin::all(surface));
    }

    /// Adds a flat rectangle in the plane x = `at.x`, facing forward or backward.
    pub(crate) fn plate_x(&mut self, at: DVec3, half_width: f64, half_height: f64, surface: Surface) {
        let (w, h) = (DVec3::Y * half_width, DVec3::Z * half_height);
        let inside = DVec3::new(0.0, at.y, at.z);
        self.polygon(&[at - w - h, at + w - h, at + w + h, at - w + h], inside, surface);
    }

    /// Adds an upright disc in the plane y = `at.y`, facing away from the model's middle.
    pub(crate) fn disc_y(&mut self, at: DVec3, radius: f64, surface: Surface) {
        let rim: Vec<DVec3> = octagon().map(|d| at + DVec3::new(d.x, 0.0, d.y) * radius).to_vec();
        self.polygon(&rim, DVec3::new(at.x, 0.0, at.z), surface);
    }

    /// Adds an upright disc in the plane x = `at.x`, facing forward.
    pub(crate) fn disc_x(&mut self, at: DVec3, radius: f64, surface: Surface) {
        let rim: Vec<DVec3> = octagon().map(|d| at + DVec3::new(0.0, d.x, d.y) * radius).to_vec();
        self.polygon(&rim, at - DVec3::X, surface);
    }

    /// Adds a thin upright ring around a wheel in the plane y = `at.y`.
    pub(crate) fn ring_y(&mut self, at: DVec3, radius: f64, surface: Surface) {
        let rim = octagon().map(|d| DVec3::new(d.x, 0.0, d.y));
        for i in 0..8 {
            let (a, b) = (rim[i], rim[(i + 1) % 8]);
            let quad = [at + a * radius, at + b * radius, at + b * (0.72 * radius), at + a * (0.72 * radius)];
            self.polygon(&quad, at - DVec3::Y, surface);
        }
    }

    /// Adds an ellipsoid of eight segments and four rings.
    pub(crate) fn ball(&mut self, centre: DVec3, radii: DVec3, surface: Surface) {
        let ring = |i: usize| {
            let angle = std::f64::consts::PI * (i as f64 / 4.0 - 0.5);
            let (height, reach) = angle.sin_cos();
            octagon().map(|d| centre + radii * DVec3::new(d.x * reach, d.y * reach, height))
        };
        for i in 0..4 {
            let (low, high) = (ring(i), ring(i + 1));
            for j in 0..8 {
                let k = (j + 1) % 8;
                match i {
                    0 => self.polygon(&[low[j], high[j], high[k]], centre, surface),
                    3 => self.polygon(&[low[j], low[k], high[k]], centre, surface),
                    _ => self.polygon(&[low[j], low[k], high[k], high[j]], centre, surface),
                }
            }
        }
    }

    /// Adds a cone of eight sides.
    pub(crate) fn cone(&mut self, centre: DVec3, radius: f64, height: f64, surface: Surface) {
        let rim = octagon().map(|d| centre + (d * radius).extend(0.0));
        let tip = centre + DVec3::Z * height;
        for j in 0..8 {
            self.polygon(&[rim[j], rim[(j + 1) % 8], tip], centre, surface);
        }
    }

    /// Adds a bar of square section from one point to another.
    pub(crate) fn bar(&mut self, from: DVec3, to: DVec3, half: f64, surface: Surface) {
        let Some(along) = (to - from).try_normalize() else { return };
        let side = along.any_orthonormal_vector() * half;
        let up = along.cross(side);
        let rim = |end: DVec3| [end + side + up, end - side + up, end - side - up, end + side - up];
        let (a, b) = (rim(from), rim(to));
        for i in 0..4 {
            let j = (i + 1) % 4;
            self.polygon(&[a[i], a[j], b[j], b[i]], from.midpoint(to), surface);
        }
    }
}

fn octagon() -> [DVec2; 8] {
    const C: f64 = std::f64::consts::FRAC_1_SQRT_2;
    [(1.0, 0.0), (C, C), (0.0, 1.0), (-C, C), (-1.0, 0.0), (-C, -C), (0.0, -1.0), (C, -C)]
        .map(|(x, y)| DVec2::new(x, y))
}
