//! Plain arrays and named weights: what crosses the border of this crate.
//!
//! An [`Array`] is a shape and row-major f32 values. [`Weights`] maps names to arrays in name order. A network
//! declares its weights as a list of [`Declared`]; a set is made from draws or checked against that list.

use std::collections::BTreeMap;

use ds_space::{Digest, DigestWriter, Draws};

/// Row-major values with their shape.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Array {
    shape: Vec<usize>,
    values: Vec<f32>,
}

impl Array {
    /// Wraps values.
    ///
    /// # Panics
    /// If the number of values is not the product of the shape.
    #[must_use]
    pub fn new(shape: &[usize], values: Vec<f32>) -> Self {
        assert_eq!(shape.iter().product::<usize>(), values.len(), "shape {shape:?} does not fit the values");
        Self { shape: shape.to_vec(), values }
    }

    /// Makes an array of zeros.
    #[must_use]
    pub fn zeros(shape: &[usize]) -> Self {
        Self { shape: shape.to_vec(), values: vec![0.0; shape.iter().product()] }
    }

    /// Draws standard normal values, the draws' first in row-major order.
    #[must_use]
    pub fn normal(shape: &[usize], draws: &Draws) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "arrays are single precision")]
        let values = (0..shape.iter().product::<usize>() as u64).map(|index| draws.normal(index) as f32).collect();
        Self::new(shape, values)
    }

    /// Joins arrays that differ in their first side alone.
    ///
    /// # Panics
    /// If there are none, or their other sides differ.
    #[must_use]
    pub fn joined<'a>(parts: impl IntoIterator<Item = &'a Self>) -> Self {
        let mut parts = parts.into_iter();
        let mut all = parts.next().expect("something is joined").clone();
        for part in parts {
            assert_eq!(all.shape[1..], part.shape[1..], "joined arrays have the same sides but for the first");
            all.shape[0] += part.shape[0];
            all.values.extend_from_slice(&part.values);
        }
        all
    }

    /// Returns the shape.
    #[must_use]
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Returns the values, row-major.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Returns the values for writing.
    pub fn values_mut(&mut self) -> &mut [f32] {
        &mut self.values
    }

    /// Takes the values out.
    #[must_use]
    pub fn into_values(self) -> Vec<f32> {
        self.values
    }

    /// Says whether every value is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.values.iter().all(|value| value.is_finite())
    }

    /// Adds shape and value bits to a digest.
    pub fn digest_into(&self, writer: &mut DigestWriter) {
        writer.u64(self.shape.len() as u64);
        for side in &self.shape {
            writer.u64(*side as u64);
        }
        digest_values(writer, &self.values);
    }

    /// Returns the digest of shape and value bits.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let mut writer = DigestWriter::new();
        self.digest_into(&mut writer);
        writer.finish()
    }
}

/// Adds the little-endian bits of values to a digest.
pub fn digest_values(writer: &mut DigestWriter, values: &[f32]) {
    if cfg!(target_endian = "little") {
        writer.raw(bytemuck::cast_slice(values));
    } else {
        for value in values {
            writer.raw(&value.to_le_bytes());
        }
    }
}

/// How a weight begins before training.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Initial {
    /// The same value everywhere.
    Constant(f32),
    /// Normal draws of this standard deviation.
    Normal(f32),
    /// Modulation rows: zeros, with ones in the rows that gate a residual branch (rows 2 and 5 of 6).
    Gates,
    /// A linear layer from two by two pixels (row, column, channel): normal draws of this deviation added to a
    /// shortcut, in which each output is the mean of a group of inputs, channel after channel.
    Folded(f32),
    /// A linear layer to two by two pixels, or to those of several frames (frame, row, column, channel): normal draws
    /// of this deviation added to a shortcut, in which groups of outputs copy an input, channel after channel.
    Grown {
        /// Frames for each of the input.
        frames: usize,
        /// Deviation.
        std: f32,
    },
}

/// The parameter-free shortcut from inputs to outputs that stand for one line cut into equal parts (DC-AE, arXiv
/// 2410.10733): an output is the mean of the inputs within it, or a copy of the one that it lies within.
fn shortcut((output, outputs): (usize, usize), (input, inputs): (usize, usize)) -> f32 {
    let met = if inputs < outputs { output * inputs / outputs == input } else { input * outputs / inputs == output };
    if met { (outputs as f32 / inputs as f32).min(1.0) } else { 0.0 }
}

/// Returns the place of a value (row, column, channel) of two by two pixels among all, channel after channel.
fn by_channel(at: usize, count: usize) -> usize {
    let channels = (count / 4).max(1);
    at % channels * 4 + at / channels
}

