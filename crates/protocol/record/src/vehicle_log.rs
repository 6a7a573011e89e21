//! The log that a real vehicle would have made of a drive: commands, own sensors, detections of others, camera frames.
//!
//! An MCAP file of JSON messages (camera frames as `foxglove.CompressedImage`) that any viewer opens. It holds no world
//! state, layout, cache, snapshot, digest or setting: two drives that differ in an effect alone differ in numbers alone.
//! Stamps are nanoseconds since the start of the scenario. Detections are those within 80 m of the car, in its rig
//! frame, with noise drawn by key, tick and road user.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Read};
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use ds_raster::{Encoding, RgbImage};
use ds_space::{Draws, Tick};
use ds_topic::{Frame, Plan, Slot, Topic, World};
use ds_world::{AgentState, EgoState, Reading};
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use serde::{Deserialize, Serialize};

use crate::checksum;
use crate::error::RecordError;
use crate::recording::Recording;
use crate::scan::MAX_RECORDING_BYTES;

/// Topic of the car's own sensors and commands.
pub const VEHICLE: &str = "vehicle";
/// Topic of what the car sees of others.
pub const DETECTIONS: &str = "detections";
/// Topic of the policy's answers: when each was made, and of what age its newest frame was.
pub const PLANS: &str = "plan";
const REACH_M: f64 = 80.0;
/// Standard deviations of detected position (m), heading (rad) and speed (m/s).
const NOISE: [f64; 3] = [0.15, 0.02, 0.2];

const VEHICLE_SCHEMA: &str = r#"{"type":"object","title":"Vehicle","properties":{
"t":{"type":"number","description":"s"},"cmd_steer":{"type":"number","description":"rad, road wheel"},
"cmd_accel":{"type":"number","description":"m/s2, force over nominal mass"},"x":{"type":"number","description":"m"},
"y":{"type":"number","description":"m"},"yaw":{"type":"number","description":"rad"},
"v":{"type":"number","description":"m/s"},"yaw_rate":{"type":"number","description":"rad/s"},
"ax":{"type":"number","description":"m/s2"},"ay":{"type":"number","description":"m/s2"},
"steer_meas":{"type":"number","description":"rad"},"v_wheel":{"type":"number","description":"m/s"}}}"#;
const DETECTIONS_SCHEMA: &str = r#"{"type":"object","title":"Detections","properties":{
"t":{"type":"number","description":"s"},"objects":{"type":"array","items":{"type":"object","properties":{
"id":{"type":"integer"},"class":{"type":"string"},"x":{"type":"number","description":"m ahead of the rear axle"},
"y":{"type":"number","description":"m left"},"yaw":{"type":"number","description":"rad against the car"},
"v":{"type":"number","description":"m/s"},"length":{"type":"number"},"width":{"type":"number"}}}}}}"#;
const PLANS_SCHEMA: &str = r#"{"type":"object","title":"Plan","properties":{
"t":{"type":"number","description":"s"},"frame_t":{"type":"number","description":"s, stamp of the newest frame shown"}}}"#;
const IMAGE_SCHEMA: &str = r#"{"type":"object","title":"foxglove.CompressedImage","properties":{
"timestamp":{"type":"object","properties":{"sec":{"type":"integer"},"nsec":{"type":"integer"}}},
"frame_id":{"type":"string"},"format":{"type":"string"},"data":{"type":"string","contentEncoding":"base64"}}}"#;

/// One sample of the car's own log; columns and units of a case file.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Vehicle {
    t: f64,
    cmd_steer: f64,
    cmd_accel: f64,
    x: f64,
    y: f64,
    yaw: f64,
    v: f64,
    yaw_rate: f64,
    ax: f64,
    ay: f64,
    steer_meas: f64,
    v_wheel: f64,
}

/// Another road user as the car sees it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Detection {
    /// Stays with the road user.
    pub id: u32,
    /// What it is.
    pub class: String,
    /// Ahead of the rear axle, m.
    pub x: f64,
    /// To the left, m.
    pub y: f64,
    /// Against the car's heading, rad.
    pub yaw: f64,
    /// Speed along its heading, m/s.
    pub v: f64,
    /// m.
    pub length: f64,
    /// m.
    pub width: f64,
}

/// What the car sees of others at one time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Detections {
    /// Stamp, s.
    pub t: f64,
    /// The road users.
    pub objects: Vec<Detection>,
}

