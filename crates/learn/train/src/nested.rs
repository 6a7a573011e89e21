//! How a network begins with the weights of a smaller configuration: as a network within it.
//!
//! Of every weight that both have, each dimension's leading part takes the smaller one's values; dimensions that are
//! several things side by side (the six rows of a modulation, latent beside layout beside start latent, a frame beside
//! the one before) are taken thing by thing. What the smaller network computed it goes on computing from the same
//! inputs: in those rows the weights of inputs that it did not have are zero. Everything else stays as drawn: further rows,
//! further layers (whose drawn gain on the residual stream is small), weights that are missing, of another rank or
//! smaller here. Networks of equal shapes are copied. Attention heads stay whole where both have the same head width.

use ds_nn::{Array, Weights};

/// Copies the weights of a smaller network into a larger one.
pub(crate) fn copy(into: &mut Weights, from: &Weights) {
    let larger = Sizes::of(into);
    let smaller = Sizes::of(from);
    for (name, array) in into.iter_mut() {
        let Some(other) = from.get(name).filter(|other| other.shape().len() == array.shape().len()) else { continue };
        let axes = (0..array.shape().len()).map(|axis| {
            let (large, small) = (array.shape()[axis], other.shape()[axis]);
            origins(&larger.parts(name, axis, large), &smaller.parts(name, axis, small))
        });
        if let Some(axes) = axes.collect::<Option<Vec<_>>>() {
            embed(array, other, &axes, name.ends_with(".weight"));
        }
    }
}

/// Sizes that say what stands side by side in a dimension; 0 where a network has no such layer.
struct Sizes {
    /// Channels of a latent.
    latent: usize,
    /// Widths of the decoder's second and third stage.
    widths: [usize; 2],
}

impl Sizes {
    fn of(weights: &Weights) -> Self {
        let side = |name: &str, axis: usize| weights.get(name).and_then(|array| array.shape().get(axis)).copied();
        Self {
            latent: side("head.head.bias", 0).unwrap_or(0) / 4,
            widths: [side("decoder.stage.1.grow.weight", 1), side("decoder.head.weight", 3)]
                .map(Option::unwrap_or_default),
        }
    }

    /// Returns the lengths of what stands side by side in a dimension of `length`.
    fn parts(&self, name: &str, axis: usize, length: usize) -> Vec<usize> {
        let equal = |count: usize| vec![length / count.max(1); count.max(1)];
        let grown = |width: usize| length.checked_div(width).map_or_else(|| vec![length], equal);
        match (name, axis) {
            ("time_projection.1.weight" | "time_projection.1.bias", 0) => equal(6),
            ("head.head.weight" | "head.head.bias", 0)
            | ("img_emb.proj.1.weight" | "encoder.stage.1.fold.weight" | "encoder.stage.2.fold.weight", 1) => equal(4),
            ("patch_embedding.weight", 1) if length > 2 * self.latent => {
                vec![self.latent, length - 2 * self.latent, self.latent]
            }
            ("decoder.stage.0.grow.weight" | "decoder.stage.0.grow.bias", 0) => grown(self.widths[0]),
            ("decoder.stage.1.grow.weight" | "decoder.stage.1.grow.bias", 0) => grown(self.widths[1]),
            (name, 3) if name.starts_with("decoder.guide.") && length > self.widths[1] => {
                vec![self.widths[1], length - self.widths[1]]
            }
            (name, 3) if name.ends_with(".conv.0.weight") => equal(2),
            _ => vec![length],
        }
    }
}

/// Returns for each index of the larger dimension the one of the smaller that it takes; none if a part does not fit.
fn origins(large: &[usize], small: &[usize]) -> Option<Vec<Option<usize>>> {
    let fits = large.len() == small.len() && large.iter().zip(small).all(|(large, small)| small <= large);
    let mut at = 0;
    let mut part = |(large, small): (&usize, &usize)| {
        let from = at;
        at += small;
        let small = *small;
        (0..*large).map(move |index| (index < small).then_some(from + index)).collect::<Vec<_>>()
    };
    fits.then(|| large.iter().zip(small).flat_map(&mut part).collect())
}

