//! A finished diagnosis in the viewer: residuals before and after over time, channel by channel; the road of each drive
//! coloured by the gap; effects with their intervals and cells as tables.
//!
//! Colours of the road are steps of the error over its noise floor. One timeline, seconds of the drive.

use std::path::Path;

use ds_record::viewing::{Along, Curve, Explained};
use rerun::blueprint::{
    Blueprint, BlueprintActivation, ContainerLike, Horizontal, Spatial3DView, TextDocumentView, TimePanel,
    TimeSeriesView, Vertical,
};
use rerun::{
    LineStrips3D, Points3D, RecordingStream, RecordingStreamBuilder, RecordingStreamError, Scalars, SeriesLines,
    TimeColumn, ViewCoordinates,
};

use crate::ViewError;
use crate::diagnosis::{ROOT, document};
use crate::stream::{APPLICATION, TIMELINE, flush};

/// Error over noise floor from which each colour stands.
const STEPS: [(f64, [u8; 3]); 8] = [
    (0.0, [185, 193, 201]),
    (1.0, [251, 230, 207]),
    (1.5, [248, 205, 158]),
    (2.0, [242, 171, 102]),
    (3.0, [229, 133, 58]),
    (5.0, [196, 87, 43]),
    (8.0, [148, 58, 18]),
    (13.0, [95, 33, 10]),
];
const BEFORE: [u8; 3] = [196, 87, 43];
const AFTER: [u8; 3] = [10, 106, 148];
const FLOOR: [u8; 3] = [130, 140, 150];
/// Curves of a drive that get a view of their own.
const MOST_CURVES: usize = 5;

/// Writes a finished diagnosis to a file that the viewer opens.
///
/// # Errors
/// If the file cannot be written.
pub fn save(explained: &Explained, path: &Path) -> Result<(), ViewError> {
    let name = format!("gap diagnosis of {}", explained.case);
    let stream = RecordingStreamBuilder::new(APPLICATION).recording_name(name).save(path)?;
    log(explained, &stream)?;
    flush(&stream)
}

fn log(explained: &Explained, stream: &RecordingStream) -> Result<(), ViewError> {
    stream.set_log_tick_enabled(false);
    stream.set_log_time_enabled(false);
    blueprint(explained).send(stream, BlueprintActivation { make_active: true, make_default: true })?;
    stream.log_static(format!("{ROOT}/verdict"), &document(&explained.summary))?;
    stream.log_static(format!("{ROOT}/ranking"), &document(&explained.ranking))?;
    stream.log_static(format!("{ROOT}/where"), &document(&explained.places))?;
    for (path, number) in &explained.numbers {
        stream.log_static(format!("{ROOT}/{path}"), &Scalars::new([*number]))?;
    }
    explained.drives.iter().try_for_each(|along| log_drive(along, stream))
}

fn colour(times_floor: f64) -> [u8; 3] {
    STEPS.iter().rev().find(|(from, _)| times_floor >= *from).map_or(STEPS[0].1, |step| step.1)
}

fn root(along: &Along) -> String {
    format!("drive_{}", along.drive)
}

fn log_drive(along: &Along, stream: &RecordingStream) -> Result<(), ViewError> {
    let root = root(along);
    stream.log_static(format!("{root}/road"), &ViewCoordinates::RIGHT_HAND_Z_UP())?;
    for curve in &along.curves {
        log_curve(curve, &root, stream)?;
    }
    let Some(error) = along.curves.first().filter(|curve| !curve.moments.is_empty()) else { return Ok(()) };
    for (what, column) in [("before", 1), ("after", 2)] {
        let (strips, colours) = coloured(along, error, column);
        let road = LineStrips3D::new(strips).with_colors(colours).with_radii([0.6]);
        stream.log_static(format!("{root}/road/{what}"), &road)?;
    }
    let times = TimeColumn::new_duration_secs(TIMELINE, along.path.iter().map(|point| point[0]));
    let here = Points3D::new(along.path.iter().map(|point| placed(point, 1.0)));
    let place = Points3D::update_fields().with_radii([1.2]).with_colors([[20, 32, 43]]);
    stream.log_static(format!("{root}/road/here"), &place)?;
    let columns = here.columns_of_unit_batches().map_err(RecordingStreamError::from)?;
    stream.send_columns(format!("{root}/road/here"), [times], columns)?;
    Ok(())
}

