//! Plane curves as dense polylines with stations, headings and curvatures (metres, radians, 1/m).
//!
//! Lanes, routes and the drives of generated traffic are made of these. Beyond either end a path goes on straight.

use crate::{DVec2, PoseSe2, angle};

/// A polyline with at least two distinct points and, at each, its station, heading and curvature.
#[derive(Debug, Clone)]
pub struct Path {
    points: Vec<DVec2>,
    stations_m: Vec<f64>,
    headings_rad: Vec<f64>,
    curvatures_pm: Vec<f64>,
}

/// Where a point lies relative to a path.
#[derive(Debug, Clone, Copy)]
pub struct Foot {
    /// Station of the nearest point of the path, in metres.
    pub station_m: f64,
    /// Distance to the left of the path, in metres.
    pub left_m: f64,
}

impl Path {
    /// Makes a path of points, near-equal neighbours merged; `None` if fewer than two are left.
    #[must_use]
    pub fn new(points: &[DVec2]) -> Option<Self> {
        let mut kept: Vec<DVec2> = Vec::with_capacity(points.len());
        for point in points {
            if kept.last().is_none_or(|last| last.distance(*point) > 1e-3) {
                kept.push(*point);
            }
        }
        if kept.len() < 2 {
            return None;
        }
        let mut stations_m = vec![0.0];
        for pair in kept.windows(2) {
            stations_m.push(stations_m[stations_m.len() - 1] + pair[0].distance(pair[1]));
        }
        let last = kept.len() - 1;
        let mut headings_rad: Vec<f64> = Vec::with_capacity(kept.len());
        for i in 0..=last {
            let along = kept[(i + 1).min(last)] - kept[i.saturating_sub(1)];
            let raw = along.y.atan2(along.x);
            let heading = headings_rad.last().map_or(raw, |before| before + angle::turn(*before, raw));
            headings_rad.push(heading);
        }
        let curvature = |i: usize| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(last));
            (headings_rad[b] - headings_rad[a]) / (stations_m[b] - stations_m[a])
        };
        let curvatures_pm = (0..=last).map(curvature).collect();
        Some(Self { points: kept, stations_m, headings_rad, curvatures_pm })
    }

    /// Returns the points of the path.
    #[must_use]
    pub fn points(&self) -> &[DVec2] {
        &self.points
    }

    /// Returns the whole length, in metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.stations_m[self.stations_m.len() - 1]
    }

    /// Returns the segment of a station and the share of it that lies before the station.
    fn locate(&self, station_m: f64) -> (usize, f64) {
        let after = self.stations_m.partition_point(|s| *s <= station_m);
        let i = after.clamp(1, self.points.len() - 1) - 1;
        (i, (station_m - self.stations_m[i]) / (self.stations_m[i + 1] - self.stations_m[i]))
    }

    /// Returns the point at a station in metres.
    #[must_use]
    pub fn point(&self, station_m: f64) -> DVec2 {
        let (i, share) = self.locate(station_m);
        self.points[i] + (self.points[i + 1] - self.points[i]) * share
    }

    /// Returns the heading at a station, in radians; beyond the ends that of the end.
    #[must_use]
    pub fn heading_rad(&self, station_m: f64) -> f64 {
        let (i, share) = self.locate(station_m);
        self.headings_rad[i] + (self.headings_rad[i + 1] - self.headings_rad[i]) * share.clamp(0.0, 1.0)
    }

    /// Returns the curvature in 1/m, left positive; none beyond the ends.
    #[must_use]
    pub fn curvature_pm(&self, station_m: f64) -> f64 {
        if station_m < 0.0 || station_m > self.length_m() {
            return 0.0;
        }
        let (i, share) = self.locate(station_m);
        self.curvatures_pm[i] + (self.curvatures_pm[i + 1] - self.curvatures_pm[i]) * share
    }

    /// Returns the point and heading at a station in metres.
    #[must_use]
    pub fn pose(&self, station_m: f64) -> PoseSe2 {
        PoseSe2 { position: self.point(station_m), heading_rad: angle::wrap(self.heading_rad(station_m)) }
    }

    /// Returns the same curve moved to the left by a distance in metres.
    #[must_use]
    pub fn offset(&self, left_m: f64) -> Vec<DVec2> {
        let shifted = |i: usize| self.points[i] + DVec2::from_angle(self.headings_rad[i]).perp() * left_m;
        (0..self.points.len()).map(shifted).collect()
    }

    /// Returns the curve with points at equal stations about `step_m` apart.
    #[must_use]
    pub fn even(&self, step_m: f64) -> Self {
        let count = (self.length_m() / step_m).ceil().max(1.0) as usize;
        let step = self.length_m() / count as f64;
        let points: Vec<DVec2> = (0..=count).map(|i| self.point(i as f64 * step)).collect();
        Self::new(&points).unwrap_or_else(|| self.clone())
    }

    /// Returns the curve averaged over `reach_m` to both sides, its ends kept.
    #[must_use]
    pub fn smooth(&self, reach_m: f64) -> Self {
        let even = self.even(0.5);
        let (count, reach) = (even.points.len(), (reach_m / 0.5).round() as usize);
        let mean = |i: usize| {
            let near = reach.min(i).min(count - 1 - i);
            let sum = even.points[i - near..=i + near].iter().fold(DVec2::ZERO, |sum, point| sum + *point);
            sum / (2 * near + 1) as f64
        };
        let points: Vec<DVec2> = (0..count).map(mean).collect();
        Self::new(&points).unwrap_or(even)
    }

    /// Returns the foot of a point on the part of the path between two stations.
    #[must_use]
    pub fn foot(&self, point: DVec2, from_m: f64, to_m: f64) -> Foot {
        let first = self.locate(from_m).0;
        let last = self.locate(to_m).0;
        let mut best = (f64::INFINITY, Foot { station_m: 0.0, left_m: 0.0 });
        for i in first..=last {
            let (a, along) = (self.points[i], self.points[i + 1] - self.points[i]);
            let length = along.length();
            let direction = along / length;
            let reach = (point - a).dot(direction);
            let low = if i == 0 { f64::NEG_INFINITY } else { 0.0 };
            let high = if i + 2 == self.points.len() { f64::INFINITY } else { length };
            let on = reach.clamp(low, high);
            let offset = point - (a + direction * on);
            if offset.length_squared() < best.0 {
                let side = if direction.perp_dot(point - a) < 0.0 { -1.0 } else { 1.0 };
                best = (
                    offset.length_squared(),
                    Foot { station_m: self.stations_m[i] + on, left_m: side * offset.length() },
                );
            }
        }
        best.1
    }

    /// Returns the foot of a point on the whole path.
    #[must_use]
    pub fn nearest(&self, point: DVec2) -> Foot {
        self.foot(point, 0.0, self.length_m())
    }
}

