//! Lane centre lines ready for look-up: which lane a vehicle is in, and the road ahead of it.

use ds_space::DVec2;
use ds_space::plane::Polyline;
use ds_world::{Lane, LaneId, Map};

/// A vehicle is in a lane if it is at most this far from its centre line and heads within 45° of it.
const MAX_OFFSET_M: f64 = 2.5;
const MIN_ALIGNMENT: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// The centre lines of a map with their bounds.
pub(crate) struct LaneIndex<'a> {
    lanes: &'a [Lane],
    lines: Vec<Option<(Polyline, DVec2, DVec2)>>,
}

impl<'a> LaneIndex<'a> {
    pub(crate) fn new(map: &'a Map) -> Self {
        let lines = map
            .lanes
            .iter()
            .map(|lane| {
                let line = Polyline::new(&lane.centre_line)?;
                let low = line.points().iter().copied().fold(DVec2::INFINITY, DVec2::min);
                let high = line.points().iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
                Some((line, low - MAX_OFFSET_M, high + MAX_OFFSET_M))
            })
            .collect();
        Self { lanes: &map.lanes, lines }
    }

    /// Returns the centre line of a lane.
    pub(crate) fn line(&self, id: LaneId) -> Option<&Polyline> {
        self.lines.get(id.0 as usize)?.as_ref().map(|(line, ..)| line)
    }

    /// Returns the nearest lane at a point that leads in a direction, and the distance along it.
    pub(crate) fn lane_at(&self, point: DVec2, direction: DVec2) -> Option<(usize, f64)> {
        let mut best = (MAX_OFFSET_M, None);
        for (index, entry) in self.lines.iter().enumerate() {
            let Some((line, low, high)) = entry else { continue };
            if point.cmplt(*low).any() || point.cmpgt(*high).any() {
                continue;
            }
            let near = line.project(point);
            if near.distance_m < best.0 && line.direction(near.segment).dot(direction) > MIN_ALIGNMENT {
                best = (near.distance_m, Some((index, near.along_m)));
            }
        }
        best.1
    }

    /// Returns points every `step_m` along the road ahead of a point, at its own offset from the centre line, turning
    /// least where lanes fork; straight on where the lanes end or there are none.
    pub(crate) fn road_ahead(&self, from: DVec2, direction: DVec2, step_m: f64, count: usize) -> Vec<DVec2> {
        let mut ahead = Vec::with_capacity(count);
        let (mut point, mut heading) = (from, direction);
        if let Some((mut lane, mut along_m)) = self.lane_at(from, direction) {
            let offset_m = self.lines[lane].as_ref().map_or(0.0, |(line, ..)| line.project(from).lateral_m);
            while ahead.len() < count {
                let Some((line, ..)) = &self.lines[lane] else { break };
                along_m += step_m;
                if along_m > line.length_m() {
                    let end = line.direction_at(line.length_m());
                    let Some(next) = self.straightest(&self.lanes[lane].successors, end) else { break };
                    (lane, along_m) = (next, along_m - line.length_m() - step_m);
                    continue;
                }
                heading = line.direction_at(along_m);
                point = line.at(along_m) + heading.perp() * offset_m;
                ahead.push(point);
            }
        }
        while ahead.len() < count {
            point += heading * step_m;
            ahead.push(point);
        }
        ahead
    }

    fn straightest(&self, successors: &[LaneId], direction: DVec2) -> Option<usize> {
        let mut best: Option<(f64, usize)> = None;
        for id in successors {
            let Some(line) = self.line(*id) else { continue };
            // A successor shorter than a step could be walked round for ever in a ring of such lanes.
            if line.length_m() < 0.5 {
                continue;
            }
            let turn = line.direction_at(line.length_m()).dot(direction);
            if best.is_none_or(|(most, _)| turn > most) {
                best = Some((turn, id.0 as usize));
            }
        }
        best.map(|(_, index)| index)
    }
}