/// When an answer of the policy was made and from what.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Planned {
    /// Stamp of the answer, s.
    pub t: f64,
    /// Stamp of the newest frame that the policy was shown, s.
    pub frame_t: f64,
}

/// A camera picture with its stamp.
#[derive(Debug, Clone, PartialEq)]
pub struct Seen {
    /// Stamp, s.
    pub t: f64,
    /// The picture.
    pub image: RgbImage,
}

#[derive(Serialize, Deserialize)]
struct Stamp {
    sec: u64,
    nsec: u64,
}

#[derive(Serialize)]
struct Image<'a> {
    timestamp: Stamp,
    frame_id: &'a str,
    format: &'static str,
    data: String,
}

/// A vehicle log in memory, frames left out.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct VehicleLog {
    /// Samples of the car's own sensors, in time order.
    pub readings: Vec<Reading>,
    /// What it saw of others, in time order.
    pub detections: Vec<Detections>,
    /// The policy's answers, in time order.
    pub plans: Vec<Planned>,
}

/// Extracts the vehicle log of a recorded drive to `path`.
///
/// # Errors
/// If the drive was made without a vehicle log, a message cannot be decoded, or the file cannot be written.
pub fn write(recording: &Recording, path: &Path) -> Result<(), RecordError> {
    let write_error = |source| RecordError::Write { path: path.to_path_buf(), source };
    let worlds: Vec<World> =
        recording.topic(Topic::World).map(|envelope| recording.body(envelope.header.slot)).collect::<Result<_, _>>()?;
    if worlds.iter().all(|world| world.readings.is_empty()) {
        let what = "a drive with a vehicle log".to_owned();
        return Err(RecordError::Foreign { what, path: path.to_path_buf() });
    }
    let plans = plans(recording)?;
    let mut log = Log::open(path, recording).map_err(write_error)?;
    let key = recording.scene().spec.draw_key();
    for world in &worlds {
        for reading in &world.readings {
            log.json(VEHICLE, reading.secs, &Vehicle::from(reading)).map_err(write_error)?;
        }
        let (tick, secs) = (world.state.tick, world.state.time.secs());
        log.json(DETECTIONS, secs, &detections(world, &key)).map_err(write_error)?;
        if let Some(planned) = plans.get(&tick) {
            log.json(PLANS, secs, planned).map_err(write_error)?;
        }
        for (index, camera) in (0u16..).zip(recording.cameras()) {
            // A drive that was cut short may lack the last frames; one that is there must be readable.
            let slot = Slot::of_camera(Topic::Frame, tick.0, index);
            if recording.get(slot).is_none() {
                continue;
            }
            let image = image(&recording.body::<Frame>(slot)?, camera.as_str(), secs, path)?;
            log.json(&topic_of(camera.as_str()), secs, &image).map_err(write_error)?;
        }
    }
    log.writer.finish().map(|_| ()).map_err(write_error)
}

/// Returns the policy's answers by the tick at which they were made.
fn plans(recording: &Recording) -> Result<BTreeMap<Tick, Planned>, RecordError> {
    let mut made = BTreeMap::new();
    for envelope in recording.topic(Topic::Plan) {
        let header = &envelope.header;
        if let Some(observed) = recording.body::<Plan>(header.slot)?.observed {
            made.insert(header.tick, Planned { t: header.time.secs(), frame_t: observed.secs() });
        }
    }
    Ok(made)
}

fn topic_of(camera: &str) -> String {
    format!("camera/{camera}")
}

fn image<'a>(frame: &Frame, camera: &'a str, secs: f64, path: &Path) -> Result<Image<'a>, RecordError> {
    let bytes = frame.image.encode(Encoding::Png).map_err(|error| RecordError::Foreign {
        what: format!("an image that PNG can hold ({error})"),
        path: path.to_path_buf(),
    })?;
    let nanos = nanos(secs);
    let timestamp = Stamp { sec: nanos / 1_000_000_000, nsec: nanos % 1_000_000_000 };
    Ok(Image { timestamp, frame_id: camera, format: "png", data: STANDARD.encode(bytes) })
}

fn nanos(secs: f64) -> u64 {
    (secs.max(0.0) * 1e9).round() as u64
}

struct Log {
    writer: Writer<BufWriter<File>>,
    channels: BTreeMap<String, u16>,
    sequence: u32,
}