/// Writes the smaller array where every index has an origin, and zeros where only that of the row (the output) has one.
fn embed(array: &mut Array, from: &Array, axes: &[Vec<Option<usize>>], matrix: bool) {
    let shape = array.shape().to_vec();
    let matrix = matrix && shape.len() > 1;
    for (index, value) in array.values_mut().iter_mut().enumerate() {
        let (mut rest, mut step, mut origin) = (index, 1, Some(0));
        let mut row = None;
        for axis in (0..shape.len()).rev() {
            row = axes[axis][rest % shape[axis]];
            origin = origin.zip(row).map(|(origin, at)| origin + at * step);
            step *= from.shape()[axis];
            rest /= shape[axis];
        }
        match origin {
            Some(origin) => *value = from.values()[origin],
            None if matrix && row.is_some() => *value = 0.0,
            None => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn array(shape: &[usize], first: usize) -> Array {
        #[expect(clippy::cast_precision_loss, reason = "small numbers")]
        let values = (0..shape.iter().product()).map(|index: usize| (first + index) as f32).collect();
        Array::new(shape, values)
    }

    /// Copies one weight, beside others that give the sizes.
    fn check(name: &str, large: &[usize], small: &[usize], sizes: [&[(&str, &[usize])]; 2], expected: &[f32]) {
        let network = |shape: &[usize], first: usize, sizes: &[(&str, &[usize])]| {
            let mut weights = Weights::default();
            sizes.iter().for_each(|(name, shape)| weights.insert(name, array(shape, 0)));
            weights.insert(name, array(shape, first));
            weights
        };
        let (mut into, from) = (network(large, 100, sizes[0]), network(small, 1, sizes[1]));
        copy(&mut into, &from);
        assert_eq!(into.get(name).expect("inserted").values(), expected, "{name}");
    }

    #[test]
    fn the_leading_block_is_taken_and_its_rows_see_nothing_new() {
        let none: [&[(&str, &[usize])]; 2] = [&[], &[]];
        check("a.weight", &[3, 3], &[2, 2], none, &[1.0, 2.0, 0.0, 3.0, 4.0, 0.0, 106.0, 107.0, 108.0]);
        check("a.bias", &[3], &[2], none, &[1.0, 2.0, 102.0]);
        check("blocks.0.modulation", &[1, 2, 2], &[1, 2, 1], none, &[1.0, 101.0, 2.0, 103.0]);
        check("a.weight", &[2, 2], &[2, 2], none, &[1.0, 2.0, 3.0, 4.0]);
        // Smaller here than there, or of another rank: as drawn.
        check("a.weight", &[2, 1], &[1, 2], none, &[100.0, 101.0]);
        check("a.weight", &[2], &[1, 2], none, &[100.0, 101.0]);
    }

    #[test]
    fn what_stands_side_by_side_is_taken_thing_by_thing() {
        let none: [&[(&str, &[usize])]; 2] = [&[], &[]];
        let rows: Vec<f32> = (0u8..6).flat_map(|row| [1.0 + f32::from(row), 101.0 + 2.0 * f32::from(row)]).collect();
        check("time_projection.1.bias", &[12], &[6], none, &rows);
        // A frame of one channel beside the one before, within frames of two channels.
        let block = [1.0, 0.0, 2.0, 0.0, 104.0, 105.0, 106.0, 107.0];
        check("encoder.block.0.conv.0.weight", &[2, 1, 1, 4], &[1, 1, 1, 2], none, &block);
        // One latent channel, two of the layout, one of the start latent, within one, three, one.
        let head: [&[(&str, &[usize])]; 2] = [&[("head.head.bias", &[4])], &[("head.head.bias", &[4])]];
        check("patch_embedding.weight", &[1, 5], &[1, 4], head, &[1.0, 2.0, 3.0, 0.0, 4.0]);
        let widths: [&[(&str, &[usize])]; 2] =
            [&[("decoder.head.weight", &[1, 1, 1, 2])], &[("decoder.head.weight", &[1, 1, 1, 1])]];
        check("decoder.stage.1.grow.bias", &[4], &[2], widths, &[1.0, 101.0, 2.0, 103.0]);
        check("decoder.guide.0.weight", &[1, 1, 1, 4], &[1, 1, 1, 3], widths, &[1.0, 0.0, 2.0, 3.0]);
    }
}