/// Returns the path piece by piece with the colour of the error there; the corrected road lies beside the other.
fn coloured(along: &Along, error: &Curve, column: usize) -> (Vec<Vec<[f32; 3]>>, Vec<[u8; 3]>) {
    let ys = along.path.iter().map(|point| point[2]);
    let (least, most) = ys.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), y| (a.min(y), b.max(y)));
    let aside = if column == 2 { -(most - least) - 15.0 } else { 0.0 };
    let moved = |point: &[f64; 3]| placed(&[point[0], point[1], point[2] + aside], 0.0);
    let piece = |pair: &[[f64; 3]]| {
        let middle = 0.5 * (pair[0][0] + pair[1][0]);
        let nearest = error.moments.iter().min_by(|a, b| (a[0] - middle).abs().total_cmp(&(b[0] - middle).abs()));
        let times = nearest.map_or(0.0, |m| if m[3] > 0.0 { m[column] / m[3] } else { 0.0 });
        (vec![moved(&pair[0]), moved(&pair[1])], colour(times))
    };
    along.path.windows(2).map(piece).unzip()
}

#[expect(clippy::cast_possible_truncation, reason = "the viewer works in single precision")]
fn placed(point: &[f64; 3], height_m: f32) -> [f32; 3] {
    [point[1] as f32, point[2] as f32, height_m]
}

fn log_curve(curve: &Curve, root: &str, stream: &RecordingStream) -> Result<(), ViewError> {
    for (what, column, rgb, width) in
        [("before", 1, BEFORE, 1.8_f32), ("after", 2, AFTER, 1.8), ("floor", 3, FLOOR, 1.0)]
    {
        let path = format!("{root}/residual/{}/{what}", curve.name);
        let look = SeriesLines::new().with_colors([rgb]).with_names([what]).with_widths([width]);
        stream.log_static(path.as_str(), &look)?;
        let times = TimeColumn::new_duration_secs(TIMELINE, curve.moments.iter().map(|moment| moment[0]));
        let values = Scalars::new(curve.moments.iter().map(|moment| moment[column]));
        let columns = values.columns_of_unit_batches().map_err(RecordingStreamError::from)?;
        stream.send_columns(path, [times], columns)?;
    }
    Ok(())
}

fn blueprint(explained: &Explained) -> Blueprint {
    let text = |name: &str, path: &str| -> ContainerLike {
        TextDocumentView::new(name).with_origin(format!("{ROOT}/{path}")).into()
    };
    let words = Vertical::new([text("what", "verdict"), text("which effect", "ranking"), text("where", "where")])
        .with_row_shares([1.0, 2.0, 2.0]);
    let mut columns: Vec<ContainerLike> = vec![words.into()];
    for along in &explained.drives {
        let root = root(along);
        let title = format!("road of drive {}: nominal, and corrected below", along.drive);
        let mut rows: Vec<ContainerLike> = Vec::new();
        if along.path.len() > 1 {
            rows.push(Spatial3DView::new(title).with_origin(format!("{root}/road")).into());
        }
        rows.extend(along.curves.iter().take(MOST_CURVES).map(|curve| -> ContainerLike {
            TimeSeriesView::new(curve.name.as_str()).with_origin(format!("{root}/residual/{}", curve.name)).into()
        }));
        columns.push(Vertical::new(rows).into());
    }
    Blueprint::new(Horizontal::new(columns)).with_time_panel(TimePanel::new().with_timeline(TIMELINE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_rise_with_the_gap() {
        assert_eq!(
            [0.3, 1.0, 1.4, 2.0, 100.0].map(colour),
            [STEPS[0].1, STEPS[1].1, STEPS[1].1, STEPS[3].1, STEPS[7].1]
        );
    }
}
