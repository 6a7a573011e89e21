//! Traffic lights over time (`dynamic_map_states`): one head and one stop line for each governed lane.
//!
//! Sources give a stop point on the ground and no head: the head is put 4.5 m above it, facing the traffic.

use ds_scenario::Warning;
use ds_space::plane::path::Path;
use ds_space::{DVec2, angle};
use ds_world::{LaneId, LightState, Map, TrafficLight};

use super::Window;
use super::lanes::across;
use crate::view::{FieldFault, View};

const HEAD_M: f64 = 4.5;

/// Returns what a source's word for a state means.
fn state(word: &str) -> LightState {
    let word = word.to_ascii_uppercase();
    if word.contains("GREEN") || word.ends_with("_GO") {
        LightState::Green
    } else if word.contains("YELLOW") || word.contains("CAUTION") {
        LightState::Yellow
    } else if word.contains("RED") || word.contains("STOP") {
        LightState::Red
    } else {
        LightState::Unknown
    }
}

pub(super) fn add(
    map: &mut Map,
    states: &View<'_>,
    window: &Window,
    notes: &mut Vec<Warning>,
) -> Result<(), FieldFault> {
    for (name, view) in states.entries()? {
        let kind = view.get("type").and_then(|kind| kind.text()).unwrap_or_default();
        let inner = view.need("state")?;
        let field = |key: &str| view.get(key).or_else(|| inner.get(key));
        let lane_name =
            field("lane").and_then(|lane| lane.text().or_else(|| lane.texts().into_iter().next())).unwrap_or(name);
        let lane = map.lanes.iter().position(|lane| lane.name == lane_name);
        let words = inner.get("object_state").map(|words| words.texts()).unwrap_or_default();
        let Some(lane) = lane.filter(|_| kind == "TRAFFIC_LIGHT" && !words.is_empty()) else {
            notes.push(Warning {
                at: view.at().to_owned(),
                message: format!("governs lane {lane_name:?}, which the map does not have; left out"),
            });
            continue;
        };
        let path =
            Path::new(&map.lanes[lane].centre_line).ok_or_else(|| view.fault("governs a lane without length"))?;
        let place = field("stop_point").and_then(|point| stop_point(&point, window)).unwrap_or(path.points()[0]);
        let heading = path.heading_rad(path.nearest(place).station_m);
        let light = u32::try_from(map.traffic_lights.len()).unwrap_or(u32::MAX);
        let at = |tick: usize| words.get(tick).map_or(LightState::Unknown, |word| state(word));
        map.traffic_lights.push(TrafficLight {
            position: place.extend(HEAD_M),
            facing_rad: angle::wrap(heading + std::f64::consts::PI),
            lanes: vec![LaneId(u32::try_from(lane).unwrap_or(u32::MAX))],
            states: (window.first..window.first + window.count).map(at).collect(),
        });
        if let Some(mut stop) = across(&map.lanes[lane], place) {
            stop.light = Some(light);
            map.stop_lines.push(stop);
        }
    }
    Ok(())
}

/// Returns a stop point given once or for each tick; the first finite one that is not the origin counts.
fn stop_point(view: &View<'_>, window: &Window) -> Option<DVec2> {
    let table = view.table().ok()?;
    let rows: Vec<DVec2> = if table.columns == 1 {
        (table.rows > 1).then(|| DVec2::new(table.values[0], table.values[1])).into_iter().collect()
    } else {
        (0..table.rows).map(|row| DVec2::new(table.get(row, 0), table.get(row, 1))).collect()
    };
    rows.into_iter().find(|point| point.is_finite() && point.length() > 1e-6).map(|point| point - window.origin)
}
