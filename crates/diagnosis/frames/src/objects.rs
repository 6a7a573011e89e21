//! What became of single objects: a box of the layout may be missing in the real frame, look different or lie elsewhere,
//! and something may be there that the layout has not.
//!
//! Judged on small rendered pictures: places whose residual is far beyond that of the picture around them, then the
//! explanation that leaves least of it. All boxes of a case share one explanation. Units px of the full size.

use ds_effect::picture::Picture;
use nalgebra::{DMatrix, DVector};

use crate::scene::Scene;
use crate::settings;

/// What may become of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// It is missing: `object_dropout`.
    Gone,
    /// It looks different: `identity_switch`.
    Restyled,
    /// It lies elsewhere: `layout_misalignment`.
    Moved,
    /// It is there without a box: `object_hallucination`.
    Appeared,
}

/// What happened to one object of one frame.
#[derive(Debug, Clone, Copy)]
pub struct Event {
    /// Frame.
    pub frame: usize,
    /// What.
    pub fate: Fate,
    /// The part of the picture that it spoils.
    pub edges: [f64; 4],
    /// How far it moved.
    pub offset: [f64; 2],
}

/// Returns what happened to objects; the boxes of a case share the fate that explains most of them.
#[must_use]
pub fn events(scene: &Scene<'_>, rendered: &[Picture]) -> Vec<Event> {
    let mut boxed: Vec<(Event, f64)> = Vec::new();
    let mut free = Vec::new();
    // once some objects stand out clearly, weaker ones are believed as well
    let clear = rendered.iter().enumerate().any(|(k, p)| {
        let view = View::new(p, &scene.small[k].1, scene.frames[k].boxes.iter().map(|b| b.edges));
        view.boxes.iter().any(|b| view.stands_out(b, 1.0))
    });
    let share = if clear { 0.4 } else { 1.0 };
    let blobs = |k: usize, share: f32| {
        let view = View::new(&rendered[k], &scene.small[k].1, scene.frames[k].boxes.iter().map(|b| b.edges));
        view.blobs(clear, share)
    };
    let found = if (0..rendered.len()).any(|k| !blobs(k, 1.0).is_empty()) { 0.4 } else { 1.0 };
    for (k, p) in rendered.iter().enumerate() {
        let real = &scene.small[k].1;
        let view = View::new(p, real, scene.frames[k].boxes.iter().map(|b| b.edges));
        for (at, b) in view.boxes.iter().enumerate() {
            if view.stands_out(b, share) {
                let (fate, offset, left) = view.fate(b);
                let edges = scene.frames[k].boxes[at].edges;
                let moved = [edges[0] + offset[0], edges[1] + offset[1], edges[2] + offset[0], edges[3] + offset[1]];
                let edges = [0, 1].map(|d| edges[d].min(moved[d])).into_iter();
                let far = [2, 3].map(|d| scene.frames[k].boxes[at].edges[d].max(moved[d]));
                let edges: Vec<f64> = edges.chain(far).collect();
                let edges = [edges[0], edges[1], edges[2], edges[3]];
                boxed.push((Event { frame: k, fate, edges, offset }, (1.0 - left).max(0.05)));
            }
        }
        free.extend(view.blobs(clear, found).into_iter().map(|edges| Event {
            frame: k,
            fate: Fate::Appeared,
            edges,
            offset: [0.0; 2],
        }));
    }
    let weight = |fate: Fate| boxed.iter().filter(|(e, _)| e.fate == fate).map(|(_, w)| w).sum::<f64>();
    let common = [Fate::Gone, Fate::Restyled, Fate::Moved].into_iter().max_by(|a, b| weight(*a).total_cmp(&weight(*b)));
    let mut out: Vec<Event> = boxed.into_iter().map(|(e, _)| Event { fate: common.unwrap_or(e.fate), ..e }).collect();
    out.extend(passing(free, rendered.len()));
    out
}

