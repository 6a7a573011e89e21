//! Figures from records: pooled over the scenarios that are drawn, each as often as it is drawn.

use ds_fidelity::Features;
use ds_perception::overlap::{Overlaps, Target};
use nalgebra::DMatrix;

use crate::estimate::mean;
use crate::record::{Glance, Record, Seam};

/// The records of an arm: per scenario, one or several rollouts.
#[derive(Debug, Clone, Default)]
pub struct Rollouts(pub Vec<Vec<Record>>);

impl Rollouts {
    /// Returns the number of scenarios.
    #[must_use]
    pub fn scenarios(&self) -> usize {
        self.0.len()
    }

    /// Returns all looks at the scenarios drawn.
    pub fn glances<'a>(&'a self, picks: &'a [usize]) -> impl Iterator<Item = &'a Glance> {
        picks.iter().flat_map(|pick| &self.0[*pick]).flat_map(|record| &record.glances)
    }

    /// Returns the pixels of all targets.
    #[must_use]
    pub fn overlaps(&self, picks: &[usize]) -> Overlaps {
        let mut sum = Overlaps::default();
        self.glances(picks).for_each(|glance| sum.merge(&glance.overlaps()));
        sum
    }

    /// Returns the IoU of a target.
    #[must_use]
    pub fn iou(&self, picks: &[usize], target: Target) -> Option<f64> {
        self.overlaps(picks).iou(target)
    }

    /// Returns the mean IoU of lane paint and vehicles: what layout error is one minus of.
    #[must_use]
    pub fn following(&self, picks: &[usize]) -> Option<f64> {
        let overlaps = self.overlaps(picks);
        Some(0.5 * (overlaps.iou(Target::Lane)? + overlaps.iou(Target::Vehicle)?))
    }

    /// Returns the mean of a figure of each look.
    #[must_use]
    pub fn mean(&self, picks: &[usize], figure: impl Fn(&Glance) -> Option<f64>) -> Option<f64> {
        mean(self.glances(picks).filter_map(figure))
    }

    /// Returns right readings and all readings of lights within distances.
    #[must_use]
    pub fn lights(&self, picks: &[usize], (from_m, to_m): (f64, f64)) -> (u64, u64) {
        let lights = self.glances(picks).flat_map(|glance| &glance.lights);
        lights
            .filter(|(distance_m, _)| (from_m..to_m).contains(distance_m))
            .fold((0, 0), |(right, all), (_, read)| (right + u64::from(*read), all + 1))
    }

    /// Returns the seam of all rollouts.
    #[must_use]
    pub fn seam(&self, picks: &[usize]) -> Option<f64> {
        let mut sum = Seam::default();
        picks.iter().flat_map(|pick| &self.0[*pick]).for_each(|record| sum.merge(&record.seam));
        sum.ratio()
    }

    /// Returns the features of looks at frames `from` to `to`, one matrix per scenario.
    #[must_use]
    pub fn features(&self, (from, to): (u32, u32)) -> Features {
        let rows = |records: &Vec<Record>| {
            let rows: Vec<&Vec<f32>> =
                records.iter().flat_map(|record| record.within(from, to)).map(|glance| &glance.features).collect();
            let columns = rows.first().map_or(0, |row| row.len());
            DMatrix::from_fn(rows.len(), columns, |row, column| f64::from(rows[row][column]))
        };
        Features(self.0.iter().map(rows).collect())
    }
}

/// Returns the slope of values over places by least squares, none of fewer than two places.
#[must_use]
pub fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let count = points.len() as f64;
    let (mean_x, mean_y) = (mean(points.iter().map(|p| p.0))?, mean(points.iter().map(|p| p.1))?);
    let spread: f64 = points.iter().map(|p| (p.0 - mean_x).powi(2)).sum();
    let along: f64 = points.iter().map(|p| (p.0 - mean_x) * (p.1 - mean_y)).sum();
    (count >= 2.0 && spread > 0.0).then(|| along / spread)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use ds_train::colour::{Colour, Steps};

    /// A look with given pixels of lanes and vehicles, and features.
    pub(crate) fn glance(frame: u32, lane: [u64; 2], vehicle: [u64; 2], features: &[f32]) -> Glance {
        Glance {
            frame,
            pixels: Some([lane, [0, 0], vehicle, [0, 0], [0, 0]]),
            lights: vec![(10.0, lane[0] > 0), (50.0, true)],
            features: features.to_vec(),
            axes: [vec![1.0], vec![1.0], vec![1.0]],
            colour: Colour::default(),
            steps: Steps::default(),
            psnr_db: Some(20.0),
            distance: None,
            off_road: None,
        }
    }

    fn rollouts() -> Rollouts {
        let record = |glances| vec![Record { drive: String::new(), glances, seam: Seam::default() }];
        Rollouts(vec![
            record(vec![glance(1, [1, 2], [2, 2], &[0.0, 1.0]), glance(2, [1, 2], [0, 2], &[1.0, 3.0])]),
            record(vec![glance(1, [0, 4], [1, 4], &[2.0, 0.0]), glance(2, [0, 0], [0, 0], &[4.0, 1.0])]),
        ])
    }

    #[test]
    fn figures_are_pooled_over_what_is_drawn() {
        let rollouts = rollouts();
        assert_eq!(rollouts.iou(&[0, 1], Target::Lane), Some(0.25));
        assert_eq!(rollouts.iou(&[0], Target::Lane), Some(0.5));
        assert_eq!(rollouts.iou(&[0, 1, 1], Target::Vehicle), Some(4.0 / 12.0));
        assert_eq!(rollouts.following(&[0]), Some(0.5));
        assert_eq!(rollouts.lights(&[0, 1], (0.0, 30.0)), (2, 4));
        assert_eq!(rollouts.lights(&[0, 1], (30.0, 90.0)), (4, 4));
        assert_eq!(rollouts.mean(&[0], |glance| glance.psnr_db), Some(20.0));
        assert_eq!(rollouts.mean(&[0], |glance| glance.distance), None);
        assert_eq!(rollouts.seam(&[0]), None);
    }

    #[test]
    fn features_are_stacked_as_drawn() {
        let features = rollouts().features((2, 2));
        assert_eq!(features.stacked(&[1, 0, 1]), DMatrix::from_row_slice(3, 2, &[4.0, 1.0, 1.0, 3.0, 4.0, 1.0]));
        assert_eq!(features.all().nrows(), 2);
        let same = features.distance(&features, &[0, 1], 0.1).expect("two rows");
        assert!(same.abs() < 1e-9, "{same}");
        assert_eq!(features.distance(&features, &[0], 0.1), None);
    }

    #[test]
    fn slopes_by_hand() {
        assert_eq!(slope(&[(0.0, 1.0), (2.0, 5.0)]), Some(2.0));
        assert_eq!(slope(&[(0.0, 1.0)]), None);
        assert_eq!(slope(&[(1.0, 1.0), (1.0, 2.0)]), None);
    }
}
