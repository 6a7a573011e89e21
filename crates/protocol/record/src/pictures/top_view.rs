//! The top-down view: map, route, agents, ego, plan and proposals around the ego, its heading upwards.
//!
//! World coordinates in metres go to pixels by turning about the rig; the ego stands in the lower third. Drawn at twice
//! the size and halved, so that edges are smooth. Ground layers are painted in order; nothing is hidden by height.

use ds_raster::shape::{self, Triangle};
use ds_raster::{DepthRaster, RgbImage, ScreenPoint};
use ds_space::{AgentId, DVec2, PoseSe2};
use ds_world::agent::AgentClass;
use ds_world::map::{LightState, LineColour, LineKind};
use ds_world::{Scene, StructureKind, Trajectory};

use crate::error::RecordError;
use crate::pictures::Moment;
use crate::pictures::canvas::halved;

/// Width of the ground that is shown, in metres.
const WIDTH_M: f64 = 42.0;
/// Smaller agents are drawn as if they had this size, in metres.
const SMALLEST_M: f64 = 0.9;
/// Where the ego stands, as a share of the height from the top.
const EGO_ROW: f64 = 0.72;

const GROUND: [u8; 3] = [36, 40, 38];
const ROAD: [u8; 3] = [70, 72, 78];
const CROSSWALK: [u8; 3] = [108, 108, 104];
const EDGE: [u8; 3] = [140, 142, 148];
const WHITE: [u8; 3] = [214, 214, 214];
const YELLOW: [u8; 3] = [216, 178, 60];
const ROUTE: [u8; 3] = [58, 98, 122];
const PATH: [u8; 3] = [44, 150, 92];
const PLAN: [u8; 3] = [255, 150, 40];
const PROPOSAL: [u8; 3] = [150, 112, 160];
const ADVERSARY: [u8; 3] = [214, 84, 214];
const EGO: [u8; 3] = [64, 222, 128];
const CONTACT: [u8; 3] = [240, 40, 40];
const WINDSCREEN: [u8; 3] = [24, 28, 32];

/// Returns the colour of a class of agents in every picture.
#[must_use]
pub fn class_colour(class: AgentClass) -> [u8; 3] {
    match class {
        AgentClass::Vehicle => [84, 148, 255],
        AgentClass::Pedestrian => [255, 92, 120],
        AgentClass::Cyclist => [255, 196, 64],
        AgentClass::Cone => [232, 120, 40],
        AgentClass::Barrier => [176, 168, 150],
    }
}

/// Returns the colour of a light in every picture.
#[must_use]
pub fn light_colour(state: LightState) -> [u8; 3] {
    match state {
        LightState::Unknown => [150, 150, 150],
        LightState::Red => [240, 50, 50],
        LightState::Yellow => [250, 200, 50],
        LightState::Green => [60, 210, 90],
    }
}

/// Returns the colour of what stands beside the road: little more than the ground, for it is not what a drive is about.
fn structure_colour(kind: StructureKind) -> [u8; 3] {
    match kind {
        StructureKind::Building => [60, 54, 66],
        StructureKind::Vegetation => [42, 60, 42],
        StructureKind::Pole | StructureKind::Fence | StructureKind::Wall => [92, 90, 82],
    }
}

/// The still part of a scene as triangles, in painting order.
pub struct TopView {
    ground: Vec<Patch>,
    stop_lines: Vec<(Option<u32>, Vec<Triangle>)>,
    vehicle: ds_world::VehicleParameters,
    adversary: Option<AgentId>,
}

/// Triangles of one colour, and the circle around them.
struct Patch {
    colour: [u8; 3],
    triangles: Vec<Triangle>,
    centre: DVec2,
    radius_m: f64,
}

impl Patch {
    fn new(colour: [u8; 3], triangles: Vec<Triangle>) -> Self {
        let corners = || triangles.iter().flatten();
        let count = (3 * triangles.len()).max(1) as f64;
        let centre = corners().fold(DVec2::ZERO, |sum, corner| sum + *corner) / count;
        let radius_m = corners().map(|corner| corner.distance(centre)).fold(0.0, f64::max);
        Self { colour, triangles, centre, radius_m }
    }
}

