//! Statistics of a stream and of a pair of streams that survive another texture: tone, contrast by scale, place and
//! distance, flat places, block edges, colour, what changes over time; of pairs also ratios frame by frame and tile by
//! tile. A pair of equal streams has the value 0 everywhere. Logarithms or tens of grey levels.

use ds_effect::picture::Picture;

use crate::scene::Scene;
use crate::settings;

/// Number of statistics of one stream.
pub const OWN: usize = 30;
/// Number of statistics of a pair.
pub const ALL: usize = 44;
/// First statistic that needs frames of the same states.
pub const PAIRED: usize = OWN;
/// First displacement: pitch, yaw, roll, focal length, distortion, left, up, line time; then objects.
pub const MOVED: usize = 35;

/// Frames of one stream as statistics need them.
pub struct Stream {
    /// Full grey frames of `Scene::full`.
    pub full: Vec<Picture>,
    /// Small frames of all.
    pub small: Vec<Picture>,
}

impl Stream {
    /// Returns the simulated or the real stream of a scene.
    #[must_use]
    pub fn of(scene: &Scene<'_>, real: bool) -> Self {
        let pick = |(a, b): &(Picture, Picture)| if real { b.clone() } else { a.clone() };
        Self {
            full: scene.full.iter().map(|k| pick(&scene.grey[*k])).collect(),
            small: scene.small.iter().map(pick).collect(),
        }
    }

    /// Returns the stream with the content of each small frame so many frames older, none older than the first.
    #[must_use]
    pub fn aged(mut self, ages: &[usize]) -> Self {
        self.small = ages.iter().enumerate().map(|(k, age)| self.small[k.saturating_sub(*age)].clone()).collect();
        self
    }
}

/// Returns what the second stream has beyond the first, whose own statistics are given; displacements stay 0.
#[must_use]
pub fn beyond(scene: &Scene<'_>, first: &Stream, known: &[f64; OWN], second: &Stream, paired: bool) -> [f64; ALL] {
    let mut out = [0.0; ALL];
    for (out, (a, b)) in out.iter_mut().zip(known.iter().zip(&own(scene, second))) {
        *out = b - a;
    }
    if paired {
        ratios(scene, first, second, &mut out[PAIRED..MOVED]);
        out[ALL - 1] = objects(scene, first, second);
    }
    out
}

/// Returns the statistics of one stream.
#[must_use]
pub fn own(scene: &Scene<'_>, stream: &Stream) -> [f64; OWN] {
    let mut s = [0.0; OWN];
    for picture in &stream.full {
        let n = stream.full.len() as f64;
        for (s, v) in s.iter_mut().zip(of_full(picture)) {
            *s += v / n;
        }
    }
    let smalls = of_small(scene, &stream.small);
    s[16..].copy_from_slice(&smalls);
    s
}

/// Tone, contrast by scale, flat places, block edges, upright lines.
fn of_full(p: &Picture) -> [f64; 16] {
    let mut s = [0.0; 16];
    let mut counts = [0u32; 256];
    p.data.iter().for_each(|v| counts[v.clamp(0.0, 255.0) as usize] += 1);
    for (s, share) in s.iter_mut().zip([0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99]) {
        let mut left = share * p.data.len() as f64;
        let level = counts.iter().position(|c| {
            left -= f64::from(*c);
            left <= 0.0
        });
        *s = level.unwrap_or(255) as f64 * 0.1;
    }
    let scales = [slopes(p), slopes(&p.shrunk(2)), slopes(&p.shrunk(4))];
    let size = |k: usize| (scales[k][0] + scales[k][1] + 0.2).ln();
    let lean = |k: usize| ((scales[k][0] + 0.1) / (scales[k][1] + 0.1)).ln();
    (s[7], s[8], s[9], s[10], s[11]) = (size(2), size(1) - size(2), size(0) - size(1), lean(0), lean(1));
    let [dark, bright] = flat(p);
    (s[12], s[13]) = (dark, bright);
    s[14] = blocky(p);
    s[15] = upright(p);
    s
}

/// Mean absolute slope across and down.
fn slopes(p: &Picture) -> [f64; 2] {
    let w = p.width;
    let (mut across, mut down) = (0.0f64, 0.0f64);
    for y in 0..p.height - 1 {
        let (row, below) = (&p.data[y * w..(y + 1) * w], &p.data[(y + 1) * w..(y + 2) * w]);
        across += f64::from(row.windows(2).map(|v| (v[1] - v[0]).abs()).sum::<f32>());
        down += f64::from(row.iter().zip(below).map(|(a, b)| (b - a).abs()).sum::<f32>());
    }
    let n = ((w - 1) * (p.height - 1)) as f64;
    [across / n, down / n]
}

