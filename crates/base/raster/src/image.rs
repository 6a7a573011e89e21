//! An 8-bit RGB image.

use ds_space::DigestWriter;

/// The largest accepted image side, in pixels.
pub const MAX_SIDE_PX: u32 = 8_192;

/// Says why an image is refused.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// A side is 0 or too large.
    #[error("image of {width_px}×{height_px} px: each side must be 1 to {MAX_SIDE_PX}")]
    Side {
        /// Width.
        width_px: u32,
        /// Height.
        height_px: u32,
    },
    /// The number of bytes does not fit the sides.
    #[error("image rows hold {found} bytes, {expected} expected")]
    Length {
        /// Bytes that the sides ask for.
        expected: usize,
        /// Bytes that came.
        found: usize,
    },
    /// The stated size is not the one inside the encoded bytes.
    #[error("image says {stated:?} px, its encoded bytes hold {found:?} px")]
    Mismatch {
        /// What the message states.
        stated: (u32, u32),
        /// What the bytes hold.
        found: (u32, u32),
    },
    /// The pixels are not 8-bit RGB.
    #[error("image pixels are {found}, 8-bit RGB expected")]
    Pixels {
        /// What was found.
        found: String,
    },
    /// The encoded bytes are broken.
    #[error("image bytes cannot be decoded")]
    Decode(#[source] ::image::ImageError),
    /// The image cannot be encoded.
    #[error("image cannot be encoded")]
    Encode(#[source] ::image::ImageError),
}

/// An 8-bit RGB image in sRGB, rows top to bottom, without padding.
#[derive(Clone, PartialEq, Eq)]
pub struct RgbImage {
    width_px: u32,
    height_px: u32,
    rgb: Vec<u8>,
}

impl RgbImage {
    /// Wraps raw rows.
    ///
    /// # Errors
    /// If a side is 0 or over [`MAX_SIDE_PX`], or the length is not width × height × 3.
    pub fn new(width_px: u32, height_px: u32, rgb: Vec<u8>) -> Result<Self, ImageError> {
        if width_px == 0 || height_px == 0 || width_px > MAX_SIDE_PX || height_px > MAX_SIDE_PX {
            return Err(ImageError::Side { width_px, height_px });
        }
        let expected = width_px as usize * height_px as usize * 3;
        if rgb.len() != expected {
            return Err(ImageError::Length { expected, found: rgb.len() });
        }
        Ok(Self { width_px, height_px, rgb })
    }

    /// Makes an image of one colour; sides are clamped to 1..=[`MAX_SIDE_PX`].
    #[must_use]
    pub fn filled(width_px: u32, height_px: u32, colour: [u8; 3]) -> Self {
        let (width_px, height_px) = (width_px.clamp(1, MAX_SIDE_PX), height_px.clamp(1, MAX_SIDE_PX));
        Self { width_px, height_px, rgb: colour.repeat(width_px as usize * height_px as usize) }
    }

    /// Returns the width, in pixels.
    #[must_use]
    pub fn width_px(&self) -> u32 {
        self.width_px
    }

    /// Returns the height, in pixels.
    #[must_use]
    pub fn height_px(&self) -> u32 {
        self.height_px
    }

    /// Returns the rows, three bytes a pixel.
    #[must_use]
    pub fn rgb(&self) -> &[u8] {
        &self.rgb
    }

    /// Returns the rows for writing.
    pub fn rgb_mut(&mut self) -> &mut [u8] {
        &mut self.rgb
    }

    /// Returns the colour of a pixel.
    ///
    /// # Panics
    /// If the pixel lies outside.
    #[must_use]
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        let at = (y as usize * self.width_px as usize + x as usize) * 3;
        [self.rgb[at], self.rgb[at + 1], self.rgb[at + 2]]
    }

    /// Sets the colour of a pixel.
    ///
    /// # Panics
    /// If the pixel lies outside.
    pub fn set_pixel(&mut self, x: u32, y: u32, colour: [u8; 3]) {
        let at = (y as usize * self.width_px as usize + x as usize) * 3;
        self.rgb[at..at + 3].copy_from_slice(&colour);
    }

    /// Adds width, height and rows to a digest.
    pub fn digest_into(&self, writer: &mut DigestWriter) {
        writer.u32(self.width_px).u32(self.height_px).raw(&self.rgb);
    }
}

impl std::fmt::Debug for RgbImage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "RgbImage({}×{})", self.width_px, self.height_px)
    }
}
