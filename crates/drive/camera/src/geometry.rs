//! Everything that is drawn, as surfaces: ground layers, surroundings, traffic lights and agents, into one raster.
//!
//! Shared by the reference camera, the plain camera and the class map, so that all three agree pixel by pixel.

use ds_raster::{DepthRaster, View};
use ds_space::{DVec2, DVec3, Digest, Draws, PoseSe2};
use ds_world::{AgentClass, AgentState, LightState, Scene, Track, TrafficLight, WorldState};

use crate::ground::{self, Patch};
use crate::solid::{Builder, Facet, Skin, Slab};
use crate::surface::{Material, PixelClass, Surface};
use crate::surroundings::{self, Standing};
use crate::vehicle::Lamps;
use crate::{figure, vehicle};

/// How far from the camera solids are drawn, in metres.
const RANGE_M: f64 = 160.0;
/// Lamps are drawn larger than life, so that a small picture shows them.
const LAMP_RADIUS_M: f64 = 0.2;

/// The drawable content of a scene.
#[derive(Debug, Clone)]
pub(crate) struct Geometry {
    pub(crate) patches: Vec<Patch>,
    pub(crate) standing: Vec<Standing>,
    heads: Vec<Head>,
    tracks: Vec<Track>,
    digest: Digest,
    palette_seed: u64,
}

/// A traffic light head with the facets of its housing and pole.
#[derive(Debug, Clone)]
struct Head {
    light: TrafficLight,
    facets: Vec<Facet>,
}

impl Geometry {
    /// Prepares a scene, with or without houses and trees.
    pub(crate) fn new(scene: &Scene, palette_seed: u64, standing: Vec<Standing>) -> Self {
        let patches = ground::layers(&scene.map);
        let heads = scene
            .map
            .traffic_lights
            .iter()
            .map(|light| Head { light: light.clone(), facets: housing(light, &patches) });
        Self {
            heads: heads.collect(),
            patches,
            standing,
            tracks: scene.tracks.clone(),
            digest: scene.digest,
            palette_seed,
        }
    }

    /// Returns what stands in a scene.
    pub(crate) fn surroundings(scene: &Scene, palette_seed: u64) -> Vec<Standing> {
        surroundings::dress(scene, palette_seed)
    }

    /// Draws the world into a raster whose background is ready.
    pub(crate) fn draw(&self, world: &WorldState, view: &View, lamps_on: bool, raster: &mut DepthRaster<Surface>) {
        for patch in self.patches.iter().filter(|patch| patch.may_be_seen(view)) {
            for triangle in &patch.triangles {
                view.paint(raster, &triangle.map(|corner| corner.extend(0.0)), patch.surface);
            }
        }
        let mut fill =
            |facets: &[Facet]| facets.iter().for_each(|(corners, surface)| view.fill(raster, corners, *surface));
        for standing in self.standing.iter().filter(|s| view.may_see(s.middle, s.radius_m, RANGE_M)) {
            fill(&standing.facets);
        }
        let mut facets = Vec::new();
        for (i, head) in self.heads.iter().enumerate() {
            if view.may_see(head.light.position, 8.0, RANGE_M) {
                fill(&head.facets);
                let state = world.lights.get(i).copied().unwrap_or(LightState::Unknown);
                lamps(&head.light, state, &mut facets);
            }
        }
        for agent in &world.agents {
            let size = agent.size;
            let radius_m = DVec3::new(size.length_m, size.width_m, size.height_m).length();
            if view.may_see(agent.pose.position.extend(agent.z_m + 0.5 * size.height_m), radius_m, RANGE_M) {
                self.agent(agent, world, lamps_on, &mut facets);
            }
        }
        fill(&facets);
    }

    fn agent(&self, agent: &AgentState, world: &WorldState, lamps_on: bool, facets: &mut Vec<Facet>) {
        let draws = Draws::new(&self.digest, "agent", &[u64::from(agent.id.0), self.palette_seed]);
        match agent.class {
            AgentClass::Vehicle => {
                let lamps = Lamps { on: lamps_on, braking: self.brakes(agent, world) };
                vehicle::add(agent, &draws, lamps, facets);
            }
            AgentClass::Pedestrian => figure::pedestrian(agent, &draws, facets),
            AgentClass::Cyclist => figure::cyclist(agent, &draws, facets),
            AgentClass::Cone => figure::cone(agent, facets),
            AgentClass::Barrier => figure::barrier(agent, facets),
        }
    }

