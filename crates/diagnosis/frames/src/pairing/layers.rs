//! Statistics of a pair by what the layout shows: brightness, contrast of two scales and strength of the edges by distance,
//! how the tone of one stream follows that of the other, what changes from frame to frame, and the boxes of objects. A pair
//! of equal streams has 0 everywhere. Logarithms or tens of grey levels.

use ds_effect::picture::Picture;

use crate::pairing::looks::Stream;
use crate::scene::Scene;
use crate::settings;

/// Number of statistics.
pub const LAYERS: usize = 17;
/// Statistics of one kind by distance, from near to far: brightness, contrast of two scales.
pub const DISTANCES: [std::ops::Range<usize>; 3] = [0..3, 4..7, 7..10];
/// Ends of the layers of distance, m; what is farther is sky.
const ENDS_M: [f32; 3] = [12.0, 35.0, 149.0];
/// Grey levels of contrast that count as none.
const LEAST: f64 = 0.5;

/// Returns what the second stream has beyond the first.
#[must_use]
pub fn layered(scene: &Scene<'_>, first: &Stream, second: &Stream) -> [f64; LAYERS] {
    let mut out = [0.0; LAYERS];
    let count = first.full.len().max(1) as f64;
    for (p, q) in first.full.iter().zip(&second.full) {
        let (a, b) = (Frame::of(scene, p), Frame::of(scene, q));
        let levels = b.level.iter().zip(&a.level).map(|(b, a)| 0.1 * (b - a));
        let fine = b.fine.iter().zip(&a.fine).map(|(b, a)| ratio(*b, *a));
        let coarse = b.coarse.iter().zip(&a.coarse).map(|(b, a)| ratio(*b, *a));
        let (slope, agreement, edges) = followed(p, q);
        let own = levels.chain(fine).chain(coarse).chain([slope, agreement, edges]);
        out.iter_mut().zip(own).for_each(|(out, own)| *out += own / count);
    }
    let (steps, turns) = changes(&first.small)
        .zip(changes(&second.small))
        .map_or((0.0, 0.0), |(a, b)| (ratio(b[0], a[0]), ratio(b[1], a[1])));
    (out[13], out[14]) = (steps, turns);
    (out[15], out[16]) = boxes(scene, first, second);
    out
}

fn ratio(a: f64, b: f64) -> f64 {
    ((a + LEAST) / (b + LEAST)).ln()
}

/// Mean brightness and contrast of the layers of one frame.
struct Frame {
    level: [f64; 4],
    fine: [f64; 3],
    coarse: [f64; 3],
}

impl Frame {
    fn of(scene: &Scene<'_>, p: &Picture) -> Self {
        let smooth = p.boxed(2);
        let layer = |k: usize| {
            let depth = scene.case.depth_m.as_ref().map_or(1.0, |depth| depth[k]);
            ENDS_M.iter().position(|end| depth < *end).unwrap_or(3)
        };
        let mut sums = [[0.0f64; 4]; 4];
        for y in 0..p.height - 3 {
            for x in 0..p.width - 3 {
                let k = y * p.width + x;
                let sum = &mut sums[layer(k)];
                let slope = |q: &Picture, step: usize| {
                    f64::from((q.data[k + step] - q.data[k]).abs() + (q.data[k + step * p.width] - q.data[k]).abs())
                };
                sum[0] += f64::from(p.data[k]);
                sum[1] += slope(p, 1);
                sum[2] += slope(&smooth, 3);
                sum[3] += 1.0;
            }
        }
        let mean = |layer: usize, k: usize| sums[layer][k] / sums[layer][3].max(1.0);
        Self {
            level: std::array::from_fn(|layer| mean(layer, 0)),
            fine: std::array::from_fn(|layer| mean(layer, 1)),
            coarse: std::array::from_fn(|layer| mean(layer, 2)),
        }
    }
}

