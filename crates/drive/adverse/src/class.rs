//! The kind of a collision by rule, from what both did in the last four seconds before they touched.
//!
//! The rules are those of the NHTSA pre-crash typology made operational; they never look at what was intended. Angles in
//! radians, one moment a tick of 0.1 s, the last one being that of first contact.

use ds_space::AgentId;
use ds_space::angle::turn;
use ds_space::{PoseSe2, Tick};
use ds_world::agent::corners;
use ds_world::{ContactKind, CrashClass, Scene, Size};

use crate::road::Road;

/// How far back the classifier looks, in ticks.
pub const WINDOW_TICKS: usize = 40;
const SAME_LANE_TICKS: usize = 20;
const CAME_OVER_TICKS: usize = 30;
const ONCOMING_TICKS: usize = 20;

/// Which lane the other is in, as seen from the ego's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Relation {
    /// In the ego's lane, or in one that leads to or from it.
    Same,
    /// In a lane beside it with the same direction.
    Adjacent,
    /// Anywhere else.
    Apart,
}

/// Both vehicles at one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Heading of the ego.
    pub ego_rad: f64,
    /// Heading of the other.
    pub other_rad: f64,
    /// Which lane the other is in.
    pub relation: Relation,
}

/// All that the class depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct Encounter {
    /// The last moments, at most [`WINDOW_TICKS`] + 1, ending with that of first contact.
    pub moments: Vec<Moment>,
    /// Which part of the ego was met.
    pub ego_face: ContactKind,
    /// Whether the other was met at its rear.
    pub other_rear: bool,
    /// Whether the place is a junction.
    pub in_junction: bool,
    /// Whether traffic keeps left, which mirrors turns across.
    pub mirrored: bool,
}

/// Returns the class of a collision; nothing if none of the rules holds.
#[must_use]
pub fn classify(encounter: &Encounter) -> Option<CrashClass> {
    let moments = &encounter.moments;
    let last = moments.last()?;
    let ago = |ticks: usize| &moments[moments.len().saturating_sub(ticks + 1)..];
    let apart = |moment: &Moment| turn(moment.ego_rad, moment.other_rad).abs().to_degrees();
    let turned = |pick: fn(&Moment) -> f64| -> f64 {
        moments.windows(2).map(|pair| turn(pick(&pair[0]), pick(&pair[1]))).sum::<f64>().to_degrees()
    };
    let (ego_turn, other_turn) = (turned(|m| m.ego_rad), turned(|m| m.other_rad));
    let now = apart(last);
    if now <= 30.0 {
        let same = moments.len() > SAME_LANE_TICKS && ago(SAME_LANE_TICKS).iter().all(|m| m.relation == Relation::Same);
        if same && encounter.ego_face == ContactKind::Front && encounter.other_rear {
            return Some(CrashClass::RearEnd);
        }
        let came_over = ago(CAME_OVER_TICKS).iter().any(|m| m.relation == Relation::Adjacent);
        return (came_over && encounter.ego_face != ContactKind::Rear).then_some(CrashClass::ChangingLanes);
    }
    if encounter.in_junction {
        let across = if encounter.mirrored { -1.0 } else { 1.0 };
        let turns_across = |turner: f64, other: f64| turner * across >= 40.0 && other.abs() < 20.0;
        if turns_across(ego_turn, other_turn) || turns_across(other_turn, ego_turn) {
            return Some(CrashClass::LeftTurnAcrossPath);
        }
        let both_straight = ego_turn.abs() < 20.0 && other_turn.abs() < 20.0;
        if both_straight && (60.0..=120.0).contains(&now) {
            return Some(CrashClass::StraightCrossingPaths);
        }
    }
    let turning = encounter.in_junction && (ego_turn.abs() >= 20.0 || other_turn.abs() >= 20.0);
    let before = ago(ONCOMING_TICKS).first().map_or(0.0, apart);
    (!turning && before >= 150.0).then_some(CrashClass::OppositeDirection)
}

/// Returns what the class of a contact between the ego and a track depends on, both as logged.
pub(crate) fn encounter(
    scene: &Scene,
    road: &Road<'_>,
    other: (AgentId, Tick),
    ego_face: ContactKind,
) -> Option<Encounter> {
    let (agent, tick) = other;
    let track = scene.tracks.get(agent.0 as usize)?;
    let first = Tick(tick.0.saturating_sub(WINDOW_TICKS as u32));
    let moment = |tick: Tick| {
        let (ego, point) = (scene.logged_ego(tick).centre(&scene.vehicle), track.at(tick)?);
        Some(Moment {
            ego_rad: ego.heading_rad,
            other_rad: point.pose.heading_rad,
            relation: relation(road, &ego, &point.pose),
        })
    };
    let moments: Vec<Moment> = first.to(tick).filter_map(moment).collect();
    let (ego, point) = (scene.logged_ego(tick).centre(&scene.vehicle), track.at(tick)?);
    Some(Encounter {
        moments,
        ego_face,
        other_rear: rear_met(&point.pose, track.size, &ego, scene.vehicle.size),
        in_junction: road.in_junction(ego.position) || road.in_junction(point.pose.position),
        mirrored: road.keeps_left(),
    })
}

/// Says whether the part of a body that is met is its rear: the other's nearest corners lie behind it.
fn rear_met(pose: &PoseSe2, size: Size, ego: &PoseSe2, ego_size: Size) -> bool {
    let centre = pose.to_local(ego.position);
    let nearest = corners(ego, ego_size.length_m, ego_size.width_m)
        .map(|corner| pose.to_local(corner).x)
        .into_iter()
        .fold(f64::MIN, f64::max);
    centre.x < 0.0 && nearest < -0.5 * size.length_m + 1.0
}

