//! The scene description that both back ends draw: the map's ground layers and structures as triangles, made once, and
//! per tick the stop lines, light heads and boxes. World frame, metres.

use ds_raster::View;
use ds_raster::shape::{self, Triangle};
use ds_space::{CameraModel, DVec2, DVec3, Digest, DigestWriter, Pose, PoseSe2, Rig, World};
use ds_world::{
    AgentClass, AgentState, LaneKind, LightState, LineKind, LineMarking, Map, StopLine, Structure, StructureKind,
    TrafficLight, WorldState,
};

use crate::colour::{self, Face, Rgb};

/// How far from the camera map and boxes are drawn, in metres.
pub const RANGE_M: f64 = 100.0;
/// How far from the camera structures are drawn, in metres: they rise above what lies before them.
const STRUCTURE_RANGE_M: f64 = 160.0;

const LINE_WIDTH_M: f64 = 0.18;
const DOUBLE_LINE_OFFSET_M: f64 = 0.16;
const CENTRE_LINE_WIDTH_M: f64 = 0.12;
const ROAD_EDGE_WIDTH_M: f64 = 0.25;
const STOP_LINE_WIDTH_M: f64 = 0.5;
const DASH_M: f64 = 3.0;
const GAP_M: f64 = 4.5;
/// Length, width and height of a drawn light head.
const HEAD_M: [f64; 3] = [0.4, 0.5, 1.1];
/// How wide a cone's top is, of its foot.
const CONE_TOP: f64 = 0.15;

/// Triangles of one colour in one layer, with the circle that holds them.
#[derive(Debug, Clone)]
pub(crate) struct Piece {
    pub(crate) centre: DVec2,
    pub(crate) radius_m: f64,
    pub(crate) colour: Rgb,
    pub(crate) triangles: Vec<Triangle>,
}

impl Piece {
    pub(crate) fn may_be_seen(&self, view: &View) -> bool {
        view.may_see(self.centre.extend(0.0), self.radius_m, RANGE_M)
    }
}

/// The ground layers of a map, triangulated, in the order in which they are painted.
#[derive(Debug, Clone)]
pub struct StaticMap {
    pub(crate) pieces: Vec<Piece>,
    pub(crate) stop_lines: Vec<StopLine>,
    pub(crate) heads: Vec<TrafficLight>,
    standing: Vec<Standing>,
    pub(crate) digest: Digest,
}

/// A structure as triangles, with the ball that holds it.
#[derive(Debug, Clone)]
struct Standing {
    middle: DVec3,
    radius_m: f64,
    solids: Vec<Solid>,
}

impl Standing {
    fn new(structure: &Structure) -> Self {
        let colour = colour::structure(structure.kind);
        let (top, side) = (colour::face(colour, Face::Top), colour::face(colour, Face::Side));
        let (low, high) = (structure.bottom_m, structure.top_m);
        let mut solids = Vec::new();
        for (i, a) in structure.outline.iter().enumerate() {
            let b = structure.outline[(i + 1) % structure.outline.len()];
            let shade = if i % 2 == 1 || structure.kind == StructureKind::Vegetation { side } else { colour };
            let [a, b, c, d] = [a.extend(low), b.extend(low), b.extend(high), a.extend(high)];
            solids.extend([([a, b, c], shade), ([a, c, d], shade)]);
        }
        for triangle in shape::triangulate(&structure.outline) {
            solids.push((triangle.map(|corner| corner.extend(high)), top));
            if low > 0.0 {
                solids.push((triangle.map(|corner| corner.extend(low)), side));
            }
        }
        let (middle, radius_m) = structure.ball();
        Self { middle, radius_m, solids }
    }
}

impl StaticMap {
    /// Triangulates a map.
    #[must_use]
    pub fn new(map: &Map) -> Self {
        Self { standing: map.structures.iter().map(Standing::new).collect(), ..Self::bare(map) }
    }

