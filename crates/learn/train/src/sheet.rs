//! Contact sheets: rows of images as one PNG, to look at while training.

use std::path::Path;

use ds_raster::{Encoding, RgbImage};

use crate::error::TrainError;

/// Returns every fourth of some images, at most a dozen: a row of a sheet.
pub(crate) fn excerpt(images: &[RgbImage]) -> Vec<RgbImage> {
    images.iter().step_by(4).take(12).cloned().collect()
}

/// Writes rows of equally large images as one PNG.
///
/// # Errors
/// If the file cannot be written.
pub fn write(path: &Path, rows: &[Vec<RgbImage>]) -> Result<(), TrainError> {
    let Some(first) = rows.first().and_then(|row| row.first()) else { return Ok(()) };
    let (width, height) = (first.width_px(), first.height_px());
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0) as u32;
    let mut sheet = RgbImage::filled(columns * width, rows.len() as u32 * height, [0; 3]);
    for (y, row) in (0u32..).zip(rows) {
        for (x, image) in (0u32..).zip(row) {
            for line in 0..height {
                let from = (line * width * 3) as usize;
                let to = (((y * height + line) * columns + x) * width * 3) as usize;
                let count = (width * 3) as usize;
                sheet.rgb_mut()[to..to + count].copy_from_slice(&image.rgb()[from..from + count]);
            }
        }
    }
    let bytes =
        sheet.encode(Encoding::Png).map_err(|error| TrainError::Clip { index: 0, reason: error.to_string() })?;
    std::fs::write(path, bytes).map_err(TrainError::io("contact sheet", path))
}
