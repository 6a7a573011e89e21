//! Why a layout cannot be rendered.

use ds_raster::ImageError;

/// Says why a layout cannot be rendered.
#[derive(Debug, thiserror::Error)]
pub enum LayoutError {
    /// No adapter answers.
    #[error("no Vulkan or GL adapter was found; the cpu back end needs none")]
    Adapter(#[source] wgpu::RequestAdapterError),
    /// The adapter gives no device.
    #[error("adapter {adapter:?} gives no device")]
    Device {
        /// The adapter's name.
        adapter: String,
        /// What it answered.
        #[source]
        source: wgpu::RequestDeviceError,
    },
    /// The device was lost or the picture could not be read back.
    #[error("the picture cannot be read back from {adapter:?}: {reason}")]
    Readback {
        /// The adapter's name.
        adapter: String,
        /// What went wrong.
        reason: String,
    },
    /// The picture is larger than the device can draw.
    #[error("picture of {width_px}×{height_px} px is larger than {limit_px} px, the limit of {adapter:?}")]
    TooLarge {
        /// Asked width.
        width_px: u32,
        /// Asked height.
        height_px: u32,
        /// The adapter's largest side.
        limit_px: u32,
        /// The adapter's name.
        adapter: String,
    },
    /// The picture's size is refused.
    #[error("camera picture is refused")]
    Image(#[from] ImageError),
}