impl TopView {
    /// Cuts the map of a scene into triangles.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let map = &scene.map;
        let mut ground: Vec<Patch> = Vec::new();
        let standing = map.structures.iter();
        ground.extend(standing.map(|s| Patch::new(structure_colour(s.kind), shape::triangulate(&s.outline))));
        let areas = map.drivable.iter().chain(&map.junctions);
        ground.extend(areas.map(|area| Patch::new(ROAD, shape::triangulate(area))));
        ground.extend(map.crosswalks.iter().map(|walk| Patch::new(CROSSWALK, shape::triangulate(&walk.polygon))));
        ground.push(Patch::new(ROUTE, shape::ribbon(&scene.route, 0.7)));
        ground.extend(map.road_edges.iter().map(|edge| Patch::new(EDGE, shape::ribbon(&edge.points, 0.25))));
        for line in &map.line_markings {
            let colour = if line.colour == LineColour::Yellow { YELLOW } else { WHITE };
            let strips = match line.kind {
                LineKind::Dashed => shape::dashes(&line.points, 3.0, 3.0),
                LineKind::Solid | LineKind::Double => vec![line.points.clone()],
            };
            let width_m = if line.kind == LineKind::Double { 0.4 } else { 0.2 };
            let triangles = strips.iter().flat_map(|strip| shape::ribbon(strip, width_m)).collect();
            ground.push(Patch::new(colour, triangles));
        }
        let stop_lines = map.stop_lines.iter().map(|line| (line.light, shape::ribbon(&line.points, 0.5))).collect();
        let adversary = scene.adversary.as_ref().map(|adversary| adversary.track);
        Self { ground, stop_lines, vehicle: scene.vehicle, adversary }
    }

    /// Draws a moment; `past` is the way driven so far, in world metres.
    pub(crate) fn draw(
        &self,
        moment: &Moment,
        past: &[DVec2],
        width_px: u32,
        height_px: u32,
    ) -> Result<RgbImage, RecordError> {
        let ego = moment.state.ego.pose;
        let mut sheet = Sheet::new(&ego, 2 * width_px, 2 * height_px)?;
        for patch in &self.ground {
            if patch.centre.distance(sheet.centre) < patch.radius_m + sheet.reach_m {
                sheet.paint(&patch.triangles, patch.colour);
            }
        }
        for (light, triangles) in &self.stop_lines {
            let state = light.and_then(|light| moment.state.lights.get(light as usize));
            sheet.paint(triangles, state.map_or(WHITE, |state| light_colour(*state)));
        }
        sheet.paint(&shape::ribbon(past, 0.5), PATH);
        if let Some((made_at, plan)) = &moment.plan {
            for proposal in &plan.proposals {
                sheet.paint(&shape::ribbon(&in_world(made_at, &proposal.trajectory), 0.25), PROPOSAL);
            }
            sheet.paint(&shape::ribbon(&in_world(made_at, &plan.trajectory), 0.5), PLAN);
        }
        for agent in &moment.state.agents {
            let colour = if self.adversary == Some(agent.id) { ADVERSARY } else { class_colour(agent.class) };
            sheet.body(&agent.pose, agent.size.length_m.max(SMALLEST_M), agent.size.width_m.max(SMALLEST_M), colour);
        }
        let colour = if moment.state.contacts.is_empty() { EGO } else { CONTACT };
        let size = self.vehicle.size;
        sheet.body(&moment.state.ego.centre(&self.vehicle), size.length_m, size.width_m, colour);
        sheet.finish()
    }
}

/// Returns a trajectory, from the rig on, in world metres.
#[must_use]
pub fn in_world(made_at: &PoseSe2, trajectory: &Trajectory) -> Vec<DVec2> {
    let points = trajectory.points().iter().map(|point| made_at.to_outer(point.pose.position));
    std::iter::once(made_at.position).chain(points).collect()
}

/// The picture while it is painted.
struct Sheet {
    raster: DepthRaster<[u8; 3]>,
    origin: DVec2,
    right: DVec2,
    forward: DVec2,
    px_per_m: f64,
    ego_px: DVec2,
    /// The middle of the picture, in world metres.
    centre: DVec2,
    /// From the middle to a corner, in metres.
    reach_m: f64,
}

impl Sheet {
    fn new(ego: &PoseSe2, width_px: u32, height_px: u32) -> Result<Self, RecordError> {
        let (width, height) = (f64::from(width_px), f64::from(height_px));
        let px_per_m = width / WIDTH_M;
        let ahead_m = (EGO_ROW - 0.5) * height / px_per_m;
        Ok(Self {
            raster: DepthRaster::new(width_px, height_px, GROUND)?,
            origin: ego.position,
            right: -ego.left(),
            forward: ego.forward(),
            px_per_m,
            ego_px: DVec2::new(0.5 * width, EGO_ROW * height),
            centre: ego.position + ego.forward() * ahead_m,
            reach_m: 0.5 * width.hypot(height) / px_per_m,
        })
    }

    fn paint(&mut self, triangles: &[Triangle], colour: [u8; 3]) {
        for triangle in triangles {
            let corners = triangle.map(|point| {
                let from_ego = (point - self.origin) * self.px_per_m;
                ScreenPoint {
                    x_px: self.ego_px.x + from_ego.dot(self.right),
                    y_px: self.ego_px.y - from_ego.dot(self.forward),
                    inverse_depth: 1.0,
                }
            });
            self.raster.paint(&corners, colour);
        }
    }

    /// A box with a darker band behind its front, so that its direction can be seen.
    fn body(&mut self, centre: &PoseSe2, length_m: f64, width_m: f64, colour: [u8; 3]) {
        let corners = ds_world::agent::corners(centre, length_m, width_m);
        self.paint(&shape::fan(&corners).collect::<Vec<_>>(), colour);
        if length_m > 2.5 {
            let at = centre.to_outer(DVec2::new(0.18 * length_m, 0.0));
            let band = PoseSe2 { position: at, heading_rad: centre.heading_rad };
            let corners = ds_world::agent::corners(&band, 0.12 * length_m, 0.8 * width_m);
            self.paint(&shape::fan(&corners).collect::<Vec<_>>(), WINDSCREEN);
        }
    }

    fn finish(self) -> Result<RgbImage, RecordError> {
        let rgb = self.raster.values().as_flattened().to_vec();
        let (width, height) = (self.raster.width(), self.raster.height());
        let side = |value: usize| u32::try_from(value).unwrap_or(u32::MAX);
        Ok(halved(&RgbImage::new(side(width), side(height), rgb)?))
    }
}
