//! Example tiles of a case of frames: simulated, real and their difference, where the diagnosis sees the largest gap.
//!
//! A difference is 128 + gain (real − simulated) per channel in grey levels: even grey means equal; the gain is the one
//! that just saturates the largest hundredth of all pixels, at most 8. For each of the most
//! conspicuous tiles the frame is taken whose tile differs most, within the cell's time spans where it has some.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ds_diagnosis::schema::Diagnosis;
use ds_diagnosis::table::Table;
use image::{ImageReader, Limits, Rgb, RgbImage, imageops};

use super::embed;
use super::markup::Markup;
use super::plot;
use super::tiles::{self, TILES};
use super::words;

/// Tiles that are shown.
const SHOWN: usize = 4;
/// Most frames that are searched.
const SEARCHED: usize = 48;
/// Largest side of a frame, px.
const LARGEST_PX: u32 = 4096;
/// Width at which a whole frame is embedded, px.
const WHOLE_PX: u32 = 420;
/// Largest factor on differences.
const GAIN: i32 = 8;

/// Pictures of one place: simulated, real, difference.
pub(crate) struct Triple {
    /// `None` for the whole frame.
    pub(crate) tile: Option<[usize; 2]>,
    /// Its number.
    pub(crate) frame: usize,
    /// Its time, s.
    pub(crate) secs: Option<f64>,
    /// Factor on the differences.
    pub(crate) gain: i32,
    /// Data URIs.
    pub(crate) pictures: [String; 3],
}

/// The strip: a whole frame, then tiles.
pub(crate) struct Strip {
    /// Width over height of a frame.
    pub(crate) aspect: f64,
    /// In order of conspicuousness.
    pub(crate) triples: Vec<Triple>,
}

/// One pair of frames with the mean squared difference of each tile.
struct Pair {
    frame: usize,
    secs: Option<f64>,
    paths: [PathBuf; 2],
    tiles: Vec<f64>,
}

/// Reads the frames of a case and picks examples; `None` if no pair of frames can be read.
pub(crate) fn strip(diagnosis: &Diagnosis, folder: &Path) -> Option<Strip> {
    let pairs = pairs(folder);
    let tiles = tiles::tiles(diagnosis);
    let mut order: Vec<[usize; 2]> = tiles.keys().copied().collect();
    order.sort_by(|a, b| tiles[b].0.total_cmp(&tiles[a].0));
    order.truncate(SHOWN);
    let total = |pair: &&Pair| -> f64 {
        let wanted = |k: &usize| tiles.is_empty() || tiles.contains_key(&[k / TILES.1, k % TILES.1]);
        (0..pair.tiles.len()).filter(wanted).map(|k| pair.tiles[k]).sum()
    };
    let whole = pairs.iter().max_by(|a, b| total(a).total_cmp(&total(b)))?;
    let (sim, real) = (read(&whole.paths[0])?, read(&whole.paths[1])?);
    let aspect = f64::from(sim.width()) / f64::from(sim.height());
    let mut triples: Vec<Triple> = triple(whole, None, &sim, &real).into_iter().collect();
    for tile in order {
        let spans: Vec<[f64; 2]> =
            diagnosis.cells.iter().filter(|c| c.regime.tile == Some(tile)).flat_map(|c| c.t.iter().copied()).collect();
        let within = |p: &&Pair| {
            p.secs.is_none_or(|t| spans.is_empty() || spans.iter().any(|s| t >= s[0] - 1e-3 && t <= s[1] + 1e-3))
        };
        let at = tile[0] * TILES.1 + tile[1];
        let by = |a: &&Pair, b: &&Pair| a.tiles[at].total_cmp(&b.tiles[at]);
        let Some(pair) = pairs.iter().filter(within).max_by(by).or_else(|| pairs.iter().max_by(by)) else { continue };
        if let (Some(sim), Some(real)) = (read(&pair.paths[0]), read(&pair.paths[1])) {
            triples.extend(triple(pair, Some(tile), &sim, &real));
        }
    }
    Some(Strip { aspect, triples })
}

