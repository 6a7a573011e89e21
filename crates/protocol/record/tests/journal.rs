//! Recordings survive what processes do to them: round trip, kills at every place, resumption, broken bytes.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use ds_record::{Outcome, RecordError, Recorder, Recording, partial_path};
use ds_space::{Digest, DigestWriter, Draws, Tick};
use ds_topic::{Envelope, Event, EventKind, Frame, Layout, Slot, Topic, World};
use proptest::prelude::*;

use crate::drive::{Drive, completed};

const CAMERAS: [&str; 2] = ["front", "rear"];

fn drive() -> Drive {
    Drive::new(&CAMERAS, 13)
}

fn messages_of(drive: &Drive) -> Vec<Envelope> {
    let mut all: Vec<Envelope> = (0..drive.iterations()).flat_map(|i| drive.iteration(i)).collect();
    all.push(drive.scene());
    all.sort_by_key(|envelope| envelope.header.slot);
    all
}

/// The bytes of a partial and of the finished recording of one drive.
struct Files {
    partial: Vec<u8>,
    complete: Vec<u8>,
}

static FILES: LazyLock<Files> = LazyLock::new(|| {
    let (drive, folder) = (drive(), tempfile::tempdir().expect("a temporary folder"));
    let path = folder.path().join("a.mcap");
    let recorder = drive.record(&path, drive.iterations());
    let partial = fs::read(partial_path(&path)).expect("the partial file is there");
    recorder.finish(&completed()).expect("finishes");
    Files { partial, complete: fs::read(&path).expect("the file is there") }
});

/// Ends of the top-level records, with their opcode.
fn records(bytes: &[u8]) -> Vec<(u8, usize)> {
    let mut ends = Vec::new();
    let mut at = 8;
    while at + 9 <= bytes.len() {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().expect("eight bytes")) as usize;
        ends.push((bytes[at], at + 9 + length));
        at += 9 + length;
    }
    ends
}

/// Ends of the marks: the first closes the scene, the others one iteration each.
fn marks(bytes: &[u8]) -> Vec<usize> {
    records(bytes).into_iter().filter(|(opcode, _)| *opcode == 0x0c).map(|(_, end)| end).collect()
}

/// Reads a partial recording that was cut and says how many iterations must be there, or that none can be.
fn check_cut(cut: usize) {
    let files = &*FILES;
    let closed = marks(&files.partial).into_iter().filter(|end| *end <= cut).count();
    let read = Recording::from_partial_bytes(&files.partial[..cut], Path::new("cut"));
    let Some(iterations) = closed.checked_sub(1) else {
        assert!(
            matches!(read, Err(RecordError::Foreign { .. } | RecordError::Unreadable { .. })),
            "cut at {cut} was read without a scene"
        );
        return;
    };
    let recording = read.unwrap_or_else(|error| panic!("cut at {cut}: {error}"));
    let drive = drive();
    let found: Vec<Vec<Envelope>> = recording.iterations().map(|messages| messages.cloned().collect()).collect();
    assert_eq!(found.len(), iterations, "cut at {cut}");
    for (index, messages) in (0..).zip(&found) {
        let mut expected = drive.iteration(index);
        expected.sort_by_key(|envelope| envelope.header.slot);
        assert_eq!(messages, &expected, "cut at {cut}, iteration {index}");
    }
    assert!(recording.completeness().is_none());
    let lacking = recording.missing().expect("orders decode");
    assert_eq!(lacking.is_empty(), iterations == drive.iterations() as usize, "cut at {cut}: {lacking:?}");
}

#[test]
fn what_was_recorded_is_read_again() {
    let drive = drive();
    let recording = Recording::from_bytes(&FILES.complete, Path::new("a.mcap")).expect("opens");
    let found: Vec<Envelope> = recording.messages().cloned().collect();
    assert_eq!(found, messages_of(&drive));
    assert_eq!(recording.scene(), drive.message());
    assert_eq!(recording.missing().expect("orders decode"), []);
    let record = recording.completeness().expect("is complete");
    assert_eq!((record.status.as_str(), record.iterations), ("completed", drive.iterations()));
    let count = |topic: Topic| messages_of(&drive).iter().filter(|e| e.header.slot.topic == topic).count() as u64;
    assert_eq!(record.messages["world"], count(Topic::World));
    assert_eq!(record.messages["frame/front"] + record.messages["frame/rear"], count(Topic::Frame));
    assert_eq!(record.messages.values().sum::<u64>(), found.len() as u64);
}

