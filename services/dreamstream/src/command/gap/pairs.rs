//! Camera frames of a vehicle log beside those of the nominal simulator at the same states: a case of two frame streams.
//!
//! The nominal run drives the same scenarios with the same policy; frames are paired at equal stamps where both cars are
//! in the same place, so that what differs is the camera and not the drive. The longest stretch becomes the case.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use ds_raster::RgbImage;
use ds_record::vehicle_log::{self, Seen};
use ds_world::Reading;
use image::ImageEncoder;
use serde_json::{Value, json};

use super::logs;

/// Both cars are in one place within this, metres and radians: what the noise of the logs leaves of the mean difference of
/// so many readings. A camera half a pixel elsewhere would be taken for another camera.
const SAME_PLACE: [f64; 2] = [0.02, 0.003];
const AVERAGED: usize = 10;
/// Stamps are equal within this, s.
const SAME_TIME_SECS: f64 = 0.001;
/// No case is longer.
const MOST_FRAMES: usize = 60;
const FEWEST_FRAMES: usize = 12;
/// Streams that differ by less, root mean square in grey levels, show no camera at all: half the quietest sensor's noise.
const EQUAL_LEVELS: f64 = 0.4;

/// How the layout of a case stores its streams: what an encoder loses is part of the mismatch that every camera has.
const SIM_QUALITY: u8 = 95;
const REAL_QUALITY: u8 = 92;

/// One frame of both streams.
struct Pair {
    t: f64,
    real: RgbImage,
    nominal: RgbImage,
    speed_mps: f64,
    yaw_rate_radps: f64,
}

/// Writes the case of two runs' logs to a folder; says so and returns `None` where no stretch is long enough.
pub(super) fn write(real: &Path, nominal: &Path, out: &Path) -> Result<Option<PathBuf>> {
    let meta = logs::read_meta(real)?;
    let camera = &meta["cameras"][0];
    ensure!(camera.is_object(), "{} names no camera: the log was made by an older version", real.display());
    let theirs = logs::drives(nominal)?;
    let mut best: Vec<Pair> = Vec::new();
    for drive in logs::drives(real)?.iter().filter(|drive| theirs.contains(drive)) {
        let file = format!("{drive}.mcap");
        let stretch = longest(pairs([&real.join(&file), &nominal.join(&file)], camera)?);
        if stretch.len() > best.len() {
            best = stretch;
        }
        if best.len() == MOST_FRAMES {
            break;
        }
    }
    if best.len() < FEWEST_FRAMES {
        crate::command::answer(&format!("{}: too few frames at the same states to compare pictures", real.display()));
        return Ok(None);
    }
    if best.iter().map(difference).fold(0.0, f64::max) < EQUAL_LEVELS {
        crate::command::answer(&format!("{}: {} camera frames are as the nominal ones", real.display(), best.len()));
        return Ok(None);
    }
    save(&best, camera, out)?;
    Ok(Some(out.to_path_buf()))
}

/// Pairs the frames of two logs; a frame without a partner in its place leaves a hole.
fn pairs([real, nominal]: [&Path; 2], camera: &Value) -> Result<Vec<Option<Pair>>> {
    let size = ["width", "height"].map(|key| camera[key].as_u64().and_then(|px| u32::try_from(px).ok()).unwrap_or(0));
    let name = camera["name"].as_str().unwrap_or_default();
    let frames = |path: &Path| vehicle_log::frames(path, name, size);
    let (own, other) = (frames(real)?, frames(nominal)?);
    let (own_log, other_log) = (vehicle_log::read(real)?.readings, vehicle_log::read(nominal)?.readings);
    let mut others = other.into_iter().peekable();
    let mut made = Vec::new();
    for Seen { t, image } in own {
        while others.next_if(|seen| seen.t < t - SAME_TIME_SECS).is_some() {}
        let partner = others.next_if(|seen| seen.t < t + SAME_TIME_SECS);
        let (here, there) = (around(&own_log, t), around(&other_log, t));
        let Some(reading) = here.last().filter(|_| same_place(here, there)) else {
            made.push(None);
            continue;
        };
        made.push(partner.map(|partner| Pair {
            t,
            real: image,
            nominal: partner.image,
            speed_mps: reading.speed_mps,
            yaw_rate_radps: reading.yaw_rate_radps,
        }));
    }
    Ok(made)
}

