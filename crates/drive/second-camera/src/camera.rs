//! The camera of this world: rasters all faces at twice the size, shades every sample, averages, prints.
//!
//! Rig of its own: wider, lower and further forward than the scenario's camera, looking down a little more, with a
//! little barrel distortion. A pure function of scene, state, camera and condition: same input, same bits.

use std::f64::consts::PI;

use ds_camera::{Appearance, LabelledCamera, SceneCamera};
use ds_raster::{DepthRaster, ImageError, PixelClass, RgbImage, View};
use ds_space::{CameraModel, DVec2, DVec3, Draws, Intrinsics, Pose, PoseSe2, Rig, Tick, Vec2, Vec3, World};
use ds_world::{AgentClass, AgentState, Condition, LightState, Scene, TrafficLight, WorldState};

use crate::body;
use crate::material::{Finish, Paint, Stuff, finish, linear};
use crate::mesh::{Face, Mould};
use crate::motor::{self, Signals};
use crate::shadow::ShadowMap;
use crate::sky::Light;
use crate::street::{self, Layer};
use crate::town::{self, Stand};
use crate::weather::{Ground, Picture};

const RANGE_M: f64 = 150.0;

/// Renders what a camera of the second world would see.
pub struct SecondCamera {
    scene: Scene,
    layers: Vec<Layer>,
    stands: Vec<Stand>,
    light: Light,
    ground: Ground,
    anchor: DVec2,
    seed: u32,
    draw_seed: u64,
}

impl SecondCamera {
    /// Prepares a scene in a look: its condition, daylight without one, and its seed, which draws sun, amounts, colours and
    /// what stands beside the road.
    #[must_use]
    pub fn new(scene: &Scene, look: &Appearance) -> Self {
        let (condition, seed) = (look.condition.unwrap_or(Condition::DAY), look.palette_seed);
        let draws = Draws::new(&scene.digest, "abroad", &[seed]);
        #[expect(clippy::cast_possible_truncation, reason = "any bits of the draw will do")]
        let texture = draws.u64(30) as u32;
        Self {
            layers: street::layers(&scene.map),
            stands: town::build(scene, seed),
            light: Light::new(condition, &draws, texture),
            ground: Ground::new(condition, &draws, scene.digest, texture),
            anchor: scene.ego_log.first().map_or(DVec2::ZERO, |ego| ego.pose.position),
            scene: scene.clone(),
            seed: texture,
            draw_seed: seed,
        }
    }

    /// Returns the camera of this world's rig with the size of another.
    #[must_use]
    pub fn rig(camera: &CameraModel) -> CameraModel {
        let size = &camera.intrinsics;
        let wide = Intrinsics::centred(size.width_px, size.height_px, 82f64.to_radians());
        // A shorter focal length downwards keeps bonnet and sky in proportion for flat pictures.
        let lens = Intrinsics { cy_px: 0.47 * f64::from(size.height_px), k1: -0.06, ..wide };
        CameraModel::mounted(camera.id.clone(), lens, DVec3::new(1.95, 0.08, 1.22), 0.0, 0.035)
    }

    /// Draws everything; also returns the faces of what moves.
    fn raster(&self, world: &WorldState, view: &View) -> Result<(DepthRaster<Paint>, Vec<Face>), ImageError> {
        let mut raster = DepthRaster::new(view.pinhole().width_px, view.pinhole().height_px, Paint::SKY)?;
        let gravel = Paint::new(Stuff::Gravel, PixelClass::Other, [142, 124, 98]);
        raster.clear_with(|x, y| if view.ray(x as f64 + 0.5, y as f64 + 0.5).z < 0.0 { gravel } else { Paint::SKY });
        for layer in self.layers.iter().filter(|layer| layer.may_be_seen(view)) {
            for triangle in &layer.triangles {
                view.paint(&mut raster, &triangle.map(|corner| corner.extend(0.0)), layer.paint);
            }
        }
        for stand in self.stands.iter().filter(|stand| view.may_see(stand.middle, stand.radius_m, RANGE_M)) {
            for (corners, paint) in &stand.faces {
                view.fill(&mut raster, corners, *paint);
            }
        }
        let mut faces = Vec::new();
        for agent in &world.agents {
            let middle = agent.pose.position.extend(agent.z_m + 0.5 * agent.size.height_m);
            // Also what casts its shadow from outside the picture.
            if middle.distance(view.origin()) < RANGE_M {
                self.agent(agent, world.tick, &mut faces);
            }
        }
        for (i, head) in self.scene.map.traffic_lights.iter().enumerate() {
            if head.position.distance(view.origin()) < RANGE_M {
                signal(head, world.lights.get(i).copied().unwrap_or(LightState::Unknown), &mut faces);
            }
        }
        for (corners, paint) in &faces {
            view.fill(&mut raster, corners, *paint);
        }
        Ok((raster, faces))
    }

