//! Camera frames of a vehicle log beside those of the nominal simulator at the same states: a case of two frame streams.
//!
//! The nominal run drives the same scenarios with the same policy; frames are paired at equal stamps where both cars are
//! in the same place, so that what differs is the camera and not the drive. The longest stretch becomes the case.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use ds_diagnosis::meta::{CameraEntry, FrameMeta, FrameSplit, PinholeEntry, VehicleMeta};
use ds_raster::RgbImage;
use ds_record::vehicle_log::{self, Seen};
use ds_world::Reading;
use image::ImageEncoder;

use crate::error::{CasesError, at};
use crate::logs;

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

/// What two runs give.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Paired {
    /// A case, now in its folder.
    Case,
    /// Too few frames at the same states.
    TooFew,
    /// So many frames that are as the nominal ones.
    Alike(usize),
}

/// Writes the case of two runs' logs to a folder.
///
/// # Errors
/// If a log is refused, names no camera, or a file cannot be written.
pub fn write(real: &Path, nominal: &Path, out: &Path) -> Result<Paired, CasesError> {
    let cameras = VehicleMeta::read(real)?.cameras;
    let camera = cameras.first().ok_or_else(|| CasesError::NoCamera { path: real.to_path_buf() })?;
    let theirs = logs::drives(nominal)?;
    let mut best: Vec<Pair> = Vec::new();
    for drive in logs::drives(real)?.iter().filter(|drive| theirs.contains(drive)) {
        let stretch = longest(pairs([real, nominal].map(|run| logs::file(run, drive)), camera)?);
        if stretch.len() > best.len() {
            best = stretch;
        }
        if best.len() == MOST_FRAMES {
            break;
        }
    }
    if best.len() < FEWEST_FRAMES {
        return Ok(Paired::TooFew);
    }
    if best.iter().map(difference).fold(0.0, f64::max) < EQUAL_LEVELS {
        return Ok(Paired::Alike(best.len()));
    }
    save(&best, camera, out)?;
    Ok(Paired::Case)
}

/// Pairs the frames of two logs; a frame without a partner in its place leaves a hole.
fn pairs([real, nominal]: [PathBuf; 2], camera: &CameraEntry) -> Result<Vec<Option<Pair>>, CasesError> {
    let frames = |path: &Path| vehicle_log::frames(path, &camera.name, [camera.width, camera.height]);
    let (own, other) = (frames(&real)?, frames(&nominal)?);
    let (own_log, other_log) = (vehicle_log::read(&real)?.readings, vehicle_log::read(&nominal)?.readings);
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

fn jpeg(image: &RgbImage, quality: u8) -> Result<Vec<u8>, CasesError> {
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

fn save(pairs: &[Pair], camera: &CameraEntry, out: &Path) -> Result<(), CasesError> {
    let put = |path: PathBuf, bytes: &[u8]| std::fs::write(&path, bytes).map_err(at(&path));
    for stream in ["sim", "real"] {
        let folder = out.join(stream);
        std::fs::create_dir_all(&folder).map_err(at(&folder))?;
    }
    let mut table = String::from("frame,time_s,real_stamp_s,speed_mps,yaw_rate_radps,light_rel\n");
    for (number, pair) in pairs.iter().enumerate() {
        let name = format!("{number:04}.jpg");
        put(out.join("sim").join(&name), &jpeg(&pair.nominal, SIM_QUALITY)?)?;
        put(out.join("real").join(&name), &jpeg(&pair.real, REAL_QUALITY)?)?;
        let (t, speed, turn) = (pair.t, pair.speed_mps, pair.yaw_rate_radps);
        let _infallible = writeln!(table, "{number},{t:.4},{t:.4},{speed:.3},{turn:.5},1.000");
    }
    put(out.join("frames.csv"), table.as_bytes())?;
    let step = (pairs[pairs.len() - 1].t - pairs[0].t) / (pairs.len() - 1) as f64;
    let kept = (pairs.len() - pairs.len() / 5) as u64;
    let pinhole = PinholeEntry { fx: camera.fx, fy: camera.fy, cx: camera.cx, cy: camera.cy };
    let meta = FrameMeta {
        case: crate::folder::name(out),
        channels: Some("rgb".to_owned()),
        suggested_split: Some(FrameSplit { fit: Some([0, kept - 1]), held_out: [kept, pairs.len() as u64 - 1] }),
        camera_height_m: Some(camera.height_m),
        ..FrameMeta::new([camera.width, camera.height].map(|px| px as usize), 1.0 / step, pinhole)
    };
    Ok(meta.write(out)?)
}
