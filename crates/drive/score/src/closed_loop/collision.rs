//! NC of a state: does the ego touch something by its own fault (BS `:570-598`, or `scoring.md` §4).

use std::collections::BTreeSet;

use super::moment::Moment;
use super::profile::{CollisionRule, OverlapRule, Profile};
use super::tick::LoopObject;
use crate::collision_type::CollisionType;
use crate::constants::bridgesim::{BEHIND_M, STOPPED_MPS};
use crate::constants::navsim::{self, STATIC_COLLISION};
use crate::scene::ObjectClass;
use ds_space::plane::OrientedBox;

/// Returns the box of an object.
pub(crate) fn box_of(object: &LoopObject) -> OrientedBox {
    OrientedBox::new(&object.pose, object.length_m, object.width_m)
}

/// Who touches the ego, and who of them is left out.
#[derive(Debug, Clone, Default)]
pub(crate) struct Collisions {
    /// Who touched in the first state; `None` before it.
    left_out: Option<BTreeSet<u32>>,
    /// Whose touch began without the ego's fault and goes on.
    ignored: BTreeSet<u32>,
}

impl Collisions {
    /// Says whether an object is left out of the time to collision.
    pub(crate) fn leaves_out(&self, id: u32) -> bool {
        self.ignored.contains(&id) || self.left_out.as_ref().is_some_and(|left_out| left_out.contains(&id))
    }

    /// Returns the score of the next state and the object at which the ego is at fault.
    pub(crate) fn observe(&mut self, moment: &Moment<'_>, profile: &Profile) -> (f64, Option<u32>) {
        let touching: Vec<(&LoopObject, OrientedBox)> = moment
            .state
            .objects
            .iter()
            .map(|object| (object, box_of(object)))
            .filter(|(_, other)| moment.ego.touches(other))
            .collect();
        let first_touching = || match profile.overlap_at_start {
            OverlapRule::LeftOut => touching.iter().map(|(object, _)| object.id).collect(),
            OverlapRule::Counted => BTreeSet::new(),
        };
        let left_out = self.left_out.get_or_insert_with(first_touching);
        self.ignored.retain(|id| touching.iter().any(|(object, _)| object.id == *id));
        let mut worst: (f64, Option<u32>) = (1.0, None);
        for (object, other) in touching.iter().filter(|(object, _)| !left_out.contains(&object.id)) {
            let value = match profile.collisions {
                CollisionRule::CentreBehind => centre_behind(moment, object),
                CollisionRule::FaultClasses => fault_classes(moment, object, other, &mut self.ignored),
            };
            let earlier = value == worst.0 && worst.1.is_some_and(|id| object.id < id);
            if value < worst.0 || earlier {
                worst = (value, Some(object.id));
            }
        }
        worst
    }
}

fn centre_behind(moment: &Moment<'_>, object: &LoopObject) -> f64 {
    let along_m = (object.pose.position - moment.ego.centre).dot(moment.ego.forward);
    super::unless(moment.speed_mps >= STOPPED_MPS && along_m >= -BEHIND_M)
}

fn fault_classes(moment: &Moment<'_>, object: &LoopObject, other: &OrientedBox, ignored: &mut BTreeSet<u32>) -> f64 {
    if ignored.contains(&object.id) {
        return 1.0;
    }
    let stopped = object.class == ObjectClass::Static || object.velocity_mps.length() <= navsim::STOPPED_MPS;
    let kind = CollisionType::of(&moment.ego, moment.rear_axle, moment.speed_mps, other, stopped);
    if !kind.at_fault(moment.astray()) {
        ignored.insert(object.id);
        return 1.0;
    }
    match object.class {
        ObjectClass::Agent => 0.0,
        ObjectClass::Static => STATIC_COLLISION,
    }
}