#[test]
fn digests_cover_payloads_per_tick_and_camera() {
    let recording = Recording::from_bytes(&FILES.complete, Path::new("a.mcap")).expect("opens");
    let stream = |add: &dyn Fn(Tick, &mut DigestWriter)| {
        let mut writer = DigestWriter::new();
        Tick(0).to(Tick(13)).for_each(|tick| add(tick, &mut writer));
        writer.finish()
    };
    let world = stream(&|tick, writer| {
        recording.body::<World>(Slot::new(Topic::World, tick.0)).expect("is there").digest_into(writer);
    });
    let frame = stream(&|tick, writer| {
        for camera in 0..2 {
            let slot = Slot::of_camera(Topic::Frame, tick.0, camera);
            recording.body::<Frame>(slot).expect("is there").digest_into(writer);
        }
    });
    let digests = recording.digests().expect("bodies decode");
    assert_eq!((digests.world, digests.frame), (world, frame));
    assert_eq!(Some(digests), recording.completeness().map(|record| record.digests));
    assert_ne!(digests.layout, digests.frame);
    let layout = recording.body::<Layout>(Slot::of_camera(Topic::Layout, 3, 1)).expect("is there");
    assert_eq!((layout.image.width_px(), layout.image.height_px()), (160, 96));
}

#[test]
fn a_kill_at_any_record_loses_only_what_was_not_committed() {
    let ends: Vec<usize> = records(&FILES.partial).into_iter().map(|(_, end)| end).collect();
    assert!(ends.len() > 10, "the recording has several chunks and marks");
    for end in ends {
        for cut in [end - 1, end, (end + 1).min(FILES.partial.len())] {
            check_cut(cut);
        }
    }
}

#[test]
fn a_cut_complete_file_is_read_as_a_partial_one() {
    let data_end = records(&FILES.complete).into_iter().find(|(opcode, _)| *opcode == 0x0f).expect("has an end").1;
    let whole = Recording::from_partial_bytes(&FILES.complete[..data_end], Path::new("cut")).expect("opens");
    assert!(whole.completeness().is_some(), "the summary is not needed");
    let last_mark = *marks(&FILES.complete).last().expect("has marks");
    let cut = Recording::from_partial_bytes(&FILES.complete[..last_mark - 1], Path::new("cut")).expect("opens");
    assert!(cut.completeness().is_none() && cut.tail().stopped.is_some());
}

#[test]
fn every_flipped_byte_and_every_cut_is_refused() {
    let (files, path) = (&*FILES, Path::new("damaged"));
    let draws = Draws::new(&Digest::of(b"damage"), "flip", &[]);
    for index in 0..400 {
        let at = draws.below(2 * index, files.complete.len() as u64) as usize;
        let mut bytes = files.complete.clone();
        bytes[at] ^= 1 << draws.below(2 * index + 1, 8);
        assert!(Recording::from_bytes(&bytes, path).is_err(), "byte {at} was changed without a word");
        assert!(Recording::from_bytes(&files.complete[..at], path).is_err(), "a cut at {at} was read without a word");
        if let Ok(recording) = Recording::from_partial_bytes(&bytes, path) {
            assert!(recording.damage().is_some(), "byte {at} was changed, and what is there does not say so");
        }
    }
    let mut bytes = files.complete.clone();
    let chunk = records(&bytes).into_iter().filter(|(opcode, _)| *opcode == 0x06).nth(2).expect("a third chunk").1;
    bytes[chunk - 20] ^= 1;
    let error = Recording::from_bytes(&bytes, path).err().expect("a broken chunk is refused").to_string();
    for part in ["byte ", "frame/front: ", "missing"] {
        assert!(error.contains(part), "no {part:?}: {error}");
    }
}

#[test]
fn what_is_missing_is_named_by_channel_and_range() {
    let drive = drive();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.mcap");
    drop(drive.record(&path, 2));
    let recording = Recording::open_partial(&partial_path(&path)).expect("opens");
    let text: Vec<String> = recording.missing().expect("orders decode").iter().map(ToString::to_string).collect();
    let refused = Recording::open(&partial_path(&path)).err().expect("an incomplete file is refused").to_string();
    assert!(refused.contains("not recorded to its end; advance: 2 of 4 missing (2 to 3); world: 8"), "{refused}");
    let expected = [
        "advance: 2 of 4 missing (2 to 3)",
        "world: 8 of 14 missing (6 to 13)",
        "ego: 8 of 14 missing (6 to 13)",
        "layout/front: 8 of 14 missing (6 to 13)",
        "layout/rear: 8 of 14 missing (6 to 13)",
        "frame/front: 8 of 14 missing (6 to 13)",
        "frame/rear: 8 of 14 missing (6 to 13)",
        "cache/front: 2 of 4 missing (2 to 3)",
        "cache/rear: 2 of 4 missing (2 to 3)",
        "plan: 1 of 3 missing (2)",
    ];
    assert_eq!(text, expected);
}

#[test]
fn what_was_taken_but_not_committed_is_not_given_out() {
    let drive = drive();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.mcap");
    let mut recorder = drive.record(&path, 1);
    recorder.append(&drive.iteration(1)).expect("takes the messages");
    drop(recorder);
    let recording = Recording::open_partial(&partial_path(&path)).expect("opens");
    assert_eq!(recording.iterations().count(), 1);
    assert!(!path.exists());
}

