//! The misfit between corrected and real frames: energy of the residual by band, tile and frame against its floor.
//!
//! Bands split the grey residual by block means (Haar): within 4 px, 4 to 16 px, above 16 px; and colour above 16 px.
//! A cell's floor is white noise, the encoder and what resampling leaves of the texture. A cell costs
//! e^u - 1 - u with u = ln(energy / floor), linear beyond |u| = 1: the divergence between two variances, made robust.

use ds_effect::picture::Picture;

use crate::grain::Grain;
use crate::scene::{Model, Placed, Scene};
use crate::settings;

/// Number of bands.
pub const BANDS: usize = 4;
/// Number of tiles.
pub const TILES: usize = settings::TILES[0] * settings::TILES[1];

/// Energy and floor of one tile of one frame in one band, levels².
#[derive(Debug, Clone, Copy, Default)]
pub struct Cell {
    /// Mean square of the residual.
    pub energy: f64,
    /// What an effect-free world leaves; 0 where nothing was measured.
    pub floor: f64,
    /// Mean square of the gradient, levels².
    pub texture: f64,
    /// Mean brightness, levels.
    pub light: f64,
    /// Whether most of the floor is what an effect is held to leave, so that too little is a misfit as well.
    pub foretold: bool,
}

impl Cell {
    /// Returns ln(energy / floor).
    #[must_use]
    pub fn excess(&self) -> f64 {
        if self.floor <= 0.0 { 0.0 } else { (self.energy.max(1e-3) / self.floor).ln() }
    }

    /// What the cell costs; only noise, in the finest band, may be foretold too high.
    fn cost(&self, finest: bool) -> f64 {
        let u = if finest || self.foretold { self.excess() } else { self.excess().max(0.0) };
        let e = std::f64::consts::E;
        if u > 1.0 {
            e - 2.0 + (e - 1.0) * (u - 1.0)
        } else if u < -1.0 {
            1.0 / e + (1.0 - 1.0 / e) * (-u - 1.0)
        } else {
            u.exp() - 1.0 - u
        }
    }
}

/// The misfit of a model.
#[derive(Debug, Clone)]
pub struct Loss {
    /// Sum over bands, scaled to a fixed count of frames.
    pub total: f64,
    /// Cells by band, then frame of that band; the first band has the frames of `Scene::full`.
    pub cells: [Vec<[Cell; TILES]>; BANDS],
}

impl Loss {
    /// Returns the cost of one band, scaled to a fixed count of frames.
    #[must_use]
    pub fn band(&self, band: usize) -> f64 {
        let frames = self.cells[band].len().max(1) as f64;
        let sum: f64 = self.cells[band].iter().flatten().map(|c| c.cost(band == 0)).sum();
        sum * settings::COUNTED_FRAMES / frames
    }
}

/// Measures a placed model.
#[must_use]
pub fn measure(scene: &Scene<'_>, model: &Model, placed: &Placed) -> Loss {
    let small = scene.small_of(model, &placed.small);
    let full = scene.full_of(model, &placed.full);
    let mut loss = of_pictures(scene, model, &small, &full);
    if let Some(coarsened) = model.coarsened() {
        widen(&mut loss, &full, &scene.full_of(&coarsened, &placed.full));
    }
    loss
}

/// Adds to the floors of the medium and coarse band what effects on fine detail leave there: their mean energy in the
/// full pictures, tile by tile, because small pictures cannot show it frame by frame.
fn widen(loss: &mut Loss, full: &[Picture], without: &[Picture]) {
    let mut left = [[0.0; TILES]; 2];
    for (with, without) in full.iter().zip(without) {
        let (with, without) = (with.shrunk(settings::SMALL), without.shrunk(settings::SMALL));
        let mask = vec![true; with.width * with.height];
        for (sums, cells) in left.iter_mut().zip(grey_bands(&with, &without, 1.0, &mask)) {
            sums.iter_mut().zip(cells).for_each(|(sum, cell)| *sum += cell.energy / full.len() as f64);
        }
    }
    for (frames, left) in loss.cells[1..].iter_mut().zip(&left) {
        for cells in frames {
            for (cell, left) in cells.iter_mut().zip(left).filter(|(cell, _)| cell.floor > 0.0) {
                cell.foretold = *left > cell.floor;
                cell.floor += left;
            }
        }
    }
    loss.total = (0..BANDS).map(|b| loss.band(b)).sum();
}

/// Measures the finest band alone.
#[must_use]
pub fn fine_only(scene: &Scene<'_>, model: &Model, placed: &Placed) -> f64 {
    finest(scene, model, placed).band(0)
}

/// Measures the finest band alone, tile by tile.
#[must_use]
pub fn fine_by_tile(scene: &Scene<'_>, model: &Model, placed: &Placed) -> [f64; TILES] {
    let loss = finest(scene, model, placed);
    std::array::from_fn(|t| loss.cells[0].iter().map(|cells| cells[t].cost(true)).sum())
}

