//! The ground as layers of triangles: sidewalk, kerb, road, tyre tracks, crosswalk bars, stop lines, lane paint.
//!
//! World plane, metres; painted in the order of the list. What no triangle covers is the verge.

use ds_raster::View;
use ds_raster::shape::{self, Triangle};
use ds_space::DVec2;
use ds_world::{LineColour, LineKind, Map};

use crate::surface::{Material, PixelClass, Rgb, Surface};

/// How far from the camera the ground layers are drawn, in metres.
const RANGE_M: f64 = 140.0;
const SIDEWALK_M: f64 = 2.6;
const KERB_M: f64 = 0.22;
const LINE_WIDTH_M: f64 = 0.15;
const STOP_LINE_WIDTH_M: f64 = 0.4;
/// Half the distance between the wheels of passing cars.
const TRACK_M: f64 = 0.8;
const BAR_M: f64 = 0.5;

const ASPHALT: Rgb = [98, 98, 101];
/// Where wheels pass.
pub(crate) const TRACKS: Rgb = [88, 88, 91];
const WHITE: Rgb = [232, 232, 228];
const YELLOW: Rgb = [226, 178, 48];

/// Triangles of one surface, with the circle that holds them.
#[derive(Debug, Clone)]
pub(crate) struct Patch {
    centre: DVec2,
    radius_m: f64,
    pub(crate) surface: Surface,
    pub(crate) triangles: Vec<Triangle>,
}

impl Patch {
    pub(crate) fn may_be_seen(&self, view: &View) -> bool {
        view.may_see(self.centre.extend(0.0), self.radius_m, RANGE_M)
    }

    /// Says whether a part may lie within a distance of a place.
    pub(crate) fn reaches(&self, place: DVec2, distance_m: f64) -> bool {
        self.centre.distance(place) <= self.radius_m + distance_m
    }
}

struct Layers(Vec<Patch>);

impl Layers {
    fn add(&mut self, surface: Surface, triangles: Vec<Triangle>) {
        let low = triangles.iter().flatten().copied().reduce(DVec2::min);
        let high = triangles.iter().flatten().copied().reduce(DVec2::max);
        let (Some(low), Some(high)) = (low, high) else { return };
        self.0.push(Patch { centre: 0.5 * (low + high), radius_m: 0.5 * low.distance(high), surface, triangles });
    }

    /// Adds triangles in parts, so that far ones can be left out.
    fn parts(&mut self, surface: Surface, triangles: &[Triangle]) {
        for part in triangles.chunks(24) {
            self.add(surface, part.to_vec());
        }
    }

    fn strip(&mut self, surface: Surface, points: &[DVec2], width_m: f64) {
        self.parts(surface, &shape::ribbon(points, width_m));
    }
}

/// Makes the layers of a map.
pub(crate) fn layers(map: &Map) -> Vec<Patch> {
    let mut layers = Layers(Vec::new());
    let road = Surface::ground(Material::Asphalt, PixelClass::Road, ASPHALT);
    let lanes = || map.lanes.iter().map(|lane| &lane.polygon);
    let all: Vec<_> =
        if map.drivable.is_empty() { lanes().chain(&map.junctions).collect() } else { map.drivable.iter().collect() };
    let surfaces = || all.iter().filter(|polygon| polygon.len() >= 3);
    // A wide outline under the road leaves a sidewalk along its outer border only.
    for (material, colour, width_m) in
        [(Material::Sidewalk, [150, 146, 140], SIDEWALK_M + KERB_M), (Material::Kerb, [172, 170, 164], KERB_M)]
    {
        for polygon in surfaces() {
            let border = Surface::ground(material, PixelClass::Other, colour);
            layers.parts(border, &shape::outline(polygon, 2.0 * width_m));
        }
    }
    for polygon in surfaces() {
        layers.add(road, shape::triangulate(polygon));
    }
    let worn = Surface { colour: TRACKS, ..road };
    for lane in &map.lanes {
        for left_m in [TRACK_M, -TRACK_M] {
            layers.strip(worn, &shape::shifted(&lane.centre_line, left_m), 0.45);
        }
    }
    let paint = |colour| Surface::ground(Material::Paint, PixelClass::Paint, colour);
    for crosswalk in &map.crosswalks {
        layers.add(paint(WHITE), bars(&crosswalk.polygon));
    }
    for line in &map.stop_lines {
        layers.strip(paint(WHITE), &line.points, STOP_LINE_WIDTH_M);
    }
    for marking in &map.line_markings {
        let surface = paint(match marking.colour {
            LineColour::White => WHITE,
            LineColour::Yellow => YELLOW,
        });
        match marking.kind {
            LineKind::Solid => layers.strip(surface, &marking.points, LINE_WIDTH_M),
            LineKind::Double => {
                for left_m in [0.16, -0.16] {
                    layers.strip(surface, &shape::shifted(&marking.points, left_m), LINE_WIDTH_M);
                }
            }
            LineKind::Dashed => {
                let dashes = shape::dashes(&marking.points, 3.0, 4.5);
                let triangles: Vec<Triangle> = dashes.iter().flat_map(|d| shape::ribbon(d, LINE_WIDTH_M)).collect();
                layers.parts(surface, &triangles);
            }
        }
    }
    layers.0
}

/// Cuts a crosswalk into bars across its long side.
fn bars(polygon: &[DVec2]) -> Vec<Triangle> {
    let edge = |i: usize| polygon[(i + 1) % polygon.len()] - polygon[i];
    let longest = (0..polygon.len()).map(edge).max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    let Some(along) = longest.and_then(DVec2::try_normalize) else { return Vec::new() };
    let reach = |triangle: &Triangle| triangle.map(|corner| corner.dot(along));
    let mut cut = Vec::new();
    for triangle in shape::triangulate(polygon) {
        let places = reach(&triangle);
        let (low, high) =
            (places.iter().copied().fold(f64::MAX, f64::min), places.iter().copied().fold(f64::MIN, f64::max));
        let mut from = (low / (2.0 * BAR_M)).floor() * 2.0 * BAR_M;
        while from < high && cut.len() < 4096 {
            let slab = between(&triangle, along, from, from + BAR_M);
            cut.extend(shape::fan(&slab));
            from += 2.0 * BAR_M;
        }
    }
    cut
}

/// Returns the part of a triangle with `low` ≤ p·along ≤ `high`.
fn between(triangle: &Triangle, along: DVec2, low: f64, high: f64) -> Vec<DVec2> {
    let above = clip(triangle, |p| p.dot(along) - low);
    clip(&above, |p| high - p.dot(along))
}

/// Keeps the part of a convex polygon where `side` is not negative.
fn clip(polygon: &[DVec2], side: impl Fn(DVec2) -> f64) -> Vec<DVec2> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, from) in polygon.iter().enumerate() {
        let to = polygon[(i + 1) % polygon.len()];
        let (a, b) = (side(*from), side(to));
        if a >= 0.0 {
            kept.push(*from);
        }
        if (a >= 0.0) != (b >= 0.0) {
            kept.push(from.lerp(to, a / (a - b)));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_cover_half_of_a_crosswalk() {
        let polygon = [(0.0, 0.0), (10.0, 0.0), (10.0, 3.0), (0.0, 3.0)].map(|(x, y)| DVec2::new(x, y));
        let area: f64 = bars(&polygon).iter().map(|t| shape::signed_area(t).abs()).sum();
        assert!((area - 15.0).abs() < 1e-9, "{area}");
    }
}
