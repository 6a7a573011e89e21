//! The other road users: class, size, validity, pose and velocity per tick.

use ds_scenario::Warning;
use ds_space::{DVec2, PoseSe2, angle};
use ds_world::{AgentClass, Size, Track, TrackPoint};

use super::Window;
use crate::view::{FieldFault, Table, View};

/// Returns the class of a ScenarioNet type; `None` for what is no road user.
fn class(kind: &str) -> Option<AgentClass> {
    match kind {
        "VEHICLE" | "BUS" | "TRUCK" | "CAR" => Some(AgentClass::Vehicle),
        "PEDESTRIAN" => Some(AgentClass::Pedestrian),
        "CYCLIST" | "BICYCLE" | "MOTORCYCLE" | "MOTORCYCLIST" => Some(AgentClass::Cyclist),
        "TRAFFIC_CONE" => Some(AgentClass::Cone),
        "TRAFFIC_BARRIER" | "TRAFFIC_OBJECT" => Some(AgentClass::Barrier),
        _ => None,
    }
}

/// Returns the usual size of a class.
pub(crate) fn usual(class: AgentClass) -> Size {
    let (length_m, width_m, height_m) = match class {
        AgentClass::Vehicle => (4.6, 1.9, 1.6),
        AgentClass::Pedestrian => (0.7, 0.7, 1.75),
        AgentClass::Cyclist => (1.8, 0.7, 1.7),
        AgentClass::Cone => (0.4, 0.4, 0.8),
        AgentClass::Barrier => (0.6, 2.0, 1.0),
    };
    Size { length_m, width_m, height_m }
}

pub(super) fn tracks(
    all: &View<'_>,
    sdc: &str,
    window: &Window,
    notes: &mut Vec<Warning>,
) -> Result<Vec<Track>, FieldFault> {
    let entries = all.entries()?;
    if entries.len().saturating_mul(window.count) > ds_scenario::MAX_STATES {
        return Err(all.fault(format!(
            "holds {} tracks of {} ticks, over {} states",
            entries.len(),
            window.count,
            ds_scenario::MAX_STATES
        )));
    }
    let mut tracks = Vec::new();
    for (name, view) in entries {
        if name == sdc {
            continue;
        }
        let kind = view.need("type")?;
        let kind = kind.text().ok_or_else(|| kind.fault("is no text"))?;
        match class(&kind) {
            Some(class) => tracks.extend(track(name, class, &view.need("state")?, window)?),
            None => {
                notes.push(Warning { at: view.at().to_owned(), message: format!("is of type {kind:?} and left out") })
            }
        }
    }
    Ok(tracks)
}

fn track(name: String, class: AgentClass, state: &View<'_>, window: &Window) -> Result<Option<Track>, FieldFault> {
    let position = state.need("position")?.table()?;
    let heading = state.need("heading")?.table()?;
    let velocity = state.get("velocity").map(|velocity| velocity.table()).transpose()?;
    let valid = state.get("valid").map(|valid| valid.table()).transpose()?;
    let rows = position.rows;
    let fits = |table: &Table, columns: usize| table.rows == rows && table.columns >= columns;
    let sound = fits(&position, 2)
        && fits(&heading, 1)
        && velocity.as_ref().is_none_or(|velocity| fits(velocity, 2))
        && valid.as_ref().is_none_or(|valid| fits(valid, 1));
    if !sound && rows > 0 {
        return Err(state.fault(format!("has series of different lengths or widths; position has {rows} rows")));
    }
    let is_valid = |tick: usize| tick < rows && valid.as_ref().is_none_or(|valid| valid.get(tick, 0) != 0.0);
    let mut points = Vec::with_capacity(window.count);
    for tick in window.first..window.first + window.count {
        points.push(if is_valid(tick) {
            Some(point(state, (&position, &heading, velocity.as_ref()), tick, window)?)
        } else {
            None
        });
    }
    if points.iter().all(Option::is_none) {
        return Ok(None);
    }
    let size = |name: &str, usual: f64| middle(state.get(name).as_ref(), is_valid).unwrap_or(usual);
    let usual = usual(class);
    let size = Size {
        length_m: size("length", usual.length_m),
        width_m: size("width", usual.width_m),
        height_m: size("height", usual.height_m),
    };
    Ok(Some(Track { name, class, size, points }))
}

fn point(
    state: &View<'_>,
    tables: (&Table, &Table, Option<&Table>),
    tick: usize,
    window: &Window,
) -> Result<TrackPoint, FieldFault> {
    let (position, heading, velocity) = tables;
    let at = DVec2::new(position.get(tick, 0), position.get(tick, 1)) - window.origin;
    let heading_rad = heading.get(tick, 0);
    let velocity_mps =
        velocity.map_or(DVec2::ZERO, |velocity| DVec2::new(velocity.get(tick, 0), velocity.get(tick, 1)));
    if !at.is_finite() || !heading_rad.is_finite() {
        return Err(state.fault(format!("has position[{tick}] {at} and heading[{tick}] {heading_rad}")));
    }
    // Some converters leave NaN where a velocity could not be estimated.
    let velocity_mps = if velocity_mps.is_finite() { velocity_mps } else { DVec2::ZERO };
    Ok(TrackPoint { pose: PoseSe2 { position: at, heading_rad: angle::wrap(heading_rad) }, z_m: 0.0, velocity_mps })
}

/// Returns the middle one of a size's values over the valid ticks.
fn middle(view: Option<&View<'_>>, is_valid: impl Fn(usize) -> bool) -> Option<f64> {
    let view = view?;
    let Ok(table) = view.table() else { return view.number().filter(|value| *value > 0.0) };
    let valid = |row: &usize| table.rows == 1 || is_valid(*row);
    let mut values: Vec<f64> =
        (0..table.rows).filter(valid).map(|row| table.get(row, 0)).filter(|value| *value > 0.0).collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}
