//! The sub-metrics of an open-loop plan, one file each (`scoring.md` §4 and §6).

pub(crate) mod comfort_v1;
pub(crate) mod drivable_area;
pub(crate) mod driving_direction;
pub(crate) mod ego_progress;
pub(crate) mod extended_comfort;
pub(crate) mod history_comfort;
pub(crate) mod lane_keeping;
pub(crate) mod no_at_fault_collision;
pub(crate) mod time_to_collision;
pub(crate) mod traffic_light;

/// Returns 1 if nothing was violated, else 0.
pub(crate) fn unless(violated: bool) -> f64 {
    if violated { 0.0 } else { 1.0 }
}
