//! Bags written by another implementation: the three containers of one drive give the same numbers, and those are the drive's.

use std::path::{Path, PathBuf};

use ds_bags::{BagError, Clock, Format, Series, Wanted, series, topics};

const BAGS: [&str; 4] = ["drive.mcap", "drive.bag", "drive-bz2.bag", "drive.db3"];
const START_NANOS: i64 = 1_700_000_000_123_456_789;

fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

fn format(name: &str) -> Format {
    Format::of(&path(name)).expect("readable").expect("a bag")
}

fn wanted(topic: &str, field: &str, clock: Clock) -> Wanted {
    Wanted { topic: topic.to_owned(), field: field.to_owned(), clock }
}

fn read(name: &str, wanted: &[Wanted]) -> Result<Vec<Series>, BagError> {
    series(&path(name), format(name), wanted)
}

#[test]
fn the_three_containers_of_one_drive_give_the_same_numbers_and_those_of_the_drive() {
    let sought = [
        wanted("/cmd", "drive.steering_angle", Clock::Own),
        wanted("/pose", "pose.position.x", Clock::Own),
        wanted("/pose", "pose.position.y", Clock::Own),
        wanted("/pose", "pose.orientation", Clock::Own),
        wanted("/twist", "twist.linear.x", Clock::Own),
        wanted("/fix", "east", Clock::Own),
        wanted("/fix", "north", Clock::Own),
        wanted("/fix", "position_covariance[8]", Clock::Log),
    ];
    let all: Vec<Vec<Series>> = BAGS.iter().map(|name| read(name, &sought).expect("a sound bag")).collect();
    for found in &all[1..] {
        for (a, b) in all[0].iter().zip(found) {
            assert_eq!(a.nanos, b.nanos);
            assert!(a.values.iter().zip(&b.values).all(|(a, b)| (a - b).abs() < 1e-12));
        }
    }
    let [steer, x, y, yaw, v, east, north, covariance] = &all[0][..] else { panic!("eight are wanted") };
    assert_eq!(steer.values.len(), 85);
    for (k, (nanos, value)) in steer.nanos.iter().zip(&steer.values).enumerate() {
        let t = k as f64 * 0.1;
        assert_eq!(*nanos, START_NANOS + k as i64 * 100_000_000);
        let known = 0.035 * (0.61 * t).sin() + 0.02 * (1.7 * t).sin() * (0.013 * t).sin();
        assert!((value - known).abs() < 1e-8, "{t} s: {value} is not {known}");
    }
    assert!((v.values[0] - 14.0).abs() < 1e-9 && (yaw.values[0] - 0.4).abs() < 1e-9);
    for k in 1..85 {
        let along = (x.values[k] - x.values[k - 1], y.values[k] - y.values[k - 1]);
        let (sin, cos) = yaw.values[k - 1].sin_cos();
        assert!(
            (along.0 - 0.1 * v.values[k - 1] * cos).abs() < 1e-9
                && (along.1 - 0.1 * v.values[k - 1] * sin).abs() < 1e-9
        );
    }
    // every fourth row has a fix; the generator's metres per degree are rounded
    for (k, (east, north)) in east.values.iter().zip(&north.values).enumerate() {
        assert!((east - x.values[4 * k]).abs() < 0.05 && (north - y.values[4 * k]).abs() < 0.05, "{k}: {east} {north}");
    }
    assert_eq!(covariance.nanos[0], START_NANOS + 4_000_000, "by receipt");
}

#[test]
fn what_a_bag_holds_is_told_with_types_counts_and_paths() {
    for name in BAGS {
        let found = topics(&path(name), format(name)).expect("a sound bag");
        let said: Vec<(&str, &str, u64)> =
            found.iter().map(|t| (t.name.as_str(), t.kind.as_str(), t.messages)).collect();
        let expected = [
            ("/cmd", "ackermann_msgs/AckermannDriveStamped", 85),
            ("/fix", "sensor_msgs/NavSatFix", 22),
            ("/pose", "geometry_msgs/PoseStamped", 85),
            ("/twist", "geometry_msgs/TwistStamped", 85),
        ];
        assert_eq!(said, expected, "{name}");
        let leaves = found[2].leaves.as_ref().expect("a definition");
        assert!(leaves.iter().any(|leaf| leaf == "pose.orientation.w"), "{leaves:?}");
    }
}

