//! Networks that only look, and manifests that do not fit them.

use super::*;
use crate::made;

const CLIPS: &str = "
version = 1
[network]
file = \"clips.onnx\"
[image]
input = \"frames\"
size_px = [2, 1]
layout = \"NCTHW\"
history = 2
scale = 0.1
[feature]
output = \"features\"
";

/// Reads a manifest beside a network whose first feature is the sum of the input and whose second is its third number.
fn read(text: &str, weight: f32) -> Result<Encoder, String> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    made::linear(&folder.path().join("clips.onnx"), &[1, 3, 2, 1, 2], 2, |row, column| {
        if column == 0 || row == 2 { weight } else { 0.0 }
    });
    let path = folder.path().join("clips.toml");
    std::fs::write(&path, text).expect("write");
    Encoder::read(&path).map_err(|error| {
        let source = std::error::Error::source(&error).map(ToString::to_string);
        format!("{error}: {}", source.unwrap_or_default())
    })
}

#[test]
fn clips_become_features() {
    let encoder = read(CLIPS, 1.0).expect("sound");
    assert_eq!((encoder.frames(), encoder.features()), (2, 2));
    // Twice as large as the network's frames.
    let frames = [10, 30].map(|level| RgbImage::filled(4, 2, [level, 0, 50]));
    let [first, second] = &frames;
    let seen = encoder.look(&[first, second]).expect("seen");
    // Red of both pixels of both frames, then green, then blue: the third number is the red of the second frame.
    assert!((seen[0] - 2.0 * (1.0 + 3.0 + 5.0 + 5.0)).abs() < 1e-5 && (seen[1] - 3.0).abs() < 1e-6, "{seen:?}");
    assert_ne!(encoder.digest(), read(&CLIPS.replace("0.1", "0.2"), 1.0).expect("sound").digest());
    assert_ne!(encoder.digest(), read(CLIPS, 2.0).expect("sound").digest());
    let error = read(CLIPS, f32::INFINITY).expect("sound").look(&[first, second]).expect_err("no numbers").to_string();
    assert!(error.contains("clips.onnx") && error.contains("number 0 of output \"features\" is"), "{error}");
}

#[test]
fn what_does_not_fit_is_named() {
    for (from, to, says) in [
        ("version = 1", "version = 3", "version"),
        ("clips.onnx", "none.onnx", "none.onnx"),
        ("clips.onnx\"", "clips.onnx\"\ndigest = \"00\"", "the manifest says 00"),
        ("[2, 1]", "[3, 1]", "input \"frames\" has shape [1, 3, 2, 1, 2], the manifest gives [1, 3, 2, 1, 3]"),
        ("NCTHW", "NTCHW", "the manifest gives [1, 2, 3, 1, 2]"),
        ("history = 2", "history = 16", "the manifest gives [1, 3, 16, 1, 2]"),
        ("scale = 0.1", "camera = { raw = \"front\" }", "image.camera"),
        ("scale = 0.1", "std = [0.0, 1.0, 1.0]", "image.std"),
        ("scale = 0.1", "range = 1.0", "range"),
        ("\"features\"", "\"pool\"", "has no output \"pool\", it gives \"features\""),
    ] {
        let error = read(&CLIPS.replace(from, to), 1.0).expect_err(says);
        assert!(error.contains(says), "{error:?} does not say {says:?}");
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    made::linear(&folder.path().join("clips.onnx"), &[1, 3, 2, 1, 2], 5_000, |_, _| 0.0);
    let path = folder.path().join("clips.toml");
    std::fs::write(&path, CLIPS).expect("write");
    let error = Encoder::read(&path).expect_err("too many").to_string();
    assert!(error.contains("holds 5000 numbers, 1 to 4096 are features"), "{error}");
}
