//! Opens an adapter and builds the two pipelines: painting (ground, in order) and filling (boxes, depth-tested).

use crate::error::LayoutError;
use crate::gpu::Vertex;

/// Colours are written as they are, without any transfer function.
pub(crate) const COLOUR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
/// Reversed depth.
pub(crate) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// An open device with its pipelines.
pub(crate) struct Device {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) painting: wgpu::RenderPipeline,
    pub(crate) filling: wgpu::RenderPipeline,
    pub(crate) bindings: wgpu::BindGroupLayout,
    info: wgpu::AdapterInfo,
}

impl Device {
    /// Opens the fastest adapter there is.
    pub(crate) fn open() -> Result<Self, LayoutError> {
        let mut description = wgpu::InstanceDescriptor::new_without_display_handle();
        description.backends = wgpu::Backends::VULKAN | wgpu::Backends::GL;
        let instance = wgpu::Instance::new(description);
        let options = wgpu::RequestAdapterOptions::<'_, '_> {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options)).map_err(LayoutError::Adapter)?;
        let info = adapter.get_info();
        let asked = wgpu::DeviceDescriptor {
            label: Some("layout"),
            required_limits: wgpu::Limits::downlevel_defaults().using_resolution(adapter.limits()),
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&asked))
            .map_err(|source| LayoutError::Device { adapter: info.name.clone(), source })?;
        let shader = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("layout"),
            source: wgpu::ShaderSource::Wgsl(include_str!("../layout.wgsl").into()),
        });
        let bindings = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("pinhole"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::VERTEX,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            }],
        });
        let painting = pipeline(&device, &shader, &bindings, None);
        let filling = pipeline(&device, &shader, &bindings, Some(wgpu::CompareFunction::Greater));
        Ok(Self { device, queue, painting, filling, bindings, info })
    }

    pub(crate) fn name(&self) -> String {
        format!("{} ({:?}, {})", self.info.name, self.info.backend, self.info.driver_info)
    }

    pub(crate) fn class(&self) -> String {
        let info = &self.info;
        format!("{:?}/{}/{}/{}", info.backend, info.name, info.driver, info.driver_info)
    }

    pub(crate) fn is_hardware(&self) -> bool {
        use wgpu::DeviceType::{DiscreteGpu, IntegratedGpu, VirtualGpu};
        matches!(self.info.device_type, DiscreteGpu | IntegratedGpu | VirtualGpu)
    }
}

/// Builds the pipeline that tests depth with `compare`, or leaves depth alone.
fn pipeline(
    device: &wgpu::Device,
    shader: &wgpu::ShaderModule,
    bindings: &wgpu::BindGroupLayout,
    compare: Option<wgpu::CompareFunction>,
) -> wgpu::RenderPipeline {
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("layout"),
        bind_group_layouts: &[Some(bindings)],
        ..Default::default()
    });
    let attributes = wgpu::vertex_attr_array![0 => Float32x3, 1 => Unorm8x4];
    let vertices = wgpu::VertexBufferLayout {
        array_stride: size_of::<Vertex>() as u64,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &attributes,
    };
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("layout"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: shader,
            entry_point: Some("place"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[Some(vertices)],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(compare.is_some()),
            depth_compare: Some(compare.unwrap_or(wgpu::CompareFunction::Always)),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: shader,
            entry_point: Some("shade"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(wgpu::ColorTargetState {
                format: COLOUR_FORMAT,
                blend: None,
                write_mask: wgpu::ColorWrites::ALL,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}
