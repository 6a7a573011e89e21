//! Reads a case folder of two paired frame streams: `meta.json`, `frames.csv`, `boxes.csv`, `depth_proxy.png`, pictures.
//!
//! What may be absent (speed, yaw rate, boxes, depth, held-out pictures) is `None` or empty; what makes no sense is an
//! error by name. Times in s, speeds in m/s, boxes in px, depth in m.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::error::FramesError;
use ds_diagnosis::CaseError;
use ds_diagnosis::meta::{FrameMeta, Pairing, PinholeEntry};
use ds_effect::frame::{FrameContext, LayoutBox, Pinhole};
use ds_effect::picture::Picture;

/// Fewest frames that can be diagnosed.
const FEWEST_FRAMES: usize = 3;
/// Height of a camera over the road where nobody says, m.
const USUAL_HEIGHT_M: f64 = 1.5;
/// Distance of walls on either side, and farthest depth, of the corridor that stands in for depth, m.
const CORRIDOR_M: [f64; 2] = [7.0, 150.0];

/// One frame of both streams.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Its number.
    pub number: u64,
    /// Simulator time, s.
    pub time_secs: f64,
    /// Capture stamp of the real frame minus simulator time, s.
    pub stamp_lead_secs: Option<f64>,
    /// Forward speed, m/s.
    pub speed_mps: Option<f64>,
    /// Yaw rate, left positive, rad/s.
    pub yaw_rate_radps: Option<f64>,
    /// Illumination relative to the start.
    pub light: f64,
    /// Boxes of the layout.
    pub boxes: Vec<LayoutBox>,
    /// What the simulator rendered.
    pub sim: Picture,
    /// What the real camera saw.
    pub real: Picture,
}

/// A case.
#[derive(Debug, Clone)]
pub struct FrameCase {
    /// Its name.
    pub name: String,
    /// Columns and rows.
    pub size: [usize; 2],
    /// Frames per second.
    pub rate_hz: f64,
    /// Whether frames follow each other in a fixed step.
    pub contiguous: bool,
    /// Camera.
    pub camera: Pinhole,
    /// Height of the camera over the road, m, where the case says a sensible one.
    pub camera_height_m: Option<f64>,
    /// Rows of the whole sensor.
    pub sensor_rows: f64,
    /// Frames at which the video model starts anew.
    pub anchors: Vec<u64>,
    /// Depth along the axis, m, one per pixel.
    pub depth_m: Option<Vec<f32>>,
    /// Frames to fit, in order.
    pub fit: Vec<Frame>,
    /// Frames kept for the measure of success.
    pub held: Vec<Frame>,
    /// How the frames of the two streams belong together, where the case says so.
    pub pairing: Option<Pairing>,
    /// Folder of effect-free pairs of the same generator, where the case names one.
    pub nuisance: Option<PathBuf>,
    /// What looked odd.
    pub warnings: Vec<String>,
}

impl FrameCase {
    /// Reads a case of one simulated stream, `sim`.
    ///
    /// # Errors
    /// If a file is missing, spoiled or absurd.
    pub fn read(folder: &Path) -> Result<Self, FramesError> {
        Self::of_stream(folder, Path::new("sim"))
    }

