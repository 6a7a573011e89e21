//! Where the tokens of a policy lie that are places: cells of the picture of the known camera, or squares of the ground before the car.
//!
//! The ground is that of the trunk of `ltf` and `diffusiondrive`: x 0 to 64 m, the farthest row first, y 32 m to the left to 32 m to the right.

use ds_space::{DVec2, DVec3};

use crate::camera::eye::known_camera;

/// How far the ground reaches ahead and to either side, in metres.
const GROUND_M: [f64; 2] = [64.0, 32.0];
/// Nearer ground is not drawn, in metres before the rear axle: it lies below the picture.
const NEAREST_M: f64 = 2.0;

/// Rows and columns of places, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grid {
    /// Of the picture.
    Picture([usize; 2]),
    /// Of the ground.
    Ground([usize; 2]),
}

impl Grid {
    /// Returns rows and columns.
    #[must_use]
    pub fn sides(self) -> [usize; 2] {
        match self {
            Self::Picture(sides) | Self::Ground(sides) => sides,
        }
    }

    /// Returns the corners of a place in the picture of the known camera, one after the other around it, in pixels; they may
    /// lie beside the picture.
    #[must_use]
    pub fn corners(self, place: usize) -> [DVec2; 4] {
        let camera = known_camera();
        let [rows, columns] = self.sides();
        let (row, column) = ((place / columns) as f64, (place % columns) as f64);
        [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]].map(|[down, right]| {
            let (down, right) = ((row + down) / rows as f64, (column + right) / columns as f64);
            match self {
                Self::Picture(_) => {
                    let lens = &camera.intrinsics;
                    DVec2::new(right * f64::from(lens.width_px), down * f64::from(lens.height_px))
                }
                Self::Ground(_) => {
                    let [ahead_m, side_m] = GROUND_M;
                    let point = DVec3::new((ahead_m * (1.0 - down)).max(NEAREST_M), side_m * (1.0 - 2.0 * right), 0.0);
                    let seen = camera.intrinsics.project(camera.rig_from_camera.inverse() * point);
                    seen.expect("the known camera hangs behind what is drawn")
                }
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_lie_where_the_known_camera_sees_them() {
        let [a, _, c, _] = Grid::Picture([6, 10]).corners(11);
        assert!(a.distance(DVec2::new(16.0, 16.0)) < 1e-9 && c.distance(DVec2::new(32.0, 32.0)) < 1e-9);
        // The farthest row and the one before the car, left of its middle: below the horizon, wider and lower the nearer.
        let grid = Grid::Ground([8, 8]);
        let [far, near] = [3, 6 * 8 + 3].map(|place| grid.corners(place));
        assert!(far[0].y > 40.0 && near[0].y > far[2].y && near[2].y > near[0].y, "{far:?} {near:?}");
        assert!(far[0].x < far[1].x && (far[1].x - 80.0).abs() < 1e-6 && far[1].x - far[0].x < near[1].x - near[0].x);
        assert!((0..64).all(|place| grid.corners(place).iter().all(|corner| corner.is_finite())));
    }
}