/// Draws a curve of (length in m, curvature in 1/m) pieces from a pose; curvature changes by at most 0.0015 per metre.
#[must_use]
pub fn trace(start: PoseSe2, pieces: &[(f64, f64)]) -> Vec<DVec2> {
    const STEP_M: f64 = 1.0;
    const CHANGE_PM2: f64 = 0.0015;
    let (mut position, mut heading, mut curvature) = (start.position, start.heading_rad, 0.0f64);
    let mut points = vec![position];
    for (length_m, wanted) in pieces {
        for _ in 0..(length_m / STEP_M).round() as usize {
            curvature += (wanted - curvature).clamp(-CHANGE_PM2 * STEP_M, CHANGE_PM2 * STEP_M);
            position += DVec2::from_angle(heading + 0.5 * curvature * STEP_M) * STEP_M;
            heading += curvature * STEP_M;
            points.push(position);
        }
    }
    points
}

/// Draws a cubic curve from pose to pose that is nearly an arc where an arc would do.
#[must_use]
pub fn bend(from: PoseSe2, to: PoseSe2) -> Vec<DVec2> {
    let chord = from.position.distance(to.position);
    let handle = chord * 0.39;
    let controls =
        [from.position, from.position + from.forward() * handle, to.position - to.forward() * handle, to.position];
    let count = (chord / 0.5).ceil() as usize + 8;
    let at = |i: usize| {
        let t = i as f64 / count as f64;
        let u = 1.0 - t;
        controls[0] * (u * u * u)
            + controls[1] * (3.0 * u * u * t)
            + controls[2] * (3.0 * u * t * t)
            + controls[3] * (t * t * t)
    };
    (0..=count).map(at).collect()
}

/// Leaves out points that lie within `tolerance_m` of the line through kept neighbours at most `gap_m` apart.
#[must_use]
pub fn thin(points: &[DVec2], tolerance_m: f64, gap_m: f64) -> Vec<DVec2> {
    let mut kept = Vec::new();
    let Some(first) = points.first() else { return kept };
    kept.push(*first);
    let mut anchor = 0;
    for end in 2..points.len() {
        let line = points[end] - points[anchor];
        let length = line.length().max(1e-9);
        let strays = |point: &DVec2| {
            let offset = *point - points[anchor];
            let share = (line.dot(offset) / length / length).clamp(0.0, 1.0);
            offset.distance(line * share) > tolerance_m
        };
        if length > gap_m || points[anchor + 1..end].iter().any(strays) {
            kept.push(points[end - 1]);
            anchor = end - 1;
        }
    }
    if points.len() > 1 {
        kept.push(points[points.len() - 1]);
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circle(radius_m: f64) -> Path {
        let points: Vec<DVec2> = (0..=90).map(|i| DVec2::from_angle(f64::from(i).to_radians()) * radius_m).collect();
        Path::new(&points).expect("a quarter circle has points")
    }

    #[test]
    fn a_circle_has_its_curvature_and_heading() {
        let path = circle(20.0);
        let middle = 0.5 * path.length_m();
        assert!((path.curvature_pm(middle) - 0.05).abs() < 1e-4);
        assert!((path.heading_rad(middle) - 135f64.to_radians()).abs() < 1e-3);
        let foot = path.nearest(DVec2::new(15.0, 15.0));
        assert!(
            (foot.station_m - middle).abs() < 0.05 && (foot.left_m + (450f64.sqrt() - 20.0)).abs() < 0.01,
            "{foot:?}"
        );
    }

    #[test]
    fn thinning_keeps_loops_and_returns() {
        let there_and_back = [0.0, 5.0, 10.0, 5.0, 0.0].map(|x| DVec2::new(x, 0.0));
        assert_eq!(thin(&there_and_back, 0.01, 100.0).len(), 3);
    }

    #[test]
    fn thinning_keeps_ends_and_stays_close() {
        let path = circle(20.0);
        let kept = thin(path.points(), 0.02, 5.0);
        assert!(kept.len() < 40 && kept[0] == path.points()[0] && kept[kept.len() - 1] == path.points()[90]);
        let thinned = Path::new(&kept).expect("points are kept");
        assert!(path.points().iter().all(|point| thinned.nearest(*point).left_m.abs() < 0.021));
    }
}