fn finest(scene: &Scene<'_>, model: &Model, placed: &Placed) -> Loss {
    let mut cells: [Vec<[Cell; TILES]>; BANDS] = Default::default();
    let full = scene.full_of(model, &placed.full);
    for (at, k) in scene.full.iter().enumerate() {
        let gain = gain(&full[at], &scene.grey[*k].1);
        cells[0].push(fine(&full[at], &scene.grey[*k].1, gain, &mask(scene, model, *k)));
    }
    floors(&mut cells, &Grain::of_model(model));
    Loss { total: 0.0, cells }
}

/// Measures pictures that are already rendered.
#[must_use]
pub fn of_pictures(scene: &Scene<'_>, model: &Model, small: &[Picture], full: &[Picture]) -> Loss {
    let mut cells: [Vec<[Cell; TILES]>; BANDS] = Default::default();
    let grain = Grain::of_model(model);
    let gains: Vec<f32> = small.iter().zip(&scene.small).map(|(p, (_, real))| gain(p, real)).collect();
    for (at, k) in scene.full.iter().enumerate() {
        let mask = mask(scene, model, *k);
        cells[0].push(fine(&full[at], &scene.grey[*k].1, gains[*k], &mask));
    }
    for (k, (rendered, (_, real))) in small.iter().zip(&scene.small).enumerate() {
        let mask = mask(scene, model, k);
        let [medium, coarse] = grey_bands(&rendered.grey(), &real.grey(), gains[k], &mask);
        cells[1].push(medium);
        cells[2].push(coarse);
        if rendered.channels == 3 {
            cells[3].push(colour(rendered, real, gains[k], &mask));
        }
    }
    floors(&mut cells, &grain);
    let mut loss = Loss { total: 0.0, cells };
    loss.total = (0..BANDS).map(|b| loss.band(b)).sum();
    loss
}

/// Returns the factor of encoded values that nuisance gain may explain, within its limit.
#[must_use]
pub fn gain(rendered: &Picture, real: &Picture) -> f32 {
    let (mut pp, mut pq) = (0.0f64, 0.0f64);
    for (p, q) in rendered.data.iter().zip(&real.data) {
        if *p < 250.0 && *q < 250.0 && (q - p).abs() < 24.0 {
            pp += f64::from(p * p);
            pq += f64::from(p * q);
        }
    }
    let most = settings::MOST_GAIN / 2.2;
    (pq / pp.max(1.0)).clamp(1.0 - most, 1.0 + most) as f32
}

/// Returns which small pixels count: those of frames whose content is in the stream,
/// outside of what objects spoil.
fn mask(scene: &Scene<'_>, model: &Model, k: usize) -> Vec<bool> {
    let picture = &scene.small[k].0;
    let mut counts = vec![k >= model.blind; picture.width * picture.height];
    let s = settings::SMALL as f64;
    for e in &model.lost[k] {
        for y in 0..picture.height {
            for x in 0..picture.width {
                let (u, v) = ((x as f64 + 0.5) * s, (y as f64 + 0.5) * s);
                if u > e[0] - 4.0 && u < e[2] + 4.0 && v > e[1] - 4.0 && v < e[3] + 4.0 {
                    counts[y * picture.width + x] = false;
                }
            }
        }
    }
    counts
}

/// Sums over the blocks of a tile.
#[derive(Clone, Copy, Default)]
struct Sum {
    energy: f64,
    texture: f64,
    light: f64,
    count: f64,
}

fn cells_of(sums: &[Sum; TILES]) -> [Cell; TILES] {
    std::array::from_fn(|t| {
        let s = sums[t];
        if s.count < 1.0 {
            return Cell::default();
        }
        // the floor is set when the noise of the case is known
        let n = s.count;
        Cell { energy: s.energy / n, floor: 1.0, texture: s.texture / n, light: s.light / n, foretold: false }
    })
}

/// Returns the tile of a place given as shares of width and height.
#[must_use]
pub fn tile(x: usize, y: usize, width: usize, height: usize) -> usize {
    (y * settings::TILES[0] / height) * settings::TILES[1] + x * settings::TILES[1] / width
}

fn fine(rendered: &Picture, real: &Picture, gain: f32, mask: &[bool]) -> [Cell; TILES] {
    let s = settings::SMALL;
    let (columns, rows) = (rendered.width / s, rendered.height / s);
    let (w, h) = (columns * s, rows * s);
    let mut sums = [Sum::default(); TILES];
    for j in 0..rows {
        for i in 0..columns {
            if !mask[j * columns + i] {
                continue;
            }
            let (mut n, mut r1, mut r2, mut texture, mut light) = (0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32);
            for y in j * s..(j + 1) * s {
                for x in i * s..(i + 1) * s {
                    let k = y * rendered.width + x;
                    let p = rendered.data[k];
                    let r = real.data[k] - gain * p;
                    // both at white: nothing can differ there
                    if p > 252.0 && real.data[k] > 252.0 {
                        continue;
                    }
                    n += 1.0;
                    r1 += r;
                    r2 += r * r;
                    light += p;
                    let (right, below) = (k + usize::from(x + 1 < w), k + rendered.width * usize::from(y + 1 < h));
                    texture += (rendered.data[right] - p).powi(2) + (rendered.data[below] - p).powi(2);
                }
            }
            if n > 8.0 {
                let sum = &mut sums[tile(i, j, columns, rows)];
                sum.energy += f64::from(r2 - r1 * r1 / n) / (f64::from(n) - 1.0);
                sum.texture += f64::from(texture / n);
                sum.light += f64::from(light / n);
                sum.count += 1.0;
            }
        }
    }
    cells_of(&sums)
}

