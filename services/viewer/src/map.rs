//! The still part of a scene for the viewer: map lines, crosswalks, stop lines and the route, logged once.
//!
//! World frame, metres. Only what lies near the route is shown, so that the viewer's first look is at the drive.

use ds_space::DVec2;
use ds_world::map::{LaneKind, LineColour};
use ds_world::{Map, Scene};
use rerun::{LineStrips3D, RecordingStream, RecordingStreamResult};

/// How far beside the route the map is shown, in metres.
const MARGIN_M: f64 = 60.0;
/// Heights of the layers, in metres, so that they do not flicker through each other.
const EDGE_M: f32 = 0.02;
const PAINT_M: f32 = 0.03;
const ROUTE_M: f32 = 0.04;

/// The rectangle around the route and the logged drive, with its margin.
struct Extent {
    least: DVec2,
    most: DVec2,
}

impl Extent {
    fn of(scene: &Scene) -> Self {
        let driven = scene.ego_log.iter().map(|state| state.pose.position);
        let mut extent = Self { least: DVec2::INFINITY, most: DVec2::NEG_INFINITY };
        for point in driven {
            extent.least = extent.least.min(point - MARGIN_M);
            extent.most = extent.most.max(point + MARGIN_M);
        }
        extent
    }

    fn touches(&self, points: &[DVec2]) -> bool {
        points.iter().any(|point| point.cmpge(self.least).all() && point.cmple(self.most).all())
    }
}

/// Lines of one look.
struct Lines<'a> {
    path: &'a str,
    height_m: f32,
    radius_m: f32,
    colour: [u8; 3],
}

/// Logs the still part of a scene.
pub(crate) fn log(scene: &Scene, stream: &RecordingStream) -> RecordingStreamResult<()> {
    stream.log_static("world", &rerun::ViewCoordinates::RIGHT_HAND_Z_UP())?;
    let (map, extent) = (&scene.map, Extent::of(scene));
    lanes(map, &extent, stream)?;
    let edges = map.road_edges.iter().map(|edge| edge.points.clone()).collect();
    let look = Lines { path: "world/map/edges", height_m: EDGE_M, radius_m: 0.08, colour: [190, 192, 198] };
    look.log(edges, &extent, stream)?;
    for (path, colour, rgb) in [
        ("world/map/lines/white", LineColour::White, [235, 235, 235]),
        ("world/map/lines/yellow", LineColour::Yellow, [232, 190, 60]),
    ] {
        let lines = map.line_markings.iter().filter(|line| line.colour == colour);
        let look = Lines { path, height_m: PAINT_M, radius_m: 0.06, colour: rgb };
        look.log(lines.map(|line| line.points.clone()).collect(), &extent, stream)?;
    }
    let crosswalks = map.crosswalks.iter().map(|crosswalk| closed(&crosswalk.polygon)).collect();
    let look = Lines { path: "world/map/crosswalks", height_m: PAINT_M, radius_m: 0.1, colour: [200, 200, 170] };
    look.log(crosswalks, &extent, stream)?;
    let route = Lines { path: "world/map/route", height_m: ROUTE_M, radius_m: 0.12, colour: [70, 130, 165] };
    route.log(vec![scene.route.clone()], &extent, stream)
}

fn lanes(map: &Map, extent: &Extent, stream: &RecordingStream) -> RecordingStreamResult<()> {
    for (path, kind, colour) in [
        ("world/map/lanes", LaneKind::Road, [90, 96, 110]),
        ("world/map/connectors", LaneKind::Connector, [110, 90, 120]),
    ] {
        let lines = map.lanes.iter().filter(|lane| lane.kind == kind).map(|lane| lane.centre_line.clone()).collect();
        Lines { path, height_m: EDGE_M, radius_m: 0.04, colour }.log(lines, extent, stream)?;
    }
    Ok(())
}

fn closed(polygon: &[DVec2]) -> Vec<DVec2> {
    polygon.iter().chain(polygon.first()).copied().collect()
}

impl Lines<'_> {
    fn log(&self, lines: Vec<Vec<DVec2>>, extent: &Extent, stream: &RecordingStream) -> RecordingStreamResult<()> {
        let near = lines.iter().filter(|line| extent.touches(line));
        let strips: Vec<Vec<[f32; 3]>> = near.map(|line| strip(line, self.height_m)).collect();
        let lines = LineStrips3D::new(strips).with_radii([self.radius_m]).with_colors([self.colour]);
        stream.log_static(self.path, &lines)
    }
}

/// Returns points of the plane at a height, in the viewer's single precision.
#[expect(clippy::cast_possible_truncation, reason = "the viewer works in single precision")]
pub(crate) fn strip(points: &[DVec2], height_m: f32) -> Vec<[f32; 3]> {
    points.iter().map(|point| [point.x as f32, point.y as f32, height_m]).collect()
}
