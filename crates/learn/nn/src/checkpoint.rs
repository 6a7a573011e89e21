//! Published checkpoints: tensors by name in mapped files, brought to the names and shapes that a network declares.
//!
//! [`Checkpoint::open`] reads headers alone. [`Checkpoint::fit`] matches the declarations of a network with the file,
//! through the wrappers of training checkpoints and the naming of other projects, and finds every fault of names and
//! shapes before a value is read. Values are converted to f32 one tensor at a time. Nothing in a file is executed.

use std::collections::BTreeMap;
use std::path::Path;

use ds_space::{Digest, DigestWriter};

use crate::array::{Array, Declared, Weights};

mod error;
mod files;
mod naming;
mod pickle;
mod zip;

pub use error::CheckpointError;
use files::{Files, dense};
pub use naming::Naming;

/// Number format of values in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    F32,
    F16,
    Bf16,
    F64,
    /// Integers and others of so many bytes: skipped or refused, never weights.
    Other(u8),
}

impl Format {
    /// Reads the name of a safetensors type or of a PyTorch storage.
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "F32" | "Float" => Self::F32,
            "F16" | "Half" => Self::F16,
            "BF16" | "BFloat16" => Self::Bf16,
            "F64" | "Double" => Self::F64,
            "I64" | "U64" | "Long" => Self::Other(8),
            "I32" | "U32" | "Int" => Self::Other(4),
            "I16" | "U16" | "Short" => Self::Other(2),
            "I8" | "U8" | "BOOL" | "F8_E4M3" | "F8_E5M2" | "Char" | "Byte" | "Bool" => Self::Other(1),
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::F64 => 8,
            Self::F32 => 4,
            Self::F16 | Self::Bf16 => 2,
            Self::Other(bytes) => usize::from(bytes),
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "weights are single precision")]
    fn value(self, bytes: &[u8]) -> f32 {
        match self {
            Self::F32 => f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
            Self::Bf16 => f32::from_bits(u32::from(u16::from_le_bytes([bytes[0], bytes[1]])) << 16),
            Self::F16 => half::f16::from_le_bytes([bytes[0], bytes[1]]).to_f32(),
            Self::F64 => f64::from_le_bytes(bytes[..8].try_into().expect("eight bytes")) as f32,
            Self::Other(_) => f32::NAN,
        }
    }
}

/// Where a tensor lies: first byte, format, shape, and strides in values.
#[derive(Debug, Clone, PartialEq)]
struct View {
    file: usize,
    start: usize,
    format: Format,
    shape: Vec<usize>,
    strides: Vec<usize>,
}

/// Whether values that are not finite are looked for when weights are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Finite {
    /// Each value is looked at.
    Checked,
    /// Values are taken as they are.
    Trusted,
}

/// A checkpoint's tensors by name, wrappers of training taken off.
pub struct Checkpoint {
    files: Files,
}

impl Checkpoint {
    /// Opens a safetensors file, an index of shards, a PyTorch archive, or a folder that holds one of them. Of a
    /// training checkpoint with several networks the averaged generator is taken, then the generator.
    ///
    /// # Errors
    /// [`CheckpointError`] says what is wrong with the files.
    pub fn open(path: &Path) -> Result<Self, CheckpointError> {
        Self::open_part(path, None)
    }

    /// As [`Self::open`], but takes the network of a training checkpoint that is named, such as `critic`.
    ///
    /// # Errors
    /// As [`Self::open`]; a part that is absent leaves every weight missing.
    pub fn open_part(path: &Path, part: Option<&str>) -> Result<Self, CheckpointError> {
        let mut files = Files::open(path)?;
        files.views = naming::unwrapped(std::mem::take(&mut files.views), part)?;
        Ok(Self { files })
    }

