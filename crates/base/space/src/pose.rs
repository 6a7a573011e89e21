//! Rigid transforms whose frames are part of their type: `p_world = world_from_rig * p_rig`.

use std::fmt;
use std::marker::PhantomData;
use std::ops::Mul;

use glam::{DQuat, DVec2, DVec3};

use crate::angle::{turn, wrap};

/// A coordinate frame; the implementors are never constructed.
pub trait Frame: Copy + 'static {
    /// The frame's name as written in files and messages.
    const NAME: &'static str;
}

macro_rules! frame {
    ($(#[$doc:meta])* $name:ident, $text:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $name {}
        impl Frame for $name {
            const NAME: &'static str = $text;
        }
    };
}

frame!(
    /// x east, y north, z up, fixed per scenario.
    World, "world"
);
frame!(
    /// x forward, y left, z up, origin on the ground under the rear axle.
    Rig, "rig"
);
frame!(
    /// x right, y down, z forward.
    Camera, "camera"
);

/// The rigid transform that takes a point given in `From` to the same point given in `To`.
pub struct Pose<To, From> {
    /// Turns axes of `From` into axes of `To`.
    pub rotation: DQuat,
    /// The origin of `From`, given in `To`, in metres.
    pub translation: DVec3,
    frames: PhantomData<(To, From)>,
}

impl<To: Frame, From: Frame> Pose<To, From> {
    /// Makes a transform of a unit rotation and a translation in metres.
    #[must_use]
    pub fn new(rotation: DQuat, translation: DVec3) -> Self {
        Self { rotation, translation, frames: PhantomData }
    }

    /// Returns the transform in the other direction.
    #[must_use]
    pub fn inverse(&self) -> Pose<From, To> {
        let rotation = self.rotation.inverse();
        Pose::new(rotation, -(rotation * self.translation))
    }
}

impl<To, From> Clone for Pose<To, From> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<To, From> Copy for Pose<To, From> {}
impl<To, From> PartialEq for Pose<To, From> {
    fn eq(&self, other: &Self) -> bool {
        self.rotation == other.rotation && self.translation == other.translation
    }
}
impl<To: Frame, From: Frame> fmt::Debug for Pose<To, From> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}_from_{} {{ {:?}, {:?} }}", To::NAME, From::NAME, self.rotation, self.translation)
    }
}

impl<To: Frame, Mid: Frame, From: Frame> Mul<Pose<Mid, From>> for Pose<To, Mid> {
    type Output = Pose<To, From>;
    fn mul(self, other: Pose<Mid, From>) -> Pose<To, From> {
        Pose::new(self.rotation * other.rotation, self.rotation * other.translation + self.translation)
    }
}

impl<To: Frame, From: Frame> Mul<DVec3> for Pose<To, From> {
    type Output = DVec3;
    fn mul(self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }
}

/// A planar pose: position in metres and heading in radians, counter-clockwise from +x.
///
/// The frame is named by the variable (`ego_in_world`, `plan_in_rig`).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PoseSe2 {
    /// The position, in metres.
    pub position: DVec2,
    /// The heading, in radians.
    pub heading_rad: f64,
}

impl PoseSe2 {
    /// Makes a pose of a position in metres and a heading in radians.
    #[must_use]
    pub fn new(x_m: f64, y_m: f64, heading_rad: f64) -> Self {
        Self { position: DVec2::new(x_m, y_m), heading_rad }
    }

    /// Returns the unit vector along the heading.
    #[must_use]
    pub fn forward(&self) -> DVec2 {
        DVec2::from_angle(self.heading_rad)
    }

    /// Returns the unit vector to the left of the heading.
    #[must_use]
    pub fn left(&self) -> DVec2 {
        self.forward().perp()
    }

    /// Takes a point given in this pose's own frame to the frame in which this pose is given.
    #[must_use]
    pub fn to_outer(&self, local: DVec2) -> DVec2 {
        self.position + self.forward() * local.x + self.left() * local.y
    }

    /// Takes a point given in the outer frame to this pose's own frame.
    #[must_use]
    pub fn to_local(&self, outer: DVec2) -> DVec2 {
        let offset = outer - self.position;
        DVec2::new(offset.dot(self.forward()), offset.dot(self.left()))
    }

    /// Takes a pose given in this pose's own frame to the outer frame.
    #[must_use]
    pub fn compose(&self, local: &Self) -> Self {
        Self { position: self.to_outer(local.position), heading_rad: wrap(self.heading_rad + local.heading_rad) }
    }

    /// Takes a pose given in the outer frame to this pose's own frame.
    #[must_use]
    pub fn relative(&self, outer: &Self) -> Self {
        Self { position: self.to_local(outer.position), heading_rad: wrap(outer.heading_rad - self.heading_rad) }
    }

    /// Returns the pose on the straight way to another in the same frame, at a share of it from 0 to 1; the heading takes the shorter
    /// turn.
    #[must_use]
    pub fn lerp(&self, to: &Self, share: f64) -> Self {
        Self {
            position: self.position.lerp(to.position, share),
            heading_rad: wrap(self.heading_rad + share * turn(self.heading_rad, to.heading_rad)),
        }
    }

    /// Returns the transform from the rig to the world for a rig that stands level at height `z_m`.
    #[must_use]
    pub fn world_from_rig(&self, z_m: f64) -> Pose<World, Rig> {
        Pose::new(DQuat::from_rotation_z(self.heading_rad), self.position.extend(z_m))
    }

    /// Says whether all numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.position.is_finite() && self.heading_rad.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_way_between_two_poses_turns_the_shorter_way() {
        let (from, to) = (PoseSe2::new(1.0, 0.0, 3.0), PoseSe2::new(3.0, 4.0, -3.0));
        let half = from.lerp(&to, 0.5);
        assert_eq!(half.position, DVec2::new(2.0, 2.0));
        assert!((half.heading_rad.abs() - std::f64::consts::PI).abs() < 1e-12, "{half:?}");
        assert!(from.lerp(&to, 0.0) == from && (from.lerp(&to, 1.0).heading_rad - to.heading_rad).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn compose_and_relative_are_inverse(x in -1e3..1e3, y in -1e3..1e3, h in -3.0..3.0, a in -50.0..50.0, b in -50.0..50.0, c in -3.0..3.0) {
            let base = PoseSe2::new(x, y, h);
            let local = PoseSe2::new(a, b, c);
            let back = base.relative(&base.compose(&local));
            prop_assert!((back.position - local.position).length() < 1e-9);
            prop_assert!(crate::angle::turn(back.heading_rad, local.heading_rad).abs() < 1e-9);
        }

        #[test]
        fn pose_inverse_takes_points_back(x in -1e3..1e3, h in -3.0..3.0, p in -50.0..50.0) {
            let world_from_rig = PoseSe2::new(x, -x, h).world_from_rig(0.5);
            let point = DVec3::new(p, 1.0, 2.0);
            prop_assert!((world_from_rig.inverse() * (world_from_rig * point) - point).length() < 1e-9);
        }
    }
}
