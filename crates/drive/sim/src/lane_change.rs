//! Lane changes by MOBIL (Kesting, Treiber and Helbing 2007): change if a_me' − a_me + p·(a_new' − a_new + a_old' − a_old)
//! exceeds a threshold and the new follower need not brake harder than is safe.
//!
//! A driver keeps its path and moves sideways between *slots*: its own lane (0), the next to the left (1), to the
//! right (−1), and so on, each at the distance of its centre line from the path. Metres, left positive.

use ds_space::DVec2;
use ds_vehicle::{IdmParameters, Lead};
use ds_world::{LaneId, LaneKind, Map};

use crate::agent_path::{AgentPath, KNOT_M};
use crate::lane_index::LaneIndex;

/// Slots to either side.
const SIDES: i8 = 2;
/// Knots of a path between two looks for lanes.
const EVERY_KNOTS: usize = 5;
/// Usual width of a lane; where no lane is drawn, a slot lies so far from the next.
pub(crate) const LANE_M: f64 = 3.5;
/// A change takes so long, and nobody changes again for so much longer.
const CHANGE_SECS: f64 = 4.0;
const REST_SECS: f64 = 3.0;
/// A driver moves sideways only while it moves on: at less than this speed more slowly.
const FULL_MPS: f64 = 3.0;
/// Advantage that a change must have, m/s².
pub const THRESHOLD_MPS2: f64 = 0.2;
/// Hardest braking of the new follower, m/s².
pub(crate) const SAFE_MPS2: f64 = 3.0;
/// Advantage of leaving a lane that ends.
const ENDING_MPS2: f64 = 3.0;
/// A target lane must go on for so far and so long.
const AHEAD_M: f64 = 30.0;
const AHEAD_SECS: f64 = 5.0;

/// The lanes beside a path.
#[derive(Debug, Clone, Default)]
pub struct Lanes {
    samples: Vec<[Option<f64>; 2 * SIDES as usize + 1]>,
}

impl Lanes {
    /// Finds the lanes beside a path: those that a map links as neighbours or that run beside it the same way.
    pub(crate) fn of(path: &AgentPath, map: &Map, index: &LaneIndex<'_>) -> Self {
        let positions: Vec<DVec2> = path.positions().collect();
        let sample = |k: usize| {
            let (at, direction) = (positions[k], path.direction_at(k as f64 * KNOT_M));
            let mut slots = [None; 2 * SIDES as usize + 1];
            slots[SIDES as usize] = Some(0.0);
            let Some((own, _)) = index.lane_at(at, direction) else { return slots };
            for slot in (-SIDES..=SIDES).filter(|slot| *slot != 0) {
                let probe = at + direction.perp() * (LANE_M * f64::from(slot));
                let Some((lane, _)) = index.lane_at(probe, direction) else { continue };
                let road = map.lanes.get(lane).is_some_and(|lane| lane.kind == LaneKind::Road);
                let line = u32::try_from(lane).ok().and_then(|id| index.line(LaneId(id)));
                let Some(line) = line.filter(|_| lane != own && road) else { continue };
                let offset_m = -line.project(at).lateral_m;
                if (offset_m - LANE_M * f64::from(slot)).abs() < 0.45 * LANE_M {
                    slots[(slot + SIDES) as usize] = Some(offset_m);
                }
            }
            slots
        };
        Self { samples: (0..positions.len()).step_by(EVERY_KNOTS).map(sample).collect() }
    }

    fn sample(&self, along_m: f64) -> usize {
        let last = self.samples.len().saturating_sub(1);
        ((along_m / (KNOT_M * EVERY_KNOTS as f64)).max(0.0) as usize).min(last)
    }

    /// Returns where a slot lies at a place of the path, if there is a lane.
    #[must_use]
    pub fn offset_m(&self, slot: i8, along_m: f64) -> Option<f64> {
        let index = usize::try_from(slot + SIDES).ok()?;
        *self.samples.get(self.sample(along_m))?.get(index)?
    }

    /// Returns where a slot lies: where its lane was last, or a lane's width beyond.
    fn held_m(&self, slot: i8, along_m: f64) -> f64 {
        let Ok(index) = usize::try_from(slot + SIDES) else { return 0.0 };
        let upto = self.sample(along_m);
        let known = self.samples.iter().take(upto + 1).rev().find_map(|slots| slots.get(index).copied().flatten());
        known.unwrap_or(LANE_M * f64::from(slot))
    }