fn triple(pair: &Pair, tile: Option<[usize; 2]>, sim: &RgbImage, real: &RgbImage) -> Option<Triple> {
    let (x, y, width, height) = tile.map_or((0, 0, sim.width(), sim.height()), |tile| bounds(tile, sim));
    let cut = |picture: &RgbImage| imageops::crop_imm(picture, x, y, width, height).to_image();
    let (sim, real) = (cut(sim), cut(real));
    let gain = gain(&sim, &real);
    let difference = RgbImage::from_fn(width, height, |x, y| {
        let (a, b) = (sim.get_pixel(x, y).0, real.get_pixel(x, y).0);
        Rgb([0, 1, 2].map(|c| (128 + gain * (i32::from(b[c]) - i32::from(a[c]))).clamp(0, 255) as u8))
    });
    let fitted = |picture: RgbImage| {
        if picture.width() <= WHOLE_PX {
            return picture;
        }
        let height = (f64::from(picture.height()) * f64::from(WHOLE_PX) / f64::from(picture.width())).round() as u32;
        imageops::resize(&picture, WHOLE_PX, height.max(1), imageops::FilterType::Triangle)
    };
    let [sim, real, difference] = [sim, real, difference].map(|picture| embed::jpeg(&fitted(picture)));
    Some(Triple { tile, frame: pair.frame, secs: pair.secs, gain, pictures: [sim?, real?, difference?] })
}

/// Returns the factor on differences that saturates a hundredth of the values.
fn gain(sim: &RgbImage, real: &RgbImage) -> i32 {
    let mut sizes: Vec<u8> = sim.as_raw().iter().zip(real.as_raw()).map(|(a, b)| a.abs_diff(*b)).collect();
    let place = sizes.len() * 99 / 100;
    if place >= sizes.len() {
        return 1;
    }
    let (_, size, _) = sizes.select_nth_unstable(place);
    (127 / i32::from((*size).max(1))).clamp(1, GAIN)
}

/// Left, top, width and height of a tile, px.
fn bounds([row, column]: [usize; 2], picture: &RgbImage) -> (u32, u32, u32, u32) {
    let end = |k: usize, of: usize, size: u32| (u64::from(size) * k as u64 / of as u64) as u32;
    let (x, x1) = (end(column, TILES.1, picture.width()), end(column + 1, TILES.1, picture.width()));
    let (y, y1) = (end(row, TILES.0, picture.height()), end(row + 1, TILES.0, picture.height()));
    (x, y, x1 - x, y1 - y)
}

/// Returns the frames that both sides have, at most [`SEARCHED`] of them.
fn pairs(folder: &Path) -> Vec<Pair> {
    let times = times(folder);
    let (sim, real) = (numbered(&folder.join("sim")), numbered(&folder.join("real")));
    let both: Vec<(usize, [PathBuf; 2])> =
        sim.into_iter().filter_map(|(frame, a)| real.get(&frame).map(|b| (frame, [a, b.clone()]))).collect();
    let stride = both.len().div_ceil(SEARCHED).max(1);
    let measured = |(frame, paths): (usize, [PathBuf; 2])| {
        let (a, b) = (read(&paths[0])?, read(&paths[1])?);
        if a.dimensions() != b.dimensions() || a.width() < TILES.1 as u32 || a.height() < TILES.0 as u32 {
            return None;
        }
        let tiles = (0..TILES.0 * TILES.1).map(|k| squared(&a, &b, [k / TILES.1, k % TILES.1])).collect();
        Some(Pair { frame, secs: times.get(&frame).copied(), paths, tiles })
    };
    both.into_iter().step_by(stride).filter_map(measured).collect()
}

fn squared(a: &RgbImage, b: &RgbImage, tile: [usize; 2]) -> f64 {
    let (x, y, width, height) = bounds(tile, a);
    let mut sum = 0;
    for (x, y) in (y..y + height).flat_map(|y| (x..x + width).map(move |x| (x, y))) {
        let (a, b) = (a.get_pixel(x, y).0, b.get_pixel(x, y).0);
        sum += (0..3).map(|c| u64::from(a[c].abs_diff(b[c])).pow(2)).sum::<u64>();
    }
    sum as f64 / f64::from(3 * width * height).max(1.0)
}

