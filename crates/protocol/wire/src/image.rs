//! Images, and the two topics that are one: `layout` and `frame`. Lossless only; sizes are bounded before decoding.

use bytes::Bytes;
use ds_raster::{Encoding, RgbImage};
use ds_topic::{Frame, Layout};

use crate::error::FieldError;
use crate::field::{checked, enumeration, extent, part};
use crate::v1;

/// The most pixels of one image: as many as fit the message limit raw.
pub const MAX_PIXELS: u64 = 10 << 20;

enumeration!(v1::Encoding, Encoding, { None = None, Png = Png, Jpeg = Jpeg });

/// Writes an image.
pub(crate) fn to_message(image: &RgbImage, encoding: Encoding) -> v1::Image {
    let data = image.encode(encoding).expect("an image within its size limits can be written to memory");
    v1::Image {
        width_px: image.width_px(),
        height_px: image.height_px(),
        encoding: v1::Encoding::from(encoding).into(),
        data: Bytes::from(data),
    }
}

/// An image and how it travelled.
pub(crate) struct Lossless(pub(crate) RgbImage, pub(crate) Encoding);

impl TryFrom<v1::Image> for Lossless {
    type Error = FieldError;
    fn try_from(message: v1::Image) -> Result<Self, FieldError> {
        let encoding = crate::field::choice::<v1::Encoding, Encoding>("encoding", message.encoding)?;
        if encoding == Encoding::Jpeg {
            return Err(FieldError::new("encoding", "is JPEG, which is lossy"));
        }
        pixels(message.width_px, message.height_px)?;
        let image = RgbImage::decode(encoding, message.width_px, message.height_px, &message.data);
        Ok(Self(checked("data", image)?, encoding))
    }
}

/// Returns the number of pixels of an image, refused above [`MAX_PIXELS`].
pub(crate) fn pixels(width_px: u32, height_px: u32) -> Result<u64, FieldError> {
    let side = crate::geometry::MAX_SIDE_PX;
    crate::field::whole("width_px", width_px, 1, side)?;
    crate::field::whole("height_px", height_px, 1, side)?;
    let pixels = u64::from(width_px) * u64::from(height_px);
    if pixels > MAX_PIXELS {
        let problem = format!("is {height_px} at width {width_px}, the limit is {MAX_PIXELS} pixels");
        return Err(FieldError::new("height_px", problem));
    }
    Ok(pixels)
}

impl From<&Layout> for v1::Layout {
    fn from(value: &Layout) -> Self {
        Self {
            header: None,
            image: Some(to_message(&value.image, value.encoding)),
            ego_in_world: Some((&value.ego_in_world).into()),
        }
    }
}

impl TryFrom<v1::Layout> for Layout {
    type Error = FieldError;
    fn try_from(message: v1::Layout) -> Result<Self, FieldError> {
        let Lossless(image, encoding) = part("image", message.image)?;
        Ok(Self { image, encoding, ego_in_world: part("ego_in_world", message.ego_in_world)? })
    }
}

impl From<&Frame> for v1::Frame {
    fn from(value: &Frame) -> Self {
        Self { header: None, image: Some(to_message(&value.image, value.encoding)), seam: Some(value.seam) }
    }
}

impl TryFrom<v1::Frame> for Frame {
    type Error = FieldError;
    fn try_from(message: v1::Frame) -> Result<Self, FieldError> {
        let Lossless(image, encoding) = part("image", message.image)?;
        Ok(Self { image, encoding, seam: extent("seam", message.seam)? })
    }
}