/// Side of the coarse blocks, small pixels.
const COARSE: usize = 4;

fn grey_bands(p: &Picture, q: &Picture, gain: f32, mask: &[bool]) -> [[Cell; TILES]; 2] {
    let mut sums = [[Sum::default(); TILES]; 2];
    let (columns, rows) = (p.width / COARSE, p.height / COARSE);
    for j in 0..rows {
        for i in 0..columns {
            let (mut n, mut r1, mut r2, mut texture, mut light) = (0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32);
            for y in j * COARSE..(j + 1) * COARSE {
                for x in i * COARSE..(i + 1) * COARSE {
                    let k = y * p.width + x;
                    if !mask[k] || (p.data[k] > 252.0 && q.data[k] > 252.0) {
                        continue;
                    }
                    let r = q.data[k] - gain * p.data[k];
                    n += 1.0;
                    r1 += r;
                    r2 += r * r;
                    light += p.data[k];
                    let right = k + usize::from(x + 1 < p.width);
                    let below = k + p.width * usize::from(y + 1 < p.height);
                    texture += (p.data[right] - p.data[k]).powi(2) + (p.data[below] - p.data[k]).powi(2);
                }
            }
            if n > 4.0 {
                let energies = [(r2 - r1 * r1 / n) / (n - 1.0), (r1 / n).powi(2)];
                for (sums, energy) in sums.iter_mut().zip(energies) {
                    let sum = &mut sums[tile(i, j, columns, rows)];
                    sum.energy += f64::from(energy);
                    sum.texture += f64::from(texture / n);
                    sum.light += f64::from(light / n);
                    sum.count += 1.0;
                }
            }
        }
    }
    [cells_of(&sums[0]), cells_of(&sums[1])]
}

fn colour(p: &Picture, q: &Picture, gain: f32, mask: &[bool]) -> [Cell; TILES] {
    let mut sums = [Sum::default(); TILES];
    let (columns, rows) = (p.width / COARSE, p.height / COARSE);
    for j in 0..rows {
        for i in 0..columns {
            let (mut n, mut c, mut texture) = (0.0f32, [0.0f32; 2], 0.0f32);
            for y in j * COARSE..(j + 1) * COARSE {
                for x in i * COARSE..(i + 1) * COARSE {
                    let k = y * p.width + x;
                    let (a, b) = (&p.data[3 * k..3 * k + 3], &q.data[3 * k..3 * k + 3]);
                    if !mask[k] || a.iter().zip(b).any(|(a, b)| *a > 250.0 || *b > 250.0) {
                        continue;
                    }
                    let r: [f32; 3] = std::array::from_fn(|d| b[d] - gain * a[d]);
                    n += 1.0;
                    c[0] += r[0] - r[1];
                    c[1] += r[2] - r[1];
                    let right = 3 * (k + usize::from(x + 1 < p.width));
                    texture += (0..3).map(|d| (p.data[right + d] - a[d]).powi(2)).sum::<f32>();
                }
            }
            if n > 4.0 {
                let sum = &mut sums[tile(i, j, columns, rows)];
                sum.energy += f64::from(((c[0] / n).powi(2) + (c[1] / n).powi(2)) * 0.5);
                sum.texture += f64::from(texture / n);
                sum.count += 1.0;
            }
        }
    }
    cells_of(&sums)
}

/// Turns texture into floors; the white noise of the case is the quiet end of its fine band, within the nuisance.
fn floors(cells: &mut [Vec<[Cell; TILES]>; BANDS], grain: &Grain) {
    let mut quiet: Vec<f64> = cells[0]
        .iter()
        .flatten()
        .filter(|c| c.floor > 0.0)
        .map(|c| c.energy - settings::TEXTURE[0] * c.texture - settings::FLAT[0] - grain.variance(c.light))
        .collect();
    let noise = ds_stats::quantile(&mut quiet, 0.3).clamp(settings::LEAST_NOISE, settings::MOST_NOISE);
    // averaging over 16 pixels at each step; white noise of the last band is that of three channels
    for (band, (frames, share)) in cells.iter_mut().zip([1.0, 1.0 / 16.0, 1.0 / 256.0, 1.0 / 128.0]).enumerate() {
        for cell in frames.iter_mut().flatten().filter(|c| c.floor > 0.0) {
            let white = (noise + grain.variance(cell.light)) * share;
            cell.floor = settings::FLAT[band] + settings::TEXTURE[band] * cell.texture + white;
        }
    }
}
