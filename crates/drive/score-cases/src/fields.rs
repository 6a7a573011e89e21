//! What fields of several schemas hold: states, points, poses; and the size of a case file.

use ds_score::VehicleState;
use ds_space::{DVec2, PoseSe2};

/// The largest case file that is read, in bytes.
pub const MAX_CASE_BYTES: u64 = 64 << 20;

/// A row of state columns.
pub(crate) type Columns = [f64; 11];

/// Takes rows of columns to states.
pub(crate) fn states(rows: &[Columns]) -> Vec<VehicleState> {
    rows.iter().copied().map(VehicleState::from_columns).collect()
}

/// Takes (x, y) to a point.
pub(crate) fn point(xy: &[f64; 2]) -> DVec2 {
    DVec2::new(xy[0], xy[1])
}

/// Takes (x, y, heading) to a pose.
pub(crate) fn pose(xyh: &[f64; 3]) -> PoseSe2 {
    PoseSe2::new(xyh[0], xyh[1], xyh[2])
}