/// Frames of a folder by their number.
fn numbered(folder: &Path) -> BTreeMap<usize, PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return BTreeMap::new() };
    let paths = entries.filter_map(|entry| entry.ok().map(|e| e.path()));
    paths.filter_map(|path| Some((path.file_stem()?.to_str()?.parse().ok()?, path))).collect()
}

fn times(folder: &Path) -> BTreeMap<usize, f64> {
    let Ok(table) = Table::read(&folder.join("frames.csv")) else { return BTreeMap::new() };
    let (Some(frames), Some(times)) = (table.column("frame"), table.column("time_s")) else { return BTreeMap::new() };
    let known = frames.iter().zip(times).filter(|(frame, secs)| **frame >= 0.0 && secs.is_finite());
    known.map(|(frame, secs)| (*frame as usize, *secs)).collect()
}

fn read(path: &Path) -> Option<RgbImage> {
    let mut reader = ImageReader::open(path).ok()?.with_guessed_format().ok()?;
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(LARGEST_PX), Some(LARGEST_PX));
    reader.limits(limits);
    Some(reader.decode().ok()?.to_rgb8())
}

/// Writes the whole frame, then the tiles.
pub(crate) fn section(m: &mut Markup, diagnosis: &Diagnosis, strip: &Strip) {
    let sizes = tiles::tiles(diagnosis);
    m.leaf(
        "p",
        &[("class", &"lead")],
        "The frame and the tiles that differ most. Difference: even grey where both are equal, brighter where the real \
         frame is brighter.",
    );
    let (tiles, whole): (Vec<&Triple>, Vec<&Triple>) = strip.triples.iter().partition(|triple| triple.tile.is_some());
    for triple in whole {
        row(m, triple, &sizes, strip.aspect);
    }
    m.inside("div", &[("class", &"triples")], |m| {
        for triple in tiles {
            m.inside("div", &[], |m| row(m, triple, &sizes, strip.aspect));
        }
    });
}

fn row(m: &mut Markup, triple: &Triple, sizes: &tiles::Tiles, aspect: f64) {
    let time = triple.secs.map(|t| format!(" at {} s", words::fixed(t, 1))).unwrap_or_default();
    let frame = format!("frame {}{time}", triple.frame);
    let place = match triple.tile {
        None => words::capital(&frame),
        Some([row, column]) => {
            let size = sizes.get(&[row, column]).map(|t| format!("{} × floor, ", tiles::size(t.0))).unwrap_or_default();
            format!("Tile row {row}, column {column}: {size}{frame}")
        }
    };
    m.leaf("h3", &[], &place);
    let titles = ["simulated".to_owned(), "real".to_owned(), format!("difference × {}", triple.gain)];
    m.inside("div", &[("class", &"triple")], |m| {
        for (title, source) in titles.iter().zip(&triple.pictures) {
            m.inside("figure", &[], |m| {
                m.inside("div", &[("class", &"over")], |m| {
                    m.void("img", &[("src", source), ("alt", &format_args!("{place}, {title}"))]);
                    if triple.tile.is_none() {
                        grid(m, sizes, aspect);
                    }
                });
                m.leaf("figcaption", &[], title);
            });
        }
    });
}

fn grid(m: &mut Markup, tiles: &tiles::Tiles, aspect: f64) {
    let (width, height) = (600.0, 600.0 / aspect.max(0.1));
    let (w, h) = (width / TILES.1 as f64, height / TILES.0 as f64);
    plot::picture(m, "grid", "Tiles with a significant gap", (width, height), |m| {
        for [row, column] in tiles.keys() {
            plot::area(m, "framed", (w * *column as f64 + 3.0, h * *row as f64 + 3.0), (w - 6.0, h - 6.0), "");
        }
    });
}
