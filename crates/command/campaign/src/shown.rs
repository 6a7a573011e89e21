//! A drive on generated frames under a condition → whether the look network names the condition on one of its frames, and on
//! the reference camera's frame of the same state.

use std::path::Path;

use anyhow::{Context, Result};
use ds_benchmark::{Cell, ConditionShown};
use ds_camera::{Appearance, ReferenceCamera, SceneCamera};
use ds_perception::look::LookReader;
use ds_process::shipped;
use ds_record::Recording;
use ds_space::Tick;
use ds_topic::{Frame, ObservationSource, Slot, Topic};

/// The tick whose frame is looked at.
const AT: Tick = Tick(80);
/// Weights of the look network.
const WEIGHTS: &str = "configs/models/look.safetensors";

/// Says whether a cell is driven on generated frames under a condition.
pub(crate) fn concerns(cell: &Cell) -> bool {
    let condition = Appearance::named(&cell.appearance).is_ok_and(|look| look.condition.is_some());
    ObservationSource::from_name(&cell.observation.name).is_some_and(ObservationSource::is_generated) && condition
}

/// Loads the look network.
///
/// # Errors
/// If its weights cannot be read.
pub(crate) fn reader() -> Result<LookReader> {
    LookReader::load(&shipped::find(Path::new(WEIGHTS))).context("the look network")
}

/// Looks at a recorded drive; nothing where the cell is of another kind or the drive ended before that frame.
///
/// # Errors
/// If the recording is damaged.
pub(crate) fn shown(reader: &LookReader, cell: &Cell, recording: &Recording) -> Result<Option<ConditionShown>> {
    let look = Appearance::named(&cell.appearance)?;
    let slot = Slot::of_camera(Topic::Frame, AT.0, 0);
    let Some(condition) = look.condition.filter(|_| concerns(cell) && recording.get(slot).is_some()) else {
        return Ok(None);
    };
    let frame: Frame = recording.body(slot)?;
    let scene = &recording.scene().scene;
    let camera = scene.cameras.first().context("a scene without cameras")?;
    let state = recording.world(AT)?;
    let reference = ReferenceCamera::new(scene, look).on_ego(&state, camera)?;
    let named = |image| reader.read(image).shows(condition);
    Ok(Some(ConditionShown { frame: named(&frame.image), reference: named(&reference) }))
}