    /// Reads a case with one of its simulated streams, whose folder is named relative to it.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn of_stream(folder: &Path, stream: &Path) -> Result<Self, FramesError> {
        let meta = read_meta(folder)?;
        let size = [meta.width, meta.height];
        let mut warnings = Vec::new();
        let camera_height_m = meta.camera_height_m.filter(|h| (0.2..10.0).contains(h));
        let mut boxes = read_boxes(&folder.join("boxes.csv"))?;
        let mut depth_m = read_depth(&folder.join("depth_proxy.png"), size)?;
        if depth_m.is_none() {
            warnings.push("no depth_proxy.png: a bare road corridor stands in for it".to_owned());
            depth_m = Some(corridor(size, &meta.intrinsics, camera_height_m.unwrap_or(USUAL_HEIGHT_M)));
        }
        let path = folder.join("frames.csv");
        let table = Table::read(&path)?;
        let mut frames = Vec::new();
        let mut before = f64::NEG_INFINITY;
        for row in 0..table.rows.len() {
            let number = table.number(row, "frame")?.unwrap_or(row as f64) as u64;
            let time_secs = table.number(row, "time_s")?.unwrap_or(row as f64 / meta.frame_rate_hz);
            if time_secs <= before {
                return Err(FramesError::TimeGoesBack { row: row + 1, time: time_secs, before, path });
            }
            before = time_secs;
            let picture = |stream: &Path| {
                ["jpg", "png"]
                    .map(|end| folder.join(stream).join(format!("{number:04}.{end}")))
                    .into_iter()
                    .find(|p| p.exists())
            };
            let (Some(sim), Some(real)) = (picture(stream), picture(Path::new("real"))) else { continue };
            frames.push(Frame {
                number,
                time_secs,
                stamp_lead_secs: table.number(row, "real_stamp_s")?.map(|s| s - time_secs),
                speed_mps: table.number(row, "speed_mps")?,
                yaw_rate_radps: table.number(row, "yaw_rate_radps")?,
                light: table.number(row, "light_rel")?.filter(|l| *l > 0.0).unwrap_or(1.0),
                boxes: boxes.remove(&number).unwrap_or_default(),
                sim: read_picture(&sim, size)?,
                real: read_picture(&real, size)?,
            });
        }
        if frames.len() < FEWEST_FRAMES {
            let found = frames.len();
            return Err(FramesError::TooFewFrames { found, needed: FEWEST_FRAMES, path: folder.to_path_buf() });
        }
        if frames.iter().any(|f| f.sim.channels != f.real.channels) {
            warnings.push("one stream is grey, the other in colour: both are compared in grey".to_owned());
            for frame in &mut frames {
                (frame.sim, frame.real) = (frame.sim.grey(), frame.real.grey());
            }
        }
        let case = Self {
            name: meta.case,
            size,
            rate_hz: meta.frame_rate_hz,
            contiguous: meta.contiguous,
            camera: pinhole(&meta.intrinsics),
            camera_height_m,
            sensor_rows: meta.sensor_rows.unwrap_or(meta.height as f64),
            anchors: meta.rollout_anchor_frames,
            depth_m,
            fit: frames,
            held: Vec::new(),
            pairing: meta.pairing,
            nuisance: meta.nuisance.map(|n| folder.join(n)),
            warnings,
        };
        case.check(folder)?;
        Ok(case.split(meta.suggested_split.map(|s| s.held_out)))
    }

    /// Keeps the suggested frames, or the last quarter, apart from the fit.
    fn split(mut self, held_out: Option<[u64; 2]>) -> Self {
        let inside = |f: &Frame| held_out.is_some_and(|[a, b]| (a..=b).contains(&f.number));
        let frames = std::mem::take(&mut self.fit);
        let fit = frames.iter().filter(|f| !inside(f)).count();
        if fit == frames.len() || fit < FEWEST_FRAMES {
            let most = (frames.len() / 4).max(1);
            let keep = frames.len() - most.min(frames.len() - FEWEST_FRAMES.min(frames.len()));
            let (a, b): (Vec<_>, Vec<_>) = frames.into_iter().enumerate().partition(|(k, _)| *k < keep);
            self.fit = a.into_iter().map(|(_, f)| f).collect();
            self.held = b.into_iter().map(|(_, f)| f).collect();
        } else {
            (self.held, self.fit) = frames.into_iter().partition(inside);
        }
        self
    }

    fn check(&self, folder: &Path) -> Result<(), FramesError> {
        for (stream, of) in [("sim", true), ("real", false)] {
            let spread = |f: &Frame| {
                let data = if of { &f.sim.data } else { &f.real.data };
                let low = data.iter().copied().fold(f32::INFINITY, f32::min);
                data.iter().copied().fold(0.0, f32::max) - low
            };
            if self.fit.iter().all(|f| spread(f) < 16.0) {
                return Err(FramesError::Blank { stream, path: folder.to_path_buf() });
            }
        }
        Ok(())
    }

    /// Returns what effects may know of a frame, for pictures made smaller by `factor`; `depth_m` is theirs.
    #[must_use]
    pub fn context<'a>(&self, frame: &'a Frame, factor: usize, depth_m: Option<&'a [f32]>) -> FrameContext<'a> {
        let (f, half) = (factor as f64, (factor as f64 - 1.0) / 2.0);
        let anchor = self.anchors.iter().copied().filter(|a| *a <= frame.number).max().unwrap_or(0);
        FrameContext {
            frame: frame.number,
            time_secs: frame.time_secs,
            frames_since_anchor: (frame.number - anchor) as f64,
            speed_mps: frame.speed_mps,
            yaw_rate_radps: frame.yaw_rate_radps,
            light: frame.light,
            depth_m,
            boxes: &frame.boxes,
            camera: Pinhole {
                fx: self.camera.fx / f,
                fy: self.camera.fy / f,
                cx: (self.camera.cx - half) / f,
                cy: (self.camera.cy - half) / f,
            },
            size: [self.size[0] / factor, self.size[1] / factor],
            sensor_rows: self.sensor_rows,
            seed: 0,
        }
    }
}

fn pinhole(entry: &PinholeEntry) -> Pinhole {
    Pinhole { fx: entry.fx, fy: entry.fy, cx: entry.cx, cy: entry.cy }
}

