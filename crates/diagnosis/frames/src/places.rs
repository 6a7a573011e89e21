//! Where the gap lies: tiles of a 4 x 6 grid in which real and nominal frames differ by more than an effect-free twin.
//!
//! A tile counts where its mean square difference exceeds that of the twin by a quarter of (twin + 1 level²), a frame
//! where some tile does so by half. The twin is the nominal frame at the nuisance offset, with what remains under the model.

use ds_diagnosis::schema::{Cell, Regime, correct};
use ds_effect::FrameChain;
use ds_stats::normal_tail;

use crate::loss::{Loss, TILES, tile};
use crate::scene::{Model, Scene};
use crate::settings;
use crate::warp::Grid;

/// Mean squares of the difference in every tile of every frame: real to nominal, and twin to nominal.
pub struct Differences {
    /// One row per frame: (real, twin) by tile, levels².
    pub rows: Vec<[[f64; 2]; TILES]>,
}

/// Returns what noise, encoder and resampling leave in every tile, levels²: what remains under the model, at most twice
/// the floor of its loss.
#[must_use]
pub fn remains(loss: &Loss) -> [f64; TILES] {
    std::array::from_fn(|t| {
        loss.cells[..3]
            .iter()
            .map(|frames| {
                let sum: f64 = frames.iter().map(|cells| cells[t].energy.min(2.0 * cells[t].floor)).sum();
                sum / frames.len().max(1) as f64
            })
            .sum()
    })
}

/// Measures all frames of a scene with the offsets of a model; `remains` is what is left under it.
#[must_use]
pub fn differences(scene: &Scene<'_>, model: &Model, remains: &[f64; TILES]) -> Differences {
    let still = FrameChain::new(&Vec::new());
    let rows = scene.frames.iter().enumerate().map(|(k, frame)| {
        let grid = Grid::new(&still, &scene.case.context(frame, 1, None), model.shifts[k]);
        let twin = grid.apply(&frame.sim);
        let mut sums = [[0.0; 3]; TILES];
        let c = twin.channels;
        for (i, ((t, s), r)) in twin.data.iter().zip(&frame.sim.data).zip(&frame.real.data).enumerate() {
            let (x, y) = (i / c % twin.width, i / c / twin.width);
            let sum = &mut sums[tile(x, y, twin.width, twin.height)];
            sum[0] += f64::from((r - s).powi(2));
            sum[1] += f64::from((t.clamp(0.0, 255.0) - s).powi(2));
            sum[2] += 1.0;
        }
        std::array::from_fn(|t| [sums[t][0] / sums[t][2], sums[t][1] / sums[t][2] + remains[t]])
    });
    Differences { rows: rows.collect() }
}

/// Returns the tiles that count, worst first.
#[must_use]
pub fn cells(scene: &Scene<'_>, differences: &Differences) -> Vec<Cell> {
    let n = differences.rows.len() as f64;
    let mut found = Vec::new();
    for t in 0..TILES {
        let mean = |d: usize| differences.rows.iter().map(|r| r[t][d]).sum::<f64>() / n;
        let (real, twin) = (mean(0), mean(1));
        if real - twin <= settings::TILE_EXCESS * (twin + 1.0) {
            continue;
        }
        let over: Vec<f64> = differences.rows.iter().map(|r| r[t][0] - r[t][1]).collect();
        let regime = Regime {
            tile: Some([t / settings::TILES[1], t % settings::TILES[1]]),
            distance: scene.case.depth_m.as_ref().map(|d| distance(scene, d, t).to_owned()),
            class: class(scene, t),
            ..Regime::default()
        };
        found.push(Cell {
            channel: "camera".to_owned(),
            regime,
            effect_size: (real / twin.max(1e-9)).sqrt(),
            q_value: Some(excess(&over)),
            t: spans(scene, differences, t),
        });
    }
    correct(&mut found, TILES);
    found.sort_by(|a, b| b.effect_size.total_cmp(&a.effect_size));
    found
}

/// Returns the chance of frames to differ by so much on average if they do not differ.
#[must_use]
pub fn excess(over: &[f64]) -> f64 {
    let (mean, count) = (over.iter().sum::<f64>() / over.len().max(1) as f64, (over.len() as f64).max(2.0));
    let variance = over.iter().map(|o| (o - mean).powi(2)).sum::<f64>() / (count - 1.0);
    normal_tail(mean / (variance / count).sqrt().max(1e-9))
}

/// Times at which a tile exceeds the twin by half, as spans.
fn spans(scene: &Scene<'_>, differences: &Differences, t: usize) -> Vec<[f64; 2]> {
    let mut spans: Vec<[f64; 2]> = Vec::new();
    let mut open = false;
    for (frame, row) in scene.frames.iter().zip(&differences.rows) {
        let [real, twin] = row[t];
        let over = real - twin > settings::FRAME_EXCESS * (twin + 1.0);
        match spans.last_mut() {
            Some(last) if over && open => last[1] = frame.time_secs,
            _ if over => spans.push([frame.time_secs; 2]),
            _ => {}
        }
        open = over;
    }
    spans
}

fn distance(scene: &Scene<'_>, depth_m: &[f32], t: usize) -> &'static str {
    let [width, height] = scene.case.size;
    let (row, column) = (t / settings::TILES[1], t % settings::TILES[1]);
    let x = (2 * column + 1) * width / (2 * settings::TILES[1]);
    let y = (2 * row + 1) * height / (2 * settings::TILES[0]);
    match depth_m[y * width + x] {
        d if d < 15.0 => "near",
        d if d < 50.0 => "middle",
        _ => "far",
    }
}

/// Class of the objects that cover most of a tile, where boxes cover at least a third of it over all frames.
fn class(scene: &Scene<'_>, t: usize) -> Option<String> {
    let [width, height] = scene.case.size.map(|s| s as f64);
    let (rows, columns) = (settings::TILES[0] as f64, settings::TILES[1] as f64);
    let (top, left) =
        ((t / settings::TILES[1]) as f64 * height / rows, (t % settings::TILES[1]) as f64 * width / columns);
    let mut areas: std::collections::BTreeMap<&str, f64> = std::collections::BTreeMap::new();
    for b in scene.frames.iter().flat_map(|f| &f.boxes) {
        let across = (b.edges[2].min(left + width / columns) - b.edges[0].max(left)).max(0.0);
        let down = (b.edges[3].min(top + height / rows) - b.edges[1].max(top)).max(0.0);
        *areas.entry(&b.class).or_default() += across * down;
    }
    let area = width * height / rows / columns * scene.frames.len() as f64;
    areas.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, a)| *a > area / 3.0).map(|(c, _)| c.to_owned())
}