impl Log {
    fn open(path: &Path, recording: &Recording) -> mcap::McapResult<Self> {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        let mut writer = WriteOptions::new()
            .library("vehicle log")
            .compression(Some(Compression::Zstd))
            .compression_threads(0)
            .create(BufWriter::new(File::create(path)?))?;
        let mut channels = BTreeMap::new();
        let images = recording.cameras().iter().map(|camera| topic_of(camera.as_str()));
        let topics = [
            (VEHICLE, "Vehicle", VEHICLE_SCHEMA),
            (DETECTIONS, "Detections", DETECTIONS_SCHEMA),
            (PLANS, "Plan", PLANS_SCHEMA),
        ]
        .into_iter()
        .map(|(topic, name, schema)| (topic.to_owned(), name, schema))
        .chain(images.map(|topic| (topic, "foxglove.CompressedImage", IMAGE_SCHEMA)));
        for (topic, name, schema) in topics {
            let schema = writer.add_schema(name, "jsonschema", schema.as_bytes())?;
            let channel = writer.add_channel(schema, &topic, "json", &BTreeMap::new())?;
            channels.insert(topic, channel);
        }
        Ok(Self { writer, channels, sequence: 0 })
    }

    fn json(&mut self, topic: &str, secs: f64, message: &impl Serialize) -> mcap::McapResult<()> {
        let channel_id = self.channels.get(topic).copied().unwrap_or_default();
        let time = nanos(secs);
        let header = MessageHeader { channel_id, sequence: self.sequence, log_time: time, publish_time: time };
        self.sequence = self.sequence.wrapping_add(1);
        let bytes = serde_json::to_vec(message).map_err(std::io::Error::from)?;
        self.writer.write_to_known_channel(&header, &bytes)
    }
}

fn detections(world: &World, key: &ds_space::Digest) -> Detections {
    let ego = &world.state.ego;
    let near = world.state.agents.iter().filter(|agent| agent.pose.position.distance(ego.pose.position) < REACH_M);
    let objects = near.map(|agent| detection(agent, ego, world.state.tick, key)).collect();
    Detections { t: world.state.time.secs(), objects }
}

fn detection(agent: &AgentState, ego: &EgoState, tick: Tick, key: &ds_space::Digest) -> Detection {
    let draws = Draws::new(key, "detection", &[u64::from(tick.0), u64::from(agent.id.0)]);
    let noise = |index: u64, sd: f64| sd * draws.normal(index);
    let place = ego.pose.relative(&agent.pose);
    Detection {
        id: agent.id.0,
        class: format!("{:?}", agent.class).to_lowercase(),
        x: place.position.x + noise(0, NOISE[0]),
        y: place.position.y + noise(1, NOISE[0]),
        yaw: place.heading_rad + noise(2, NOISE[1]),
        v: agent.velocity_mps.dot(agent.pose.forward()) + noise(3, NOISE[2]),
        length: agent.size.length_m,
        width: agent.size.width_m,
    }
}

impl From<&Reading> for Vehicle {
    fn from(reading: &Reading) -> Self {
        let [t, cmd_steer, cmd_accel, x, y, yaw, v, yaw_rate, ax, ay, steer_meas, v_wheel] = reading.to_array();
        Self { t, cmd_steer, cmd_accel, x, y, yaw, v, yaw_rate, ax, ay, steer_meas, v_wheel }
    }
}

impl From<Vehicle> for Reading {
    fn from(row: Vehicle) -> Self {
        let Vehicle { t, cmd_steer, cmd_accel, x, y, yaw, v, yaw_rate, ax, ay, steer_meas, v_wheel } = row;
        Self::from_array([t, cmd_steer, cmd_accel, x, y, yaw, v, yaw_rate, ax, ay, steer_meas, v_wheel])
    }
}

