//! What kind of collision a touch is (PDM `scoring/pdm_scorer_utils.py:12-64`, NUP `idm/utils.py:20-52,191-202`).

use ds_space::DVec2;
use ds_space::plane::OrientedBox;

use crate::constants::navsim::{AHEAD_DEG, BEHIND_DEG, STOPPED_MPS};

/// The kinds of collision, in the order in which they are tested.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CollisionType {
    /// The ego stood still.
    StoppedEgo,
    /// The other stood still.
    StoppedTrack,
    /// The other came from behind.
    ActiveRear,
    /// The ego's front edge touched.
    ActiveFront,
    /// Anything else.
    ActiveLateral,
}

impl CollisionType {
    /// Classifies a touch. `rear_axle` and `speed_mps` are the ego's, `stopped` says whether the other stands still.
    #[must_use]
    pub fn of(ego: &OrientedBox, rear_axle: DVec2, speed_mps: f64, other: &OrientedBox, stopped: bool) -> Self {
        if speed_mps <= STOPPED_MPS {
            Self::StoppedEgo
        } else if stopped {
            Self::StoppedTrack
        } else if is_behind(ego.forward, other.centre - rear_axle) {
            Self::ActiveRear
        } else if other.touches_segment(ego.front_edge()) {
            Self::ActiveFront
        } else {
            Self::ActiveLateral
        }
    }

    /// Says whether the ego is at fault; `astray` if it is in multiple lanes or off drivable surface.
    #[must_use]
    pub fn at_fault(self, astray: bool) -> bool {
        match self {
            Self::StoppedTrack | Self::ActiveFront => true,
            Self::ActiveLateral => astray,
            Self::StoppedEgo | Self::ActiveRear => false,
        }
    }
}

/// Says whether an offset points less than 30° away from a heading.
pub(crate) fn is_ahead(forward: DVec2, offset: DVec2) -> bool {
    angle_rad(forward, offset) < AHEAD_DEG.to_radians()
}

/// Says whether an offset points more than 150° away from a heading.
pub(crate) fn is_behind(forward: DVec2, offset: DVec2) -> bool {
    angle_rad(forward, offset) > BEHIND_DEG.to_radians()
}

/// NaN for no offset at all, which is neither ahead nor behind, as in the reference.
fn angle_rad(forward: DVec2, offset: DVec2) -> f64 {
    forward.dot(offset / offset.length()).acos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::PoseSe2;

    #[test]
    fn by_table() {
        // The ego is 5.176 x 2.297 m with its centre at 1.461 m and its front edge at x = 4.049 m.
        let ego = crate::footprint::Footprint::NAVSIM.at(&PoseSe2::default());
        let other = |x: f64, y: f64| OrientedBox::new(&PoseSe2::new(x, y, 0.0), 4.0, 2.0);
        for (x, y, speed_mps, stopped, expected) in [
            (6.0, 0.0, 0.05, false, CollisionType::StoppedEgo),
            (6.0, 0.0, 0.06, true, CollisionType::StoppedTrack),
            (-3.0, 0.0, 5.0, false, CollisionType::ActiveRear),
            (-3.0, 1.7, 5.0, false, CollisionType::ActiveRear),
            (-3.0, 1.8, 5.0, false, CollisionType::ActiveLateral),
            (6.0, 0.0, 5.0, false, CollisionType::ActiveFront),
            (2.05, 2.1, 5.0, false, CollisionType::ActiveFront),
            (2.04, 2.1, 5.0, false, CollisionType::ActiveLateral),
        ] {
            let got = CollisionType::of(&ego, DVec2::ZERO, speed_mps, &other(x, y), stopped);
            assert_eq!(got, expected, "({x}, {y})");
        }
    }

    #[test]
    fn fault_by_table() {
        for (kind, on_its_lane, astray) in [
            (CollisionType::StoppedEgo, false, false),
            (CollisionType::StoppedTrack, true, true),
            (CollisionType::ActiveRear, false, false),
            (CollisionType::ActiveFront, true, true),
            (CollisionType::ActiveLateral, false, true),
        ] {
            assert_eq!((kind.at_fault(false), kind.at_fault(true)), (on_its_lane, astray), "{kind:?}");
        }
    }
}
