//! What manifests say, and which are refused.

use super::*;

const SOUND: &str = r#"
version = 1
[policy]
name = "mine"
file = "mine.onnx"
[image]
input = "image"
size_px = [320, 160]
history = 2
[state]
input = "state"
fields = ["speed_mps", "command_left", "zero"]
[command]
input = "command"
one_hot = ["left", "straight", "right", "unknown"]
[plan]
output = "plan"
first_s = 0.5
spacing_s = 0.5
"#;

fn read(text: &str) -> Result<Manifest, String> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("mine.toml");
    std::fs::write(&path, text).expect("write");
    Manifest::read(&path).map_err(|error| {
        let source = std::error::Error::source(&error).map(ToString::to_string);
        format!("{error}: {}", source.unwrap_or_default())
    })
}

#[test]
fn inputs_have_the_shapes_that_the_manifest_gives() {
    let shapes = |text: &str| {
        let manifest = read(text).expect("sound");
        manifest.inputs().into_iter().map(|input| input.shape).collect::<Vec<_>>()
    };
    assert_eq!(shapes(SOUND), [vec![1, 6, 160, 320], vec![1, 3], vec![1, 4]]);
    let image = |layout: &str| SOUND.replace("history = 2", &format!("history = 2\nlayout = {layout:?}"));
    assert_eq!(shapes(&image("NHWC"))[0], [1, 160, 320, 6]);
    assert_eq!(shapes(&image("NTCHW"))[0], [1, 2, 3, 160, 320]);
    let calibrated = shapes(&format!("{SOUND}\n[calibration]\nimage_from_rig = \"P\"\nintrinsics = \"K\""));
    assert_eq!(calibrated[3..], [vec![1, 3, 3], vec![1, 4, 4]]);
}

#[test]
fn what_cannot_be_is_named_with_its_field() {
    for (from, to, says) in [
        ("version = 1", "version = 2", "version"),
        ("name = \"mine\"", "name = \"My policy\"", "policy.name"),
        ("first_s = 0.5", "first_s = 0.1", "plan.first_s"),
        ("spacing_s = 0.5", "spacing_s = -1.0", "it must be 0.01 to 60 s"),
        ("spacing_s = 0.5", "spacing_s = 1e-12", "it must be 0.01 to 60 s"),
        ("spacing_s = 0.5", "spacing_s = 1e300", "it must be 0.01 to 60 s"),
        ("spacing_s = 0.5", "spacing_s = nan", "it must be 0.01 to 60 s"),
        ("[320, 160]", "[0, 160]", "image.size_px"),
        ("input = \"state\"", "input = \"image\"", "\"image\" stands in two tables"),
        ("history = 2", "history = 0", "image.history"),
        ("history = 2", "std = [1.0, 0.0, 1.0]", "image.std"),
        ("\"zero\"]", "\"zero\"]\nscale = [1.0]", "state.scale"),
        ("\"speed_mps\"", "\"speed_kmh\"", "speed_kmh"),
        ("[plan]", "[calibration]\nintrinsics = \"state\"\n[plan]", "\"state\" stands in two tables"),
        ("[plan]", "[calibration]\nextrinsics = \"E\"\n[plan]", "extrinsics"),
        ("spacing_s = 0.5", "spacing_s = 0.5\nrate_hz = 2", "rate_hz"),
        ("output = \"plan\"", "", "output"),
    ] {
        let error = read(&SOUND.replace(from, to)).expect_err(says);
        assert!(error.contains(says), "{error:?} does not say {says:?}");
    }
    let blind = SOUND.replace("[image]\ninput = \"image\"\nsize_px = [320, 160]\nhistory = 2", "[calibration]");
    assert!(read(&blind).expect_err("no image").contains("of the camera of [image]"));
}
