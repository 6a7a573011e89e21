//! The ground of this world: concrete roads with cobbled strips, wide pale lines, crosswalks as framed ladders.
//!
//! Made of the same map as the layout, so that both show the same lanes; painted in the order of the list.

use ds_raster::shape::{self, Triangle};
use ds_raster::{PixelClass, View};
use ds_space::DVec2;
use ds_world::{LineColour, LineKind, Map};

use crate::material::{Paint, Stuff};

const RANGE_M: f64 = 140.0;

/// Triangles of one paint with the circle around them.
#[derive(Debug, Clone)]
pub(crate) struct Layer {
    centre: DVec2,
    radius_m: f64,
    pub(crate) paint: Paint,
    pub(crate) triangles: Vec<Triangle>,
}

impl Layer {
    pub(crate) fn may_be_seen(&self, view: &View) -> bool {
        view.may_see(self.centre.extend(0.0), self.radius_m, RANGE_M)
    }
}

fn add(layers: &mut Vec<Layer>, paint: Paint, triangles: &[Triangle]) {
    for part in triangles.chunks(32) {
        let corners = || part.iter().flatten().copied();
        let (Some(low), Some(high)) = (corners().reduce(DVec2::min), corners().reduce(DVec2::max)) else { continue };
        let (centre, radius_m) = (0.5 * (low + high), 0.5 * low.distance(high));
        layers.push(Layer { centre, radius_m, paint, triangles: part.to_vec() });
    }
}

/// Makes the layers of a map.
pub(crate) fn layers(map: &Map) -> Vec<Layer> {
    let mut layers = Vec::new();
    let road = Paint::new(Stuff::Slabs, PixelClass::Road, [138, 136, 130]);
    let gutter = Paint::new(Stuff::Cobbles, PixelClass::Other, [122, 112, 104]);
    let rim = Paint::new(Stuff::Plain, PixelClass::Other, [92, 90, 88]);
    let lanes = || map.lanes.iter().map(|lane| &lane.polygon);
    let surfaces: Vec<_> =
        if map.drivable.is_empty() { lanes().chain(&map.junctions).collect() } else { map.drivable.iter().collect() };
    for (paint, width_m) in [(gutter, 7.0), (rim, 0.9)] {
        for polygon in surfaces.iter().filter(|polygon| polygon.len() > 2) {
            add(&mut layers, paint, &shape::outline(polygon, width_m));
        }
    }
    for polygon in surfaces.iter().filter(|polygon| polygon.len() > 2) {
        add(&mut layers, road, &shape::triangulate(polygon));
    }
    let mark = |tint| Paint::new(Stuff::Marking, PixelClass::Paint, tint);
    let white = mark([246, 244, 236]);
    for crosswalk in &map.crosswalks {
        ladder(&mut layers, &crosswalk.polygon, white);
    }
    for stop in &map.stop_lines {
        // Shark-like teeth would hide the place of the line: a bar of two strips keeps it.
        for left_m in [0.14, -0.14] {
            add(&mut layers, white, &shape::ribbon(&shape::shifted(&stop.points, left_m), 0.2));
        }
    }
    for line in &map.line_markings {
        let paint = mark(match line.colour {
            LineColour::White => [246, 244, 236],
            LineColour::Yellow => [236, 160, 60],
        });
        match line.kind {
            LineKind::Solid => add(&mut layers, paint, &shape::ribbon(&line.points, 0.2)),
            LineKind::Double => {
                for left_m in [0.13, -0.13] {
                    add(&mut layers, paint, &shape::ribbon(&shape::shifted(&line.points, left_m), 0.12));
                }
            }
            LineKind::Dashed => {
                let dashes = shape::dashes(&line.points, 2.0, 4.0);
                let strips: Vec<Triangle> = dashes.iter().flat_map(|dash| shape::ribbon(dash, 0.18)).collect();
                add(&mut layers, paint, &strips);
            }
        }
    }
    layers
}

/// Draws a crosswalk: its outline and rungs across its long side, a metre apart.
fn ladder(layers: &mut Vec<Layer>, polygon: &[DVec2], paint: Paint) {
    let edges = (0..polygon.len()).map(|i| (polygon[i], polygon[(i + 1) % polygon.len()]));
    let Some((from, to)) = edges.max_by(|a, b| a.0.distance(a.1).total_cmp(&b.0.distance(b.1))) else { return };
    let Some(along) = (to - from).try_normalize() else { return };
    let across = along.perp();
    let reach = |direction: DVec2| {
        let places = || polygon.iter().map(|point| (*point - from).dot(direction));
        (places().fold(f64::MAX, f64::min), places().fold(f64::MIN, f64::max))
    };
    let ((start, end), (low, high)) = (reach(along), reach(across));
    let line = |a: f64, b: f64, c: f64, d: f64| [from + along * a + across * b, from + along * c + across * d];
    for side in [low + 0.15, high - 0.15] {
        add(layers, paint, &shape::ribbon(&line(start, side, end, side), 0.25));
    }
    let mut at = start + 0.5;
    while at < end && end - start < 120.0 {
        add(layers, paint, &shape::ribbon(&line(at, low, at, high), 0.4));
        at += 1.0;
    }
}
