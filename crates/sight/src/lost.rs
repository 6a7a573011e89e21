//! Which boxes of the layout are missing in the real frame: a box counts as lost where the residual inside is far beyond
//! that of the picture around it.

use ds_effect::picture::Picture;

use crate::scene::Scene;

/// Returns the boxes missing from each frame, judged on small rendered pictures.
#[must_use]
pub fn boxes(scene: &Scene<'_>, rendered: &[Picture]) -> Vec<Vec<usize>> {
    let mut out = vec![Vec::new(); rendered.len()];
    for (k, p) in rendered.iter().enumerate() {
        let (p, q) = (p.grey(), scene.small[k].1.grey());
        let energy = |x: usize, y: usize| f64::from((q.data[y * p.width + x] - p.data[y * p.width + x]).powi(2));
        let boxes: Vec<[usize; 4]> = scene.frames[k].boxes.iter().map(|b| pixels(b.edges, &p)).collect();
        let within = |b: &[usize; 4], x: usize, y: usize| x >= b[0] && x < b[2] && y >= b[1] && y < b[3];
        let mut outside = Vec::new();
        for y in 0..p.height {
            for x in 0..p.width {
                if !boxes.iter().any(|b| within(b, x, y)) {
                    outside.push(energy(x, y));
                }
            }
        }
        let typical = outside.iter().sum::<f64>() / outside.len().max(1) as f64;
        for (i, b) in boxes.iter().enumerate() {
            let inside: Vec<f64> =
                (b[1]..b[3]).flat_map(|y| (b[0]..b[2]).map(move |x| (x, y))).map(|(x, y)| energy(x, y)).collect();
            let mean = inside.iter().sum::<f64>() / inside.len().max(1) as f64;
            if inside.len() >= 4 && mean > 8.0 * typical + 40.0 {
                out[k].push(i);
            }
        }
    }
    out
}

fn pixels(e: [f64; 4], small: &Picture) -> [usize; 4] {
    let s = crate::settings::SMALL as f64;
    let limit = |v: f64, most: usize| (v / s).round().clamp(0.0, most as f64) as usize;
    [limit(e[0], small.width), limit(e[1], small.height), limit(e[2], small.width), limit(e[3], small.height)]
}
