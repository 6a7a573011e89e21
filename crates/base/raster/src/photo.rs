//! Photographs: PNG or JPEG files of a size that only the file knows; pictures at the size of a model.

use std::io::Cursor;
use std::ops::Range;

use image::codecs::{jpeg, png};
use image::{DynamicImage, ImageDecoder};

use crate::image::{ImageError, MAX_SIDE_PX, RgbImage};

impl RgbImage {
    /// Decodes a PNG or JPEG of any colour type; its size is checked before anything is allocated.
    ///
    /// # Errors
    /// If a side is out of bounds or the bytes are broken.
    pub fn photo(bytes: &[u8]) -> Result<Self, ImageError> {
        if bytes.starts_with(b"\x89PNG") {
            developed(png::PngDecoder::new(Cursor::new(bytes)).map_err(ImageError::Decode)?)
        } else {
            developed(jpeg::JpegDecoder::new(Cursor::new(bytes)).map_err(ImageError::Decode)?)
        }
    }

    /// Returns a part of the picture, cut off at its sides.
    #[must_use]
    pub fn part(&self, [left_px, top_px]: [u32; 2], [width_px, height_px]: [u32; 2]) -> Self {
        let (left, top) = (left_px.min(self.width_px() - 1), top_px.min(self.height_px() - 1));
        let width = width_px.clamp(1, self.width_px() - left);
        let height = height_px.clamp(1, self.height_px() - top);
        let mut part = Self::filled(width, height, [0; 3]);
        for y in 0..height {
            (0..width).for_each(|x| part.set_pixel(x, y, self.pixel(left + x, top + y)));
        }
        part
    }

    /// Returns the picture at another size, each pixel the mean of all it covers, edges included on both sides.
    #[must_use]
    pub fn reduced(&self, width_px: u32, height_px: u32) -> Self {
        self.averaged(width_px, height_px, |i, from, to| {
            let low = edge(i, from, to);
            let high = ((u64::from(i) + 1) * u64::from(from)).div_ceil(u64::from(to)) as u32;
            low..high.max(low + 1).min(from)
        })
    }

    /// Returns the picture at another size, each source pixel counted once; the same size gives the same picture.
    #[must_use]
    pub fn resized(&self, width_px: u32, height_px: u32) -> Self {
        if (self.width_px(), self.height_px()) == (width_px, height_px) {
            return self.clone();
        }
        self.averaged(width_px, height_px, |i, from, to| {
            let low = edge(i, from, to);
            low..edge(i + 1, from, to).max(low + 1).min(from)
        })
    }

    /// Averages the rows and columns that `span` names for each pixel, sides scaled each by itself.
    fn averaged(&self, width_px: u32, height_px: u32, span: impl Fn(u32, u32, u32) -> Range<u32>) -> Self {
        let (width_px, height_px) = (width_px.clamp(1, MAX_SIDE_PX), height_px.clamp(1, MAX_SIDE_PX));
        let mut averaged = Self::filled(width_px, height_px, [0; 3]);
        for y in 0..height_px {
            let rows = span(y, self.height_px(), height_px);
            for x in 0..width_px {
                let columns = span(x, self.width_px(), width_px);
                let (mut sum, mut count) = ([0u32; 3], 0);
                for row in rows.clone() {
                    for column in columns.clone() {
                        let pixel = self.pixel(column, row);
                        (0..3).for_each(|c| sum[c] += u32::from(pixel[c]));
                        count += 1;
                    }
                }
                #[expect(clippy::cast_possible_truncation, reason = "a mean of bytes is a byte")]
                let mean = sum.map(|sum| ((sum + count / 2) / count.max(1)) as u8);
                averaged.set_pixel(x, y, mean);
            }
        }
        averaged
    }
}

/// Returns where a pixel of the new size begins in the old one.
fn edge(index: u32, from: u32, to: u32) -> u32 {
    (u64::from(index) * u64::from(from) / u64::from(to)) as u32
}

fn developed(decoder: impl ImageDecoder) -> Result<RgbImage, ImageError> {
    let (width_px, height_px) = decoder.dimensions();
    if width_px == 0 || height_px == 0 || width_px > MAX_SIDE_PX || height_px > MAX_SIDE_PX {
        return Err(ImageError::Side { width_px, height_px });
    }
    let picture = DynamicImage::from_decoder(decoder).map_err(ImageError::Decode)?;
    RgbImage::new(width_px, height_px, picture.into_rgb8().into_raw())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::Encoding;

    #[test]
    fn photographs_are_read_and_reduced_to_their_means() {
        let mut picture = RgbImage::filled(6, 4, [10, 20, 30]);
        (0..4).for_each(|y| (3..6).for_each(|x| picture.set_pixel(x, y, [110, 20, 30])));
        let png = picture.encode(Encoding::Png).expect("encodes");
        let read = RgbImage::photo(&png).expect("decodes");
        assert_eq!(read, picture);
        let small = read.reduced(2, 2);
        assert_eq!((small.pixel(0, 0), small.pixel(1, 1)), ([10, 20, 30], [110, 20, 30]));
        assert_eq!(read.reduced(1, 1).pixel(0, 0), [60, 20, 30]);
        let jpeg = picture.encode(Encoding::Jpeg).expect("encodes");
        assert_eq!(RgbImage::photo(&jpeg).expect("decodes").width_px(), 6);
        assert!(RgbImage::photo(&png[..40]).is_err() && RgbImage::photo(b"GIF89a").is_err());
    }

    #[test]
    fn resizing_keeps_flat_colour_and_identity() {
        let rgb = (0u32..20 * 10 * 3).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let image = RgbImage::new(20, 10, rgb).expect("the size fits");
        assert_eq!(image.resized(20, 10), image);
        let flat = RgbImage::filled(33, 7, [9, 8, 7]);
        assert_eq!(flat.resized(16, 8), RgbImage::filled(16, 8, [9, 8, 7]));
    }
}
