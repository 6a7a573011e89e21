//! A pinhole view of the world: world triangle → camera frame → near-plane clip → screen triangles.
//!
//! p_camera = camera_from_world · p_world, in metres; pixel = (cx + fx·x/z, cy + fy·y/z). Distortion is not here but in
//! [`crate::lens`], which warps the finished pinhole picture.

use ds_space::pose::Camera;
use ds_space::{DMat3, DVec3, Intrinsics, Pose, World};

use crate::depth::{DepthRaster, ScreenPoint};
use crate::lens::Lens;

/// What lies nearer to the camera plane than this is cut away, in metres.
pub const NEAR_M: f64 = 0.1;

/// A pinhole camera at a place in the world.
#[derive(Debug, Clone, Copy)]
pub struct View {
    rotation: DMat3,
    translation: DVec3,
    origin: DVec3,
    lens: Intrinsics,
    /// Bounds of x/z and y/z in the picture: left, right, top, bottom.
    bounds: [f64; 4],
}

impl View {
    /// Places a pinhole (its distortion is not looked at) in the world.
    #[must_use]
    pub fn new(pinhole: &Intrinsics, world_from_camera: Pose<World, Camera>) -> Self {
        let camera_from_world = world_from_camera.inverse();
        let lens = *pinhole;
        let bounds = [
            -lens.cx_px / lens.fx_px,
            (f64::from(lens.width_px) - lens.cx_px) / lens.fx_px,
            -lens.cy_px / lens.fy_px,
            (f64::from(lens.height_px) - lens.cy_px) / lens.fy_px,
        ];
        Self {
            rotation: DMat3::from_quat(camera_from_world.rotation),
            translation: camera_from_world.translation,
            origin: world_from_camera.translation,
            lens,
            bounds,
        }
    }

    /// Places a camera in the world: the lens that makes its picture, and the view with which the lens' pinhole sees.
    #[must_use]
    pub fn through(intrinsics: &Intrinsics, world_from_camera: Pose<World, Camera>) -> (Lens, Self) {
        let lens = Lens::new(intrinsics);
        let view = Self::new(lens.pinhole(), world_from_camera);
        (lens, view)
    }

    /// Returns the camera's place in the world, in metres.
    #[must_use]
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Returns the pinhole.
    #[must_use]
    pub fn pinhole(&self) -> &Intrinsics {
        &self.lens
    }