fn relation(road: &Road<'_>, ego: &PoseSe2, other: &PoseSe2) -> Relation {
    let (Some(mine), Some(theirs)) = (road.lane_at(ego), road.lane_at(other)) else { return Relation::Apart };
    if mine.lane == theirs.lane || road.one_way(mine.lane, theirs.lane) {
        return Relation::Same;
    }
    let beside = ego.to_local(other.position).y.abs();
    let aligned = turn(ego.heading_rad, other.heading_rad).abs() < 0.6;
    if road.adjacent(mine.lane, theirs.lane) || (aligned && beside < 5.5 && beside > 2.0) {
        return Relation::Adjacent;
    }
    Relation::Apart
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Headings in degrees run evenly from the first to the last number.
    fn encounter(ego: [f64; 2], other: [f64; 2], relation: fn(usize) -> Relation) -> Encounter {
        let at = |ends: [f64; 2], i: usize| (ends[0] + (ends[1] - ends[0]) * i as f64 / 40.0).to_radians();
        let moments =
            (0..=40).map(|i| Moment { ego_rad: at(ego, i), other_rad: at(other, i), relation: relation(40 - i) });
        Encounter {
            moments: moments.collect(),
            ego_face: ContactKind::Front,
            other_rear: false,
            in_junction: false,
            mirrored: false,
        }
    }

    #[test]
    fn rear_end_needs_the_same_lane_for_two_seconds_and_front_on_rear() {
        let behind = Encounter { other_rear: true, ..encounter([0.0, 0.0], [0.0, 5.0], |_| Relation::Same) };
        assert_eq!(classify(&behind), Some(CrashClass::RearEnd));
        let struck = Encounter { ego_face: ContactKind::Rear, ..behind.clone() };
        assert_eq!(classify(&struck), None, "being struck from behind is no class");
        let turned = encounter([0.0, 0.0], [0.0, 31.0], |_| Relation::Same);
        assert_eq!(classify(&Encounter { other_rear: true, ..turned }), None);
        let late = |ago: usize| if ago <= 19 { Relation::Same } else { Relation::Adjacent };
        let cut_in = Encounter { other_rear: true, ..encounter([0.0, 0.0], [0.0, 0.0], late) };
        assert_eq!(classify(&cut_in), Some(CrashClass::ChangingLanes), "19 ticks in the lane are too few");
    }

    #[test]
    fn changing_lanes_needs_an_adjacent_lane_within_three_seconds() {
        let within = |ago: usize| if ago < 30 { Relation::Same } else { Relation::Adjacent };
        let before = |ago: usize| if ago < 31 { Relation::Same } else { Relation::Adjacent };
        assert_eq!(classify(&encounter([0.0, 0.0], [0.0, 10.0], within)), Some(CrashClass::ChangingLanes));
        assert_eq!(classify(&encounter([0.0, 0.0], [0.0, 10.0], before)), None);
        let rear = Encounter { ego_face: ContactKind::Rear, ..encounter([0.0, 0.0], [0.0, 0.0], within) };
        assert_eq!(classify(&rear), None);
    }

    #[test]
    fn opposite_direction_counts_two_seconds_before_and_outside_turns() {
        let apart = |_| Relation::Apart;
        assert_eq!(classify(&encounter([0.0, 0.0], [180.0, 175.0], apart)), Some(CrashClass::OppositeDirection));
        assert_eq!(classify(&encounter([0.0, 0.0], [149.0, 149.0], apart)), None);
        // The road bends for both: still no turn outside junctions.
        assert_eq!(classify(&encounter([0.0, 30.0], [180.0, 210.0], apart)), Some(CrashClass::OppositeDirection));
        let right_turn = Encounter { in_junction: true, ..encounter([0.0, 0.0], [180.0, 155.0], apart) };
        assert_eq!(classify(&right_turn), None);
    }

    #[test]
    fn crossing_paths_need_a_junction_and_two_that_go_straight() {
        let crossing = encounter([0.0, 0.0], [90.0, 95.0], |_| Relation::Apart);
        assert_eq!(classify(&crossing), None);
        let crossing = Encounter { in_junction: true, ..crossing };
        assert_eq!(classify(&crossing), Some(CrashClass::StraightCrossingPaths));
        for (ego, other) in [([0.0, 0.0], [59.0, 59.0]), ([0.0, 0.0], [121.0, 121.0]), ([0.0, 21.0], [90.0, 90.0])] {
            let other = encounter(ego, other, |_| Relation::Apart);
            assert_eq!(classify(&Encounter { in_junction: true, ..other }), None, "{ego:?}");
        }
    }

    #[test]
    fn a_turn_across_is_left_or_mirrored() {
        let with = |ego, other, mirrored| {
            classify(&Encounter { in_junction: true, mirrored, ..encounter(ego, other, |_| Relation::Apart) })
        };
        let left = Some(CrashClass::LeftTurnAcrossPath);
        assert_eq!(with([0.0, 0.0], [180.0, 225.0], false), left, "the other turns");
        assert_eq!(with([0.0, 45.0], [180.0, 180.0], false), left, "the ego turns");
        assert_eq!(with([0.0, 0.0], [180.0, 219.0], false), None, "39 degrees are no turn");
        assert_eq!(with([0.0, 25.0], [180.0, 225.0], false), None, "both turn");
        assert_eq!(with([0.0, 0.0], [180.0, 135.0], false), None, "a right turn");
        assert_eq!(with([0.0, 0.0], [180.0, 135.0], true), left, "a right turn where traffic keeps left");
    }

    #[test]
    fn nothing_has_no_class() {
        let none = Encounter { moments: Vec::new(), ..encounter([0.0, 0.0], [0.0, 0.0], |_| Relation::Same) };
        assert_eq!(classify(&none), None);
    }
}