/// Lists what a vehicle log tells besides its numbers: each channel's topic, schema, encoding and metadata keys, then
/// the keys of the file's own metadata and the names of its attachments.
///
/// # Errors
/// If the file cannot be read or is no complete MCAP.
pub fn inventory(path: &Path) -> Result<Vec<String>, RecordError> {
    let bytes = bytes_of(path)?;
    let foreign = |what: String| RecordError::Foreign { what, path: path.to_path_buf() };
    let summary = mcap::Summary::read(&bytes).map_err(|error| foreign(error.to_string()))?;
    let summary = summary.ok_or_else(|| foreign("an MCAP file with a summary".to_owned()))?;
    let mut lines: Vec<String> = summary
        .channels
        .values()
        .map(|channel| {
            let schema = channel.schema.as_ref().map_or("none", |schema| schema.name.as_str());
            let keys: Vec<&str> = channel.metadata.keys().map(String::as_str).collect();
            format!("{} {schema} {} {keys:?}", channel.topic, channel.message_encoding)
        })
        .collect();
    lines.sort();
    lines.extend(summary.metadata_indexes.iter().map(|index| format!("metadata {}", index.name)));
    lines.extend(summary.attachment_indexes.iter().map(|index| format!("attachment {}", index.name)));
    Ok(lines)
}

/// Reads a whole file whose checksums, as far as its writer made them, are right.
fn bytes_of(path: &Path) -> Result<Vec<u8>, RecordError> {
    let failed = |source| RecordError::File { action: "read", path: path.to_path_buf(), source };
    let mut bytes = Vec::new();
    File::open(path).map_err(failed)?.take(MAX_RECORDING_BYTES + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > MAX_RECORDING_BYTES {
        return Err(RecordError::TooLarge { found: bytes.len() as u64, limit: MAX_RECORDING_BYTES });
    }
    if !bytes.starts_with(mcap::MAGIC) {
        return Err(RecordError::Foreign { what: "no MCAP magic bytes".to_owned(), path: path.to_path_buf() });
    }
    match checksum::verify(&bytes) {
        Ok(_) => Ok(bytes),
        Err(what) => Err(RecordError::Damaged { what, path: path.to_path_buf() }),
    }
}

/// Reads a vehicle log, frames left out.
///
/// # Errors
/// If the file cannot be read, is no MCAP, or holds no message of the car's own sensors.
pub fn read(path: &Path) -> Result<VehicleLog, RecordError> {
    let foreign = |what: String| RecordError::Foreign { what, path: path.to_path_buf() };
    let bytes = bytes_of(path)?;
    let mut log = VehicleLog::default();
    for message in mcap::MessageStream::new(&bytes).map_err(|error| foreign(error.to_string()))? {
        let message = message.map_err(|error| foreign(error.to_string()))?;
        let unread = |error: serde_json::Error| foreign(format!("{} message: {error}", message.channel.topic));
        match message.channel.topic.as_str() {
            VEHICLE => log.readings.push(serde_json::from_slice::<Vehicle>(&message.data).map_err(unread)?.into()),
            PLANS => log.plans.push(serde_json::from_slice(&message.data).map_err(unread)?),
            DETECTIONS => log.detections.push(serde_json::from_slice(&message.data).map_err(unread)?),
            _ => {}
        }
    }
    if log.readings.is_empty() {
        return Err(foreign(format!("no message on {VEHICLE:?}")));
    }
    Ok(log)
}

#[derive(Deserialize)]
struct Picture {
    timestamp: Stamp,
    data: String,
}

/// Reads the pictures of a camera of a vehicle log, in time order.
///
/// # Errors
/// If the file cannot be read, is no MCAP, or holds a picture that cannot be decoded or has another size.
pub fn frames(path: &Path, camera: &str, [width_px, height_px]: [u32; 2]) -> Result<Vec<Seen>, RecordError> {
    let foreign = |what: String| RecordError::Foreign { what, path: path.to_path_buf() };
    let (bytes, topic) = (bytes_of(path)?, topic_of(camera));
    let mut frames = Vec::new();
    for message in mcap::MessageStream::new(&bytes).map_err(|error| foreign(error.to_string()))? {
        let message = message.map_err(|error| foreign(error.to_string()))?;
        if message.channel.topic != topic {
            continue;
        }
        let unread = |error: &dyn std::fmt::Display| foreign(format!("{topic} message: {error}"));
        let picture: Picture = serde_json::from_slice(&message.data).map_err(|error| unread(&error))?;
        let data = STANDARD.decode(&picture.data).map_err(|error| unread(&error))?;
        let image = RgbImage::decode(Encoding::Png, width_px, height_px, &data).map_err(|error| unread(&error))?;
        let t = picture.timestamp.sec as f64 + 1e-9 * picture.timestamp.nsec as f64;
        frames.push(Seen { t, image });
    }
    Ok(frames)
}
