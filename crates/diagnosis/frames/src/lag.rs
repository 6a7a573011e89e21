//! How old the content of each real frame is: every real frame is compared with the simulated ones before it.
//!
//! At a quarter of the size, with shift, scale, turn, gain and offset free for each pair, so that a wrong focal length
//! or exposure does not pass for age; what is left is parallax and moving objects. Ages in frames.

use ds_effect::picture::Picture;

/// Oldest content looked for, frames.
pub const OLDEST: usize = 5;

/// Residual variance of the best similarity between two small grey pictures, grey levels², and its shift, px.
#[must_use]
pub fn mismatch(sim: &Picture, real: &Picture, start: [f64; 2]) -> (f64, [f64; 2]) {
    let (cx, cy) = (sim.width as f64 / 2.0, sim.height as f64 / 2.0);
    // shift across, shift down, scale, turn
    let mut p = [start[0], start[1], 0.0, 0.0];
    let mut best = (f64::INFINITY, start);
    for round in 0..4 {
        let moved = sim.warped(|x, y| {
            let (u, v) = (x as f64 - cx, y as f64 - cy);
            [(x as f64 + p[0] + p[2] * u - p[3] * v) as f32, (y as f64 + p[1] + p[2] * v + p[3] * u) as f32]
        });
        let (step, variance) = step(&moved, real, [cx, cy]);
        if variance < best.0 {
            best = (variance, [p[0], p[1]]);
        }
        if round < 3 {
            for (p, s) in p.iter_mut().zip(step) {
                *p += s;
            }
            p[2] = p[2].clamp(-0.15, 0.15);
            p[3] = p[3].clamp(-0.1, 0.1);
        }
    }
    best
}

/// Returns the Gauss-Newton step and the residual variance with the best gain and offset at the present place.
fn step(moved: &Picture, real: &Picture, [cx, cy]: [f64; 2]) -> ([f64; 4], f64) {
    const N: usize = 6;
    let mut m = nalgebra::SMatrix::<f64, N, N>::zeros();
    let mut v = nalgebra::SVector::<f64, N>::zeros();
    let (mut pp, mut p1, mut rp, mut r1, mut rr, mut n) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    let w = moved.width;
    for y in 2..moved.height - 2 {
        for x in 2..w - 2 {
            let k = y * w + x;
            let d = &moved.data;
            let gx = f64::from(0.5 * (d[k + 1] - d[k - 1]));
            let gy = f64::from(0.5 * (d[k + w] - d[k - w]));
            let (p, q) = (f64::from(d[k]) - 128.0, f64::from(real.data[k]) - 128.0);
            let (u, t) = (x as f64 - cx, y as f64 - cy);
            let f = [gx, gy, gx * u + gy * t, gy * u - gx * t, p, 1.0];
            for i in 0..N {
                for j in i..N {
                    m[(i, j)] += f[i] * f[j];
                }
                v[i] += f[i] * q;
            }
            pp += p * p;
            p1 += p;
            rp += p * q;
            r1 += q;
            rr += q * q;
            n += 1.0;
        }
    }
    m.fill_lower_triangle_with_upper_triangle();
    for i in 0..N {
        m[(i, i)] *= 1.0 + 1e-6;
    }
    let (cov, var_p, var_q) = (rp - p1 * r1 / n, pp - p1 * p1 / n, rr - r1 * r1 / n);
    let variance = (var_q - cov * cov / var_p.max(1e-9)) / n;
    let solved = m.cholesky().map(|c| c.solve(&v));
    let step = solved.map_or([0.0; 4], |s| {
        // the residual is q - gain p, so that steps come out multiplied by the gain
        let gain = if s[4].abs() > 0.2 { s[4] } else { 1.0 };
        [s[0] / gain, s[1] / gain, s[2] / gain, s[3] / gain]
    });
    (step.map(|s| s.clamp(-3.0, 3.0)), variance)
}

/// Returns the whole-pixel shift within `reach` at which two small grey pictures agree best (highest correlation).
#[must_use]
pub fn coarse_shift(sim: &Picture, real: &Picture, reach: isize) -> [f64; 2] {
    let mut best = (f64::NEG_INFINITY, [0.0; 2]);
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let (mut pp, mut p1, mut pq, mut q1, mut qq, mut n) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
            for y in 0.max(-dy)..(sim.height as isize).min(sim.height as isize - dy) {
                for x in 0.max(-dx)..(sim.width as isize).min(sim.width as isize - dx) {
                    let p = sim.data[((y + dy) * sim.width as isize + x + dx) as usize];
                    let q = real.data[(y * sim.width as isize + x) as usize];
                    pp += p * p;
                    p1 += p;
                    pq += p * q;
                    q1 += q;
                    qq += q * q;
                    n += 1.0;
                }
            }
            let correlation = (pq - p1 * q1 / n) / ((pp - p1 * p1 / n) * (qq - q1 * q1 / n)).max(1e-6).sqrt();
            // a little against far shifts where nothing decides
            let score = f64::from(correlation) - 1e-4 * (dx * dx + dy * dy) as f64;
            if score > best.0 {
                best = (score, [dx as f64, dy as f64]);
            }
        }
    }
    best.1
}
