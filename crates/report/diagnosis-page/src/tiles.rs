//! The tiles of an image, and how large the gap is in each.

use std::collections::BTreeMap;

use ds_diagnosis::schema::Diagnosis;

use super::words;

/// Rows and columns of the tiles of an image.
pub(crate) const TILES: (usize, usize) = (4, 6);

/// Effect size and q-value by row and column of the image.
pub(crate) type Tiles = BTreeMap<[usize; 2], (f64, Option<f64>)>;

/// Returns the largest effect size and its q-value per image tile.
pub(crate) fn tiles(diagnosis: &Diagnosis) -> Tiles {
    let mut found = Tiles::new();
    for cell in &diagnosis.cells {
        let Some(tile) = cell.regime.tile.filter(|t| t[0] < TILES.0 && t[1] < TILES.1) else { continue };
        let best = found.entry(tile).or_insert((cell.effect_size, cell.q_value));
        if cell.effect_size > best.0 {
            *best = (cell.effect_size, cell.q_value);
        }
    }
    found
}

/// Returns an effect size with two digits, whole from 10.
pub(crate) fn size(value: f64) -> String {
    words::fixed(value, usize::from(value < 9.95))
}
