//! A recording is read by a program that shares no line with this project: Python with `mcap` and its protobuf support.
//!
//! The test makes an environment of its own below the target folder. Where `python3 -m venv` or the package index is not
//! to be had it says so and is skipped.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use ds_record::Recording;
use ds_topic::{Topic, World};

use crate::drive::{Drive, completed};

const PACKAGES: [&str; 2] = ["mcap==1.6.0", "mcap-protobuf-support==0.6.0"];

/// Prints one line per channel (count and schema) and one per world state, from the embedded schemas alone.
const PROGRAM: &str = r#"
import sys
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

counts, schemas, worlds = {}, {}, []
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
    for schema, channel, message, decoded in reader.iter_decoded_messages():
        counts[channel.topic] = counts.get(channel.topic, 0) + 1
        schemas[channel.topic] = schema.name
        assert decoded.header.time_ns == message.log_time == message.publish_time
        if channel.topic == "world":
            worlds.append((decoded.header.tick, len(decoded.agents), decoded.header.slot.index))
    marks = [mark.name for mark in reader.iter_metadata()]
for topic in sorted(counts):
    print("channel", topic, counts[topic], schemas[topic])
for world in worlds:
    print("world", *world)
print("marks", " ".join(marks))
"#;

/// Returns the environment's Python, or why there is none.
fn python() -> Result<PathBuf, String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mcap-reader");
    let python = folder.join("bin").join("python");
    let has_packages = |python: &Path| {
        Command::new(python)
            .args(["-c", "import mcap, mcap_protobuf"])
            .output()
            .is_ok_and(|output| output.status.success())
    };
    if has_packages(&python) {
        return Ok(python);
    }
    run(Command::new("python3").args(["-m", "venv"]).arg(&folder))?;
    run(Command::new(&python).args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]).args(PACKAGES))?;
    if has_packages(&python) { Ok(python) } else { Err("the packages do not import".to_owned()) }
}

fn run(command: &mut Command) -> Result<String, String> {
    let output = command.output().map_err(|error| error.to_string())?;
    if output.status.success() {
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    } else {
        Err(String::from_utf8_lossy(&output.stderr).into_owned())
    }
}

#[test]
fn python_decodes_every_message_with_the_embedded_schemas() {
    let python = match python() {
        Ok(python) => python,
        Err(why) => {
            eprintln!("skipped: no Python environment with {PACKAGES:?}: {why}");
            return;
        }
    };
    let drive = Drive::new(&["front", "rear"], 13);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.mcap");
    let record = drive.record(&path, drive.iterations()).finish(&completed()).expect("finishes");
    let program = folder.path().join("read.py");
    fs::write(&program, PROGRAM).expect("writes");
    let said = run(Command::new(&python).arg(&program).arg(&path)).expect("Python reads the recording");

    let recording = Recording::open(&path).expect("opens");
    assert_eq!(recording.scene(), drive.message());
    let mut expected: Vec<String> = record
        .messages
        .iter()
        .map(|(name, count)| {
            let topic = Topic::from_name(name.split('/').next().unwrap_or(name)).expect("channels are named by topic");
            format!("channel {name} {count} {}", ds_wire::message_name(topic))
        })
        .collect();
    for envelope in recording.topic(Topic::World) {
        let world: World = recording.body(envelope.header.slot).expect("decodes");
        let tick = world.state.tick;
        expected.push(format!("world {tick} {} {tick}", world.state.agents.len()));
    }
    let commits = vec!["dreamstream.commit"; drive.iterations() as usize].join(" ");
    expected.push(format!("marks dreamstream.begin {commits} dreamstream.complete"));
    assert_eq!(said.lines().collect::<Vec<_>>(), expected);
}
