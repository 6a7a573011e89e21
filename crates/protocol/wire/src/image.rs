//! Images, and the two topics that are one: `layout` and `frame`. Lossless only; sizes are bounded before decoding.

use bytes::Bytes;
use ds_raster::{Encoding, Mover, RgbImage, geometry};
use ds_topic::{Frame, Layout, LayoutGeometry};
use ds_world::Size;

use crate::error::FieldError;
use crate::field::{checked, enumeration, extent, list, number, part};
use crate::v1;
use crate::world::MAX_AGENTS;

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
            geometry: value.geometry.as_ref().map(Into::into),
        }
    }
}

impl TryFrom<v1::Layout> for Layout {
    type Error = FieldError;
    fn try_from(message: v1::Layout) -> Result<Self, FieldError> {
        let Lossless(image, encoding) = part("image", message.image)?;
        let told = |told| part::<_, LayoutGeometry>("geometry", Some(told));
        let geometry = message.geometry.map(told).transpose()?;
        let pixels = image.width_px() as usize * image.height_px() as usize;
        if let Some(count) = geometry.as_ref().map(|told| told.inverse_depths.len()).filter(|count| *count != pixels) {
            return Err(FieldError::new(
                "geometry.inverse_depths",
                format!("are {count}, the picture has {pixels} pixels"),
            ));
        }
        Ok(Self { image, encoding, ego_in_world: part("ego_in_world", message.ego_in_world)?, geometry })
    }
}

impl From<&LayoutGeometry> for v1::LayoutGeometry {
    fn from(value: &LayoutGeometry) -> Self {
        let inverse_depths = geometry::bytes_of_depths(&value.inverse_depths).into();
        Self { inverse_depths, movers: value.movers.iter().map(Into::into).collect() }
    }
}

impl TryFrom<v1::LayoutGeometry> for LayoutGeometry {
    type Error = FieldError;
    fn try_from(message: v1::LayoutGeometry) -> Result<Self, FieldError> {
        let odd = || FieldError::new("inverse_depths", "has an odd number of bytes");
        let inverse_depths = geometry::depths_of_bytes(&message.inverse_depths).ok_or_else(odd)?;
        Ok(Self { inverse_depths, movers: list("movers", message.movers, MAX_AGENTS)? })
    }
}

impl From<&Mover> for v1::Mover {
    fn from(value: &Mover) -> Self {
        let [length_m, width_m, height_m] = value.size_m;
        let size = Size { length_m, width_m, height_m };
        Self { id: value.id, pose: Some((&value.pose).into()), z_m: Some(value.bottom_m), size: Some((&size).into()) }
    }
}

impl TryFrom<v1::Mover> for Mover {
    type Error = FieldError;
    fn try_from(message: v1::Mover) -> Result<Self, FieldError> {
        let Size { length_m, width_m, height_m } = part("size", message.size)?;
        Ok(Self {
            id: message.id,
            pose: part("pose", message.pose)?,
            bottom_m: number("z_m", message.z_m)?,
            size_m: [length_m, width_m, height_m],
        })
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