/// Statistics that grow where something fine is added, with what is added to a size before its logarithm: fine contrast
/// over the next coarser one, flat places dark and bright.
pub(super) const FINE: [(usize, f64); 3] = [(9, 0.0), (12, FLAT), (13, FLAT)];
const FLAT: f64 = 0.3;

/// ln of the mean second difference in the flattest tenth of dark and of bright blocks.
fn flat(p: &Picture) -> [f64; 2] {
    let w = p.width;
    let mut blocks: Vec<(f32, f64)> = Vec::new();
    for top in (1..p.height.saturating_sub(9)).step_by(8) {
        for left in (1..w.saturating_sub(9)).step_by(8) {
            let (mut sum, mut light) = (0.0f32, 0.0f32);
            for y in top..top + 8 {
                for x in left..left + 8 {
                    let k = y * w + x;
                    let d = &p.data;
                    sum += (4.0 * d[k] - d[k - 1] - d[k + 1] - d[k - w] - d[k + w]).abs();
                    light += d[k];
                }
            }
            if light < 64.0 * 248.0 {
                blocks.push((light / 64.0, f64::from(sum) / 64.0));
            }
        }
    }
    let mut lights: Vec<f64> = blocks.iter().map(|b| f64::from(b.0)).collect();
    let middle = ds_stats::quantile(&mut lights, 0.5) as f32;
    [true, false].map(|dark| {
        let mut own: Vec<f64> = blocks.iter().filter(|b| (b.0 < middle) == dark).map(|b| b.1).collect();
        if own.is_empty() { 0.0 } else { (ds_stats::quantile(&mut own, 0.1) + FLAT).ln() }
    })
}

/// ln of the steps at the edges of 8 x 8 blocks over those within.
fn blocky(p: &Picture) -> f64 {
    let w = p.width;
    let (mut edge, mut inner, mut n) = (0.0f64, 0.0f64, [0.0f64; 2]);
    for y in 0..p.height {
        for x in 1..w - 1 {
            let k = y * w + x;
            // second differences, so that slopes do not count
            let step = f64::from((p.data[k] - p.data[k - 1]).abs().min(12.0));
            match x % 8 {
                0 => (edge, n[0]) = (edge + step, n[0] + 1.0),
                3..=5 => (inner, n[1]) = (inner + step, n[1] + 1.0),
                _ => {}
            }
        }
    }
    ((edge / n[0].max(1.0) + 0.1) / (inner / n[1].max(1.0) + 0.1)).ln() * 3.0
}

/// Asymmetry of upright thin lines: bright ones more than dark ones.
fn upright(p: &Picture) -> f64 {
    let w = p.width;
    let (mut cubes, mut squares, mut n) = (0.0f64, 0.0f64, 0.0f64);
    for y in (2..p.height.saturating_sub(3)).step_by(2) {
        for x in 2..w - 2 {
            let mut line = 0.0;
            for j in y - 2..=y + 2 {
                let k = j * w + x;
                line += p.data[k] - 0.5 * (p.data[k - 2] + p.data[k + 2]);
            }
            let line = f64::from(line / 5.0).clamp(-60.0, 60.0);
            cubes += line.powi(3);
            squares += line * line;
            n += 1.0;
        }
    }
    let v = squares / n.max(1.0) + 1.0;
    cubes / n.max(1.0) / v.powf(1.5)
}

