//! What every importer gives a scene: the checks of our own format, a safe name, a camera where the log has none.

use std::path::Path;

use ds_space::{CameraId, CameraModel, DVec3, Intrinsics};
use ds_world::Scene;

use crate::error::ImportError;

/// Puts a scene through the checks of our own format.
pub(crate) fn checked(scene: &Scene, path: &Path) -> Result<Scene, ImportError> {
    ds_scenario::checked(scene).map_err(|fault| ImportError::Field {
        path: path.to_owned(),
        at: fault.at,
        problem: fault.problem,
    })
}

/// Returns a name made safe for file names.
pub(crate) fn safe_name(name: &str) -> String {
    let safe = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.') { c } else { '-' };
    let name: String = name.chars().map(safe).take(80).collect();
    let name = name.trim_start_matches('.');
    if name.is_empty() { "imported".to_owned() } else { name.to_owned() }
}

/// The camera of logs that tell of none.
pub(crate) fn usual_camera() -> CameraModel {
    let intrinsics = Intrinsics::centred(160, 96, 70f64.to_radians());
    let id = CameraId::new("front").expect("a plain word is an id");
    CameraModel::mounted(id, intrinsics, DVec3::new(1.5, 0.0, 1.6), 0.0, 0.05)
}
