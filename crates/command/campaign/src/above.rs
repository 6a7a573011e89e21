//! States of a drive → an animation from above, in a file that is whole if it is there.

use std::path::Path;

use anyhow::{Context, Result};
use ds_record::{Moment, Reel};
use ds_world::{Scene, WorldState};

/// Draws states of a scenario.
///
/// # Errors
/// If the file cannot be written.
pub(crate) fn animate(scene: &Scene, states: &[WorldState], path: &Path) -> Result<()> {
    let reel = Reel {
        scene,
        path: states.iter().map(|state| state.ego.pose.position).collect(),
        moment: Box::new(|index| {
            Ok(Moment { state: states[index].clone(), layouts: Vec::new(), frames: Vec::new(), plan: None })
        }),
    };
    let partial = path.with_extension("gif.partial");
    reel.animate(&partial)?;
    std::fs::rename(&partial, path).with_context(|| format!("write {}", path.display()))
}
