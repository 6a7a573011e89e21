//! The reference camera: the rich picture that stands in for a real camera, rendered on the CPU.
//!
//! Surfaces are rastered at twice the size, each 2×2 block is shaded once where it shows one surface and four times
//! where it does not, and averaged. A pure function of scene, state, camera and appearance: same input, same bits.

use ds_raster::{DepthRaster, Fall, ImageError, RgbImage, Sight, View};
use ds_space::{CameraModel, DVec2, DVec3, Draws, Intrinsics, Pose, Rig, Vec2, Vec3, World};
use ds_world::{Scene, WorldState, agent::corners};

use crate::appearance::Appearance;
use crate::fall::Canvas;
use crate::geometry::Geometry;
use crate::light::Light;
use crate::scene_camera::{LabelledCamera, SceneCamera};
use crate::shade::{CONTACT, Point, SUN_SHADOW, Shader, developed};
use crate::surface::{Material, PixelClass, Surface};
use ds_raster::shape::{self, Triangle};

/// How a picture is sampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sampling {
    /// Four samples a pixel.
    #[default]
    Smooth,
    /// One sample a pixel: faster, with jagged edges.
    Single,
}

/// Renders what a real camera would see in a scene.
#[derive(Debug, Clone)]
pub struct ReferenceCamera {
    geometry: Geometry,
    light: Light,
    /// Shadows of houses and trees, with the circles that hold them.
    shadows: Vec<(DVec2, f64, Vec<Triangle>)>,
    anchor: DVec2,
    seed: u32,
    sampling: Sampling,
    fall: Option<Fall>,
}

impl ReferenceCamera {
    /// Prepares a scene: triangulates its map, places houses and trees, casts their shadows.
    #[must_use]
    pub fn new(scene: &Scene, appearance: Appearance) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "any bits of the draw will do")]
        let seed = Draws::new(&scene.digest, "texture", &[appearance.palette_seed]).u64(0) as u32;
        let light = Light::new(&appearance, seed);
        let standing = Geometry::surroundings(scene, appearance.palette_seed);
        let shadows = if light.casts_shadows() {
            let cast = |s: &crate::surroundings::Standing| {
                shadow(&s.shadow_base, s.shadow_from_m, s.shadow_to_m, light.shadow_per_m())
            };
            standing.iter().filter_map(cast).collect()
        } else {
            Vec::new()
        };
        let anchor = scene.ego_log.first().map_or(DVec2::ZERO, |ego| ego.pose.position);
        let geometry = Geometry::new(scene, appearance.palette_seed, standing);
        let fall = appearance.falling(scene.digest);
        Self { geometry, light, shadows, anchor, seed, sampling: Sampling::Smooth, fall }
    }

    /// Returns the camera with another sampling.
    #[must_use]
    pub fn with_sampling(self, sampling: Sampling) -> Self {
        Self { sampling, ..self }
    }

    /// Returns what is drawn.
    pub(crate) fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Returns the light of every pixel of a pinhole picture.
    fn expose(&self, world: &WorldState, view: &View) -> Result<Vec<Vec3>, ImageError> {
        let raster = surfaces(&self.geometry, world, view, self.light.lamps_on())?;
        let shadows = self.shadow_mask(world, view)?;
        let (width, height) = (raster.width(), raster.height());
        let scene = Exposure::new(self, view, &raster, &shadows);
        let mut light = vec![Vec3::ZERO; width * height];
        let block = if self.sampling == Sampling::Smooth { 2 } else { 1 };
        for y in (0..height).step_by(block) {
            for x in (0..width).step_by(block) {
                let (right, bottom) = ((x + block).min(width), (y + block).min(height));
                if scene.is_uniform(x..right, y..bottom) {
                    let here = scene.light_at(x, y, 0.5 * block as f64);
                    for row in y..bottom {
                        light[row * width + x..row * width + right].fill(here);
                    }
                } else {
                    for row in y..bottom {
                        for column in x..right {
                            light[row * width + column] = scene.light_at(column, row, 0.5);
                        }
                    }
                }
            }
        }
        Ok(light)
    }

    fn shadow_mask(&self, world: &WorldState, view: &View) -> Result<Vec<u8>, ImageError> {
        let (width_px, height_px) = (view.pinhole().width_px, view.pinhole().height_px);
        let mut mask = DepthRaster::new(width_px, height_px, 0u8)?;
        let mut paint = |triangles: &[Triangle], value: u8| {
            for triangle in triangles {
                view.paint(&mut mask, &triangle.map(|corner| corner.extend(0.0)), value);
            }
        };
        let near = |centre: DVec2, radius_m: f64| view.may_see(centre.extend(0.0), radius_m, 120.0);
        let agents = || world.agents.iter().filter(|agent| near(agent.pose.position, 20.0));
        if self.light.casts_shadows() {
            for (_, _, triangles) in self.shadows.iter().filter(|(centre, radius_m, _)| near(*centre, *radius_m)) {
                paint(triangles, SUN_SHADOW);
            }
            for agent in agents() {
                let cast = shadow(
                    &agent.corners(),
                    agent.z_m,
                    agent.z_m + 0.92 * agent.size.height_m,
                    self.light.shadow_per_m(),
                );
                if let Some((_, _, triangles)) = cast {
                    paint(&triangles, SUN_SHADOW);
                }
            }
        }
        for agent in agents() {
            let under = corners(&agent.pose, agent.size.length_m + 0.1, agent.size.width_m + 0.1);
            paint(&shape::triangulate(&under), SUN_SHADOW | CONTACT);
        }
        Ok(mask.values().to_vec())
    }
}