    /// Tells whether a slot has a lane all the way between two places.
    fn goes_on(&self, slot: i8, from_m: f64, to_m: f64) -> bool {
        let (Ok(index), span) = (usize::try_from(slot + SIDES), self.sample(from_m)..=self.sample(to_m)) else {
            return false;
        };
        self.samples.get(span).is_some_and(|all| all.iter().all(|slots| slots.get(index).is_some_and(Option::is_some)))
    }
}

/// A driver's way from one slot to another.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Weave {
    from: i8,
    to: i8,
    secs: f64,
}

impl Weave {
    /// Returns the state as numbers.
    pub(crate) fn to_array(self) -> [f64; 3] {
        [f64::from(self.from), f64::from(self.to), self.secs]
    }

    /// Reads the state from numbers, or nothing if they are none.
    pub(crate) fn from_array([from, to, secs]: [f64; 3]) -> Option<Self> {
        let slot = |value: f64| (value.abs() <= f64::from(SIDES) && value.fract() == 0.0).then_some(value as i8);
        (0.0..=CHANGE_SECS + REST_SECS).contains(&secs).then_some(())?;
        Some(Self { from: slot(from)?, to: slot(to)?, secs })
    }

    /// Returns the distance from the path and the speed sideways.
    pub(crate) fn place(&self, lanes: &Lanes, along_m: f64, speed_mps: f64) -> (f64, f64) {
        if self.from == 0 && self.to == 0 {
            return (0.0, 0.0);
        }
        let (from_m, to_m) = (lanes.held_m(self.from, along_m), lanes.held_m(self.to, along_m));
        let share = (self.secs / CHANGE_SECS).min(1.0);
        let smooth = share * share * (3.0 - 2.0 * share);
        let slope = if share < 1.0 { 6.0 * share * (1.0 - share) / CHANGE_SECS } else { 0.0 };
        (from_m + smooth * (to_m - from_m), (to_m - from_m) * slope * (speed_mps / FULL_MPS).min(1.0))
    }

    /// Returns the slot that the driver goes to or is in.
    pub(crate) fn slot(&self) -> i8 {
        self.to
    }

    /// Tells whether a change is under way or just done.
    pub(crate) fn busy(&self) -> bool {
        self.from != self.to
    }

    /// Goes on with a change, or begins one.
    pub(crate) fn advance(&mut self, wanted: Option<i8>, speed_mps: f64, dt_secs: f64) {
        if self.busy() {
            let pace = if self.secs < CHANGE_SECS { (speed_mps / FULL_MPS).min(1.0) } else { 1.0 };
            self.secs += dt_secs * pace;
            if self.secs >= CHANGE_SECS + REST_SECS {
                *self = Self { from: self.to, to: self.to, secs: 0.0 };
            }
        } else if let Some(to) = wanted {
            *self = Self { from: self.to, to, secs: 0.0 };
        }
    }
}

/// Somebody near a driver, along its path.
#[derive(Debug, Clone, Copy)]
pub struct Neighbour {
    /// Centre ahead of the driver's centre, m; negative behind.
    pub ahead_m: f64,
    /// Left of the path, m.
    pub lateral_m: f64,
    /// Half its extent across the path, m.
    pub half_across_m: f64,
    /// Half its extent along the path, m.
    pub half_along_m: f64,
    /// Along the path, m/s.
    pub speed_mps: f64,
    /// Speed that it wants, m/s.
    pub desired_mps: f64,
}

/// A driver that may change lanes.
pub struct Changer<'a> {
    /// How it follows.
    pub idm: &'a IdmParameters,
    /// Weight of others.
    pub politeness: f64,
    /// The lanes beside its path.
    pub lanes: &'a Lanes,
    /// Its centre along the path, m.
    pub along_m: f64,
    /// Its speed, m/s.
    pub speed_mps: f64,
    /// The speed that it wants, m/s.
    pub desired_mps: f64,
    /// Half its length, m.
    pub half_length_m: f64,
    /// Half its width, m.
    pub half_width_m: f64,
}

/// A lane change that is safe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// The slot to change to.
    pub to: i8,
    /// Gain of the own acceleration, m/s².
    pub mine_mps2: f64,
    /// Gain of the accelerations of the new and the old follower, m/s².
    pub others_mps2: f64,
}

