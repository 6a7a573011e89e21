//! The renderer: picks a back end, places the camera, renders the pinhole picture, warps it through the lens.

use ds_raster::{Geometry, Lens, RgbImage, View};
use ds_space::{CameraModel, Intrinsics, Pose, Rig, World};
use ds_world::LayoutBackend;

use crate::colour::Rgb;
use crate::cpu;
use crate::error::LayoutError;
use crate::geometry;
use crate::gpu::Gpu;
use crate::scene::{LayoutScene, Shot};

enum Backend {
    Cpu,
    Wgpu(Box<Gpu>),
}

/// Renders layout images.
pub struct Renderer {
    backend: Backend,
    description: String,
    /// Prepared lenses of the cameras seen so far.
    lenses: Vec<(Intrinsics, Lens)>,
}

/// More cameras than this are prepared anew each time.
const MOST_LENSES: usize = 32;

impl Renderer {
    /// Opens a back end.
    ///
    /// # Errors
    /// If [`LayoutBackend::Wgpu`] is asked for and no adapter gives a device.
    pub fn new(choice: LayoutBackend) -> Result<Self, LayoutError> {
        let (backend, description) = match choice {
            LayoutBackend::Cpu => (Backend::Cpu, "cpu, a software rasteriser".to_owned()),
            LayoutBackend::Wgpu => {
                let gpu = Gpu::open()?;
                let kind = if gpu.is_hardware() { "hardware" } else { "software" };
                let description = format!("wgpu on {}, a {kind} adapter", gpu.name());
                (Backend::Wgpu(Box::new(gpu)), description)
            }
            LayoutBackend::Auto => match Gpu::open() {
                Ok(gpu) if gpu.is_hardware() => {
                    let description = format!("wgpu on {} (auto: a hardware adapter)", gpu.name());
                    (Backend::Wgpu(Box::new(gpu)), description)
                }
                Ok(gpu) => (Backend::Cpu, format!("cpu (auto: {} is software)", gpu.name())),
                Err(error) => (Backend::Cpu, format!("cpu (auto: {error})")),
            },
        };
        Ok(Self { backend, description, lenses: Vec::new() })
    }

    /// Says which back end was taken and why.
    #[must_use]
    pub fn describe(&self) -> &str {
        &self.description
    }

    /// Returns the name of the class of machines on which the same input gives the same bits.
    #[must_use]
    pub fn compute_class(&self) -> String {
        let version = env!("CARGO_PKG_VERSION");
        match &self.backend {
            Backend::Cpu => format!("layout-{version}/cpu/{}", std::env::consts::ARCH),
            Backend::Wgpu(gpu) => format!("layout-{version}/wgpu/{}", gpu.class()),
        }
    }

    /// Renders one picture.
    ///
    /// # Errors
    /// If the picture's size is refused or the device fails.
    pub fn render(
        &mut self,
        scene: &LayoutScene,
        camera: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Result<RgbImage, LayoutError> {
        let mut images = self.render_batch(&[Shot { scene: *scene, camera, world_from_rig }])?;
        Ok(images.remove(0))
    }

    /// Returns the geometry of what a picture of the same shows; its depths are the same to the bit, whatever the back end.
    ///
    /// # Errors
    /// If the picture's size is refused.
    pub fn geometry(
        &mut self,
        scene: &LayoutScene,
        camera: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Result<Geometry, LayoutError> {
        let lens = self.lens(&camera.intrinsics);
        geometry::of(&Shot { scene: *scene, camera, world_from_rig }, &lens)
    }

    /// Renders many pictures, of one episode or several, in the order given.
    ///
    /// # Errors
    /// If a picture's size is refused or the device fails.
    pub fn render_batch(&mut self, shots: &[Shot]) -> Result<Vec<RgbImage>, LayoutError> {
        let mut lenses = Vec::with_capacity(shots.len());
        let mut views = Vec::with_capacity(shots.len());
        for shot in shots {
            let lens = self.lens(&shot.camera.intrinsics);
            views.push(View::new(lens.pinhole(), shot.world_from_rig * shot.camera.rig_from_camera));
            lenses.push(lens);
        }
        let pictures = match &mut self.backend {
            Backend::Cpu => {
                shots.iter().zip(&views).map(|(shot, view)| cpu::render(&shot.scene, view)).collect::<Result<_, _>>()?
            }
            Backend::Wgpu(gpu) => gpu.render(shots, &views)?,
        };
        let develop = |((shot, lens), picture): ((&Shot, &Lens), Vec<Rgb>)| {
            let size = &shot.camera.intrinsics;
            let rgb = lens.develop(picture).into_flattened();
            Ok(RgbImage::new(size.width_px, size.height_px, rgb)?)
        };
        shots.iter().zip(&lenses).zip(pictures).map(develop).collect()
    }

    fn lens(&mut self, intrinsics: &Intrinsics) -> Lens {
        if let Some((_, lens)) = self.lenses.iter().find(|(known, _)| known == intrinsics) {
            return lens.clone();
        }
        let lens = Lens::new(intrinsics);
        if self.lenses.len() < MOST_LENSES {
            self.lenses.push((*intrinsics, lens.clone()));
        }
        lens
    }
}