/// Brightness by radius and height, contrast by distance, colour, what stays in place, what changes over time.
fn of_small(scene: &Scene<'_>, small: &[Picture]) -> [f64; OWN - 16] {
    let mut s = [0.0; OWN - 16];
    let n = small.len() as f64;
    let grey: Vec<Picture> = small.iter().map(Picture::grey).collect();
    let (w, h) = (grey[0].width, grey[0].height);
    let mean: Vec<f64> = (0..w * h).map(|k| grey.iter().map(|g| f64::from(g.data[k])).sum::<f64>() / n).collect();
    let bands = |which: &dyn Fn(usize, usize) -> usize| {
        let (mut sums, mut counts) = ([0.0; 3], [1e-9; 3]);
        for (k, level) in mean.iter().enumerate() {
            let band = which(k % w, k / w).min(2);
            sums[band] += (level + 4.0).ln();
            counts[band] += 1.0;
        }
        [0, 1, 2].map(|b| sums[b] / counts[b])
    };
    let radius = |x: usize, y: usize| {
        let (u, v) = (2.0 * (x as f64 + 0.5) / w as f64 - 1.0, 2.0 * (y as f64 + 0.5) / h as f64 - 1.0);
        (u.hypot(v) / 2f64.sqrt() * 3.0) as usize
    };
    let (rings, rows) = (bands(&radius), bands(&|_, y| y * 3 / h));
    (s[0], s[1]) = (rings[1] - rings[0], rings[2] - rings[0]);
    (s[2], s[3]) = (rows[1] - rows[0], rows[2] - rows[0]);
    let depth = scene.small_depth_m.as_deref();
    s[4] = depth.map_or(0.0, |d| far_contrast(&grey, d));
    if small[0].channels == 3 {
        let colour = colour(small);
        s[5..8].copy_from_slice(&colour);
    }
    (s[8], s[9]) = fixed(&grey);
    let level: Vec<f64> =
        grey.iter().map(|g| (g.data.iter().sum::<f32>() / g.data.len() as f32 + 4.0).into()).collect();
    let level: Vec<f64> = level.into_iter().map(f64::ln).collect();
    let contrast: Vec<f64> = grey.iter().map(|g| (slopes(g)[0] + slopes(g)[1] + 0.2).ln()).collect();
    let since: Vec<f64> = scene.frames.iter().map(|f| scene.case.context(f, 1, None).frames_since_anchor).collect();
    s[10] = (unrest(&level) + 0.004).ln();
    (s[11], s[12]) = (10.0 * slope(&since, &level), 10.0 * slope(&since, &contrast));
    s[13] = repeats(&grey);
    s
}

/// ln of the slopes beyond 40 m over those within 20 m.
fn far_contrast(grey: &[Picture], depth_m: &[f32]) -> f64 {
    let (mut sums, mut counts) = ([0.0f64; 2], [1e-9f64; 2]);
    for g in grey {
        for y in 0..g.height - 1 {
            for x in 0..g.width - 1 {
                let k = y * g.width + x;
                let band = match depth_m[k] {
                    d if d > 40.0 => 0,
                    d if d < 20.0 => 1,
                    _ => continue,
                };
                sums[band] += f64::from((g.data[k + 1] - g.data[k]).abs() + (g.data[k + g.width] - g.data[k]).abs());
                counts[band] += 1.0;
            }
        }
    }
    ((sums[0] / counts[0] + 0.3) / (sums[1] / counts[1] + 0.3)).ln()
}

/// Means of ln R/G and ln B/G, and ln of the mean distance from grey.
fn colour(small: &[Picture]) -> [f64; 3] {
    let (mut sums, mut n) = ([0.0f64; 3], 0.0f64);
    for v in small.iter().flat_map(|p| p.data.chunks_exact(3)) {
        let [r, g, b] = [v[0], v[1], v[2]].map(|v| f64::from(v) + 8.0);
        if r.max(b).max(g) < 255.0 {
            sums[0] += (r / g).ln();
            sums[1] += (b / g).ln();
            sums[2] += (r / g).ln().abs() + (b / g).ln().abs();
            n += 1.0;
        }
    }
    let n = n.max(1.0);
    [3.0 * sums[0] / n, 3.0 * sums[1] / n, (sums[2] / n + 0.02).ln()]
}

/// How unevenly places change over time: the lowest tenth and the spread of ln temporal spread.
fn fixed(grey: &[Picture]) -> (f64, f64) {
    let n = grey.len() as f64;
    let (w, h) = (grey[0].width, grey[0].height);
    let mut spread = Vec::new();
    for y in (1..h.saturating_sub(2)).step_by(2) {
        for x in (1..w.saturating_sub(2)).step_by(2) {
            let (mut sum, mut squares) = (0.0f64, 0.0f64);
            for g in grey {
                let v = f64::from(g.data[y * w + x]);
                sum += v;
                squares += v * v;
            }
            spread.push(((squares / n - (sum / n).powi(2)).max(0.0) + 4.0).ln() * 0.5);
        }
    }
    let mean = spread.iter().sum::<f64>() / spread.len() as f64;
    let sd = (spread.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / spread.len() as f64).sqrt();
    let low = ds_stats::quantile(&mut spread, 0.1);
    (low - mean, sd)
}

/// Root mean square of second differences.
fn unrest(series: &[f64]) -> f64 {
    let squares: f64 = series.windows(3).map(|v| (v[0] - 2.0 * v[1] + v[2]).powi(2)).sum();
    (squares / (series.len() as f64 - 2.0).max(1.0) / 6.0).sqrt()
}

