//! The `wgpu` back end: the same triangles on any Vulkan or GL adapter, headless, with a depth buffer.
//!
//! A map's ground layers are uploaded once; per picture come the camera, stop lines and boxes. Positions are sent in
//! single precision relative to the map's anchor. Ground is painted in order without depth, boxes are depth-tested.

mod device;
mod target;

use ds_raster::View;
use ds_raster::view::NEAR_M;
use ds_space::{DMat4, DVec3, DVec4, Digest};
use wgpu::util::DeviceExt;

use crate::colour::{GROUND, Rgb, SKY};
use crate::error::LayoutError;
use crate::scene::{Shot, Solid, StaticMap};
use device::Device;
use target::Target;

/// Maps kept on the device at a time.
const MOST_MAPS: usize = 16;
/// The ground reaches this far, in metres, so that it ends at the horizon.
const GROUND_REACH_M: f64 = 20_000.0;

/// A corner as the shader reads it.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Vertex {
    position: [f32; 3],
    colour: [u8; 4],
}

/// A map's ground layers on the device.
struct Uploaded {
    digest: Digest,
    anchor: DVec3,
    vertices: wgpu::Buffer,
    /// The vertices of each piece of the map.
    ranges: Vec<std::ops::Range<u32>>,
}

/// An open adapter with all that is kept between pictures.
pub(crate) struct Gpu {
    device: Device,
    maps: Vec<Uploaded>,
    targets: Vec<Target>,
}

impl Gpu {
    pub(crate) fn open() -> Result<Self, LayoutError> {
        Ok(Self { device: Device::open()?, maps: Vec::new(), targets: Vec::new() })
    }

    pub(crate) fn name(&self) -> String {
        self.device.name()
    }

    pub(crate) fn class(&self) -> String {
        self.device.class()
    }

    pub(crate) fn is_hardware(&self) -> bool {
        self.device.is_hardware()
    }

    /// Renders pinhole pictures; all are submitted before the first is read back.
    pub(crate) fn render(&mut self, shots: &[Shot], views: &[View]) -> Result<Vec<Vec<Rgb>>, LayoutError> {
        let mut pictures = Vec::with_capacity(shots.len());
        // Batches bound the memory that waits for its read-back.
        for (shots, views) in shots.chunks(16).zip(views.chunks(16)) {
            let mut waiting = Vec::with_capacity(shots.len());
            for (index, (shot, view)) in shots.iter().zip(views).enumerate() {
                let map = self.upload(shot.scene.map);
                let target = self.target(index, view)?;
                self.submit(shot, view, map, target);
                waiting.push(target);
            }
            for target in &waiting {
                self.targets[*target].start_reading();
            }
            for target in waiting {
                pictures.push(self.targets[target].read(&self.device)?);
            }
        }
        Ok(pictures)
    }

    /// Returns the index of a map's buffers, uploading it if it is new.
    fn upload(&mut self, map: &StaticMap) -> usize {
        if let Some(known) = self.maps.iter().position(|known| known.digest == map.digest) {
            return known;
        }
        if self.maps.len() == MOST_MAPS {
            self.maps.remove(0);
        }
        let anchor = map.pieces.first().map_or(DVec3::ZERO, |piece| piece.centre.extend(0.0));
        let mut vertices = Vec::new();
        let mut ranges = Vec::with_capacity(map.pieces.len());
        for piece in &map.pieces {
            let first = count(&vertices);
            for corner in piece.triangles.iter().flatten() {
                vertices.push(vertex(corner.extend(0.0) - anchor, piece.colour));
            }
            ranges.push(first..count(&vertices));
        }
        let vertices = self.device.vertices(&vertices);
        self.maps.push(Uploaded { digest: map.digest, anchor, vertices, ranges });
        self.maps.len() - 1
    }

    /// Returns the index of a free target of the picture's size, the `index`-th of its batch.
    fn target(&mut self, index: usize, view: &View) -> Result<usize, LayoutError> {
        let size = (view.pinhole().width_px, view.pinhole().height_px);
        while self.targets.len() <= index {
            self.targets.push(Target::new(&self.device, size)?);
        }
        if self.targets[index].size() != size {
            self.targets[index] = Target::new(&self.device, size)?;
        }
        Ok(index)
    }

