//! `drivable_area`: the share of states in which all four corners of the ego lie on drivable surface.
//!
//! Each corner may lie in another polygon, and up to 0.2 m outside (seams between polygons, map error).
//! Not applicable where the map has no drivable polygons.

use ds_world::{EgoState, Map, VehicleParameters};

use super::area::Area;

const TOLERANCE_M: f64 = 0.2;

#[derive(Debug, Clone)]
pub(crate) struct DrivableArea {
    area: Area,
    vehicle: VehicleParameters,
    inside: u32,
    seen: u32,
}

impl DrivableArea {
    pub(crate) fn new(map: &Map, vehicle: VehicleParameters) -> Self {
        Self { area: Area::new(&map.drivable, TOLERANCE_M), vehicle, inside: 0, seen: 0 }
    }

    /// Takes the next state; returns 1 if the ego is on drivable surface in it, else 0.
    pub(crate) fn observe(&mut self, ego: &EgoState) -> Option<f64> {
        if self.area.is_empty() {
            return None;
        }
        let inside = ego.corners(&self.vehicle).iter().all(|corner| self.area.holds(*corner));
        self.seen += 1;
        self.inside += u32::from(inside);
        Some(f64::from(u32::from(inside)))
    }

    /// Returns the share of states so far.
    pub(crate) fn score(&self) -> Option<f64> {
        (self.seen > 0).then(|| f64::from(self.inside) / f64::from(self.seen))
    }
}
