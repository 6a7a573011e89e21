//! How well found labels overlap with true ones: intersection over union, pooled over all pixels that were added.
//!
//! A *target* is a set of labels. Its IoU is the number of pixels that are of the set in both maps over the number
//! that are in either; it is unknown where neither map has one.

use crate::Label;

/// A set of labels that is measured as one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Target {
    /// Lane lines and stop lines.
    Lane,
    /// Pedestrian crossings.
    Crosswalk,
    /// Cars, trucks, buses.
    Vehicle,
    /// Pedestrians and cyclists.
    Pedestrian,
    /// The drivable surface with paint and crossings.
    Road,
}

impl Target {
    /// All targets, in the order of reports.
    pub const ALL: [Self; 5] = [Self::Lane, Self::Crosswalk, Self::Vehicle, Self::Pedestrian, Self::Road];

    /// Returns the name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Lane => "lane",
            Self::Crosswalk => "crosswalk",
            Self::Vehicle => "vehicle",
            Self::Pedestrian => "pedestrian",
            Self::Road => "road",
        }
    }

    /// Says whether a label belongs to the set.
    #[must_use]
    pub fn holds(self, label: Label) -> bool {
        match self {
            Self::Lane => label == Label::Lane,
            Self::Crosswalk => label == Label::Crosswalk,
            Self::Vehicle => label == Label::Vehicle,
            Self::Pedestrian => label == Label::Pedestrian,
            Self::Road => matches!(label, Label::Road | Label::Lane | Label::Crosswalk),
        }
    }
}

/// Pixels of one target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Overlap {
    /// Pixels in both maps.
    pub both: u64,
    /// Pixels in either map.
    pub either: u64,
}

/// Pixels of every target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Overlaps(pub [Overlap; Target::ALL.len()]);

impl Overlaps {
    /// Counts a frame.
    ///
    /// # Panics
    /// If the maps differ in size.
    pub fn add(&mut self, truth: &[Label], found: &[Label]) {
        assert_eq!(truth.len(), found.len(), "both maps are of one frame");
        for (target, overlap) in Target::ALL.into_iter().zip(&mut self.0) {
            for (truth, found) in truth.iter().zip(found) {
                let (truth, found) = (target.holds(*truth), target.holds(*found));
                overlap.both += u64::from(truth && found);
                overlap.either += u64::from(truth || found);
            }
        }
    }

    /// Adds the counts of other frames.
    pub fn merge(&mut self, other: &Self) {
        for (sum, more) in self.0.iter_mut().zip(&other.0) {
            sum.both += more.both;
            sum.either += more.either;
        }
    }

    /// Returns the counts of a target.
    #[must_use]
    pub fn of(&self, target: Target) -> Overlap {
        self.0[target as usize]
    }

    /// Returns the intersection over union of a target, none where no map has it.
    #[must_use]
    pub fn iou(&self, target: Target) -> Option<f64> {
        let Overlap { both, either } = self.of(target);
        (either > 0).then(|| both as f64 / either as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Label::{Crosswalk, Lane, Other, Pedestrian, Road, Sky, Vehicle};

    fn check(truth: &[Label], found: &[Label], expected: [Option<f64>; 5]) {
        let mut overlaps = Overlaps::default();
        overlaps.add(truth, found);
        assert_eq!(Target::ALL.map(|target| overlaps.iou(target)), expected, "{truth:?} {found:?}");
    }

    #[test]
    fn overlaps_worked_out_by_hand() {
        check(&[Sky, Other], &[Other, Sky], [None; 5]);
        check(
            &[Road, Lane, Lane, Vehicle, Pedestrian, Sky],
            &[Road, Lane, Road, Vehicle, Pedestrian, Sky],
            // One of two painted pixels was found; paint taken for road is still road.
            [Some(0.5), None, Some(1.0), Some(1.0), Some(1.0)],
        );
        check(
            &[Vehicle, Vehicle, Crosswalk, Pedestrian, Crosswalk, Road],
            &[Vehicle, Pedestrian, Road, Vehicle, Crosswalk, Road],
            // Vehicle: 1 of {0, 1, 3}. Pedestrian: none of {1, 3}. Crosswalk: 1 of {2, 4}.
            [None, Some(0.5), Some(1.0 / 3.0), Some(0.0), Some(1.0)],
        );
        check(&[Lane], &[Sky], [Some(0.0), None, None, None, Some(0.0)]);
    }

    #[test]
    fn frames_are_pooled_by_pixels() {
        let (mut first, mut second) = (Overlaps::default(), Overlaps::default());
        first.add(&[Vehicle, Sky], &[Vehicle, Sky]);
        second.add(&[Vehicle, Vehicle, Vehicle], &[Sky, Sky, Sky]);
        first.merge(&second);
        assert_eq!(first.of(Target::Vehicle), Overlap { both: 1, either: 4 });
        assert_eq!(first.iou(Target::Vehicle), Some(0.25));
    }
}