    /// Says whether a vehicle is slower than its recorded self was half a second before, at the same tick.
    fn brakes(&self, agent: &AgentState, world: &WorldState) -> bool {
        let before = ds_space::Tick(world.tick.0.saturating_sub(5));
        let earlier = self.tracks.get(agent.id.0 as usize).and_then(|track| track.at(before));
        earlier.is_some_and(|point| point.velocity_mps.length() > agent.velocity_mps.length() + 0.5)
    }
}

const fn thing(material: Material, colour: [u8; 3]) -> Surface {
    Surface::solid(material, PixelClass::Other, colour)
}

/// Returns housing, pole and, over a road, the arm that holds the head.
fn housing(light: &TrafficLight, patches: &[Patch]) -> Vec<Facet> {
    let mut facets = Vec::new();
    let pose = PoseSe2 { position: light.position.truncate(), heading_rad: light.facing_rad };
    let dark = thing(Material::Matte, [30, 32, 34]);
    let steel = thing(Material::Matte, [112, 116, 118]);
    let z = light.position.z;
    let mut builder = Builder::new(pose, 0.0, &mut facets);
    builder.frustum(Slab::new(z - 0.72, -0.16, 0.12, 0.27), Slab::new(z + 0.72, -0.16, 0.12, 0.27), &Skin::all(dark));
    let side_m = free_side(&pose, patches);
    if side_m.abs() > 0.1 {
        builder.bar(DVec3::new(-0.25, 0.0, z + 0.6), DVec3::new(-0.25, side_m, z + 0.6), 0.06, steel);
    }
    builder.block(Slab::new(0.0, -0.34, -0.18, 0.08).moved_left(side_m), z + 0.68, steel);
    facets
}

/// Returns how far to the left of a head (right negative) its pole stands clear of the road.
fn free_side(pose: &PoseSe2, patches: &[Patch]) -> f64 {
    let near: Vec<&Patch> = patches
        .iter()
        .filter(|patch| patch.surface.material == Material::Asphalt && patch.reaches(pose.position, 20.0))
        .collect();
    let on_road = |left_m: f64| {
        let place = pose.to_outer(DVec2::new(-0.25, left_m));
        near.iter().flat_map(|patch| &patch.triangles).any(|triangle| covers(triangle, place))
    };
    if !on_road(0.0) {
        return 0.0;
    }
    let sides = (1..40).flat_map(|i| [0.5 * f64::from(i), -0.5 * f64::from(i)]);
    let free = sides.into_iter().find(|left_m| !on_road(*left_m));
    free.map_or(0.0, |left_m| left_m + 0.5 * left_m.signum())
}

fn covers([a, b, c]: &[DVec2; 3], p: DVec2) -> bool {
    let sides = [(*b - *a).perp_dot(p - *a), (*c - *b).perp_dot(p - *b), (*a - *c).perp_dot(p - *c)];
    sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)
}

/// Adds the three lamps of a head, the one that is lit shining.
fn lamps(light: &TrafficLight, state: LightState, facets: &mut Vec<Facet>) {
    let pose = PoseSe2 { position: light.position.truncate(), heading_rad: light.facing_rad };
    let mut builder = Builder::new(pose, 0.0, facets);
    let rows = [
        (LightState::Red, 0.46, [255, 36, 28], [58, 14, 12]),
        (LightState::Yellow, 0.0, [255, 176, 20], [58, 42, 10]),
        (LightState::Green, -0.46, [40, 255, 130], [10, 52, 30]),
    ];
    for (shows, up, lit, unlit) in rows {
        let surface = if shows == state { thing(Material::Lamp, lit) } else { thing(Material::Matte, unlit) };
        builder.disc_x(DVec3::new(0.15, 0.0, light.position.z + up), LAMP_RADIUS_M, surface);
    }
}