    fn agent(&self, agent: &AgentState, tick: Tick, faces: &mut Vec<Face>) {
        let draws = Draws::new(&self.scene.digest, "abroad-agent", &[u64::from(agent.id.0), self.draw_seed]);
        match agent.class {
            AgentClass::Vehicle => {
                let before = Tick(tick.0.saturating_sub(5));
                let track = self.scene.tracks.get(agent.id.0 as usize).and_then(|track| track.at(before));
                let braking = track.is_some_and(|p| p.velocity_mps.length() > agent.velocity_mps.length() + 0.5);
                motor::add(agent, &draws, Signals { lit: self.light.lamps > 0.2, braking }, faces);
            }
            AgentClass::Pedestrian => body::walker(agent, &draws, faces),
            AgentClass::Cyclist => body::rider(agent, &draws, faces),
            AgentClass::Cone => body::pillar(agent, faces),
            AgentClass::Barrier => body::wedge(agent, faces),
        }
    }

    fn shadows(&self, view: &View, faces: &[Face]) -> Option<ShadowMap> {
        if self.light.sun.max_element() < 0.05 {
            return None;
        }
        let centre = view.origin() + view.ray(view.pinhole().cx_px, view.pinhole().cy_px) * 30.0;
        let mut map = ShadowMap::new(centre.truncate().extend(0.0), self.light.sun_direction.as_dvec3())?;
        for stand in self.stands.iter().filter(|stand| stand.middle.distance(centre) < 110.0) {
            map.add(&stand.faces);
        }
        map.add(faces);
        Some(map)
    }

    fn shade(&self, view: &View, raster: &DepthRaster<Paint>, shadows: Option<&ShadowMap>) -> Vec<Vec3> {
        let (eye, width) = (view.origin(), raster.width());
        let ahead = view.ray(view.pinhole().cx_px, view.pinhole().cy_px).normalize_or_zero().as_vec3();
        #[expect(clippy::cast_possible_truncation, reason = "shading is done in single precision")]
        let pixel_rad = (1.0 / view.pinhole().fx_px) as f32;
        let (paints, depths) = (raster.values(), raster.inverse_depths());
        let mut light = vec![Vec3::ZERO; paints.len()];
        let sample = |i: usize, shift: f64| {
            let (paint, inverse_depth) = (&paints[i], depths[i]);
            let ray = view.ray((i % width) as f64 + shift, (i / width) as f64 + shift);
            let direction = ray.normalize().as_vec3();
            if paint.stuff == Stuff::Sky {
                return self.light.seen(direction);
            }
            // What was painted lies on the ground; its depth is not kept.
            let ground = paint.stuff.is_ground() || inverse_depth <= 0.0;
            let reach = if ground { eye.z / (-ray.z).max(1e-4) } else { 1.0 / f64::from(inverse_depth) };
            let place = eye + ray * reach.min(2_000.0);
            let hidden = shadows.map_or(0.0, |map| map.hidden(place));
            let away = (place - eye).as_vec3().length();
            let at = (place - self.anchor.extend(0.0)).as_vec3();
            let spot = ShadingPoint { at, direction, away, hidden, pixel_m: away * pixel_rad, ahead };
            self.light.through_air(self.lit(paint, &spot), away)
        };
        // Blocks of one paint are shaded once; thin marks and edges four times.
        for y in (0..raster.height()).step_by(2) {
            for x in (0..width).step_by(2) {
                let (right, below) = ((x + 1).min(width - 1), (y + 1).min(raster.height() - 1));
                let block = [y * width + x, y * width + right, below * width + x, below * width + right];
                if block.iter().all(|i| paints[*i] == paints[block[0]]) {
                    let here = sample(block[0], 1.0);
                    block.iter().for_each(|i| light[*i] = here);
                } else {
                    block.iter().for_each(|i| light[*i] = sample(*i, 0.5));
                }
            }
        }
        light
    }

