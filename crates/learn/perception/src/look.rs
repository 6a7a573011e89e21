//! What a frame looks like on three axes (lighting, weather, road surface), and features for distances between frames.
//!
//! One network, one image at a time. Beside the axes it learns how much the frame was softened and which labels it shows
//! where, so that its features (the layer before the scores) tell of look, sharpness and content alike. The features
//! are for distances: compare them between sets of frames, not by value.

use ds_camera::{Condition, Lighting, RoadSurface, Weather};
use ds_graph::classifier::{Answer, Classifier, ClassifierShape};
use ds_nn::{Array, Weights, WeightsError};
use ds_raster::RgbImage;

use crate::label::Label;
use crate::reader::{Reader, Task};
use crate::segmenter::{highest, values_of};

/// The sizes that frames are brought to, in pixels: width and height.
pub const SIZE_PX: (u32, u32) = (160, 96);
/// Rows and columns of cells whose labels are part of the task.
pub const CELLS: [usize; 2] = [2, 3];
/// Degrees of softness that are told apart: none, some, much.
pub const SOFTNESS: usize = 3;

/// Number of values of each axis, in the order of the scores: lighting, weather, road surface.
pub const AXES: [usize; 3] = [Lighting::ALL.len(), Weather::ALL.len(), RoadSurface::ALL.len()];

/// The network's sizes.
pub const SHAPE: ClassifierShape = ClassifierShape {
    widths: &[16, 32, 64, 64],
    bands: 3,
    features: 64,
    scores: AXES[0] + AXES[1] + AXES[2] + SOFTNESS + CELLS[0] * CELLS[1] * Label::COUNT,
};

/// Returns the index of a condition on each axis.
#[must_use]
pub fn indices(condition: Condition) -> [usize; 3] {
    let lighting = Lighting::ALL.iter().position(|value| *value == condition.lighting());
    let weather = Weather::ALL.iter().position(|value| *value == condition.weather());
    let surface = RoadSurface::ALL.iter().position(|value| *value == condition.surface());
    [lighting, weather, surface].map(|index| index.expect("every value is one of its axis"))
}

/// Returns what of a condition is out of the ordinary, as axis and index on it: its lighting if that is not day and its
/// weather if that is not clear, else its road surface.
#[must_use]
pub fn sought(condition: Condition) -> Vec<(usize, usize)> {
    let axes: &[usize] = match (condition.lighting(), condition.weather()) {
        (Lighting::Day, Weather::Clear) => &[2],
        (Lighting::Day, _) => &[1],
        (_, Weather::Clear) => &[0],
        _ => &[0, 1],
    };
    let values = indices(condition);
    axes.iter().map(|axis| (*axis, values[*axis])).collect()
}

/// Returns the name of a value of an axis, as in the names of conditions.
///
/// # Panics
///
/// Panics if there is no such value.
#[must_use]
pub fn name(axis: usize, value: usize) -> &'static str {
    match axis {
        0 => Lighting::ALL[value].name(),
        1 => Weather::ALL[value].name(),
        _ => RoadSurface::ALL[value].name(),
    }
}

/// What a frame looks like.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// Probability of each time of day, weather and road surface.
    pub axes: [Vec<f32>; 3],
    /// Features for distances.
    pub features: Vec<f32>,
}

impl Look {
    /// Returns the index of the likeliest value of an axis.
    #[must_use]
    pub fn likeliest(&self, axis: usize) -> usize {
        highest(&self.axes[axis])
    }

    /// Says whether what is out of the ordinary in a condition is the likeliest on its axes.
    #[must_use]
    pub fn shows(&self, condition: Condition) -> bool {
        sought(condition).into_iter().all(|(axis, value)| self.likeliest(axis) == value)
    }
}

/// Telling what a frame looks like.
pub struct Looks;

impl Task for Looks {
    type Network = Classifier;

