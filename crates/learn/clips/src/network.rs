//! The identity of a road network: a digest of its lanes that does not depend on where the map lies.
//!
//! Centre lines and crosswalks are given in the frame of the first lane's start and rounded to 5 cm, so that the same
//! roads, moved and turned, have the same id. Traffic and lights do not count.

use ds_space::{DVec2, DigestWriter, PoseSe2};
use ds_world::Map;

const ROUNDING_M: f64 = 0.05;

/// Returns the id of a map's roads: 16 hexadecimal digits.
#[must_use]
pub fn network_id(map: &Map) -> String {
    let origin = map.lanes.first().and_then(|lane| {
        let along = (*lane.centre_line.get(1)? - lane.centre_line[0]).try_normalize()?;
        Some(PoseSe2 { position: lane.centre_line[0], heading_rad: along.to_angle() })
    });
    let origin = origin.unwrap_or_default();
    let mut writer = DigestWriter::new();
    let mut line = |points: &[DVec2]| {
        writer.u64(points.len() as u64);
        for point in points {
            let local = origin.to_local(*point) / ROUNDING_M;
            #[expect(clippy::cast_possible_truncation, reason = "float casts saturate")]
            let (x, y) = (local.x.round() as i64, local.y.round() as i64);
            writer.raw(&x.to_le_bytes()).raw(&y.to_le_bytes());
        }
    };
    map.lanes.iter().for_each(|lane| line(&lane.centre_line));
    map.crosswalks.iter().for_each(|crosswalk| line(&crosswalk.polygon));
    writer.finish().to_string()[..16].to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_scenario::Family;

    #[test]
    fn a_moved_network_is_the_same_and_another_one_is_not() {
        let scene = ds_scenario::generate(Family::SignalisedCrossing, 5);
        let mut moved = scene.map.clone();
        let place = PoseSe2::new(212.5, -77.25, 1.1);
        for lane in &mut moved.lanes {
            lane.centre_line.iter_mut().for_each(|point| *point = place.to_outer(*point));
        }
        for crosswalk in &mut moved.crosswalks {
            crosswalk.polygon.iter_mut().for_each(|point| *point = place.to_outer(*point));
        }
        assert_eq!(network_id(&scene.map), network_id(&moved));
        moved.lanes[3].centre_line[1].x += 0.5;
        assert_ne!(network_id(&scene.map), network_id(&moved));
        let other = ds_scenario::generate(Family::SignalisedCrossing, 6);
        assert_ne!(network_id(&scene.map), network_id(&other.map));
    }
}