#[test]
fn what_is_not_in_a_bag_is_refused_by_name_with_what_there_is() {
    for (topic, field, clock, hints) in [
        ("/odom", "x", Clock::Own, &["/odom", "/twist (geometry_msgs"][..]),
        ("/pose", "pose.position", Clock::Own, &["pose.position", "structure"]),
        ("/pose", "pose.place.x", Clock::Own, &["pose.place.x", "orientation"]),
        ("/pose", "header.frame_id", Clock::Own, &["text"]),
        ("/fix", "position_covariance", Clock::Own, &["position_covariance[0]"]),
        ("/fix", "position_covariance[9]", Clock::Own, &["9 elements"]),
        ("/twist", "north", Clock::Own, &["no number"]),
    ] {
        for name in BAGS {
            let error = read(name, &[wanted(topic, field, clock)]).expect_err("not there").to_string();
            assert!(hints.iter().all(|hint| error.contains(hint)), "{name}: {error}");
        }
    }
    let sent = [wanted("/pose", "pose.position.x", Clock::Publish)];
    assert!(read("drive.mcap", &sent).is_ok());
    assert!(
        read("drive.bag", &sent).expect_err("a ROS 1 bag does not say").to_string().contains("when a message was sent")
    );
}

#[test]
fn a_bag_cut_off_is_an_error_and_another_file_no_bag() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in BAGS {
        let whole = std::fs::read(path(name)).expect("the bag");
        let cut = folder.path().join(name);
        std::fs::write(&cut, &whole[..whole.len() * 2 / 3]).expect("writable");
        let error = topics(&cut, format(name)).expect_err("cut off");
        assert!(error.to_string().contains(name), "{error}");
    }
    let text = folder.path().join("text.bag");
    std::fs::write(&text, "t,x\n0,1\n").expect("writable");
    assert_eq!(Format::of(&text).expect("readable"), None);
}

#[test]
fn compressed_chunks_of_an_mcap_hold_the_same_messages() {
    let folder = tempfile::tempdir().expect("a folder");
    let whole = std::fs::read(path("drive.mcap")).expect("the bag");
    let sought = [wanted("/twist", "twist.linear.x", Clock::Own), wanted("/cmd", "drive.acceleration", Clock::Publish)];
    let plain = read("drive.mcap", &sought).expect("a sound bag");
    for compression in [mcap::Compression::Zstd, mcap::Compression::Lz4] {
        let to = folder.path().join("packed.mcap");
        let file = std::fs::File::create(&to).expect("writable");
        let options = mcap::WriteOptions::new().compression(Some(compression)).chunk_size(Some(8_192));
        let mut writer = options.create(file).expect("a writer");
        for message in mcap::MessageStream::new(&whole).expect("a sound bag") {
            writer.write(&message.expect("a sound message")).expect("writable");
        }
        writer.finish().expect("writable");
        drop(writer);
        let packed = series(&to, Format::Mcap, &sought).expect("a sound bag");
        for (a, b) in plain.iter().zip(&packed) {
            assert!(a.nanos == b.nanos && a.values == b.values && a.values.len() == 85);
        }
    }
}

#[test]
fn a_definition_that_the_bag_does_not_hold_is_taken_from_beside_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut whole = std::fs::read(path("drive.mcap")).expect("the bag");
    // definitions in a language that is not read
    let places: Vec<usize> = (0..whole.len() - 7).filter(|at| &whole[*at..at + 7] == b"ros2msg").collect();
    places.into_iter().for_each(|at| whole[at..at + 7].copy_from_slice(b"ros2idl"));
    let to = folder.path().join("drive.mcap");
    std::fs::write(&to, whole).expect("writable");
    let sought = [wanted("/cmd", "drive.acceleration", Clock::Own)];
    let error = series(&to, Format::Mcap, &sought).expect_err("no definition").to_string();
    assert!(error.contains("ros2idl") && error.contains("ackermann_msgs/msg/AckermannDriveStamped.msg"), "{error}");
    let messages = folder.path().join("ackermann_msgs/msg");
    std::fs::create_dir_all(&messages).expect("writable");
    let put = |name: &str, text: &str| std::fs::write(messages.join(name), text).expect("writable");
    put("AckermannDriveStamped.msg", "std_msgs/Header header # when\nAckermannDrive drive\n");
    let fields = "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\nfloat32 acceleration\n";
    put("AckermannDrive.msg", fields);
    let error = series(&to, Format::Mcap, &sought);
    assert!(error.is_ok(), "four bytes over may be padding: {error:?}");
    put("AckermannDrive.msg", "float32 steering_angle\nfloat32 acceleration\n");
    let error = series(&to, Format::Mcap, &sought).expect_err("another version").to_string();
    assert!(error.contains("left over"), "{error}");
    put("AckermannDrive.msg", &(fields.to_owned() + "float32 jerk\n"));
    let found = series(&to, Format::Mcap, &sought).expect("a definition");
    assert_eq!(found[0].values, read("drive.mcap", &sought).expect("a sound bag")[0].values);
}