/// Returns ln of the slope of the second picture's tone on the first one's, how far their agreement is from full, and ln of
/// the strength of the first one's edges in the second, each against a pair of equal ones.
fn followed(p: &Picture, q: &Picture) -> (f64, f64, f64) {
    let (a, b) = (p.boxed(2), q.boxed(2));
    let n = a.data.len() as f64;
    let mean = |p: &Picture| p.data.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
    let (ma, mb) = (mean(&a), mean(&b));
    let (mut aa, mut ab, mut bb) = (1.0, 1.0, 1.0);
    for (u, v) in a.data.iter().zip(&b.data) {
        let (u, v) = (f64::from(*u) - ma, f64::from(*v) - mb);
        (aa, ab, bb) = (aa + u * u, ab + u * v, bb + v * v);
    }
    let agreement = (ab / (aa * bb).sqrt()).clamp(0.05, 1.0);
    let slope = 0.5 * (bb / aa).ln();
    let strength = |p: &Picture| -> Vec<f32> {
        let w = p.width;
        let at = |k: usize| (p.data[k + 1] - p.data[k]).hypot(p.data[k + w] - p.data[k]);
        (0..p.height - 1).flat_map(|y| (0..w - 1).map(move |x| y * w + x)).map(at).collect()
    };
    let (own, other) = (strength(p), strength(q));
    let strong = strongest(&own);
    let (mut here, mut there) = (0.0f64, 0.0f64);
    for (u, v) in own.iter().zip(&other).filter(|(u, _)| **u >= strong) {
        (here, there) = (here + f64::from(*u), there + f64::from(*v));
    }
    (slope, agreement.ln(), ((there + 1.0) / (here + 1.0)).ln())
}

/// Returns the strength that one in fifteen exceeds, in steps of half a grey level.
fn strongest(strengths: &[f32]) -> f32 {
    let mut counts = [0usize; 1024];
    strengths.iter().for_each(|v| counts[((2.0 * v) as usize).min(1023)] += 1);
    let mut left = strengths.len() / 15;
    let bin = (0..1024).rev().find(|bin| {
        left = left.saturating_sub(counts[*bin]);
        left == 0
    });
    0.5 * bin.unwrap_or(0) as f32
}

/// Returns the mean change from frame to frame, and of that change, grey levels.
fn changes(small: &[Picture]) -> Option<[f64; 2]> {
    let grey: Vec<Picture> = small.iter().map(Picture::grey).collect();
    let n = grey.first()?.data.len() as f64;
    let frames = grey.len() as f64;
    let step = |w: &[Picture]| w[0].data.iter().zip(&w[1].data).map(|(a, b)| f64::from((b - a).abs())).sum::<f64>() / n;
    let turn = |w: &[Picture]| {
        let of = |k: usize| f64::from((w[2].data[k] - 2.0 * w[1].data[k] + w[0].data[k]).abs());
        (0..w[0].data.len()).map(of).sum::<f64>() / n
    };
    let steps = grey.windows(2).map(step).sum::<f64>() / (frames - 1.0).max(1.0);
    Some([steps, grey.windows(3).map(turn).sum::<f64>() / (frames - 2.0).max(1.0)])
}

/// Returns the mean of ln brightness of boxes against their surroundings, and the spread of it, over all boxes.
fn boxes(scene: &Scene<'_>, first: &Stream, second: &Stream) -> (f64, f64) {
    let s = settings::SMALL as f64;
    let mut all: Vec<f64> = Vec::new();
    for ((a, b), frame) in first.small.iter().zip(&second.small).zip(&scene.frames) {
        let (a, b) = (a.grey(), b.grey());
        for layout in &frame.boxes {
            let [left, top, right, bottom] = layout.edges.map(|v| (v / s).max(0.0).round() as usize);
            let mean = |p: &Picture| {
                let (mut sum, mut n) = (0.0f64, 0.0f64);
                for y in top.min(p.height - 1)..bottom.clamp(top + 1, p.height.max(top + 1)).min(p.height) {
                    for x in left.min(p.width - 1)..right.clamp(left + 1, p.width.max(left + 1)).min(p.width) {
                        sum += f64::from(p.data[y * p.width + x]);
                        n += 1.0;
                    }
                }
                (sum / n.max(1.0) + 8.0).ln()
            };
            all.push(mean(&b) - mean(&a));
        }
    }
    let n = all.len().max(1) as f64;
    let mean = all.iter().sum::<f64>() / n;
    (mean, all.iter().map(|v| (v - mean).abs()).sum::<f64>() / n)
}