/// A weight that a network asks for.
#[derive(Debug, Clone, PartialEq)]
pub struct Declared {
    /// Name, as in the weights file.
    pub name: String,
    /// Shape.
    pub shape: Vec<usize>,
    /// First values.
    pub initial: Initial,
}

impl Declared {
    /// Declares a weight.
    #[must_use]
    pub fn new(name: impl Into<String>, shape: &[usize], initial: Initial) -> Self {
        Self { name: name.into(), shape: shape.to_vec(), initial }
    }

    /// Declares weight and bias of a 3×3 convolution, stored as [outputs, 3, 3, inputs].
    pub fn convolution(list: &mut Vec<Self>, name: &str, inputs: usize, outputs: usize, gain: f32) {
        let std = gain / ((9 * inputs) as f32).sqrt();
        list.push(Self::new(format!("{name}.weight"), &[outputs, 3, 3, inputs], Initial::Normal(std)));
        list.push(Self::new(format!("{name}.bias"), &[outputs], Initial::Constant(0.0)));
    }

    /// Declares weight and bias of a linear layer, stored as [outputs, inputs].
    pub fn linear(list: &mut Vec<Self>, name: &str, inputs: usize, outputs: usize, gain: f32) {
        Self::layer(list, name, [outputs, inputs], Initial::Normal(gain / (inputs as f32).sqrt()));
    }

    /// Declares weight [outputs, inputs] and bias of a linear layer, of other first values than [`Self::linear`].
    pub fn layer(list: &mut Vec<Self>, name: &str, shape: [usize; 2], initial: Initial) {
        list.push(Self::new(format!("{name}.weight"), &shape, initial));
        list.push(Self::new(format!("{name}.bias"), &shape[..1], Initial::Constant(0.0)));
    }
}

/// Says why a set of weights is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WeightsError {
    /// A declared weight is absent.
    #[error("weight {name:?} is missing")]
    Missing {
        /// Its name.
        name: String,
    },
    /// An undeclared weight is present.
    #[error("weight {name:?} is not part of the model")]
    Extra {
        /// Its name.
        name: String,
    },
    /// A weight has another shape.
    #[error("weight {name:?} has shape {found:?}, {expected:?} expected")]
    Shape {
        /// Its name.
        name: String,
        /// The declared shape.
        expected: Vec<usize>,
        /// The shape found.
        found: Vec<usize>,
    },
    /// The back end has no such layers.
    #[error("back end {backend:?} runs the project's own networks alone, not published ones")]
    Backend {
        /// Its name.
        backend: &'static str,
    },
    /// A weight holds a value that is not finite.
    #[error("weight {name:?} holds {value} at index {index}")]
    NotFinite {
        /// Its name.
        name: String,
        /// Index of the first such value.
        index: usize,
        /// That value.
        value: f32,
    },
}

/// Named arrays in name order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Weights {
    arrays: BTreeMap<String, Array>,
}

impl Weights {
    /// Makes the first values of a network: a pure function of the declarations and the seed.
    #[must_use]
    pub fn initialised(declared: &[Declared], seed: &Digest) -> Self {
        let mut weights = Self::default();
        for weight in declared {
            let draws = Draws::new(seed, &weight.name, &[]);
            let mut array = Array::zeros(&weight.shape);
            let count = array.values.len();
            for (index, value) in array.values.iter_mut().enumerate() {
                *value = match weight.initial {
                    Initial::Constant(constant) => constant,
                    #[expect(clippy::cast_possible_truncation, reason = "weights are single precision")]
                    Initial::Normal(std) => std * draws.normal(index as u64) as f32,
                    Initial::Gates => f32::from(u8::from((index * 6 / count) % 3 == 2)),
                    #[expect(clippy::cast_possible_truncation, reason = "weights are single precision")]
                    Initial::Folded(std) => {
                        let [outputs, inputs] = [weight.shape[0], weight.shape[1]];
                        let input = (by_channel(index % inputs, inputs), inputs);
                        shortcut((index / inputs, outputs), input) + std * draws.normal(index as u64) as f32
                    }
                    #[expect(clippy::cast_possible_truncation, reason = "weights are single precision")]
                    Initial::Grown { frames, std } => {
                        let [outputs, inputs] = [weight.shape[0] / frames, weight.shape[1]];
                        let output = (by_channel(index / inputs % outputs, outputs), outputs);
                        shortcut(output, (index % inputs, inputs)) + std * draws.normal(index as u64) as f32
                    }
                };
            }
            weights.insert(&weight.name, array);
        }
        weights
    }