    /// Takes a world point to the camera frame, in metres.
    #[must_use]
    pub fn to_camera(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// Returns the world direction of a point of the picture, scaled so that its depth is 1 m.
    #[must_use]
    pub fn ray(&self, x_px: f64, y_px: f64) -> DVec3 {
        let (u, v) = ((x_px - self.lens.cx_px) / self.lens.fx_px, (y_px - self.lens.cy_px) / self.lens.fy_px);
        self.rotation.transpose() * DVec3::new(u, v, 1.0)
    }

    /// Says whether a ball within `range_m` of the camera may be in the picture.
    #[must_use]
    pub fn may_see(&self, centre: DVec3, radius_m: f64, range_m: f64) -> bool {
        let reach = range_m + radius_m;
        if (centre - self.origin).length_squared() > reach * reach {
            return false;
        }
        let c = self.to_camera(centre);
        let [left, right, top, bottom] = self.bounds;
        let outside = |across: f64, slope: f64| across - slope * c.z > radius_m * (1.0 + slope * slope).sqrt();
        c.z > NEAR_M - radius_m
            && !outside(c.x, right)
            && !outside(-c.x, -left)
            && !outside(c.y, bottom)
            && !outside(-c.y, -top)
    }

    /// Draws a world triangle over whatever is there (see [`DepthRaster::paint`]).
    pub fn paint<P: Copy>(&self, raster: &mut DepthRaster<P>, corners: &[DVec3; 3], value: P) {
        self.project(corners, |triangle| raster.paint(triangle, value));
    }

    /// Draws a world triangle where it is the nearest (see [`DepthRaster::fill`]).
    pub fn fill<P: Copy>(&self, raster: &mut DepthRaster<P>, corners: &[DVec3; 3], value: P) {
        self.project(corners, |triangle| raster.fill(triangle, value));
    }

    /// Clips a world triangle at the near plane and hands its one or two screen triangles on.
    fn project(&self, corners: &[DVec3; 3], mut draw: impl FnMut(&[ScreenPoint; 3])) {
        let inside = corners.map(|corner| self.to_camera(corner));
        if self.misses(&inside) {
            return;
        }
        if inside.iter().all(|p| p.z >= NEAR_M) {
            return draw(&inside.map(|p| self.on_screen(p)));
        }
        let mut clipped = [DVec3::ZERO; 4];
        let mut count = 0;
        for (i, from) in inside.iter().enumerate() {
            let to = &inside[(i + 1) % 3];
            if from.z >= NEAR_M {
                clipped[count] = *from;
                count += 1;
            }
            if (from.z >= NEAR_M) != (to.z >= NEAR_M) {
                clipped[count] = cut(from, to);
                count += 1;
            }
        }
        let screen = clipped.map(|p| self.on_screen(p));
        for i in 2..count {
            draw(&[screen[0], screen[i - 1], screen[i]]);
        }
    }

    /// Says whether a camera-frame triangle lies wholly beyond one side of the picture.
    fn misses(&self, corners: &[DVec3; 3]) -> bool {
        let [left, right, top, bottom] = self.bounds;
        corners.iter().all(|p| p.z < NEAR_M)
            || corners.iter().all(|p| p.x > right * p.z)
            || corners.iter().all(|p| p.x < left * p.z)
            || corners.iter().all(|p| p.y > bottom * p.z)
            || corners.iter().all(|p| p.y < top * p.z)
            || !corners.iter().all(|p| p.is_finite())
    }

    fn on_screen(&self, p: DVec3) -> ScreenPoint {
        let inverse_depth = 1.0 / p.z;
        ScreenPoint {
            x_px: self.lens.cx_px + self.lens.fx_px * p.x * inverse_depth,
            y_px: self.lens.cy_px + self.lens.fy_px * p.y * inverse_depth,
            inverse_depth,
        }
    }
}

/// Returns where an edge meets the near plane, reckoned from its end in front, so that neighbours agree.
fn cut(a: &DVec3, b: &DVec3) -> DVec3 {
    let (front, behind) = if a.z >= NEAR_M { (a, b) } else { (b, a) };
    let share = (front.z - NEAR_M) / (front.z - behind.z);
    let point = *front + (*behind - *front) * share;
    DVec3::new(point.x, point.y, NEAR_M)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::{CameraId, CameraModel, PoseSe2};
    use proptest::prelude::*;

    fn view() -> View {
        let id = CameraId::new("front").expect("a plain word is an id");
        let lens = Intrinsics::centred(64, 40, 1.2);
        let camera = CameraModel::mounted(id, lens, DVec3::new(0.0, 0.0, 1.5), 0.0, 0.0);
        View::new(&lens, PoseSe2::new(0.0, 0.0, 0.0).world_from_rig(0.0) * camera.rig_from_camera)
    }

    fn drawn(corners: &[DVec3; 3]) -> usize {
        let mut raster = DepthRaster::new(64, 40, 0u8).expect("the size fits");
        view().fill(&mut raster, corners, 1);
        raster.values().iter().filter(|v| **v == 1).count()
    }

    #[test]
    fn the_ground_under_the_camera_is_clipped_not_mirrored() {
        let ground = [DVec3::new(-50.0, -40.0, 0.0), DVec3::new(80.0, 0.0, 0.0), DVec3::new(-50.0, 40.0, 0.0)];
        let mut raster = DepthRaster::new(64, 40, 0u8).expect("the size fits");
        view().fill(&mut raster, &ground, 1);
        assert!(raster.values()[..64 * 20].iter().all(|v| *v == 0), "ground above the horizon");
        assert!(raster.values()[64 * 30..].iter().filter(|v| **v == 1).count() > 500);
    }

    proptest! {
        #[test]
        fn nothing_behind_the_camera_is_drawn(x in -50.0..0.09, y in -20.0..20.0, z in -5.0..5.0) {
            let corner = DVec3::new(x, y, z);
            prop_assert_eq!(drawn(&[corner, corner - DVec3::new(1.0, 5.0, 0.0), corner - DVec3::new(1.0, 0.0, 5.0)]), 0);
        }

        #[test]
        fn a_ray_leads_back_to_the_point(x in 1.0..60.0, y in -20.0..20.0, z in -2.0..4.0) {
            let (view, point) = (view(), DVec3::new(x, y, z));
            let screen = view.on_screen(view.to_camera(point));
            let back = view.origin() + view.ray(screen.x_px, screen.y_px) / screen.inverse_depth;
            prop_assert!((back - point).length() < 1e-9);
        }

        #[test]
        fn what_is_drawn_may_be_seen(x in -60.0..60.0, y in -60.0..60.0, size in 0.5..5.0) {
            let centre = DVec3::new(x, y, 1.0);
            let corners = [centre + DVec3::X * size, centre + DVec3::Y * size, centre - DVec3::Y * size];
            prop_assert!(drawn(&corners) == 0 || view().may_see(centre, size, 200.0));
        }
    }
}
