//! Between images and pixel values of −1 to 1, as networks take them: bytes 0 to 255, row by row, colours last.

use crate::image::RgbImage;

impl RgbImage {
    /// Returns the pixel values, −1 to 1.
    pub fn values(&self) -> impl Iterator<Item = f32> {
        self.rgb().iter().map(|byte| value(*byte))
    }

    /// Turns [height, width, 3] values, −1 to 1, into an image; values beyond are clamped.
    ///
    /// # Panics
    /// If the number of values does not fit the sides.
    #[must_use]
    pub fn of_values(values: &[f32], width_px: u32, height_px: u32) -> Self {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the range of a byte")]
        let byte = |value: &f32| ((value + 1.0) * 127.5).round().clamp(0.0, 255.0) as u8;
        Self::new(width_px, height_px, values.iter().map(byte).collect()).expect("one value for each byte of the sides")
    }
}

/// Returns the value of a byte, −1 to 1.
#[must_use]
#[inline]
pub fn value(byte: u8) -> f32 {
    f32::from(byte) * (1.0 / 127.5) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_and_images_are_inverse() {
        let rgb = (0u32..16 * 8 * 3).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let image = RgbImage::new(16, 8, rgb).expect("the size fits");
        assert_eq!(RgbImage::of_values(&image.values().collect::<Vec<_>>(), 16, 8), image);
        assert_eq!([value(0), value(255)], [-1.0, 1.0]);
    }
}
