//! Image encodings: none and PNG are lossless (models and policies consume them), JPEG is for viewers.

use std::io::Cursor;

use image::codecs::{jpeg, png};
use image::{ExtendedColorType, ImageDecoder, ImageEncoder};

use crate::image::{ImageError, RgbImage};

/// How the rows of an image are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Encoding {
    /// Raw rows.
    #[default]
    None,
    /// PNG, lossless.
    Png,
    /// JPEG of quality 90, lossy: for viewers only.
    Jpeg,
}

impl RgbImage {
    /// Encodes the image.
    ///
    /// # Errors
    /// If the codec refuses it.
    pub fn encode(&self, encoding: Encoding) -> Result<Vec<u8>, ImageError> {
        let (w, h) = (self.width_px(), self.height_px());
        let mut bytes = Vec::new();
        let written = match encoding {
            Encoding::None => return Ok(self.rgb().to_vec()),
            Encoding::Png => {
                png::PngEncoder::new_with_quality(&mut bytes, png::CompressionType::Fast, png::FilterType::Sub)
                    .write_image(self.rgb(), w, h, ExtendedColorType::Rgb8)
            }
            Encoding::Jpeg => jpeg::JpegEncoder::new_with_quality(&mut bytes, 90).write_image(
                self.rgb(),
                w,
                h,
                ExtendedColorType::Rgb8,
            ),
        };
        written.map_err(ImageError::Encode)?;
        Ok(bytes)
    }

    /// Decodes an image whose size is known beforehand; sizes are compared before anything is allocated.
    ///
    /// # Errors
    /// If the size differs, is out of bounds, or the bytes are broken.
    pub fn decode(encoding: Encoding, width_px: u32, height_px: u32, bytes: &[u8]) -> Result<Self, ImageError> {
        match encoding {
            Encoding::None => {
                let expected = width_px as usize * height_px as usize * 3;
                if bytes.len() != expected {
                    return Err(ImageError::Length { expected, found: bytes.len() });
                }
                Self::new(width_px, height_px, bytes.to_vec())
            }
            Encoding::Png => {
                let decoder = png::PngDecoder::new(Cursor::new(bytes)).map_err(ImageError::Decode)?;
                read(decoder, width_px, height_px)
            }
            Encoding::Jpeg => {
                let decoder = jpeg::JpegDecoder::new(Cursor::new(bytes)).map_err(ImageError::Decode)?;
                read(decoder, width_px, height_px)
            }
        }
    }
}

fn read(decoder: impl ImageDecoder, width_px: u32, height_px: u32) -> Result<RgbImage, ImageError> {
    let found = decoder.dimensions();
    if found != (width_px, height_px) {
        return Err(ImageError::Mismatch { stated: (width_px, height_px), found });
    }
    let blank = RgbImage::new(width_px, height_px, Vec::new());
    if let Err(error @ ImageError::Side { .. }) = blank {
        return Err(error);
    }
    if decoder.color_type() != image::ColorType::Rgb8 {
        return Err(ImageError::Pixels { found: format!("{:?}", decoder.color_type()) });
    }
    let mut rgb = vec![0; width_px as usize * height_px as usize * 3];
    decoder.read_image(&mut rgb).map_err(ImageError::Decode)?;
    RgbImage::new(width_px, height_px, rgb)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lossless_encodings_give_the_same_pixels() {
        let rgb = (0..160 * 96 * 3).map(|i: u32| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let image = RgbImage::new(160, 96, rgb).expect("the size fits");
        for encoding in [Encoding::None, Encoding::Png] {
            let bytes = image.encode(encoding).expect("encodes");
            assert_eq!(RgbImage::decode(encoding, 160, 96, &bytes).expect("decodes"), image);
            assert!(RgbImage::decode(encoding, 96, 160, &bytes[..100]).is_err());
        }
    }

    #[test]
    fn a_wrong_size_is_refused_before_allocation() {
        let bytes = RgbImage::filled(8, 8, [1, 2, 3]).encode(Encoding::Png).expect("encodes");
        assert!(matches!(RgbImage::decode(Encoding::Png, 9, 8, &bytes), Err(ImageError::Mismatch { .. })));
        assert!(matches!(RgbImage::new(1 << 20, 1 << 20, vec![]), Err(ImageError::Side { .. })));
    }
}