    /// Triangulates a map without what stands beside the road.
    #[must_use]
    pub fn bare(map: &Map) -> Self {
        let mut layers = Layers(Vec::new());
        for polygon in &map.drivable {
            layers.add(colour::DRIVABLE, shape::triangulate(polygon));
        }
        for polygon in &map.junctions {
            layers.add(colour::JUNCTION, shape::triangulate(polygon));
        }
        for lane in map.lanes.iter().filter(|lane| lane.kind == LaneKind::Road) {
            layers.add(colour::LANE, shape::triangulate(&lane.polygon));
        }
        for crosswalk in &map.crosswalks {
            layers.add(colour::CROSSWALK, shape::triangulate(&crosswalk.polygon));
        }
        for lane in &map.lanes {
            layers.strip(colour::CENTRE_LINE, &lane.centre_line, CENTRE_LINE_WIDTH_M);
        }
        for edge in &map.road_edges {
            layers.strip(colour::ROAD_EDGE, &edge.points, ROAD_EDGE_WIDTH_M);
        }
        for marking in &map.line_markings {
            layers.marking(marking);
        }
        let digest = digest(&layers.0);
        Self {
            pieces: layers.0,
            stop_lines: map.stop_lines.clone(),
            heads: map.traffic_lights.clone(),
            standing: Vec::new(),
            digest,
        }
    }
}

struct Layers(Vec<Piece>);

impl Layers {
    fn add(&mut self, colour: Rgb, triangles: Vec<Triangle>) {
        let corners = || triangles.iter().flatten();
        let low = corners().copied().reduce(DVec2::min);
        let high = corners().copied().reduce(DVec2::max);
        let (Some(low), Some(high)) = (low, high) else { return };
        self.0.push(Piece { centre: 0.5 * (low + high), radius_m: 0.5 * low.distance(high), colour, triangles });
    }

    /// Adds a ribbon in parts of 16 segments, so that far parts can be left out.
    fn strip(&mut self, colour: Rgb, points: &[DVec2], width_m: f64) {
        for part in shape::ribbon(points, width_m).chunks(32) {
            self.add(colour, part.to_vec());
        }
    }

    fn marking(&mut self, marking: &LineMarking) {
        let colour = colour::line(marking.colour);
        match marking.kind {
            LineKind::Solid => self.strip(colour, &marking.points, LINE_WIDTH_M),
            LineKind::Double => {
                for left_m in [DOUBLE_LINE_OFFSET_M, -DOUBLE_LINE_OFFSET_M] {
                    self.strip(colour, &shape::shifted(&marking.points, left_m), LINE_WIDTH_M);
                }
            }
            LineKind::Dashed => {
                let dashes = shape::dashes(&marking.points, DASH_M, GAP_M);
                for part in dashes.chunks(6) {
                    self.add(colour, part.iter().flat_map(|dash| shape::ribbon(dash, LINE_WIDTH_M)).collect());
                }
            }
        }
    }
}

fn digest(pieces: &[Piece]) -> Digest {
    let mut writer = DigestWriter::new();
    for piece in pieces {
        writer.raw(&piece.colour).u64(piece.triangles.len() as u64);
        for corner in piece.triangles.iter().flatten() {
            writer.f64s(&[corner.x, corner.y]);
        }
    }
    writer.finish()
}

/// What one layout image shows: the map and the state of the world at a tick.
#[derive(Debug, Clone, Copy)]
pub struct LayoutScene<'a> {
    /// The map's ground layers.
    pub map: &'a StaticMap,
    /// Agents and lights; the ego is not drawn.
    pub world: &'a WorldState,
}

/// One picture to render: what, through which camera, from where.
#[derive(Debug, Clone, Copy)]
pub struct Shot<'a> {
    /// Map and world.
    pub scene: LayoutScene<'a>,
    /// The camera.
    pub camera: &'a CameraModel,
    /// Where the rig stands.
    pub world_from_rig: Pose<World, Rig>,
}

/// A coloured world triangle.
pub(crate) type Solid = ([DVec3; 3], Rgb);