    fn submit(&self, shot: &Shot, view: &View, map: usize, target: usize) {
        let (uploaded, target) = (&self.maps[map], &self.targets[target]);
        let bind_group = self.device.pinhole(clip_from_local(view, uploaded.anchor));
        let corners = |solids: &[Solid]| -> Vec<Vertex> {
            let corner = |(corners, colour): &Solid| corners.map(|c| vertex(c - uploaded.anchor, *colour));
            solids.iter().flat_map(corner).collect()
        };
        let mut moving = corners(&ground_plane(view));
        let plane = count(&moving);
        moving.extend(corners(&shot.scene.ground(view)));
        let ground = count(&moving);
        moving.extend(corners(&shot.scene.solids(view)));
        let all = count(&moving);
        let moving = self.device.vertices(&moving);
        let mut encoder = self.device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = target.begin(&mut encoder, SKY);
            pass.set_bind_group(0, &bind_group, &[]);
            pass.set_pipeline(&self.device.painting);
            pass.set_vertex_buffer(0, moving.slice(..));
            pass.draw(0..plane, 0..1);
            pass.set_vertex_buffer(0, uploaded.vertices.slice(..));
            for range in seen(shot.scene.map, uploaded, view) {
                pass.draw(range, 0..1);
            }
            pass.set_vertex_buffer(0, moving.slice(..));
            pass.draw(plane..ground, 0..1);
            pass.set_pipeline(&self.device.filling);
            pass.draw(ground..all, 0..1);
        }
        target.copy(&mut encoder);
        self.device.queue.submit([encoder.finish()]);
    }
}

/// Returns the vertex ranges of the pieces that may be seen, neighbours joined.
fn seen(map: &StaticMap, uploaded: &Uploaded, view: &View) -> Vec<std::ops::Range<u32>> {
    let mut joined: Vec<std::ops::Range<u32>> = Vec::new();
    for (piece, range) in map.pieces.iter().zip(&uploaded.ranges).filter(|(piece, _)| piece.may_be_seen(view)) {
        match joined.last_mut() {
            Some(last) if last.end == range.start => last.end = range.end,
            _ => joined.push(range.clone()),
        }
        debug_assert!(!piece.triangles.is_empty());
    }
    joined
}

/// Returns the verge as a square around the camera that reaches to the horizon.
fn ground_plane(view: &View) -> Vec<Solid> {
    let middle = view.origin().truncate().extend(0.0);
    let corner = |x: f64, y: f64| middle + DVec3::new(x, y, 0.0) * GROUND_REACH_M;
    let (a, b, c, d) = (corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0));
    vec![([a, b, c], GROUND), ([a, c, d], GROUND)]
}

/// Returns the projection to clip space: x right, y up, z = near (so that z/w = near/depth), w = depth.
fn clip_from_local(view: &View, anchor: DVec3) -> [[f32; 4]; 4] {
    let lens = view.pinhole();
    let (w, h) = (f64::from(lens.width_px), f64::from(lens.height_px));
    let clip_from_camera = DMat4::from_cols(
        DVec4::new(2.0 * lens.fx_px / w, 0.0, 0.0, 0.0),
        DVec4::new(0.0, -2.0 * lens.fy_px / h, 0.0, 0.0),
        DVec4::new(2.0 * lens.cx_px / w - 1.0, 1.0 - 2.0 * lens.cy_px / h, 0.0, 1.0),
        DVec4::new(0.0, 0.0, NEAR_M, 0.0),
    );
    let origin = view.to_camera(anchor);
    let axis = |direction: DVec3| (view.to_camera(anchor + direction) - origin).extend(0.0);
    let camera_from_local = DMat4::from_cols(axis(DVec3::X), axis(DVec3::Y), axis(DVec3::Z), origin.extend(1.0));
    (clip_from_camera * camera_from_local).as_mat4().to_cols_array_2d()
}

fn vertex(position: DVec3, [r, g, b]: Rgb) -> Vertex {
    Vertex { position: position.as_vec3().to_array(), colour: [r, g, b, 255] }
}

fn count(vertices: &[Vertex]) -> u32 {
    u32::try_from(vertices.len()).unwrap_or(u32::MAX)
}

impl Device {
    fn vertices(&self, vertices: &[Vertex]) -> wgpu::Buffer {
        // A buffer may not be empty.
        let nothing = [Vertex { position: [0.0; 3], colour: [0; 4] }];
        let contents = bytemuck::cast_slice(if vertices.is_empty() { &nothing } else { vertices });
        let usage = wgpu::BufferUsages::VERTEX;
        self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: Some("triangles"), contents, usage })
    }

    fn pinhole(&self, clip_from_local: [[f32; 4]; 4]) -> wgpu::BindGroup {
        let buffer = self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("pinhole"),
            contents: bytemuck::cast_slice(&clip_from_local),
            usage: wgpu::BufferUsages::UNIFORM,
        });
        self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("pinhole"),
            layout: &self.bindings,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
        })
    }
}