#[test]
fn messages_are_checked_against_what_is_there() {
    let drive = drive();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut recorder = drive.record(&folder.path().join("a.mcap"), 1);
    recorder.append(&drive.iteration(0)).expect("equal messages are passed over");
    let mut other = drive.iteration(0)[1].clone();
    other.header.content = Digest::of(b"other");
    assert!(matches!(recorder.append(&[other]), Err(RecordError::Divergent { .. })));
    let mut third = drive.iteration(1).into_iter().find(|e| e.header.slot.topic == Topic::Frame).expect("has frames");
    third.header.slot.camera = 2;
    assert!(matches!(recorder.append(&[third]), Err(RecordError::Camera { cameras: 2, .. })));
    assert!(matches!(recorder.commit(0), Err(RecordError::Order { found: 0, expected: 1 })));
}

#[test]
fn a_complete_recording_is_not_resumed_and_a_foreign_file_not_opened() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.mcap");
    fs::write(partial_path(&path), &FILES.complete).expect("writes");
    assert!(matches!(Recorder::resume(&path), Err(RecordError::Complete { .. })));
    fs::write(&path, b"a text").expect("writes");
    assert!(matches!(Recording::open(&path), Err(RecordError::Foreign { .. })));
    assert!(matches!(Recording::open(&folder.path().join("none")), Err(RecordError::File { action: "read", .. })));
}

/// Resumes a recording cut at some byte, drives on to the end, and returns the file.
fn resumed(cut: usize, folder: &Path) -> Vec<u8> {
    let drive = drive();
    let path: PathBuf = folder.join("a.mcap");
    fs::write(partial_path(&path), &FILES.partial[..cut]).expect("writes");
    let resumed = Recorder::resume(&path).expect("resumes");
    assert_eq!(resumed.scene, drive.scene());
    let mut recorder = resumed.recorder;
    assert_eq!(recorder.next_iteration() as usize, resumed.iterations.len());
    for iteration in recorder.next_iteration()..drive.iterations() {
        recorder.append(&drive.iteration(iteration)).expect("takes the messages");
        recorder.commit(iteration).expect("commits");
    }
    recorder.finish(&completed()).expect("finishes");
    assert!(!partial_path(&path).exists());
    fs::read(&path).expect("the file is there")
}

/// Recorders are handed to threads that may wait for the disk.
#[test]
fn a_recorder_may_move_to_another_thread() {
    let drive = drive();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.mcap");
    let recorder = drive.record(&path, 1);
    let finished = std::thread::spawn(move || recorder.finish(&completed()).is_ok()).join();
    assert!(finished.expect("the thread ends") && path.exists());
}

#[test]
fn the_last_events_come_with_the_completeness_record() {
    let drive = drive();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.mcap");
    let mut recorder = drive.record(&path, 2);
    let event = Event { kind: EventKind::Failed, reason: "policy_deadline".to_owned() };
    let envelope = drive.envelope(Slot::new(Topic::Event, 1), Tick(5), 1, &event);
    recorder.append(&[envelope]).expect("takes the event");
    let outcome = Outcome { status: "failed".to_owned(), reason: "policy_deadline".to_owned() };
    recorder.finish(&outcome).expect("finishes");
    let recording = Recording::open(&path).expect("opens");
    assert_eq!(recording.body::<Event>(Slot::new(Topic::Event, 1)).expect("is there"), event);
    let record = recording.completeness().expect("is complete");
    assert_eq!((record.reason.as_str(), record.iterations, record.messages["event"]), ("policy_deadline", 2, 2));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_kill_at_any_byte_loses_only_what_was_not_committed(share in 0.0..1.0f64) {
        check_cut((share * FILES.partial.len() as f64) as usize);
    }

    #[test]
    fn a_broken_byte_never_changes_what_is_given_out(share in 0.0..1.0f64, flip in 1u8..=255) {
        let mut bytes = FILES.complete.clone();
        let at = (share * bytes.len() as f64) as usize;
        bytes[at] ^= flip;
        if let Ok(recording) = Recording::from_partial_bytes(&bytes, Path::new("broken")) {
            let truth = messages_of(&drive());
            for envelope in recording.messages() {
                prop_assert!(truth.contains(envelope), "{} changed", envelope.header.slot);
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn a_resumed_recording_ends_as_if_nothing_had_happened(share in 0.0..1.0f64) {
        let begun = marks(&FILES.partial)[0];
        let cut = begun + (share * (FILES.partial.len() - begun) as f64) as usize;
        let folder = tempfile::tempdir().expect("a temporary folder");
        prop_assert!(resumed(cut, folder.path()) == FILES.complete, "the file differs after a cut at {}", cut);
    }
}