impl SceneCamera for ReferenceCamera {
    fn render(
        &self,
        world: &WorldState,
        camera: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Result<RgbImage, ImageError> {
        let size = &camera.intrinsics;
        let scale = if self.sampling == Sampling::Smooth { 2 } else { 1 };
        let fine = size.resized(size.width_px * scale, size.height_px * scale);
        let (lens, view) = View::through(&fine, world_from_rig * camera.rig_from_camera);
        let samples = lens.develop(self.expose(world, &view)?);
        let mut light = averaged(&samples, size, scale as usize);
        if let Some(fall) = &self.fall {
            let (bright, headlight) = (self.light.ambient * 1.1 + self.light.sun * 0.3, self.light.headlight);
            Canvas { light: &mut light, sight: Sight::of(size), bright, headlight }.cover(fall, world.tick);
        }
        let colours: Vec<[u8; 3]> = light.into_iter().map(developed).collect();
        RgbImage::new(size.width_px, size.height_px, colours.into_flattened())
    }
}

impl LabelledCamera for ReferenceCamera {
    fn classes(
        &self,
        world: &WorldState,
        camera: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Result<Vec<PixelClass>, ImageError> {
        let (lens, view) = View::through(&camera.intrinsics, world_from_rig * camera.rig_from_camera);
        let raster = surfaces(&self.geometry, world, &view, false)?;
        Ok(lens.develop(raster.values().iter().map(|surface| surface.class).collect()))
    }
}

/// Rasters all surfaces of a world.
pub(crate) fn surfaces(
    geometry: &Geometry,
    world: &WorldState,
    view: &View,
    lamps_on: bool,
) -> Result<DepthRaster<Surface>, ImageError> {
    let pinhole = view.pinhole();
    let mut raster = DepthRaster::new(pinhole.width_px, pinhole.height_px, Surface::SKY)?;
    let verge = Surface::ground(Material::Verge, PixelClass::Other, [86, 104, 58]);
    let (corner, right, down) = ray_steps(view);
    raster.clear_with(|x, y| {
        let ray_z = corner.z + right.z * x as f64 + down.z * y as f64;
        if ray_z < 0.0 { verge } else { Surface::SKY }
    });
    geometry.draw(world, view, lamps_on, &mut raster);
    Ok(raster)
}

/// Returns the ray of the first pixel's centre and its steps to the right and down.
fn ray_steps(view: &View) -> (DVec3, DVec3, DVec3) {
    let corner = view.ray(0.5, 0.5);
    (corner, view.ray(1.5, 0.5) - corner, view.ray(0.5, 1.5) - corner)
}

/// Returns the shadow of an upright prism with its circle.
fn shadow(base: &[DVec2], from_m: f64, to_m: f64, per_m: DVec2) -> Option<(DVec2, f64, Vec<Triangle>)> {
    let moved = |height_m: f64| base.iter().map(move |corner| *corner + per_m * height_m);
    let hull = shape::convex_hull(&moved(from_m).chain(moved(to_m)).collect::<Vec<_>>());
    let low = hull.iter().copied().reduce(DVec2::min)?;
    let high = hull.iter().copied().reduce(DVec2::max)?;
    Some((0.5 * (low + high), 0.5 * low.distance(high), shape::fan(&hull).collect()))
}

/// One picture being shaded.
struct Exposure<'a> {
    shader: Shader<'a>,
    raster: &'a DepthRaster<Surface>,
    shadows: &'a [u8],
    rays: (DVec3, DVec3, DVec3),
    eye: DVec3,
    anchor: DVec2,
}

impl<'a> Exposure<'a> {
    fn new(camera: &'a ReferenceCamera, view: &View, raster: &'a DepthRaster<Surface>, shadows: &'a [u8]) -> Self {
        let lens = view.pinhole();
        let ahead = view.ray(lens.cx_px, lens.cy_px).truncate().normalize_or_zero();
        #[expect(clippy::cast_possible_truncation, reason = "shading is done in single precision")]
        let (ahead, pixel_rad) = (Vec2::new(ahead.x as f32, ahead.y as f32), (1.0 / lens.fx_px) as f32);
        let shader = Shader { light: &camera.light, seed: camera.seed, ahead, pixel_rad };
        Self { shader, raster, shadows, rays: ray_steps(view), eye: view.origin(), anchor: camera.anchor }
    }