/// Returns the last readings before a time.
fn around(log: &[Reading], t: f64) -> &[Reading] {
    let end = log.partition_point(|reading| reading.secs < t);
    &log[end.saturating_sub(AVERAGED)..end]
}

fn same_place(here: &[Reading], there: &[Reading]) -> bool {
    if here.len() < AVERAGED || there.len() < AVERAGED {
        return false;
    }
    let mean = |field: fn(&Reading) -> f64| {
        let differences = here.iter().zip(there).map(|(own, other)| field(own) - field(other));
        differences.sum::<f64>() / AVERAGED as f64
    };
    mean(|r| r.x_m).hypot(mean(|r| r.y_m)) < SAME_PLACE[0] && mean(|r| r.yaw_rad).abs() < SAME_PLACE[1]
}

/// Returns the longest stretch without a hole, up to [`MOST_FRAMES`].
fn longest(pairs: Vec<Option<Pair>>) -> Vec<Pair> {
    let (mut best, mut start) = (0..0, 0);
    for end in 1..=pairs.len() {
        start = if pairs[end - 1].is_none() { end } else { start.max(end.saturating_sub(MOST_FRAMES)) };
        if end - start > best.len() {
            best = start..end;
        }
    }
    pairs.into_iter().skip(best.start).take(best.len()).flatten().collect()
}

fn jpeg(image: &RgbImage, quality: u8) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality);
    encoder.write_image(image.rgb(), image.width_px(), image.height_px(), image::ExtendedColorType::Rgb8)?;
    Ok(bytes)
}

/// Returns the root mean square difference of a pair, grey levels.
fn difference(pair: &Pair) -> f64 {
    let (real, nominal) = (pair.real.rgb(), pair.nominal.rgb());
    let squares: f64 = real.iter().zip(nominal).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
    (squares / real.len().max(1) as f64).sqrt()
}

fn save(pairs: &[Pair], camera: &Value, out: &Path) -> Result<()> {
    let put =
        |path: PathBuf, bytes: &[u8]| std::fs::write(&path, bytes).with_context(|| format!("write {}", path.display()));
    for stream in ["sim", "real"] {
        let folder = out.join(stream);
        std::fs::create_dir_all(&folder).with_context(|| format!("create {}", folder.display()))?;
    }
    let mut table = String::from("frame,time_s,real_stamp_s,speed_mps,yaw_rate_radps,light_rel\n");
    for (number, pair) in pairs.iter().enumerate() {
        let name = format!("{number:04}.jpg");
        put(out.join("sim").join(&name), &jpeg(&pair.nominal, SIM_QUALITY)?)?;
        put(out.join("real").join(&name), &jpeg(&pair.real, REAL_QUALITY)?)?;
        writeln!(table, "{number},{:.4},{:.4},{:.3},{:.5},1.000", pair.t, pair.t, pair.speed_mps, pair.yaw_rate_radps)?;
    }
    put(out.join("frames.csv"), table.as_bytes())?;
    let step = (pairs[pairs.len() - 1].t - pairs[0].t) / (pairs.len() - 1) as f64;
    let kept = pairs.len() - pairs.len() / 5;
    let meta = json!({
        "case": out.file_name().map(|name| name.to_string_lossy()),
        "width": camera["width"],
        "height": camera["height"],
        "channels": "rgb",
        "frame_rate_hz": 1.0 / step,
        "contiguous": true,
        "intrinsics": { "fx": camera["fx"], "fy": camera["fy"], "cx": camera["cx"], "cy": camera["cy"] },
        "camera_height_m": camera["height_m"],
        "suggested_split": { "fit": [0, kept - 1], "held_out": [kept, pairs.len() - 1] },
    });
    put(out.join("meta.json"), (serde_json::to_string_pretty(&meta)? + "\n").as_bytes())
}