/// Leaves out what stays at one place of the picture: that is on the lens.
fn passing(events: Vec<Event>, frames: usize) -> Vec<Event> {
    let middle = |e: &Event| [0.5 * (e.edges[0] + e.edges[2]), 0.5 * (e.edges[1] + e.edges[3])];
    let inside =
        |m: [f64; 2], e: &Event| m[0] > e.edges[0] && m[0] < e.edges[2] && m[1] > e.edges[1] && m[1] < e.edges[3];
    let stays = |e: &Event| {
        let seen = events.iter().filter(|o| inside(middle(e), o)).count();
        2 * seen > frames.max(4)
    };
    events.iter().filter(|e| !stays(e)).copied().collect()
}

/// A rendered and a real small picture with the residual between them.
struct View<'a> {
    p: &'a Picture,
    q: &'a Picture,
    energy: Vec<f32>,
    boxes: Vec<[usize; 4]>,
    typical: f32,
}

impl<'a> View<'a> {
    fn new(p: &'a Picture, q: &'a Picture, boxes: impl Iterator<Item = [f64; 4]>) -> Self {
        let c = p.channels;
        let energy: Vec<f32> = p
            .data
            .chunks_exact(c)
            .zip(q.data.chunks_exact(c))
            .map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>() / c as f32)
            .collect();
        let boxes: Vec<[usize; 4]> = boxes.map(|b| pixels(b, p)).collect();
        let mut view = Self { p, q, energy, boxes, typical: 0.0 };
        let mut outside: Vec<f32> = Vec::new();
        for y in 0..p.height {
            for x in 0..p.width {
                if !view.boxes.iter().any(|b| within(b, x, y, 2)) {
                    outside.push(view.energy[y * p.width + x]);
                }
            }
        }
        // the worst twentieth may itself be objects
        outside.sort_by(f32::total_cmp);
        let keep = outside.len() * 19 / 20;
        view.typical = outside[..keep].iter().sum::<f32>() / keep.max(1) as f32;
        view
    }

    fn mean(&self, [x0, y0, x1, y1]: &[usize; 4]) -> f32 {
        let count = (x1.saturating_sub(*x0) * y1.saturating_sub(*y0)).max(1) as f32;
        (*y0..*y1)
            .flat_map(|y| (*x0..*x1).map(move |x| (x, y)))
            .map(|(x, y)| self.energy[y * self.p.width + x])
            .sum::<f32>()
            / count
    }

    fn stands_out(&self, b: &[usize; 4], share: f32) -> bool {
        let area = b[2].saturating_sub(b[0]) * b[3].saturating_sub(b[1]);
        area >= 4 && self.mean(b) > share * (8.0 * self.typical + 40.0)
    }

    /// Returns what explains a box best, how far it moved in full pixels, and the share of the residual left.
    fn fate(&self, b: &[usize; 4]) -> (Fate, [f64; 2], f64) {
        let now = self.mean(b).max(1e-3);
        let gone = self.gone(b) / now;
        let restyled = self.restyled(b) / now;
        let (moved, offset) = self.moved(b);
        let moved = moved / now;
        let best = gone.min(restyled).min(moved);
        let smooth = self.smooth(b);
        let fate = if moved <= best + 0.02 && offset[0].hypot(offset[1]) > 1.5 {
            Fate::Moved
        } else if smooth < 0.15 || (gone < 0.5 * restyled && smooth < 0.5) {
            Fate::Gone
        } else {
            Fate::Restyled
        };
        let offset = if fate == Fate::Moved { offset } else { [0.0; 2] };
        (fate, offset, f64::from(best.min(1.0)))
    }

    /// Second differences of the real over those of the simulated box, in the direction in which less is left.
    fn smooth(&self, [x0, y0, x1, y1]: &[usize; 4]) -> f32 {
        let (w, c) = (self.p.width, self.p.channels);
        let bent = |picture: &Picture, step: usize| {
            let mut sum = 0.0f32;
            for y in (*y0).max(1)..(*y1).min(picture.height - 1) {
                for x in (*x0).max(1)..(*x1).min(w - 1) {
                    for k in (y * w + x) * c..(y * w + x + 1) * c {
                        let d = &picture.data;
                        sum += (2.0 * d[k] - d[k - step] - d[k + step]).powi(2);
                    }
                }
            }
            sum
        };
        let ratio = |step: usize| bent(self.q, step) / bent(self.p, step).max(1.0);
        ratio(c).min(ratio(w * c))
    }

    /// Residual against the passage between the real surroundings, across or down.
    fn gone(&self, [x0, y0, x1, y1]: &[usize; 4]) -> f32 {
        let q = self.q;
        let mut sums = [0.0f32; 3];
        let mut count = 0.0f32;
        let at = |x: isize, y: isize, k: usize| q.at(x, y, k);
        let [a, b, c, d] = [*x0, *y0, *x1, *y1].map(|v| v as isize);
        let (open_left, open_right) = (a > 0, (*x1) < q.width);
        let (open_top, open_bottom) = (b > 0, (*y1) < q.height);
        for y in b..d {
            for x in a..c {
                for k in 0..q.channels {
                    let v = at(x, y, k);
                    let pass = |from: f32, to: f32, share: f32, open: [bool; 2]| match open {
                        [true, true] => from + share * (to - from),
                        [true, false] => from,
                        _ => to,
                    };
                    let across = pass(
                        at(a - 2, y, k),
                        at(c + 1, y, k),
                        (x - a + 1) as f32 / (c - a + 1) as f32,
                        [open_left, open_right],
                    );
                    let down = pass(
                        at(x, b - 2, k),
                        at(x, d + 1, k),
                        (y - b + 1) as f32 / (d - b + 1) as f32,
                        [open_top, open_bottom],
                    );
                    sums[0] += (v - across).powi(2);
                    sums[1] += (v - down).powi(2);
                    sums[2] += (v - 0.5 * (across + down)).powi(2);
                    count += 1.0;
                }
            }
        }
        sums[0].min(sums[1]).min(sums[2]) / count.max(1.0)
    }

    /// Residual after the best linear map of the simulated channels.
    fn restyled(&self, [x0, y0, x1, y1]: &[usize; 4]) -> f32 {
        let c = self.p.channels;
        let n = c + 1;
        let mut m = DMatrix::<f64>::identity(n, n) * 1e-6;
        let mut v = vec![DVector::<f64>::zeros(n); c];
        let mut qq = 0.0;
        let mut count = 0.0;
        for y in *y0..*y1 {
            for x in *x0..*x1 {
                let k = (y * self.p.width + x) * c;
                let f: Vec<f64> = self.p.data[k..k + c].iter().map(|v| f64::from(*v)).chain([1.0]).collect();
                for i in 0..n {
                    for j in 0..n {
                        m[(i, j)] += f[i] * f[j];
                    }
                    for (d, v) in v.iter_mut().enumerate() {
                        v[i] += f[i] * f64::from(self.q.data[k + d]);
                    }
                }
                qq += self.q.data[k..k + c].iter().map(|q| f64::from(q * q)).sum::<f64>();
                count += c as f64;
            }
        }
        let Some(solver) = m.cholesky() else { return f32::INFINITY };
        let explained: f64 = v.iter().map(|v| v.dot(&solver.solve(v))).sum();
        // the map has a freedom of its own, which small boxes must pay
        ((qq - explained).max(0.0) / (count - (n * c) as f64).max(1.0)) as f32
    }

    /// Residual of the simulated object at its best place within four small pixels, over old and new place.
    fn moved(&self, b: &[usize; 4]) -> (f32, [f64; 2]) {
        const REACH: i32 = 8;
        let mut best = (f32::INFINITY, [0.0; 2]);
        let [x0, y0, x1, y1] = b.map(|v| v as isize);
        for j in -REACH..=REACH {
            for i in -REACH..=REACH {
                let (dx, dy) = (i as f32 * 0.5, j as f32 * 0.5);
                let (mut sum, mut count) = (0.0f32, 0.0f32);
                for y in y0..y1 {
                    for x in x0..x1 {
                        let (u, v) = (x as f32 + dx, y as f32 + dy);
                        if u < 0.0 || v < 0.0 || u > (self.q.width - 1) as f32 || v > (self.q.height - 1) as f32 {
                            continue;
                        }
                        for k in 0..self.p.channels {
                            let q = between(self.q, u, v, k);
                            sum += (q - self.p.at(x, y, k)).powi(2);
                            count += 1.0;
                        }
                    }
                }
                if 2.0 * count < ((x1 - x0) * (y1 - y0)) as f32 {
                    continue;
                }
                let mean = sum / count * (1.0 + 0.002 * (i * i + j * j) as f32);
                if mean < best.0 {
                    best = (mean, [dx, dy].map(|d| f64::from(d) * settings::SMALL as f64));
                }
            }
        }
        best
    }

    /// Returns compact places of strong residual outside of boxes; clear of boxes where those are spoiled themselves.
    fn blobs(&self, clear: bool, share: f32) -> Vec<[f64; 4]> {
        let (w, h) = (self.p.width, self.p.height);
        let margin = if clear { 5 } else { 1 };
        let level = share * (25.0 * self.typical + 150.0);
        let mut hot: Vec<bool> = (0..w * h)
            .map(|k| self.energy[k] > level && !self.boxes.iter().any(|b| within(b, k % w, k / w, margin)))
            .collect();
        let mut out = Vec::new();
        for first in 0..w * h {
            if !hot[first] {
                continue;
            }
            hot[first] = false;
            let (mut stack, mut area) = (vec![first], 0usize);
            let mut edges = [w, h, 0, 0];
            while let Some(k) = stack.pop() {
                let (x, y) = (k % w, k / w);
                area += 1;
                edges = [edges[0].min(x), edges[1].min(y), edges[2].max(x + 1), edges[3].max(y + 1)];
                for y in y.saturating_sub(2)..(y + 3).min(h) {
                    for x in x.saturating_sub(2)..(x + 3).min(w) {
                        if std::mem::take(&mut hot[y * w + x]) {
                            stack.push(y * w + x);
                        }
                    }
                }
            }
            let (across, down) = (edges[2] - edges[0], edges[3] - edges[1]);
            let compact = 10 * area >= 3 * across * down && across.min(down) >= 2;
            if area >= 6 && compact && 8 * across * down <= w * h {
                let [a, b, c, d] = edges.map(|v| (v * settings::SMALL) as f64);
                let rim = settings::SMALL as f64;
                out.push([a - rim, b - rim, c + rim, d + rim]);
            }
        }
        out
    }
}

fn within(b: &[usize; 4], x: usize, y: usize, margin: usize) -> bool {
    x + margin >= b[0] && x < b[2] + margin && y + margin >= b[1] && y < b[3] + margin
}

fn between(q: &Picture, u: f32, v: f32, k: usize) -> f32 {
    let (i, j) = (u.floor(), v.floor());
    let (a, b) = (u - i, v - j);
    let row = |j: isize| (1.0 - a) * q.at(i as isize, j, k) + a * q.at(i as isize + 1, j, k);
    (1.0 - b) * row(j as isize) + b * row(j as isize + 1)
}

fn pixels(e: [f64; 4], small: &Picture) -> [usize; 4] {
    let s = settings::SMALL as f64;
    let limit = |v: f64, most: usize| (v / s).round().clamp(0.0, most as f64) as usize;
    [limit(e[0], small.width), limit(e[1], small.height), limit(e[2], small.width), limit(e[3], small.height)]
}
