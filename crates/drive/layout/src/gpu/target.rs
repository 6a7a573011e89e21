//! What a picture is drawn into: colour, depth, and the buffer through which its rows come back.

use std::sync::mpsc::{Receiver, sync_channel};

use crate::colour::Rgb;
use crate::error::LayoutError;
use crate::gpu::device::{COLOUR_FORMAT, DEPTH_FORMAT, Device};

/// Textures and read-back buffer of one picture size.
pub(crate) struct Target {
    width_px: u32,
    height_px: u32,
    colour: wgpu::Texture,
    colour_view: wgpu::TextureView,
    depth_view: wgpu::TextureView,
    rows: wgpu::Buffer,
    bytes_per_row: u32,
    mapped: Option<Receiver<Result<(), wgpu::BufferAsyncError>>>,
}

impl Target {
    pub(crate) fn new(device: &Device, (width_px, height_px): (u32, u32)) -> Result<Self, LayoutError> {
        let limit_px = device.device.limits().max_texture_dimension_2d;
        if width_px == 0 || height_px == 0 || width_px > limit_px || height_px > limit_px {
            return Err(LayoutError::TooLarge { width_px, height_px, limit_px, adapter: device.name() });
        }
        let texture = |format, usage| {
            device.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("picture"),
                size: wgpu::Extent3d { width: width_px, height: height_px, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let attachment = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let colour = texture(COLOUR_FORMAT, attachment | wgpu::TextureUsages::COPY_SRC);
        let depth = texture(DEPTH_FORMAT, attachment);
        let view = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        let bytes_per_row = (4 * width_px).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let rows = device.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("rows"),
            size: u64::from(bytes_per_row) * u64::from(height_px),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let (colour_view, depth_view) = (view(&colour), view(&depth));
        Ok(Self { width_px, height_px, colour, colour_view, depth_view, rows, bytes_per_row, mapped: None })
    }

    pub(crate) fn size(&self) -> (u32, u32) {
        (self.width_px, self.height_px)
    }

    /// Begins a pass over a picture of one colour, infinitely far.
    pub(crate) fn begin<'a>(&'a self, encoder: &'a mut wgpu::CommandEncoder, [r, g, b]: Rgb) -> wgpu::RenderPass<'a> {
        let share = |c: u8| f64::from(c) / 255.0;
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("layout"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.colour_view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color { r: share(r), g: share(g), b: share(b), a: 1.0 }),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth_view,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            ..Default::default()
        })
    }

    /// Records the copy of the finished picture to the read-back buffer.
    pub(crate) fn copy(&self, encoder: &mut wgpu::CommandEncoder) {
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(self.bytes_per_row),
            rows_per_image: Some(self.height_px),
        };
        encoder.copy_texture_to_buffer(
            self.colour.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &self.rows, layout },
            wgpu::Extent3d { width: self.width_px, height: self.height_px, depth_or_array_layers: 1 },
        );
    }

    /// Asks for the rows; they come once the device is waited for.
    pub(crate) fn start_reading(&mut self) {
        let (sender, receiver) = sync_channel(1);
        self.rows.map_async(wgpu::MapMode::Read, .., move |result| {
            // The reader may have given up; then nobody is left to be told.
            drop(sender.send(result));
        });
        self.mapped = Some(receiver);
    }

    /// Waits for the rows and returns the picture.
    pub(crate) fn read(&mut self, device: &Device) -> Result<Vec<Rgb>, LayoutError> {
        let failed = |reason: String| LayoutError::Readback { adapter: device.name(), reason };
        device.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|error| failed(error.to_string()))?;
        let answer = self.mapped.take().and_then(|receiver| receiver.recv().ok());
        answer
            .ok_or_else(|| failed("no answer to the read-back".to_owned()))?
            .map_err(|error| failed(error.to_string()))?;
        let mut picture = Vec::with_capacity(self.width_px as usize * self.height_px as usize);
        {
            let rows = self.rows.get_mapped_range(..).map_err(|error| failed(error.to_string()))?;
            for row in rows.chunks_exact(self.bytes_per_row as usize) {
                let pixels = row[..4 * self.width_px as usize].chunks_exact(4);
                picture.extend(pixels.map(|pixel| [pixel[0], pixel[1], pixel[2]]));
            }
        }
        self.rows.unmap();
        Ok(picture)
    }
}