    fn bind(weights: &Weights) -> Result<Self::Network, WeightsError> {
        Classifier::new(SHAPE, weights)
    }
}

/// The network, ready to look.
pub type LookReader = Reader<Looks>;

impl LookReader {
    /// Says what a frame looks like; a frame of another size is resized first.
    #[must_use]
    pub fn read(&self, frame: &RgbImage) -> Look {
        let frame = frame.resized(SIZE_PX.0, SIZE_PX.1);
        let Answer { features, scores } = self.network.answer(&values_of(&frame));
        let mut rest = scores.values();
        let axes = AXES.map(|count| {
            let (axis, later) = rest.split_at(count);
            rest = later;
            softmax(axis)
        });
        Look { axes, features: features.into_values() }
    }
}

impl LookReader {
    /// Returns how far apart two frames are to the network's eye: per level, the mean over places of the squared
    /// difference of unit vectors of channels, averaged over levels (after Zhang et al. 2018, without learned weights).
    /// 0 for equal frames, at most 2, for activations are never below zero.
    #[must_use]
    pub fn distance(&self, a: &RgbImage, b: &RgbImage) -> f64 {
        self.mean_distance(a, b, |_, _, _| true).unwrap_or(0.0)
    }

    /// Returns the same over places most of whose pixels are chosen, rows top to bottom as in the frames; `None` without any.
    #[must_use]
    pub fn distance_where(&self, a: &RgbImage, b: &RgbImage, chosen: &[bool]) -> Option<f64> {
        let (width, height) = (a.width_px() as usize, a.height_px() as usize);
        self.mean_distance(a, b, |[rows, columns], y, x| {
            let span =
                |at: usize, of: usize, size: usize| at * size / of..((at + 1) * size / of).max(at * size / of + 1);
            let (span_y, span_x) = (span(y, rows, height), span(x, columns, width));
            let all = span_y.len() * span_x.len();
            2 * span_y.flat_map(|y| span_x.clone().map(move |x| chosen[y * width + x])).filter(|c| *c).count() > all
        })
    }

    /// Averages over levels the mean over the places of each that are wanted: rows and columns of the level, row, column.
    fn mean_distance(
        &self,
        a: &RgbImage,
        b: &RgbImage,
        wanted: impl Fn([usize; 2], usize, usize) -> bool,
    ) -> Option<f64> {
        let levels = |frame: &RgbImage| {
            let frame = frame.resized(SIZE_PX.0, SIZE_PX.1);
            self.network.levels(&values_of(&frame))
        };
        let (a, b) = (levels(a), levels(b));
        let apart = |(a, b): (&Array, &Array)| {
            let [rows, columns, width] = [1, 2, 3].map(|axis| a.shape()[axis]);
            let pairs = a.values().chunks_exact(width).zip(b.values().chunks_exact(width)).enumerate();
            let there = pairs.filter(|(at, _)| wanted([rows, columns], at / columns, at % columns));
            ds_stats::mean(there.map(|(_, (a, b))| unit_distance(a, b)))
        };
        let levels: Option<Vec<f64>> = a.iter().zip(&b).map(apart).collect();
        ds_stats::mean(levels?)
    }
}

/// Returns the squared distance of two vectors brought to length one.
fn unit_distance(a: &[f32], b: &[f32]) -> f64 {
    let norm = |v: &[f32]| v.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt().max(1e-9);
    let (norm_a, norm_b) = (norm(a), norm(b));
    a.iter().zip(b).map(|(a, b)| (f64::from(*a) / norm_a - f64::from(*b) / norm_b).powi(2)).sum()
}

fn softmax(scores: &[f32]) -> Vec<f32> {
    let top = scores.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let powers: Vec<f32> = scores.iter().map(|score| (score - top).exp()).collect();
    let sum: f32 = powers.iter().sum();
    powers.iter().map(|power| power / sum).collect()
}