    fn lit(&self, paint: &Paint, spot: &ShadingPoint) -> Vec3 {
        let (normal, p) = (paint.normal(), spot.at.truncate());
        if paint.stuff == Stuff::Glow {
            return linear(paint.tint) * (1.2 / self.light.exposure).max(0.05);
        }
        let flat = if paint.stuff.is_ground() { (-spot.direction.z).max(0.04).sqrt() } else { 1.0 };
        let Finish { albedo, gloss, lit } = finish(paint, spot.at, spot.pixel_m / flat, self.seed);
        if lit && self.light.lamps > 0.5 {
            return Vec3::new(0.32, 0.22, 0.10);
        }
        let albedo = self.ground.covered(albedo, paint, p, normal.z);
        let sun = self.light.sun * (normal.dot(self.light.sun_direction).max(0.0) * (1.0 - spot.hidden));
        let dome = self.light.dome.lerp(self.light.floor, 0.5 - 0.5 * normal.z);
        // Low places between things see less of the sky.
        let open = 0.7 + 0.3 * (spot.at.z * 0.8).clamp(0.0, 1.0) * (1.0 - normal.z) + 0.3 * normal.z.max(0.0);
        let mut light = albedo * (sun + dome * open + self.beam(spot));
        let facing = (-spot.direction.dot(normal)).clamp(0.0, 1.0);
        let water = self.ground.water(paint, p);
        let gloss = gloss.max(if self.ground.wet() && paint.stuff.is_ground() { 0.04 } else { 0.0 });
        if gloss > 0.0 || water > 0.0 {
            let back = spot.direction - normal * (2.0 * spot.direction.dot(normal));
            let seen = if back.z > 0.02 { self.light.seen(back) } else { self.light.floor };
            let share = gloss + (1.0 - gloss) * (1.0 - facing).powi(5) * (2.5 * gloss).min(1.0);
            light = light * (1.0 - share) + seen * share;
            let glint = back.dot(self.light.sun_direction).max(0.0).powi(220) * (1.0 - spot.hidden);
            light += self.light.sun * (glint * gloss * 6.0);
            let mirror = 0.06 + 0.94 * (1.0 - facing).powi(4);
            light = light.lerp(light * 0.4 + seen * mirror, water);
        }
        light
    }

    /// Returns the light of the ego's lamps: two cones that meet ahead, cut off above.
    fn beam(&self, spot: &ShadingPoint) -> Vec3 {
        if self.light.lamps <= 0.0 {
            return Vec3::ZERO;
        }
        // A broad, flat cone that thins out to its sides and with the distance.
        let away = spot.direction - spot.ahead * spot.direction.dot(spot.ahead);
        let aside = Vec2::new(away.truncate().length(), 2.0 * away.z);
        let aim = (-9.0 * aside.length_squared()).exp();
        let height = (1.7 - spot.at.z).clamp(0.12, 1.0);
        let fall = 1.0 / (1.0 + (spot.away / 14.0).powi(2));
        let near = (spot.away / 5.0).clamp(0.2, 1.0);
        let dark = 1.0 / (1.0 + 14.0 * self.light.dome.max_element());
        (Vec3::new(0.86, 0.92, 1.0) * (0.24 * aim * fall * near * height) + Vec3::new(1.0, 0.72, 0.45) * 0.007)
            * (self.light.lamps * dark)
    }
}