fn read_meta(folder: &Path) -> Result<FrameMeta, FramesError> {
    let meta = FrameMeta::read(folder)?;
    let (w, h) = (meta.width as f64, meta.height as f64);
    let rows = [
        ("width", w, 32.0, 8192.0, "32 to 8192 px"),
        ("height", h, 32.0, 8192.0, "32 to 8192 px"),
        ("fx", meta.intrinsics.fx, 0.1 * w, 20.0 * w, "0.1 to 20 widths"),
        ("fy", meta.intrinsics.fy, 0.1 * h, 50.0 * h, "0.1 to 50 heights"),
        ("cx", meta.intrinsics.cx, -w, 2.0 * w, "near the picture"),
        ("cy", meta.intrinsics.cy, -h, 2.0 * h, "near the picture"),
        ("frame_rate_hz", meta.frame_rate_hz, 0.01, 1000.0, "0.01 to 1000 Hz"),
    ];
    for (field, value, low, high, range) in rows {
        if !(low..=high).contains(&value) {
            return Err(FramesError::AbsurdCamera { field, value, range });
        }
    }
    Ok(meta)
}

fn read_text(path: &Path) -> Result<String, FramesError> {
    Ok(std::fs::read_to_string(path).map_err(|source| CaseError::Read { path: path.to_path_buf(), source })?)
}

fn read_picture(path: &Path, size: [usize; 2]) -> Result<Picture, FramesError> {
    let decoded = image::open(path).map_err(|source| FramesError::Decode { path: path.to_path_buf(), source })?;
    let found = [decoded.width() as usize, decoded.height() as usize];
    if found != size {
        return Err(FramesError::Size { found, expected: size, path: path.to_path_buf() });
    }
    let grey = decoded.color().channel_count() < 3;
    let bytes = if grey { decoded.into_luma8().into_raw() } else { decoded.into_rgb8().into_raw() };
    let data = bytes.into_iter().map(f32::from).collect();
    Ok(Picture { width: size[0], height: size[1], channels: if grey { 1 } else { 3 }, data })
}

fn read_depth(path: &Path, size: [usize; 2]) -> Result<Option<Vec<f32>>, FramesError> {
    if !path.exists() {
        return Ok(None);
    }
    let decoded = image::open(path).map_err(|source| FramesError::Decode { path: path.to_path_buf(), source })?;
    let found = [decoded.width() as usize, decoded.height() as usize];
    if found != size {
        return Err(FramesError::Size { found, expected: size, path: path.to_path_buf() });
    }
    Ok(Some(decoded.into_luma16().into_raw().into_iter().map(|cm| (f32::from(cm) * 0.01).max(0.5)).collect()))
}

/// Returns the depth of a flat road between two walls, m.
fn corridor(size: [usize; 2], camera: &PinholeEntry, height_m: f64) -> Vec<f32> {
    let place = |k: usize| {
        let across = ((k % size[0]) as f64 - camera.cx).abs() / camera.fx;
        let down = ((k / size[0]) as f64 - camera.cy) / camera.fy;
        let [walls_m, farthest_m] = CORRIDOR_M;
        let road_m = if down > 0.0 { height_m / down } else { farthest_m };
        road_m.min(walls_m / across.max(1e-4)).min(farthest_m).max(0.5) as f32
    };
    (0..size[0] * size[1]).map(place).collect()
}

fn read_boxes(path: &Path) -> Result<BTreeMap<u64, Vec<LayoutBox>>, FramesError> {
    let mut boxes: BTreeMap<u64, Vec<LayoutBox>> = BTreeMap::new();
    if !path.exists() {
        return Ok(boxes);
    }
    let table = Table::read(path)?;
    for row in 0..table.rows.len() {
        let value = |column| table.number(row, column).map(|v| v.unwrap_or(0.0));
        let edges = [value("x0")?, value("y0")?, value("x1")?, value("y1")?];
        let class = table.text(row, "class").unwrap_or("car").to_owned();
        boxes.entry(value("frame")? as u64).or_default().push(LayoutBox { edges, class });
    }
    Ok(boxes)
}

/// A small table with a head.
struct Table {
    path: PathBuf,
    head: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    fn read(path: &Path) -> Result<Self, FramesError> {
        let text = read_text(path)?;
        let cells = |line: &str| line.split(',').map(|c| c.trim().to_owned()).collect::<Vec<_>>();
        let mut lines = text.lines().filter(|l| !l.trim().is_empty());
        let head = lines.next().map(cells).unwrap_or_default();
        if !head.iter().any(|h| h == "frame") {
            return Err(FramesError::MissingColumn { column: "frame", path: path.to_path_buf() });
        }
        Ok(Self { path: path.to_path_buf(), head, rows: lines.map(cells).collect() })
    }

    fn text(&self, row: usize, column: &str) -> Option<&str> {
        let at = self.head.iter().position(|h| h == column)?;
        self.rows[row].get(at).map(String::as_str).filter(|t| !t.is_empty())
    }

    fn number(&self, row: usize, column: &'static str) -> Result<Option<f64>, FramesError> {
        let Some(text) = self.text(row, column) else { return Ok(None) };
        let value = text.parse().ok().filter(|v: &f64| v.is_finite());
        let path = self.path.clone();
        value.map(Some).ok_or_else(|| FramesError::NotANumber { row: row + 1, column, text: text.to_owned(), path })
    }
}
