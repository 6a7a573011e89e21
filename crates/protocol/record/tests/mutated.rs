//! Mutated recordings: broken bytes of the file, and sound files whose messages hold broken bytes.

use std::path::Path;
use std::sync::LazyLock;

use ds_record::{Body, Recorder, Recording};
use ds_topic::{Advance, Ego, Envelope, Plan, SceneMessage, Topic, World};

use crate::drive::{Drive, completed};

/// Writes a drive with some messages changed; nothing if the recorder refuses them.
fn record(drive: &Drive, change: &dyn Fn(&mut Envelope)) -> Option<Vec<u8>> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.mcap");
    let mut scene = drive.scene();
    change(&mut scene);
    let mut recorder = Recorder::create(&path, &scene).ok()?;
    for iteration in 0..drive.iterations() {
        let mut messages = drive.iteration(iteration);
        messages.iter_mut().for_each(change);
        recorder.append(&messages).ok()?;
        recorder.commit(iteration).ok()?;
    }
    recorder.finish(&completed()).ok()?;
    std::fs::read(&path).ok()
}

static WHOLE: LazyLock<Vec<u8>> = LazyLock::new(|| record(&drive(), &|_| {}).expect("a sound drive is recorded"));

fn drive() -> Drive {
    Drive::new(&["front"], 9)
}

/// Puts other bytes in place of a body; where they can be read the digest follows them.
fn replaced<B: Body>(envelope: &mut Envelope, body: Vec<u8>) {
    if let Ok(read) = B::from_bytes(&body) {
        envelope.header.content = read.content();
    }
    envelope.body = body.into();
}

fn mutate(envelope: &mut Envelope, index: u64) {
    let slot = envelope.header.slot;
    if u64::from(slot.index) != index % 5 && slot.topic != Topic::Scene {
        return;
    }
    let body = crate::mutation::bytes(&envelope.body, slot.topic.name(), index);
    match (slot.topic, index % 5) {
        (Topic::Scene, 0 | 1) => replaced::<SceneMessage>(envelope, body),
        (Topic::Advance, 1) => replaced::<Advance>(envelope, body),
        (Topic::World, 2) => replaced::<World>(envelope, body),
        (Topic::Plan, 3 | 1) => replaced::<Plan>(envelope, body),
        (Topic::Ego, 4) => replaced::<Ego>(envelope, body),
        _ => {}
    }
}

fn use_all(recording: &Recording) {
    drop(recording.missing());
    drop(recording.digests());
    if let Ok(reel) = recording.reel() {
        for index in 0..reel.path.len() {
            drop((reel.moment)(index));
        }
    }
}

#[test]
fn mutated_recordings_are_refused_or_read() {
    crate::mutation::all_are_borne("mutated::mutated_recordings_are_refused_or_read", |index| {
        let path = Path::new("mutated.mcap");
        let bytes = if index.is_multiple_of(2) {
            crate::mutation::bytes(&WHOLE, "recording", index)
        } else {
            let Some(bytes) = record(&drive(), &|envelope| mutate(envelope, index / 2)) else { return };
            bytes
        };
        if let Ok(recording) = Recording::from_bytes(&bytes, path) {
            use_all(&recording);
        }
        if let Ok(recording) = Recording::from_partial_bytes(&bytes, path) {
            use_all(&recording);
        }
    });
}
