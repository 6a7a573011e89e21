//! A small fixed bank of features of a picture, one row per tile of a 4 x 6 grid.
//!
//! Columns: mean and spread of brightness; for each of three octaves (1, 2, 4 px) the mean absolute gradient across,
//! down and their Laplacian; for colour, means of R - G and B - G. All in grey levels, gradients as 10 ln(1 + level).

use ds_effect::picture::Picture;
use nalgebra::DMatrix;

/// Rows and columns of the tiles of a picture.
pub const TILES: [usize; 2] = [4, 6];
/// Features per tile.
pub const FEATURES: usize = 13;

/// Returns the features of some pictures, `TILES[0] * TILES[1]` rows for each.
#[must_use]
pub fn features(pictures: &[Picture]) -> DMatrix<f64> {
    let rows: Vec<[f64; FEATURES]> = pictures.iter().flat_map(rows).collect();
    DMatrix::from_fn(rows.len(), FEATURES, |r, c| rows[r][c])
}

fn rows(picture: &Picture) -> Vec<[f64; FEATURES]> {
    let grey = picture.grey();
    let mut out = vec![[0.0; FEATURES]; TILES[0] * TILES[1]];
    let mut counts = vec![0.0; out.len()];
    let tile = |x: usize, y: usize, of: &Picture| (y * TILES[0] / of.height) * TILES[1] + x * TILES[1] / of.width;
    for y in 0..grey.height {
        for x in 0..grey.width {
            let (t, k) = (tile(x, y, &grey), y * grey.width + x);
            let value = f64::from(grey.data[k]);
            counts[t] += 1.0;
            out[t][0] += value;
            out[t][1] += value * value;
            if picture.channels == 3 {
                let p = &picture.data[3 * k..3 * k + 3];
                out[t][11] += f64::from(p[0] - p[1]);
                out[t][12] += f64::from(p[2] - p[1]);
            }
        }
    }
    for (row, n) in out.iter_mut().zip(&counts) {
        row[0] /= n;
        row[1] = (row[1] / n - row[0] * row[0]).max(0.0).sqrt();
        row[11] /= n;
        row[12] /= n;
    }
    for (octave, factor) in [1, 2, 4].into_iter().enumerate() {
        let small = grey.shrunk(factor);
        let mut sums = vec![[0.0; 4]; out.len()];
        for y in 1..small.height.saturating_sub(1) {
            for x in 1..small.width.saturating_sub(1) {
                let k = y * small.width + x;
                let d = &small.data;
                let (left, right, up, down) = (d[k - 1], d[k + 1], d[k - small.width], d[k + small.width]);
                let sum = &mut sums[tile(x, y, &small)];
                sum[0] += f64::from((right - left).abs());
                sum[1] += f64::from((down - up).abs());
                sum[2] += f64::from((4.0 * d[k] - left - right - up - down).abs());
                sum[3] += 1.0;
            }
        }
        for (row, sum) in out.iter_mut().zip(&sums) {
            for i in 0..3 {
                row[2 + 3 * octave + i] = 10.0 * (1.0 + sum[i] / sum[3].max(1.0)).ln();
            }
        }
    }
    out
}