    /// Returns the digest of all bytes of the files; all of them are read.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let mut writer = DigestWriter::new();
        for map in &self.files.maps {
            writer.u64(map.len() as u64).raw(map);
        }
        writer.finish()
    }

    /// Returns all names and shapes, in name order.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &[usize])> {
        self.files.views.iter().map(|(name, view)| (name.as_str(), view.shape.as_slice()))
    }

    /// Returns the shape of a tensor.
    #[must_use]
    pub fn shape(&self, name: &str) -> Option<&[usize]> {
        self.files.views.get(name).map(|view| view.shape.as_slice())
    }

    /// Matches the file with what a network declares: none missing, none extra, every shape right.
    ///
    /// # Errors
    /// [`CheckpointError`] names the first weight that is wrong.
    pub fn fit(&self, declared: &[Declared], naming: Naming) -> Result<Fitted<'_>, CheckpointError> {
        let foreign = naming.is_foreign(&self.files.views);
        let mut used = std::collections::BTreeSet::new();
        let mut weights = BTreeMap::new();
        for weight in declared {
            let names = if foreign { naming.foreign(&weight.name) } else { vec![weight.name.clone()] };
            let found: Option<Vec<&View>> = names.iter().map(|name| self.files.views.get(name)).collect();
            let Some(views) = found else {
                return Err(CheckpointError::Missing { name: weight.name.clone(), looked_for: names });
            };
            let shape = joined(&views);
            if shape != weight.shape && !(foreign && narrow(&shape) == narrow(&weight.shape)) {
                let (name, expected) = (weight.name.clone(), weight.shape.clone());
                return Err(CheckpointError::Shape { name, expected, found: shape });
            }
            if let Some(view) = views.iter().find(|view| matches!(view.format, Format::Other(_))) {
                return Err(CheckpointError::Type { name: weight.name.clone(), dtype: format!("{:?}", view.format) });
            }
            used.extend(names.clone());
            weights.insert(weight.name.clone(), (weight.shape.clone(), names, views));
        }
        let extra = self.files.views.keys().find(|name| !used.contains(*name) && !naming.ignores(name));
        match extra {
            Some(name) => Err(CheckpointError::Unexpected { name: name.clone() }),
            None => Ok(Fitted { checkpoint: self, weights }),
        }
    }

    /// Reads one tensor as it is called in the file.
    ///
    /// # Errors
    /// If it is absent or no weight.
    pub fn read(&self, name: &str) -> Result<Array, CheckpointError> {
        let missing = || CheckpointError::Missing { name: name.to_owned(), looked_for: vec![name.to_owned()] };
        let view = self.files.views.get(name).ok_or_else(missing)?;
        if let Format::Other(_) = view.format {
            return Err(CheckpointError::Type { name: name.to_owned(), dtype: format!("{:?}", view.format) });
        }
        let mut values = Vec::with_capacity(view.shape.iter().product());
        self.values(view, &mut values);
        Ok(Array::new(&view.shape, values))
    }

    /// Reads rows of a matrix, one after another, as it is called in the file.
    ///
    /// # Errors
    /// If it is absent or no weight.
    ///
    /// # Panics
    /// If a row is beyond the last.
    pub fn rows(&self, name: &str, rows: &[usize]) -> Result<Vec<f32>, CheckpointError> {
        let missing = || CheckpointError::Missing { name: name.to_owned(), looked_for: vec![name.to_owned()] };
        let view = self.files.views.get(name).ok_or_else(missing)?;
        let [count, _] = view.shape[..] else {
            let expected = vec![view.shape.iter().product(), 1];
            return Err(CheckpointError::Shape { name: name.to_owned(), expected, found: view.shape.clone() });
        };
        let mut values = Vec::new();
        for row in rows {
            assert!(*row < count, "row {row} of {count}");
            let start = view.start + row * view.strides[0] * view.format.bytes();
            let shape = vec![1, view.shape[1]];
            let strides = if view.strides[1] == 1 { dense(&shape) } else { view.strides.clone() };
            self.values(&View { start, shape, strides, ..view.clone() }, &mut values);
        }
        Ok(values)
    }

    /// Appends the values of a tensor in row-major order.
    fn values(&self, view: &View, out: &mut Vec<f32>) {
        let bytes = view.format.bytes();
        let file = &self.files.maps[view.file][view.start..];
        let count: usize = view.shape.iter().product();
        if view.strides == dense(&view.shape) {
            out.extend(file[..count * bytes].chunks_exact(bytes).map(|value| view.format.value(value)));
            return;
        }
        let mut at = vec![0; view.shape.len()];
        for _ in 0..count {
            let place: usize = at.iter().zip(&view.strides).map(|(index, stride)| index * stride).sum();
            out.push(view.format.value(&file[place * bytes..]));
            for axis in (0..at.len()).rev() {
                at[axis] += 1;
                if at[axis] < view.shape[axis] {
                    break;
                }
                at[axis] = 0;
            }
        }
    }
}

/// The declared shape, the names in the file, and where those tensors lie.
type Match<'a> = (Vec<usize>, Vec<String>, Vec<&'a View>);

/// A checkpoint matched with a network's declarations; values are still in the file.
pub struct Fitted<'a> {
    checkpoint: &'a Checkpoint,
    weights: BTreeMap<String, Match<'a>>,
}

impl Fitted<'_> {
    /// Returns the number of weights.
    #[must_use]
    pub fn tensors(&self) -> usize {
        self.weights.len()
    }

    /// Returns the number of values in all weights.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.weights.values().map(|(shape, _, _)| shape.iter().product::<usize>()).sum()
    }

    /// Leaves a weight in the file; returns what it is called there, if it is one tensor.
    pub fn leave(&mut self, name: &str) -> Option<String> {
        let (_, names, _) = self.weights.remove(name)?;
        names.into_iter().next()
    }

    /// Reads the weights one by one, in name order.
    ///
    /// # Errors
    /// [`CheckpointError::NotFinite`] if that is checked, or what `take` says.
    pub fn each(&self, finite: Finite, mut take: impl FnMut(&str, Array)) -> Result<(), CheckpointError> {
        for (name, (shape, _, views)) in &self.weights {
            let mut values = Vec::with_capacity(shape.iter().product());
            for view in views {
                self.checkpoint.values(view, &mut values);
            }
            let odd = |values: &[f32]| values.iter().position(|value| !value.is_finite());
            if finite == Finite::Checked
                && let Some(index) = odd(&values)
            {
                return Err(CheckpointError::NotFinite { name: name.clone(), index, value: values[index] });
            }
            take(name, Array::new(shape, values));
        }
        Ok(())
    }

    /// Reads all weights.
    ///
    /// # Errors
    /// As [`Self::each`].
    pub fn weights(&self, finite: Finite) -> Result<Weights, CheckpointError> {
        let mut weights = Weights::default();
        self.each(finite, |name, array| weights.insert(name, array))?;
        Ok(weights)
    }
}

/// Returns the shape of tensors put one after another along the first axis.
fn joined(views: &[&View]) -> Vec<usize> {
    let mut shape = views[0].shape.clone();
    if let Some(first) = shape.first_mut()
        && views.iter().all(|view| view.shape.get(1..) == views[0].shape.get(1..))
    {
        *first = views.iter().map(|view| view.shape[0]).sum();
    }
    shape
}

/// Returns a shape without leading axes of one.
fn narrow(shape: &[usize]) -> &[usize] {
    let ones = shape.iter().take_while(|side| **side == 1).count();
    &shape[ones..]
}
