//! Meshes by lofting: rings of points stacked along a way, joined by faces, closed by caps. Placed by a planar pose.

use ds_space::{DVec2, DVec3, PoseSe2};

use crate::material::Paint;

/// A world triangle with what it shows.
pub(crate) type Face = ([DVec3; 3], Paint);

/// Builds meshes at one place. Local frame: x forward, y left, z up from the bottom, metres.
pub(crate) struct Mould<'a> {
    pub(crate) pose: PoseSe2,
    pub(crate) bottom_m: f64,
    pub(crate) faces: &'a mut Vec<Face>,
}

impl Mould<'_> {
    fn out(&self, p: DVec3) -> DVec3 {
        self.pose.to_outer(p.truncate()).extend(self.bottom_m + p.z)
    }

    /// Adds a flat convex face that looks away from `core`.
    pub(crate) fn face(&mut self, points: &[DVec3], core: DVec3, paint: Paint) {
        if points.len() < 3 {
            return;
        }
        let Some(normal) = (points[1] - points[0]).cross(points[2] - points[0]).try_normalize() else { return };
        let normal = if normal.dot(points[0] - core) < 0.0 { -normal } else { normal };
        let turned = DVec2::from_angle(self.pose.heading_rad).rotate(normal.truncate());
        let paint = paint.facing(turned.extend(normal.z));
        for i in 2..points.len() {
            let corners = [points[0], points[i - 1], points[i]].map(|p| self.out(p));
            self.faces.push((corners, paint));
        }
    }

    /// Joins rings of equally many points; `paint(ring, side)` colours each quad; ends are closed with `cap`.
    pub(crate) fn loft(&mut self, rings: &[Vec<DVec3>], cap: Paint, paint: impl Fn(usize, usize) -> Paint) {
        let centre = |ring: &[DVec3]| ring.iter().sum::<DVec3>() / ring.len().max(1) as f64;
        for (i, pair) in rings.windows(2).enumerate() {
            let core = centre(&pair[0]).midpoint(centre(&pair[1]));
            let count = pair[0].len();
            for j in 0..count {
                let k = (j + 1) % count;
                let (a, b, c, d) = (pair[0][j], pair[0][k], pair[1][k], pair[1][j]);
                // Two triangles, since the quad may be warped or collapse to one.
                let paint = paint(i, j);
                self.face(&[a, b, c], core, paint);
                self.face(&[a, c, d], core, paint);
            }
        }
        if let (Some(first), Some(last)) = (rings.first(), rings.last()) {
            let core = centre(first).midpoint(centre(last));
            let (first, last) = (first.clone(), last.clone());
            self.face(&first, core, cap);
            self.face(&last, core, cap);
        }
    }

    /// Adds an upright prism over a ring of `sides`, its radius changing with height: (z, radius) from the bottom up.
    pub(crate) fn turned(&mut self, at: DVec2, sides: u32, profile: &[(f64, f64)], paint: Paint) {
        let rings: Vec<Vec<DVec3>> = profile
            .iter()
            .map(|(z, radius)| {
                let corner = |i: u32| {
                    let angle = f64::from(i) / f64::from(sides) * std::f64::consts::TAU;
                    (at + DVec2::from_angle(angle) * *radius).extend(*z)
                };
                (0..sides).map(corner).collect()
            })
            .collect();
        self.loft(&rings, paint, |_, _| paint);
    }

    /// Adds a box from one corner to the opposite one.
    pub(crate) fn cuboid(&mut self, low: DVec3, high: DVec3, paint: Paint) {
        let ring = |z: f64| {
            vec![
                DVec3::new(high.x, high.y, z),
                DVec3::new(low.x, high.y, z),
                DVec3::new(low.x, low.y, z),
                DVec3::new(high.x, low.y, z),
            ]
        };
        self.loft(&[ring(low.z), ring(high.z)], paint, |_, _| paint);
    }

    /// Adds a bar of triangular section between two points.
    pub(crate) fn limb(&mut self, from: DVec3, to: DVec3, radius: f64, paint: Paint) {
        let Some(along) = (to - from).try_normalize() else { return };
        let side = along.any_orthonormal_vector();
        let other = along.cross(side);
        let ring = |end: DVec3| -> Vec<DVec3> {
            let corner = |i: u8| {
                let (s, c) = (f64::from(i) * std::f64::consts::TAU / 3.0).sin_cos();
                end + (side * c + other * s) * radius
            };
            (0..3).map(corner).collect()
        };
        self.loft(&[ring(from), ring(to)], paint, |_, _| paint);
    }
}
