//! What backward passes do with whole images: fill them, fold pixels into channels and back, and take the slope of a relu.

use crate::Buffer;
use crate::image::Image;

/// Returns an image of zeros.
pub(super) fn sized(size: [usize; 4]) -> Image {
    let mut image = Image::default();
    image.reset(size);
    image
}

/// Returns an image of values [frames, h, w, c].
pub(super) fn filled(size: [usize; 4], values: &[f32]) -> Image {
    let mut image = sized(size);
    image.fill(values);
    image
}

/// Adds values one by one.
pub(super) fn add(to: &mut [f32], values: &[f32]) {
    to.iter_mut().zip(values).for_each(|(to, value)| *to += value);
}

/// The backward pass of relu, from its output.
pub(super) fn where_positive(d: &mut Image, out: &Image) {
    d.values_mut().iter_mut().zip(out.values()).for_each(|(d, out)| *d = if *out > 0.0 { *d } else { 0.0 });
}

/// Unfolds channels (frame, row, column, channel) of pixels of `small`'s size into an image twice as large.
pub(super) fn shuffled(values: &[f32], small: &Image, frames: usize) -> Image {
    let (h, w) = (small.h, small.w);
    let c = values.len() / (small.frames * h * w * frames * 4);
    let mut out = sized([small.frames * frames, 2 * h, 2 * w, c]);
    out.each_row(|frame, y, row| {
        let line = &values[(frame / frames * h + y / 2) * w * frames * 4 * c..];
        let part = (frame % frames * 2 + y % 2) * 2 * c;
        for (to, from) in row[c..].chunks_exact_mut(2 * c).zip(line.chunks_exact(frames * 4 * c)).take(w) {
            to.copy_from_slice(&from[part..part + 2 * c]);
        }
    });
    out
}

/// Folds values [frames, 2h, 2w, c] into the pixels of `small`'s size: the inverse of [`shuffled`].
pub(super) fn unshuffled(values: &[f32], small: &Image, frames: usize) -> Buffer {
    let (h, w) = (small.h, small.w);
    let c = values.len() / (small.frames * h * w * frames * 4);
    let mut out = Buffer::zeros(values.len());
    for (index, line) in values.chunks_exact(2 * w * c).enumerate() {
        let (frame, y) = (index / (2 * h), index % (2 * h));
        let at = (frame / frames * h + y / 2) * w * frames * 4 * c;
        let part = (frame % frames * 2 + y % 2) * 2 * c;
        for (to, from) in out[at..].chunks_exact_mut(frames * 4 * c).zip(line.chunks_exact(2 * c)) {
            to[part..part + 2 * c].copy_from_slice(from);
        }
    }
    out
}

/// Puts the channels of values [frames, h, w, c] behind those of an image.
pub(super) fn beside(image: &Image, values: &[f32]) -> Image {
    let c = values.len() / (image.frames * image.h * image.w);
    let pixels = image.dense();
    let both = pixels.chunks_exact(image.c).zip(values.chunks_exact(c)).flat_map(|(a, b)| a.iter().chain(b));
    filled([image.frames, image.h, image.w, image.c + c], &both.copied().collect::<Vec<f32>>())
}

/// Returns the first channels of an image.
pub(super) fn leading(image: &Image, c: usize) -> Image {
    let values: Vec<f32> = image.dense().chunks_exact(image.c).flat_map(|pixel| &pixel[..c]).copied().collect();
    filled([image.frames, image.h, image.w, c], &values)
}

/// Folds blocks of two by two pixels into channels.
pub(super) fn folded(image: &Image) -> Image {
    let small = sized([image.frames, image.h / 2, image.w / 2, 4 * image.c]);
    filled(small.size(), &unshuffled(&image.dense(), &small, 1))
}

/// The inverse of [`folded`].
pub(super) fn unfolded(image: &Image) -> Image {
    shuffled(&image.dense(), image, 1)
}

/// Returns an image of the same values.
pub(super) fn copied(image: &Image) -> Image {
    filled(image.size(), &image.dense())
}
