//! Displacement between two pictures block by block (Lucas and Kanade 1981), blind to any gain and offset of the block.
//!
//! For each block, real - rendered = gx dx + gy dy + a rendered + b is solved by least squares; gain a and offset b are
//! eliminated, so that tone curves, fog or shading do not pass for motion; a lower gain weakens the gradients. Units px.

use ds_effect::picture::Picture;

/// What one block says about its displacement: information matrix (xx, xy, yy) and the pull, information times step.
#[derive(Debug, Clone, Copy)]
pub struct Block {
    /// Its middle, px.
    pub at: [f64; 2],
    /// Information, 1/px².
    pub info: [f64; 3],
    /// Information times the step that would explain the residual, 1/px.
    pub pull: [f64; 2],
}

/// Measures all blocks of `size` pixels a side; both pictures are grey.
#[must_use]
pub fn blocks(rendered: &Picture, real: &Picture, size: usize) -> Vec<Block> {
    let (width, height) = (rendered.width, rendered.height);
    let mut out = Vec::new();
    for top in (0..height).step_by(size) {
        for left in (0..width).step_by(size) {
            let bounds = [left.max(1), top.max(1), (left + size).min(width - 1), (top + size).min(height - 1)];
            if let Some(block) = block(rendered, real, bounds) {
                out.push(block);
            }
        }
    }
    out
}

fn block(rendered: &Picture, real: &Picture, [x0, y0, x1, y1]: [usize; 4]) -> Option<Block> {
    // sums of products of (gx, gy, p, 1) with each other and with r
    let mut m = [[0.0f32; 4]; 4];
    let mut v = [0.0f32; 4];
    let (mut rr, mut n) = (0.0f32, 0.0f32);
    let width = rendered.width;
    let mean = rendered.data[(y0 + y1) / 2 * width + (x0 + x1) / 2];
    for y in y0..y1 {
        for x in x0..x1 {
            let k = y * width + x;
            let (p, q) = (rendered.data[k], real.data[k]);
            if p > 252.0 || !(2.0..=252.0).contains(&q) {
                continue;
            }
            let gx = 0.5 * (rendered.data[k + 1] - rendered.data[k - 1]);
            let gy = 0.5 * (rendered.data[k + width] - rendered.data[k - width]);
            let (f, r) = ([gx, gy, p - mean, 1.0], q - p);
            for i in 0..4 {
                for j in i..4 {
                    m[i][j] += f[i] * f[j];
                }
                v[i] += f[i] * r;
            }
            rr += r * r;
            n += 1.0;
        }
    }
    if n < 16.0 {
        return None;
    }
    // eliminate offset, then gain
    let mut gain = 1.0;
    for k in [3, 2] {
        let pivot = m[k][k];
        if pivot < 1e-3 * n {
            continue;
        }
        for i in 0..k {
            for j in i..k {
                m[i][j] -= m[i][k] * m[j][k] / pivot;
            }
            v[i] -= m[i][k] * v[k] / pivot;
        }
        rr -= v[k] * v[k] / pivot;
        if k == 2 {
            gain = f64::from(1.0 + v[k] / pivot).clamp(0.25, 4.0);
        }
    }
    let [xx, xy, yy] = [m[0][0], m[0][1], m[1][1]].map(f64::from);
    let (bx, by) = (f64::from(v[0]), f64::from(v[1]));
    let (xx, yy) = (xx + 1.0, yy + 1.0);
    let det = xx * yy - xy * xy;
    if det < 1e-6 {
        return None;
    }
    let explained = (yy * bx * bx - 2.0 * xy * bx * by + xx * by * by) / det;
    let variance = ((f64::from(rr) - explained) / f64::from(n - 4.0)).max(2.0);
    Some(Block {
        at: [(x0 + x1 - 1) as f64 / 2.0, (y0 + y1 - 1) as f64 / 2.0],
        info: [xx, xy, yy].map(|v| v * gain * gain / variance),
        pull: [bx, by].map(|v| v * gain / variance),
    })
}
