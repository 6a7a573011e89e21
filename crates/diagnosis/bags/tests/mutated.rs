//! Mutated bags: each is refused by name or read; never a panic, a hang or memory without bound.

use std::path::Path;

use ds_bags::{Clock, Format, Wanted, series, topics};

fn read_mutated(name: &str, format: Format, index: u64) {
    let whole = std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)).expect("the bag");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(name);
    std::fs::write(&path, crate::mutation::bytes(&whole, name, index)).expect("writable");
    let wanted =
        |topic: &str, field: &str| Wanted { topic: topic.to_owned(), field: field.to_owned(), clock: Clock::Own };
    let wanted = [wanted("/cmd", "drive.acceleration"), wanted("/pose", "pose.orientation"), wanted("/fix", "north")];
    drop(topics(&path, format));
    drop(series(&path, format, &wanted));
}

#[test]
fn mutated_mcaps_are_borne() {
    crate::mutation::all_are_borne("mutated::mutated_mcaps_are_borne", |index| {
        read_mutated("drive.mcap", Format::Mcap, index)
    });
}

#[test]
fn mutated_ros_1_bags_are_borne() {
    crate::mutation::all_are_borne("mutated::mutated_ros_1_bags_are_borne", |index| {
        read_mutated("drive.bag", Format::Rosbag1, index)
    });
}

#[test]
fn mutated_bzip2_chunks_are_borne() {
    crate::mutation::all_are_borne("mutated::mutated_bzip2_chunks_are_borne", |i| {
        read_mutated("drive-bz2.bag", Format::Rosbag1, i)
    });
}

#[test]
fn mutated_rosbag2_files_are_borne() {
    crate::mutation::all_are_borne("mutated::mutated_rosbag2_files_are_borne", |index| {
        read_mutated("drive.db3", Format::Rosbag2, index)
    });
}