/// Returns the share of every label in every cell, cells row by row.
#[must_use]
pub fn shares(labels: &[Label], width_px: usize) -> Vec<f32> {
    let height_px = labels.len() / width_px;
    let mut shares = vec![0.0; CELLS[0] * CELLS[1] * Label::COUNT];
    for (at, label) in labels.iter().enumerate() {
        let cell = at / width_px * CELLS[0] / height_px * CELLS[1] + at % width_px * CELLS[1] / width_px;
        shares[cell * Label::COUNT + *label as usize] += 1.0;
    }
    for cell in shares.chunks_exact_mut(Label::COUNT) {
        let count: f32 = cell.iter().sum::<f32>().max(1.0);
        cell.iter_mut().for_each(|share| *share /= count);
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::Draws;

    #[test]
    fn shares_are_counted_by_cell() {
        let mut labels = vec![Label::Sky; 6 * 4];
        labels[3 * 6 + 5] = Label::Lane;
        let shares = shares(&labels, 6);
        let cell = |row: usize, column: usize, label: Label| shares[(row * 3 + column) * Label::COUNT + label as usize];
        assert_eq!((cell(0, 0, Label::Sky), cell(1, 2, Label::Sky), cell(1, 2, Label::Lane)), (1.0, 0.75, 0.25));
    }

    #[test]
    fn probabilities_of_each_axis_sum_to_one_and_size_does_not_matter() {
        let weights = Weights::initialised(&SHAPE.declare(), &ds_space::Digest::of(b"look"));
        let reader = LookReader::new(&weights).expect("the weights fit");
        let draws = Draws::from_seed(1, "look");
        let small = RgbImage::filled(80, 48, [draws.below(0, 255) as u8, 40, 90]);
        let large = RgbImage::filled(160, 96, small.pixel(0, 0));
        let look = reader.read(&large);
        assert_eq!(look.axes.each_ref().map(Vec::len), AXES);
        assert!(look.axes.iter().all(|axis| (axis.iter().sum::<f32>() - 1.0).abs() < 1e-5));
        assert_eq!(look.features.len(), SHAPE.features);
        assert_eq!(reader.read(&small), look);
        let other = RgbImage::filled(160, 96, [5, 200, 90]);
        assert!(reader.distance(&small, &large) < 1e-9);
        let (there, back) = (reader.distance(&large, &other), reader.distance(&other, &large));
        assert!(there > 0.0 && (there - back).abs() < 1e-9, "{there} {back}");
        assert!(SHAPE.declare().iter().map(|d| d.shape.iter().product::<usize>()).sum::<usize>() < 200_000);
    }

    #[test]
    fn what_counts_of_a_condition_is_what_is_not_ordinary() {
        let check = |name: &str, expected: &[usize]| {
            let condition: Condition = name.parse().expect("a condition");
            assert_eq!(sought(condition).iter().map(|(axis, _)| *axis).collect::<Vec<_>>(), expected, "{name}");
            let mut look = Look { axes: AXES.map(|count| vec![0.0; count]), features: Vec::new() };
            sought(condition).into_iter().for_each(|(axis, value)| look.axes[axis][value] = 1.0);
            assert!(look.shows(condition));
            look.axes[expected[0]].iter_mut().for_each(|chance| *chance = 1.0 - *chance);
            assert!(!look.shows(condition), "{name}");
        };
        check("night", &[0]);
        check("snow", &[1]);
        check("rain", &[1]);
        check("night-fog", &[0, 1]);
        check("sand", &[2]);
    }

    #[test]
    fn conditions_have_their_place_on_every_axis() {
        for condition in Condition::all() {
            let [lighting, weather, surface] = indices(condition);
            assert_eq!(Lighting::ALL[lighting], condition.lighting());
            assert_eq!(Weather::ALL[weather], condition.weather());
            assert_eq!(RoadSurface::ALL[surface], condition.surface());
        }
    }
}