fn slope(x: &[f64], y: &[f64]) -> f64 {
    let n = x.len() as f64;
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let xx: f64 = x.iter().map(|v| (v - mx).powi(2)).sum();
    x.iter().zip(y).map(|(a, b)| (a - mx) * (b - my)).sum::<f64>() / xx.max(1e-9)
}

/// Share of frames that differ from the one before by less than a third of the usual.
fn repeats(grey: &[Picture]) -> f64 {
    let steps: Vec<f64> = grey
        .windows(2)
        .map(|p| p[0].data.iter().zip(&p[1].data).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>())
        .collect();
    let mut sorted = steps.clone();
    let usual = ds_stats::quantile(&mut sorted, 0.6);
    5.0 * steps.iter().filter(|s| **s < 0.33 * usual).count() as f64 / steps.len().max(1) as f64
}

/// Ratios of brightness frame by frame and tile by tile.
fn ratios(scene: &Scene<'_>, first: &Stream, second: &Stream, out: &mut [f64]) {
    let [rows, columns] = settings::TILES;
    let mut frames = Vec::new();
    let mut tiles = vec![0.0; rows * columns];
    for (a, b) in first.small.iter().zip(&second.small) {
        let (a, b) = (a.grey(), b.grey());
        let mut sums = vec![[0.0f64; 2]; rows * columns];
        for k in 0..a.data.len() {
            let sum = &mut sums[crate::loss::tile(k % a.width, k / a.width, a.width, a.height)];
            sum[0] += f64::from(a.data[k]) + 4.0;
            sum[1] += f64::from(b.data[k]) + 4.0;
        }
        let all = sums.iter().fold([0.0; 2], |t, s| [t[0] + s[0], t[1] + s[1]]);
        let frame = (all[1] / all[0]).ln();
        frames.push(frame);
        for (tile, s) in tiles.iter_mut().zip(&sums) {
            *tile += ((s[1] / s[0]).ln() - frame) / first.small.len() as f64;
        }
    }
    let since: Vec<f64> = scene.frames.iter().map(|f| scene.case.context(f, 1, None).frames_since_anchor).collect();
    out[0] = (unrest(&frames) + 0.004).ln() - 0.004f64.ln();
    out[1] = 10.0 * slope(&since, &frames);
    out[2] = slope(&lagging(scene), &frames);
    let radius: Vec<f64> = (0..tiles.len())
        .map(|t| {
            let (y, x) = ((t / columns) as f64 + 0.5, (t % columns) as f64 + 0.5);
            (2.0 * x / columns as f64 - 1.0).powi(2) + (2.0 * y / rows as f64 - 1.0).powi(2)
        })
        .collect();
    out[4] = slope(&radius, &tiles);
    let mean = radius.iter().sum::<f64>() / radius.len() as f64;
    let left: f64 = tiles.iter().zip(&radius).map(|(t, r)| (t - out[4] * (r - mean)).powi(2)).sum();
    out[3] = ((left / tiles.len() as f64).sqrt() + 0.01).ln() - 0.01f64.ln();
}

/// What an exposure that lags by 0.4 s would do to ln brightness; 0 where the light does not change.
fn lagging(scene: &Scene<'_>) -> Vec<f64> {
    let mut level = scene.frames[0].light;
    let mut before = scene.frames[0].time_secs;
    let mut out = Vec::new();
    for f in &scene.frames {
        level += (f.light - level) * (1.0 - (-(f.time_secs - before) / 0.4).exp());
        before = f.time_secs;
        out.push((f.light / level).ln());
    }
    out
}

/// Mean over boxes of ln contrast inside over that of the whole frame.
fn objects(scene: &Scene<'_>, first: &Stream, second: &Stream) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    let s = settings::SMALL as f64;
    for ((a, b), frame) in first.small.iter().zip(&second.small).zip(&scene.frames) {
        let (a, b) = (a.grey(), b.grey());
        for layout in &frame.boxes {
            let e = layout.edges.map(|v| (v / s).max(0.0) as usize);
            let contrast = |p: &Picture| {
                let (mut c, mut m) = (0.0f64, 1e-9f64);
                for y in e[1]..e[3].min(p.height - 1) {
                    for x in e[0]..e[2].min(p.width - 1) {
                        let k = y * p.width + x;
                        c += f64::from((p.data[k + 1] - p.data[k]).abs() + (p.data[k + p.width] - p.data[k]).abs());
                        m += 1.0;
                    }
                }
                (c / m + 1.0).ln()
            };
            sum += contrast(&b) - contrast(&a);
            n += 1.0;
        }
    }
    sum / f64::max(n, 1.0)
}
