//! NumPy arrays as plain values: numbers as f64, texts, or objects, in row-major order.

use super::Value;

/// An array; numbers of every width become f64.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    /// Extent of each axis.
    pub shape: Vec<usize>,
    /// The items, row-major.
    pub data: Data,
}

/// The items of an array.
#[derive(Debug, Clone, PartialEq)]
pub enum Data {
    /// Numbers.
    Numbers(Vec<f64>),
    /// Texts.
    Texts(Vec<String>),
    /// Values of the arena.
    Objects(Vec<Value>),
}

/// The supported kinds of array items; widths in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dtype {
    /// Truth values.
    Bool,
    /// Whole numbers with a sign.
    Signed {
        /// Width.
        bytes: usize,
        /// Whether the highest byte comes first.
        big: bool,
    },
    /// Whole numbers without one.
    Unsigned {
        /// Width.
        bytes: usize,
        /// Whether the highest byte comes first.
        big: bool,
    },
    /// Floating-point numbers.
    Float {
        /// Width.
        bytes: usize,
        /// Whether the highest byte comes first.
        big: bool,
    },
    /// UTF-32 text of so many characters.
    Wide {
        /// Characters.
        chars: usize,
        /// Whether the highest byte comes first.
        big: bool,
    },
    /// Byte text of so many bytes.
    Narrow {
        /// Width.
        bytes: usize,
    },
    /// Values of the arena.
    Object,
}

impl Dtype {
    /// Reads a code such as `f8`, `<i4`, `U12`, `O8`.
    pub(super) fn parse(code: &str) -> Option<Self> {
        let (order, code) = match code.as_bytes().first()? {
            b'<' | b'>' | b'=' | b'|' => code.split_at(1),
            _ => ("|", code),
        };
        let kind = code.chars().next()?;
        let width = &code[kind.len_utf8()..];
        let bytes: usize = if width.is_empty() { 0 } else { width.parse().ok()? };
        let big = order == ">";
        match (kind, bytes) {
            ('?', 0) | ('b', 1) => Some(Self::Bool),
            ('i', 1 | 2 | 4 | 8) => Some(Self::Signed { bytes, big }),
            ('u', 1 | 2 | 4 | 8) => Some(Self::Unsigned { bytes, big }),
            ('f', 4 | 8) => Some(Self::Float { bytes, big }),
            ('U', chars) if chars <= 4096 => Some(Self::Wide { chars, big }),
            ('S' | 'a', bytes) if bytes <= 16_384 => Some(Self::Narrow { bytes }),
            ('O', _) => Some(Self::Object),
            _ => None,
        }
    }

    /// Returns the same kind in the byte order of a dtype's state.
    pub(super) fn ordered(self, order: &str) -> Self {
        let big = order == ">";
        match self {
            Self::Signed { bytes, .. } => Self::Signed { bytes, big },
            Self::Unsigned { bytes, .. } => Self::Unsigned { bytes, big },
            Self::Float { bytes, .. } => Self::Float { bytes, big },
            Self::Wide { chars, .. } => Self::Wide { chars, big },
            other => other,
        }
    }

    pub(super) fn item_bytes(self) -> usize {
        match self {
            Self::Bool => 1,
            Self::Signed { bytes, .. }
            | Self::Unsigned { bytes, .. }
            | Self::Float { bytes, .. }
            | Self::Narrow { bytes } => bytes,
            Self::Wide { chars, .. } => 4 * chars,
            Self::Object => 8,
        }
    }

    pub(super) fn is_text(self) -> bool {
        matches!(self, Self::Wide { .. } | Self::Narrow { .. })
    }

    /// Decodes items whose total length was checked. Items of no width give no items.
    pub(super) fn decode(self, bytes: &[u8]) -> Data {
        let items = bytes.chunks_exact(self.item_bytes().max(1));
        match self {
            Self::Bool => Data::Numbers(items.map(|item| f64::from(u8::from(item[0] != 0))).collect()),
            Self::Signed { big, .. } => Data::Numbers(items.map(|item| signed(item, big) as f64).collect()),
            Self::Unsigned { big, .. } => Data::Numbers(items.map(|item| unsigned(item, big) as f64).collect()),
            Self::Float { bytes: 4, big } => {
                let value = |item: &[u8]| f32::from_bits(u32::try_from(unsigned(item, big)).unwrap_or(0));
                Data::Numbers(items.map(|item| f64::from(value(item))).collect())
            }
            Self::Float { big, .. } => Data::Numbers(items.map(|item| f64::from_bits(unsigned(item, big))).collect()),
            Self::Wide { big, .. } => Data::Texts(items.map(|item| wide(item, big)).collect()),
            Self::Narrow { .. } => {
                let text =
                    |item: &[u8]| item.iter().take_while(|byte| **byte != 0).map(|byte| char::from(*byte)).collect();
                Data::Texts(items.map(text).collect())
            }
            Self::Object => Data::Objects(Vec::new()),
        }
    }
}

fn unsigned(item: &[u8], big: bool) -> u64 {
    let fold = |value: u64, byte: &u8| (value << 8) | u64::from(*byte);
    if big { item.iter().fold(0, fold) } else { item.iter().rev().fold(0, fold) }
}

fn signed(item: &[u8], big: bool) -> i64 {
    let shift = 64 - 8 * u32::try_from(item.len()).unwrap_or(8);
    (unsigned(item, big) << shift).cast_signed() >> shift
}

fn wide(item: &[u8], big: bool) -> String {
    let code = |chars: &[u8]| u32::try_from(unsigned(chars, big)).unwrap_or(0);
    item.chunks_exact(4).map(code).take_while(|code| *code != 0).filter_map(char::from_u32).collect()
}

impl Array {
    /// Turns items given in column-major order into row-major order.
    pub(super) fn reorder_by_rows(&mut self) {
        let (shape, count) = (self.shape.clone(), self.shape.iter().product::<usize>());
        let source = |mut row_major: usize| {
            let mut index = vec![0; shape.len()];
            for axis in (0..shape.len()).rev() {
                index[axis] = row_major % shape[axis];
                row_major /= shape[axis];
            }
            (0..shape.len()).rev().fold(0, |at, axis| at * shape[axis] + index[axis])
        };
        match &mut self.data {
            Data::Numbers(numbers) => *numbers = (0..count).map(|i| numbers[source(i)]).collect(),
            Data::Texts(texts) => *texts = (0..count).map(|i| texts[source(i)].clone()).collect(),
            Data::Objects(_) => {}
        }
    }
}