    /// Checks the set against the declarations: none missing, none extra, every shape right, every value finite.
    ///
    /// # Errors
    /// [`WeightsError`] names the first weight that is wrong.
    pub fn check(&self, declared: &[Declared]) -> Result<(), WeightsError> {
        for weight in declared {
            let array = self.arrays.get(&weight.name).ok_or(WeightsError::Missing { name: weight.name.clone() })?;
            if array.shape != weight.shape {
                let (expected, found) = (weight.shape.clone(), array.shape.clone());
                return Err(WeightsError::Shape { name: weight.name.clone(), expected, found });
            }
            if let Some(index) = array.values.iter().position(|value| !value.is_finite()) {
                let value = array.values[index];
                return Err(WeightsError::NotFinite { name: weight.name.clone(), index, value });
            }
        }
        let known: std::collections::BTreeSet<&str> = declared.iter().map(|weight| weight.name.as_str()).collect();
        match self.arrays.keys().find(|name| !known.contains(name.as_str())) {
            Some(name) => Err(WeightsError::Extra { name: name.clone() }),
            None => Ok(()),
        }
    }

    /// Adds or replaces an array.
    pub fn insert(&mut self, name: &str, array: Array) {
        self.arrays.insert(name.to_owned(), array);
    }

    /// Takes an array out.
    pub fn remove(&mut self, name: &str) -> Option<Array> {
        self.arrays.remove(name)
    }

    /// Keeps the arrays of some names.
    pub fn keep(&mut self, kept: impl Fn(&str) -> bool) {
        self.arrays.retain(|name, _| kept(name));
    }

    /// Returns an array by name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Array> {
        self.arrays.get(name)
    }

    /// Returns an array by name for writing.
    pub fn get_mut(&mut self, name: &str) -> Option<&mut Array> {
        self.arrays.get_mut(name)
    }

    /// Returns all names and arrays, in name order.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Array)> {
        self.arrays.iter().map(|(name, array)| (name.as_str(), array))
    }

    /// Returns all names and arrays for writing, in name order.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = (&str, &mut Array)> {
        self.arrays.iter_mut().map(|(name, array)| (name.as_str(), array))
    }

    /// Returns the number of values in all arrays.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.arrays.values().map(|array| array.values.len()).sum()
    }

    /// Returns the weights whose names begin with `prefix`, with the prefix taken off.
    #[must_use]
    pub fn part(&self, prefix: &str) -> Self {
        let strip = |(name, array): (&String, &Array)| Some((name.strip_prefix(prefix)?.to_owned(), array.clone()));
        Self { arrays: self.arrays.iter().filter_map(strip).collect() }
    }

    /// Adds all weights of `other` under `prefix`.
    pub fn absorb(&mut self, prefix: &str, other: &Self) {
        for (name, array) in &other.arrays {
            self.arrays.insert(format!("{prefix}{name}"), array.clone());
        }
    }

    /// Makes zeros of the same names and shapes.
    #[must_use]
    pub fn zeros_like(&self) -> Self {
        Self { arrays: self.arrays.iter().map(|(name, array)| (name.clone(), Array::zeros(&array.shape))).collect() }
    }

    /// Returns the digest of names, shapes and value bits in name order.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let mut writer = DigestWriter::new();
        for (name, array) in &self.arrays {
            writer.text(name);
            array.digest_into(&mut writer);
        }
        writer.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Draws nothing beside the shortcut, whose weights are told row by row.
    fn check(shape: &[usize], initial: Initial, expected: &[f32]) {
        let made = Weights::initialised(&[Declared::new("w", shape, initial)], &Digest::of(b"any"));
        assert_eq!(made.get("w").expect("declared").values(), expected);
    }

    #[test]
    fn shortcuts_average_and_copy_channel_after_channel() {
        // Two channels of two by two pixels, side by side: the first output is the mean of the first channel.
        let means = [0.25, 0.0, 0.25, 0.0, 0.25, 0.0, 0.25, 0.0, 0.0, 0.25, 0.0, 0.25, 0.0, 0.25, 0.0, 0.25];
        check(&[2, 8], Initial::Folded(0.0), &means);
        // More outputs than inputs: each pixel of the only channel twice.
        let twice: Vec<f32> =
            (0..8).flat_map(|row| (0..4).map(move |pixel| f32::from(u8::from(row / 2 == pixel)))).collect();
        check(&[8, 4], Initial::Folded(0.0), &twice);
        // Two channels to one of two by two pixels of two frames: the first to the upper row, the second to the lower.
        let copies = [1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0];
        check(&[8, 2], Initial::Grown { frames: 2, std: 0.0 }, &copies.repeat(2));
    }
}
