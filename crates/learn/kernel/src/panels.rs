//! Matrices packed into panels of 48, 32 or 16 columns, in the order in which the kernel reads them.
//!
//! Column counts are rounded up to 16; a rest of 16 beyond full panels of 48 is joined to make two panels of 32, as
//! narrow panels starve the kernel.

use crate::Buffer;

/// Columns of the narrowest panel.
pub(crate) const UNIT: usize = 16;

/// Returns a number of columns rounded up to whole units.
pub(crate) fn padded(columns: usize) -> usize {
    columns.next_multiple_of(UNIT)
}

/// A run of columns that lie together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Panel {
    /// First column.
    pub(crate) first: usize,
    /// Columns, padding included.
    pub(crate) width: usize,
}

/// Lists the panels of a number of columns.
pub(crate) fn panels(columns: usize) -> impl Iterator<Item = Panel> + Clone {
    let units = columns.div_ceil(UNIT);
    let (wide, rest) = (units / 3, units % 3);
    // 3k + 1 = 3·(k − 1) + 2 + 2.
    let (wide, middle, narrow) = match rest {
        1 if wide > 0 => (wide - 1, 2, 0),
        1 => (0, 0, 1),
        2 => (wide, 1, 0),
        _ => (wide, 0, 0),
    };
    let panel = move |index: usize| {
        if index < wide {
            Panel { first: 48 * index, width: 48 }
        } else if index < wide + middle {
            Panel { first: 48 * wide + 32 * (index - wide), width: 32 }
        } else {
            Panel { first: 48 * wide + 32 * middle, width: 16 }
        }
    };
    (0..wide + middle + narrow).map(panel)
}

/// A matrix [depth, columns] in panels, with a bias per column.
pub(crate) struct Packed {
    /// Length of the rows that it is multiplied with.
    pub(crate) depth: usize,
    /// Columns, without padding.
    pub(crate) columns: usize,
    data: Buffer,
    /// One value per column, zeros where there is none, padded.
    pub(crate) bias: Buffer,
}

impl Packed {
    /// Packs the matrix whose value at (k, column) a function tells.
    pub(crate) fn new(depth: usize, columns: usize, bias: Option<&[f32]>, value: impl Fn(usize, usize) -> f32) -> Self {
        let mut data = Buffer::zeros(depth * padded(columns));
        for panel in panels(columns) {
            let lines = data[panel.first * depth..(panel.first + panel.width) * depth].chunks_exact_mut(panel.width);
            for (k, line) in lines.enumerate() {
                for (column, slot) in (panel.first..columns).zip(line) {
                    *slot = value(k, column);
                }
            }
        }
        let mut padded_bias = Buffer::zeros(padded(columns));
        if let Some(bias) = bias {
            padded_bias[..columns].copy_from_slice(bias);
        }
        Self { depth, columns, data, bias: padded_bias }
    }

    /// Packs a linear layer's weight, stored as [columns, depth].
    pub(crate) fn linear(weight: &[f32], bias: Option<&[f32]>, depth: usize) -> Self {
        Self::new(depth, weight.len() / depth, bias, |k, column| weight[column * depth + k])
    }

    /// Returns the values of a panel, line by line.
    pub(crate) fn values(&self, panel: Panel) -> &[f32] {
        &self.data[panel.first * self.depth..(panel.first + panel.width) * self.depth]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(columns: usize, expected: &[usize]) {
        let found: Vec<Panel> = panels(columns).collect();
        assert_eq!(found.iter().map(|panel| panel.width).collect::<Vec<_>>(), expected, "{columns} columns");
        let mut next = 0;
        for panel in found {
            assert_eq!(panel.first, next);
            next += panel.width;
        }
        assert_eq!(next, padded(columns));
    }

    #[test]
    fn columns_fall_into_panels() {
        check(0, &[]);
        check(12, &[16]);
        check(32, &[32]);
        check(48, &[48]);
        check(60, &[32, 32]);
        check(72, &[48, 32]);
        check(97, &[48, 32, 32]);
        check(768, &[48; 16]);
        check(256, &[48, 48, 48, 48, 32, 32]);
    }

    #[test]
    fn packing_keeps_every_value() {
        let packed = Packed::new(5, 60, None, |k, column| (100 * k + column) as f32);
        for panel in panels(60) {
            for (k, line) in packed.values(panel).chunks_exact(panel.width).enumerate() {
                for (column, value) in (panel.first..60).zip(line) {
                    assert_eq!(*value, (100 * k + column) as f32);
                }
            }
        }
    }
}
