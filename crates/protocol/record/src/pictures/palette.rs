//! A palette of at most 255 colours for a whole animation, by median cut over a 15-bit histogram.
//!
//! The box with the most pixels times extent is cut at its median until the palette is full. Colours are looked up in a
//! table over all 32,768 cells. Everything is counted in integers, so the same pixels give the same palette.

use ds_raster::RgbImage;

const CELLS: usize = 1 << 15;
/// The most colours; one index stays free for "unchanged".
pub const MAX_COLOURS: usize = 255;

/// Counts the colours of images.
pub struct Histogram {
    counts: Vec<u64>,
}

/// A palette and the index of every 15-bit colour in it.
pub struct Palette {
    colours: Vec<[u8; 3]>,
    index_of_cell: Vec<u8>,
}

impl Default for Histogram {
    fn default() -> Self {
        Self { counts: vec![0; CELLS] }
    }
}

impl Histogram {
    /// Counts the pixels of an image.
    pub fn add(&mut self, image: &RgbImage) {
        for pixel in image.rgb().chunks_exact(3) {
            self.counts[cell(pixel)] += 1;
        }
    }

    /// Chooses the palette.
    #[must_use]
    pub fn palette(&self) -> Palette {
        let all: Vec<usize> = (0..CELLS).filter(|cell| self.counts[*cell] > 0).collect();
        let mut boxes = vec![all];
        while boxes.len() < MAX_COLOURS {
            let weights = boxes.iter().map(|cells| self.weight(cells));
            let Some((heaviest, weight)) =
                weights.enumerate().max_by_key(|(index, weight)| (*weight, usize::MAX - index))
            else {
                break;
            };
            if weight == 0 {
                break;
            }
            let (lower, upper) = self.cut(boxes.swap_remove(heaviest));
            boxes.extend([lower, upper]);
        }
        let colours: Vec<[u8; 3]> =
            boxes.iter().filter(|cells| !cells.is_empty()).map(|cells| self.mean(cells)).collect();
        let index_of_cell = (0..CELLS).map(|cell| nearest(&colours, colour(cell))).collect();
        Palette { colours, index_of_cell }
    }

    /// Pixels times extent, with a square root on the pixels so that large even areas do not take all colours.
    fn weight(&self, cells: &[usize]) -> u64 {
        let (_, extent) = widest(cells);
        self.pixels(cells).isqrt() * u64::from(extent)
    }

    fn pixels(&self, cells: &[usize]) -> u64 {
        cells.iter().map(|cell| self.counts[*cell]).sum()
    }

    fn cut(&self, mut cells: Vec<usize>) -> (Vec<usize>, Vec<usize>) {
        let (axis, _) = widest(&cells);
        cells.sort_by_key(|cell| (colour(*cell)[axis], *cell));
        let half = self.pixels(&cells).div_ceil(2);
        let mut seen = 0;
        let median = cells.iter().position(|cell| {
            seen += self.counts[*cell];
            seen >= half
        });
        let at = median.map_or(1, |index| index + 1).clamp(1, cells.len() - 1);
        let upper = cells.split_off(at);
        (cells, upper)
    }

    fn mean(&self, cells: &[usize]) -> [u8; 3] {
        let total = self.pixels(cells).max(1);
        [0, 1, 2].map(|axis| {
            let sum: u64 = cells.iter().map(|cell| u64::from(colour(*cell)[axis]) * self.counts[*cell]).sum();
            ((sum + total / 2) / total) as u8
        })
    }
}

impl Palette {
    /// Returns red, green and blue of each colour in turn.
    #[must_use]
    pub fn rgb(&self) -> Vec<u8> {
        self.colours.concat()
    }

    /// Returns how many colours there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.colours.len()
    }

    /// Says whether there are no colours.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.colours.is_empty()
    }

    /// Returns the index of each pixel's colour.
    #[must_use]
    pub fn indices(&self, image: &RgbImage) -> Vec<u8> {
        image.rgb().chunks_exact(3).map(|pixel| self.index_of_cell[cell(pixel)]).collect()
    }
}

fn cell(pixel: &[u8]) -> usize {
    usize::from(pixel[0] >> 3) << 10 | usize::from(pixel[1] >> 3) << 5 | usize::from(pixel[2] >> 3)
}

/// Returns the colour at the middle of a cell.
fn colour(cell: usize) -> [u8; 3] {
    [cell >> 10, cell >> 5, cell].map(|value| ((value & 31) << 3 | 4) as u8)
}

/// Returns the axis along which the cells spread farthest, and how far; green counts more, as the eye does.
fn widest(cells: &[usize]) -> (usize, u32) {
    let spread = |axis: usize| {
        let values = cells.iter().map(|cell| u32::from(colour(*cell)[axis]));
        let (least, most) = values.fold((u32::MAX, 0), |(least, most), value| (least.min(value), most.max(value)));
        most.saturating_sub(least) * [3, 4, 2][axis]
    };
    let spreads = [spread(0), spread(1), spread(2)];
    let axis = (0..3).max_by_key(|axis| (spreads[*axis], 3 - axis)).unwrap_or(0);
    (axis, spreads[axis])
}

fn nearest(colours: &[[u8; 3]], wanted: [u8; 3]) -> u8 {
    let distance = |colour: &[u8; 3]| -> i32 {
        let part = |axis: usize| (i32::from(colour[axis]) - i32::from(wanted[axis])).pow(2) * [3, 4, 2][axis];
        part(0) + part(1) + part(2)
    };
    let found = (0u8..=255).zip(colours).min_by_key(|(index, colour)| (distance(colour), *index));
    found.map_or(0, |(index, _)| index)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn few_colours_are_kept_apart() {
        let pixels = [[255u8, 0, 0], [0, 255, 0], [0, 0, 255], [20, 20, 20]];
        let image = RgbImage::new(4, 1, pixels.concat()).expect("the size fits");
        let mut histogram = Histogram::default();
        histogram.add(&image);
        let palette = histogram.palette();
        let mut indices = palette.indices(&image);
        for (pixel, index) in pixels.iter().zip(&indices) {
            let chosen = palette.colours[usize::from(*index)];
            assert!(pixel.iter().zip(chosen).all(|(a, b)| a.abs_diff(b) <= 4), "{pixel:?} became {chosen:?}");
        }
        indices.sort_unstable();
        assert_eq!(indices, [0, 1, 2, 3]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(8))]

        #[test]
        fn noise_fits_the_palette_with_a_small_error(seed in 0u32..1000) {
            let rgb = (0..64 * 64 * 3).map(|i: u32| (i.wrapping_mul(2_654_435_761).wrapping_add(seed) >> 21) as u8).collect();
            let image = RgbImage::new(64, 64, rgb).expect("the size fits");
            let mut histogram = Histogram::default();
            histogram.add(&image);
            let palette = histogram.palette();
            prop_assert!(palette.len() <= MAX_COLOURS);
            let indices = palette.indices(&image);
            let error: u64 = image.rgb().chunks_exact(3).zip(&indices).map(|(pixel, index)| {
                let chosen = palette.colours[usize::from(*index)];
                pixel.iter().zip(chosen).map(|(a, b)| u64::from(a.abs_diff(b))).sum::<u64>()
            }).sum();
            prop_assert!(error / (64 * 64 * 3) < 24, "mean error {}", error / (64 * 64 * 3));
        }
    }
}