impl LayoutScene<'_> {
    /// Returns the triangles that change with time and lie on the ground, in painting order.
    pub(crate) fn ground(&self, view: &View) -> Vec<Solid> {
        let mut solids = Vec::new();
        for line in &self.map.stop_lines {
            let [from, to] = line.points;
            if view.may_see(from.midpoint(to).extend(0.0), from.distance(to), RANGE_M) {
                let state = line.light.map_or(LightState::Unknown, |light| self.light(light as usize));
                let strip = shape::ribbon(&line.points, STOP_LINE_WIDTH_M);
                solids.extend(strip.iter().map(|t| (t.map(|p| p.extend(0.0)), colour::light(state))));
            }
        }
        solids
    }

    /// Returns the triangles of structures, light heads and boxes.
    pub(crate) fn solids(&self, view: &View) -> Vec<Solid> {
        let mut solids = Vec::new();
        for standing in &self.map.standing {
            if view.may_see(standing.middle, standing.radius_m, STRUCTURE_RANGE_M) {
                let away = standing.middle.distance(view.origin()) / STRUCTURE_RANGE_M;
                let dimmed = |(corners, colour): &Solid| (*corners, colour::dimmed(*colour, away));
                solids.extend(standing.solids.iter().map(dimmed));
            }
        }
        for (i, head) in self.map.heads.iter().enumerate() {
            if view.may_see(head.position, 1.0, RANGE_M) {
                let pose = PoseSe2 { position: head.position.truncate(), heading_rad: head.facing_rad };
                let bottom_m = head.position.z - 0.5 * HEAD_M[2];
                frustum(&mut solids, &pose, bottom_m, HEAD_M, 1.0, colour::light(self.light(i)));
            }
        }
        for agent in &self.world.agents {
            let size = [agent.size.length_m, agent.size.width_m, agent.size.height_m];
            if view.may_see(middle(agent), 0.5 * DVec3::from_array(size).length(), RANGE_M) {
                let top = if agent.class == AgentClass::Cone { CONE_TOP } else { 1.0 };
                frustum(&mut solids, &agent.pose, agent.z_m, size, top, colour::agent(agent.class));
            }
        }
        solids
    }

    fn light(&self, index: usize) -> LightState {
        self.world.lights.get(index).copied().unwrap_or(LightState::Unknown)
    }
}

fn middle(agent: &AgentState) -> DVec3 {
    agent.pose.position.extend(agent.z_m + 0.5 * agent.size.height_m)
}

/// Adds the five visible faces of an upright box whose top is as wide as `top` of its foot, shaded by face.
fn frustum(solids: &mut Vec<Solid>, pose: &PoseSe2, bottom_m: f64, size: [f64; 3], top: f64, colour: Rgb) {
    let [length, width, height] = size;
    let corner = |x: f64, y: f64, z: f64| {
        let reach = 0.5 * (1.0 + (top - 1.0) * z);
        pose.to_outer(reach * DVec2::new(length * x, width * y)).extend(bottom_m + height * z)
    };
    let faces = [
        (Face::Front, [(1.0, 1.0, 0.0), (1.0, -1.0, 0.0), (1.0, -1.0, 1.0), (1.0, 1.0, 1.0)]),
        (Face::Rear, [(-1.0, 1.0, 0.0), (-1.0, -1.0, 0.0), (-1.0, -1.0, 1.0), (-1.0, 1.0, 1.0)]),
        (Face::Side, [(-1.0, 1.0, 0.0), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0), (-1.0, 1.0, 1.0)]),
        (Face::Side, [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, -1.0, 1.0), (-1.0, -1.0, 1.0)]),
        (Face::Top, [(-1.0, -1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, 1.0), (-1.0, 1.0, 1.0)]),
    ];
    for (face, corners) in faces {
        let [a, b, c, d] = corners.map(|(x, y, z)| corner(x, y, z));
        let shade = colour::face(colour, face);
        solids.push(([a, b, c], shade));
        solids.push(([a, c, d], shade));
    }
}
