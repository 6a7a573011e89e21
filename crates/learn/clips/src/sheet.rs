//! Contact sheets: frames and layouts of a set as one picture.

use ds_raster::RgbImage;

use crate::error::ClipsError;
use crate::set::ClipSet;

/// Returns a sheet of up to `most` clips, evenly spread: a row each of four frames (as many as there are) and the first
/// layout.
///
/// # Errors
/// If a clip cannot be read.
pub fn contact_sheet(set: &ClipSet, most: usize) -> Result<RgbImage, ClipsError> {
    const COLUMNS: u32 = 5;
    let rows = most.min(set.len()).max(1);
    let (width, height) = set.size();
    // Two clips side by side.
    let lines = rows.div_ceil(2) as u32;
    let mut sheet = RgbImage::filled(2 * COLUMNS * width, lines * height, [0; 3]);
    for row in 0..rows.min(set.len()) {
        let clip = row * set.len() / rows;
        let info = set.info(clip);
        let (left, top) = ((row as u32 % 2) * COLUMNS * width, (row as u32 / 2) * height);
        for column in 0..4u32 {
            let tick = info.frames.saturating_sub(1) * column as usize / 3;
            if column > 0 && info.frames == 1 {
                continue;
            }
            if let Some(frame) = set.read(clip, tick, 1)?.frames.first() {
                paste(&mut sheet, frame, left + column * width, top);
            }
        }
        if let Some(layout) = set.read(clip, 0, 1)?.layouts.first() {
            paste(&mut sheet, layout, left + 4 * width, top);
        }
    }
    Ok(sheet)
}

fn paste(sheet: &mut RgbImage, image: &RgbImage, left: u32, top: u32) {
    let (wide, bytes) = (sheet.width_px() as usize, 3 * image.width_px() as usize);
    for (line, row) in image.rgb().chunks_exact(bytes).enumerate() {
        let at = ((top as usize + line) * wide + left as usize) * 3;
        sheet.rgb_mut()[at..at + bytes].copy_from_slice(row);
    }
}
