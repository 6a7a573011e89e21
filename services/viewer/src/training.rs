//! A training in the viewer: the losses of every stage over steps, and its samples as pictures.
//!
//! One timeline, `step`; every stage begins at step 1 and has entities of its own.

use std::path::Path;

use ds_record::viewing::{TrainedStage, Training};
use rerun::{EncodedImage, RecordingStream, RecordingStreamBuilder, Scalars, SeriesLines};

use crate::ViewError;
use crate::stream::{APPLICATION, flush};

/// The timeline of trainings.
const STEPS: &str = "step";

/// Writes a training to a file that the viewer opens.
///
/// # Errors
/// If a contact sheet cannot be read or the file not be written.
pub fn save(training: &Training, path: &Path) -> Result<(), ViewError> {
    let name = format!("training {}", training.name);
    let stream = RecordingStreamBuilder::new(APPLICATION).recording_name(name).save(path)?;
    stream.set_log_tick_enabled(false);
    stream.set_log_time_enabled(false);
    training.stages.iter().try_for_each(|stage| log(stage, &stream))?;
    flush(&stream)
}

fn log(stage: &TrainedStage, stream: &RecordingStream) -> Result<(), ViewError> {
    for (name, points) in &stage.curves {
        let entity = format!("{}/loss/{name}", stage.name);
        stream.log_static(entity.as_str(), &SeriesLines::new().with_names([format!("{} {name}", stage.name)]))?;
        for (step, loss) in points {
            #[expect(clippy::cast_possible_truncation, reason = "steps are whole numbers")]
            stream.set_time_sequence(STEPS, *step as i64);
            stream.log(entity.as_str(), &Scalars::new([*loss]))?;
        }
    }
    if let Some(path) = &stage.sheet {
        let sheet = std::fs::read(path).map_err(|source| ViewError::File { path: path.clone(), source })?;
        stream.log_static(
            format!("{}/samples", stage.name),
            &EncodedImage::from_file_contents(sheet).with_media_type("image/png"),
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_training_becomes_a_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("training.rrd");
        let stage = TrainedStage {
            name: "ode".to_owned(),
            curves: vec![("model".to_owned(), vec![(1.0, 2.0), (2.0, 1.5)])],
            sheet: None,
        };
        let training = Training { name: "smoke".to_owned(), stages: vec![stage] };
        save(&training, &path).expect("writes");
        let bytes = std::fs::read(&path).expect("reads");
        assert!(
            bytes.starts_with(b"RRF2") && bytes.windows(14).any(|part| part == b"ode/loss/model"),
            "{}",
            bytes.len()
        );
    }
}
