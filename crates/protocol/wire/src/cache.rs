//! Topic `cache`: tensors and digests of a committed chunk.

use ds_raster::Encoding;
use ds_space::Tick;
use ds_topic::Cache;
use ds_topic::body::Tensor;

use crate::error::FieldError;
use crate::field::{digest, part, whole};
use crate::image::{Lossless, to_message};
use crate::v1;

/// The most axes of a tensor.
pub const MAX_AXES: usize = 8;
/// The most elements of a tensor.
pub const MAX_ELEMENTS: usize = 4 << 20;

impl From<&Tensor> for v1::Tensor {
    fn from(value: &Tensor) -> Self {
        Self { shape: value.shape.clone(), values: value.values.clone() }
    }
}

impl TryFrom<v1::Tensor> for Tensor {
    type Error = FieldError;
    fn try_from(message: v1::Tensor) -> Result<Self, FieldError> {
        let v1::Tensor { shape, values } = message;
        if shape.len() > MAX_AXES {
            return Err(FieldError::new("shape", format!("has {} axes, the limit is {MAX_AXES}", shape.len())));
        }
        // No axes and no values is the empty tensor; otherwise the extents give the count.
        let count = if shape.is_empty() { 0 } else { product(&shape)? };
        if count != values.len() {
            return Err(FieldError::new(
                "values",
                format!("has {} elements, shape {shape:?} needs {count}", values.len()),
            ));
        }
        if let Some((index, value)) = values.iter().enumerate().find(|(_, value)| !value.is_finite()) {
            return Err(FieldError::new("", format!("is {value}")).within("values", index));
        }
        Ok(Self { shape, values })
    }
}

fn product(shape: &[u32]) -> Result<usize, FieldError> {
    let count = shape.iter().try_fold(1_usize, |product, extent| product.checked_mul(*extent as usize));
    count
        .filter(|count| *count <= MAX_ELEMENTS)
        .ok_or_else(|| FieldError::new("shape", format!("is {shape:?}, the limit is {MAX_ELEMENTS} elements")))
}

impl From<&Cache> for v1::Cache {
    fn from(value: &Cache) -> Self {
        let bytes = |digest: &ds_space::Digest| digest.0.to_vec().into();
        Self {
            header: None,
            chunk: value.chunk,
            first_tick: value.first.0,
            ticks: value.ticks,
            cached_input: Some((&value.cached_input).into()),
            clean: Some((&value.clean).into()),
            control: Some((&value.control).into()),
            conditioning: bytes(&value.conditioning),
            cache_digest: bytes(&value.cache_digest),
            encoder_digest: bytes(&value.encoder_digest),
            decoder_digest: bytes(&value.decoder_digest),
            frame: value.frame.as_ref().map(|frame| to_message(frame, Encoding::None)),
        }
    }
}

impl TryFrom<v1::Cache> for Cache {
    type Error = FieldError;
    fn try_from(message: v1::Cache) -> Result<Self, FieldError> {
        Ok(Self {
            chunk: message.chunk,
            first: Tick(message.first_tick),
            ticks: whole("ticks", message.ticks, 1, crate::scene::MAX_TICKS as u32)?,
            cached_input: part("cached_input", message.cached_input)?,
            clean: part("clean", message.clean)?,
            control: part("control", message.control)?,
            conditioning: digest("conditioning", &message.conditioning)?,
            cache_digest: digest("cache_digest", &message.cache_digest)?,
            encoder_digest: digest("encoder_digest", &message.encoder_digest)?,
            decoder_digest: digest("decoder_digest", &message.decoder_digest)?,
            frame: message
                .frame
                .map(|frame| part::<_, Lossless>("frame", Some(frame)))
                .transpose()?
                .map(|frame| frame.0),
        })
    }
}