    /// Says whether a block shows one surface in one light.
    fn is_uniform(&self, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> bool {
        let width = self.raster.width();
        let first = rows.start * width + columns.start;
        let (surface, shadow) = (self.raster.values()[first], self.shadows[first]);
        rows.flat_map(|y| columns.clone().map(move |x| y * width + x))
            .all(|i| self.raster.values()[i] == surface && (!surface.material.is_ground() || self.shadows[i] == shadow))
    }

    /// Shades the sample of a pixel, at `offset` from the pixel's top left corner.
    fn light_at(&self, x: usize, y: usize, offset: f64) -> Vec3 {
        let i = y * self.raster.width() + x;
        let surface = self.raster.values()[i];
        let (corner, right, down) = self.rays;
        let ray = corner + right * (x as f64 + offset - 0.5) + down * (y as f64 + offset - 0.5);
        let reach = match surface.material {
            Material::Sky => 1.0,
            // A ray of a block's middle may just miss the ground at the horizon.
            material if material.is_ground() => self.eye.z / (-ray.z).max(1e-4),
            _ => 1.0 / f64::from(self.raster.inverse_depths()[i].max(1e-6)),
        };
        let offset_from_eye = ray * reach;
        let place = self.eye + offset_from_eye - self.anchor.extend(0.0);
        let distance = offset_from_eye.length();
        let point = Point {
            surface,
            position: place.as_vec3(),
            direction: (offset_from_eye / distance).as_vec3(),
            #[expect(clippy::cast_possible_truncation, reason = "shading is done in single precision")]
            distance_m: distance as f32,
            shadow: self.shadows[i],
        };
        self.shader.shade(&point)
    }
}

/// Averages blocks of `scale` × `scale` samples.
fn averaged(light: &[Vec3], size: &Intrinsics, scale: usize) -> Vec<Vec3> {
    let (width, height) = (size.width_px as usize, size.height_px as usize);
    let mut image = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let mut sum = Vec3::ZERO;
            for row in 0..scale {
                for column in 0..scale {
                    sum += light[(y * scale + row) * width * scale + x * scale + column];
                }
            }
            image.push(sum / (scale * scale) as f32);
        }
    }
    image
}