impl SceneCamera for SecondCamera {
    fn render(
        &self,
        world: &WorldState,
        camera: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Result<RgbImage, ImageError> {
        let size = &camera.intrinsics;
        let fine = size.resized(2 * size.width_px, 2 * size.height_px);
        let (lens, view) = View::through(&fine, world_from_rig * camera.rig_from_camera);
        let (raster, faces) = self.raster(world, &view)?;
        let shadows = self.shadows(&view, &faces);
        let samples = lens.develop(self.shade(&view, &raster, shadows.as_ref()));
        let (width, height) = (size.width_px as usize, size.height_px as usize);
        let mut light: Vec<Vec3> = (0..width * height)
            .map(|i| {
                let (x, y) = (i % width, i / width);
                let row = |k: usize| (2 * y + k) * 2 * width + 2 * x;
                (samples[row(0)] + samples[row(0) + 1] + samples[row(1)] + samples[row(1) + 1]) * 0.25
            })
            .collect();
        let bright = self.light.dome * 0.95 + self.light.sun * 0.2 + Vec3::splat(0.05 * self.light.lamps);
        let mut picture = Picture { light: &mut light, width, height, focal_px: size.fx_px, bright };
        self.ground.fall(world.tick, &mut picture);
        let rows: Vec<u8> = light.into_iter().flat_map(|light| self.light.print(light)).collect();
        RgbImage::new(size.width_px, size.height_px, rows)
    }
}

impl LabelledCamera for SecondCamera {
    fn classes(
        &self,
        world: &WorldState,
        camera: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Result<Vec<PixelClass>, ImageError> {
        let (lens, view) = View::through(&camera.intrinsics, world_from_rig * camera.rig_from_camera);
        Ok(lens.develop(self.raster(world, &view)?.0.values().iter().map(|paint| paint.class).collect()))
    }
}

/// A place that is being shaded.
struct ShadingPoint {
    /// From the scene's anchor, in metres.
    at: Vec3,
    direction: Vec3,
    away: f32,
    hidden: f32,
    pixel_m: f32,
    ahead: Vec3,
}

/// Adds a traffic light: a round-cornered box with a light rim, round lamps under hoods, hung from a post beside it.
fn signal(head: &TrafficLight, state: LightState, faces: &mut Vec<Face>) {
    let thing = |stuff, tint| Paint::new(stuff, PixelClass::Other, tint);
    let pose = PoseSe2 { position: head.position.truncate(), heading_rad: head.facing_rad };
    let z = head.position.z;
    let mut mould = Mould { pose, bottom_m: 0.0, faces };
    mould.cuboid(
        DVec3::new(-0.12, -0.42, z - 0.9),
        DVec3::new(-0.06, 0.42, z + 0.9),
        thing(Stuff::Plain, [226, 226, 220]),
    );
    mould.cuboid(DVec3::new(-0.06, -0.3, z - 0.78), DVec3::new(0.1, 0.3, z + 0.78), thing(Stuff::Plain, [44, 48, 42]));
    mould.turned(DVec2::new(-0.2, 0.0), 6, &[(0.0, 0.09), (z - 0.7, 0.07)], thing(Stuff::Plain, [92, 98, 96]));
    let rows = [
        (LightState::Red, 0.5, [255, 48, 40], [64, 20, 18]),
        (LightState::Yellow, 0.0, [255, 190, 40], [66, 52, 16]),
        (LightState::Green, -0.5, [60, 255, 170], [14, 58, 44]),
    ];
    for (shows, up, on, off) in rows {
        let paint = if shows == state { thing(Stuff::Glow, on) } else { thing(Stuff::Plain, off) };
        let rim = |i: u32| {
            let (s, c) = (f64::from(i) * PI / 6.0).sin_cos();
            DVec3::new(0.13, 0.21 * c, z + up + 0.21 * s)
        };
        let disc: Vec<DVec3> = (0..12).map(rim).collect();
        mould.face(&disc, DVec3::new(0.0, 0.0, z + up), paint);
    }
}