impl Choice {
    /// Returns the advantage in the sense of MOBIL, m/s².
    #[must_use]
    pub fn advantage(&self, politeness: f64) -> f64 {
        self.mine_mps2 + politeness * self.others_mps2
    }
}

/// Who is before and behind a driver in a slot: gap, speed and wanted speed.
struct Around {
    ahead: Option<(f64, f64)>,
    behind: Option<(f64, Neighbour)>,
}

impl Changer<'_> {
    /// Returns the slot to change to, if any is better enough and safe.
    pub(crate) fn wanted(&self, weave: &Weave, all: &[Neighbour]) -> Option<i8> {
        if weave.busy() {
            return None;
        }
        self.options(weave.slot(), all)
            .into_iter()
            .map(|option| (option.advantage(self.politeness), option.to))
            .filter(|(advantage, _)| *advantage > THRESHOLD_MPS2)
            .fold(None, |best: Option<(f64, i8)>, new| if best.is_none_or(|b| new.0 > b.0) { Some(new) } else { best })
            .map(|(_, to)| to)
    }

    /// Returns the changes from a slot that are safe, with what each brings.
    #[must_use]
    pub fn options(&self, here: i8, all: &[Neighbour]) -> Vec<Choice> {
        let reach_m = self.along_m + AHEAD_M + AHEAD_SECS * self.speed_mps;
        let ends = here != 0 && !self.lanes.goes_on(here, self.along_m, reach_m);
        let mut options = Vec::new();
        for to in [here - 1, here + 1] {
            let back = ends && to.abs() < here.abs();
            if to.abs() > SIDES || !(back || self.lanes.goes_on(to, self.along_m, reach_m)) {
                continue;
            }
            let Some([mine_mps2, others_mps2]) = self.changes([here, to], all) else { continue };
            let mine_mps2 = mine_mps2 + if back { ENDING_MPS2 } else { 0.0 };
            options.push(Choice { to, mine_mps2, others_mps2 });
        }
        options
    }

    /// Returns what a change does to the own acceleration and to those of others; nothing where it is not safe.
    fn changes(&self, [here, to]: [i8; 2], all: &[Neighbour]) -> Option<[f64; 2]> {
        let (old, new) = (self.around(here, all), self.around(to, all));
        let lead = |(gap_m, speed_mps): (f64, f64)| Lead { gap_m, speed_mps };
        let own = |around: &Around| self.idm.acceleration(self.speed_mps, self.desired_mps, around.ahead.map(lead));
        if new.ahead.is_some_and(|(gap_m, _)| gap_m < self.idm.minimum_gap_m) {
            return None;
        }
        let mine = own(&new) - own(&old);
        let length_m = 2.0 * self.half_length_m;
        let follower = |behind: Option<(f64, Neighbour)>, ahead: Option<(f64, f64)>| {
            let Some((gap_m, other)) = behind else { return (0.0, 0.0) };
            let without = ahead.map(|(ahead_m, speed_mps)| Lead { gap_m: gap_m + length_m + ahead_m, speed_mps });
            let with = Some(Lead { gap_m, speed_mps: self.speed_mps });
            let accelerates = |lead| self.idm.acceleration(other.speed_mps, other.desired_mps, lead);
            (accelerates(without), accelerates(with))
        };
        let (new_before, new_after) = follower(new.behind, new.ahead);
        let (old_after, old_before) = follower(old.behind, old.ahead);
        if new_after < -SAFE_MPS2 || new.behind.is_some_and(|(gap_m, _)| gap_m < self.idm.minimum_gap_m) {
            return None;
        }
        Some([mine, new_after - new_before + old_after - old_before])
    }

    fn around(&self, slot: i8, all: &[Neighbour]) -> Around {
        let offset_m = self.lanes.held_m(slot, self.along_m);
        let mut around = Around { ahead: None, behind: None };
        for other in all {
            if (other.lateral_m - offset_m).abs() >= other.half_across_m + self.half_width_m + 0.2 {
                continue;
            }
            let gap_m = other.ahead_m.abs() - other.half_along_m - self.half_length_m;
            if other.ahead_m > 0.0 {
                if around.ahead.is_none_or(|(least_m, _)| gap_m < least_m) {
                    around.ahead = Some((gap_m, other.speed_mps));
                }
            } else if around.behind.is_none_or(|(least_m, _)| gap_m < least_m) && other.speed_mps > -0.5 {
                around.behind = Some((gap_m, *other));
            }
        }
        around
    }
}
