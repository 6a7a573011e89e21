//! Turns what a pixel shows into the light that it sends: texture, sun, shadow, reflection, headlights, haze.
//!
//! Positions in metres relative to the scene's anchor (so that single precision is enough); light is linear, gamma 2.

use ds_space::{Vec2, Vec3};

use crate::light::Light;
use crate::surface::{Material, Surface};
use crate::texture::{self, Front, linear};

/// Bits of the shadow mask.
pub(crate) const SUN_SHADOW: u8 = 1;
/// Directly under something.
pub(crate) const CONTACT: u8 = 2;

/// What is known about a point when it is shaded.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Point {
    pub(crate) surface: Surface,
    pub(crate) position: Vec3,
    /// From the eye, unit length.
    pub(crate) direction: Vec3,
    pub(crate) distance_m: f32,
    pub(crate) shadow: u8,
}

/// Light, seed and camera of one picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shader<'a> {
    pub(crate) light: &'a Light,
    pub(crate) seed: u32,
    /// Horizontal direction of the camera, unit length.
    pub(crate) ahead: Vec2,
    /// Angle of a pixel.
    pub(crate) pixel_rad: f32,
}

impl Shader<'_> {
    /// Returns the light that comes from a point.
    pub(crate) fn shade(&self, point: &Point) -> Vec3 {
        let surface = point.surface;
        match surface.material {
            Material::Sky => self.light.skyline(point.direction).unwrap_or_else(|| self.light.sky(point.direction)),
            material if material.is_ground() => self.light.hazed(self.ground(point), point.distance_m),
            _ => self.light.hazed(self.solid(point), point.distance_m),
        }
    }

    fn ground(&self, point: &Point) -> Vec3 {
        let p = point.position.truncate();
        let steep = (-point.direction.z).max(0.02);
        let grain_m = point.distance_m * self.pixel_rad / steep.sqrt();
        let base = linear(point.surface.colour);
        let material = point.surface.material;
        let mut albedo = match material {
            Material::Sidewalk => texture::paving(base, p, grain_m, self.seed),
            Material::Kerb => base,
            Material::Asphalt => texture::asphalt(base, p, grain_m, self.seed),
            Material::Paint => {
                let road = texture::asphalt(linear([94, 94, 97]), p, grain_m, self.seed);
                road + (base - road) * texture::paint_left(p, grain_m, self.seed)
            }
            _ => texture::verge(p, grain_m, self.seed),
        };
        if let Some(cover) = &self.light.cover {
            albedo = cover.ground(albedo, &point.surface, p, self.seed);
        }
        let wet = if matches!(material, Material::Asphalt | Material::Paint) { self.light.wetness } else { 0.0 };
        albedo *= 1.0 - 0.45 * wet;
        let sun = if point.shadow & SUN_SHADOW == 0 { self.light.sun * self.light.sun_direction.z } else { Vec3::ZERO };
        let closed = if point.shadow & CONTACT == 0 { 1.0 } else { 0.35 };
        let mut light = albedo * (sun + self.light.ambient * closed + self.headlights(point) * closed);
        if wet > 0.0 {
            let mirrored = point.direction * Vec3::new(1.0, 1.0, -1.0);
            let graze = (1.0 - steep).powi(4);
            let puddle = 0.4 + 0.6 * crate::noise::smooth(p.x / 3.0, p.y / 3.0, self.seed ^ 71);
            light += self.light.sky(mirrored) * (wet * closed * puddle * (0.03 + 0.5 * graze));
            let standing = self.light.cover.map_or(0.0, |cover| cover.puddle(p, self.seed));
            if standing > 0.0 {
                let sky = self.light.skyline(mirrored).unwrap_or_else(|| self.light.sky(mirrored));
                let water = light * 0.25 + sky * (closed * (0.12 + 0.75 * (1.0 - steep).powi(3)));
                light += (water - light) * standing;
            }
        }
        light
    }

    fn solid(&self, point: &Point) -> Vec3 {
        let surface = point.surface;
        let n = surface.normal.map(f32::from);
        let normal = Vec3::from_array(n) * (1.0 / 127.0);
        let base = self.covered(linear(surface.colour), &surface, normal);
        let grain_m = point.distance_m * self.pixel_rad;
        let facing = (-point.direction.dot(normal)).abs().min(1.0);
        match surface.material {
            Material::Lamp => base * 1.4,
            Material::Gloss => {
                self.lit(base, normal, point) + self.mirrored(point, normal, 0.04 + 0.3 * (1.0 - facing).powi(3))
            }
            Material::Glass => {
                self.lit(base, normal, point) * 0.5 + self.mirrored(point, normal, 0.10 + 0.6 * (1.0 - facing).powi(3))
            }
            Material::Foliage => self.lit(texture::foliage(base, point.position, grain_m, self.seed), normal, point),
            Material::Facade if normal.z < 0.5 => {
                let along = point.position.dot(Vec3::new(-normal.y, normal.x, 0.0));
                match texture::facade(base, along, point.position.z, grain_m, self.seed) {
                    Front::Wall(albedo) => self.lit(albedo, normal, point),
                    Front::Window { lit } if lit && self.light.night > 0.3 => {
                        Vec3::new(0.62, 0.46, 0.2) * self.light.night
                    }
                    Front::Window { .. } => {
                        self.lit(linear([44, 52, 60]), normal, point) + self.mirrored(point, normal, 0.16)
                    }
                }
            }
            _ => self.lit(base, normal, point),
        }
    }

    /// Returns an albedo under what lies on a face; lamps and glass stay clear.
    fn covered(&self, albedo: Vec3, surface: &Surface, normal: Vec3) -> Vec3 {
        match &self.light.cover {
            Some(cover) if !matches!(surface.material, Material::Lamp | Material::Glass) => {
                cover.thing(albedo, surface, normal.z)
            }
            _ => albedo,
        }
    }

    fn lit(&self, albedo: Vec3, normal: Vec3, point: &Point) -> Vec3 {
        let sun = normal.dot(self.light.sun_direction).max(0.0);
        // Less sky is seen from faces that look sideways or down, and near the ground.
        let open = (0.62 + 0.38 * normal.z) * (0.55 + 0.45 * (point.position.z * 1.2).clamp(0.0, 1.0));
        albedo * (self.light.sun * sun + self.light.ambient * open + self.headlights(point))
    }

    fn mirrored(&self, point: &Point, normal: Vec3, share: f32) -> Vec3 {
        let d = point.direction;
        let back = d - normal * (2.0 * d.dot(normal));
        if back.z < 0.0 {
            return self.light.ambient * (0.12 * share);
        }
        self.light.sky(back) * share
    }

    /// Returns the light of the ego's own headlights and a little of the street's.
    fn headlights(&self, point: &Point) -> Vec3 {
        if self.light.headlight <= 0.0 {
            return Vec3::ZERO;
        }
        let flat = point.direction.truncate().normalize_or_zero();
        let aim = ((flat.dot(self.ahead) - 0.80) / 0.18).clamp(0.0, 1.0);
        let fall = 1.0 / (1.0 + (point.distance_m / 16.0) * (point.distance_m / 16.0));
        Vec3::new(1.0, 0.93, 0.78) * (self.light.headlight * (1.5 * aim * aim * fall + 0.06))
    }
}

/// Returns the sRGB bytes of a light.
pub(crate) fn developed(light: Vec3) -> [u8; 3] {
    // A soft shoulder keeps bright skies and lamps from clipping hard.
    let tone = |x: f32| {
        let x = 1.08 * x.max(0.0);
        let x = if x > 0.7 { 0.7 + 0.3 * (1.0 - (-(x - 0.7) / 0.3).exp()) } else { x };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "float casts saturate")]
        let byte = (x.sqrt() * 255.0 + 0.5) as u8;
        byte
    };
    [tone(light.x), tone(light.y), tone(light.z)]
}
