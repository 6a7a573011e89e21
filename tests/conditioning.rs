//! What the video model starts from: first frames and prompts of a run, and defaults as clips for training have them.

use std::path::Path;
use std::sync::LazyLock;

use crate::harness::{Drive, drive, text, workspace};
use ds_clips::{ClipSet, Progress, Recipe};
use ds_raster::{Encoding, RgbImage};
use ds_record::Recording;
use ds_topic::{Cache, Frame, Slot, Topic};

const SCENARIO: &str = "scenarios/base/free-curve.scenario.json";
const LAST_TICK: u32 = 20;

fn driven(arguments: &[&str]) -> (Drive, Recording) {
    let drive = drive(&[&[SCENARIO, "--duration", "2", "--policy", "log-replay"][..], arguments].concat());
    assert_eq!(drive.episode(0)["status"], "completed", "{}", drive.episode(0));
    let recording = Recording::open(&drive.recording(0)).expect("a recording");
    (drive, recording)
}

/// The drive that is given nothing.
static PLAIN: LazyLock<(Drive, Recording)> = LazyLock::new(|| driven(&[]));

fn frame(recording: &Recording, tick: u32) -> RgbImage {
    recording.body::<Frame>(Slot::new(Topic::Frame, tick)).expect("a frame").image
}

fn configuration(drive: &Drive) -> String {
    text(&drive.results["run"]["configuration_digest"])
}

/// Returns a picture of the camera's size, enlarged `times` times.
fn picture(times: u32) -> RgbImage {
    let mut picture = RgbImage::filled(160 * times, 96 * times, [150, 170, 210]);
    for (y, x) in (0..96 * times).flat_map(|y| (0..160 * times).map(move |x| (y, x))) {
        if y / times > 50 {
            picture.set_pixel(x, y, [(x / times) as u8, (y / times) as u8, 60]);
        }
    }
    picture
}

#[test]
fn a_given_first_frame_is_frame_0_and_changes_the_later_ones() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let [small, large] = [1, 3].map(|times| {
        let path = folder.path().join(format!("{times}.png"));
        std::fs::write(&path, picture(times).encode(Encoding::Png).expect("encodes")).expect("a file");
        path.to_str().expect("UTF-8").to_owned()
    });
    let (plain, default) = &*PLAIN;
    let (given, recording) = driven(&["--first-frame", &small]);
    let (again, _) = driven(&["--first-frame", &small]);
    let (reduced, _) = driven(&["--first-frame", &format!("front={large}")]);
    assert!(frame(&recording, 0) == picture(1) && recording.scene().first_frames == [picture(1)]);
    assert!(frame(default, 0) != picture(1) && frame(default, LAST_TICK) != frame(&recording, LAST_TICK));
    assert_eq!(plain.digests(0)[..2], given.digests(0)[..2], "world and layout do not depend on the first frame");
    assert_eq!(given.digests(0), again.digests(0), "equal runs");
    assert_eq!(given.digests(0), reduced.digests(0), "a larger picture is reduced");
    assert_eq!(configuration(&given), configuration(&again));
    assert_ne!(configuration(&given), configuration(plain));
    assert_eq!(recording.scene().scene.digest, default.scene().scene.digest);
}

#[test]
fn a_given_prompt_reaches_the_model() {
    let (plain, default) = &*PLAIN;
    let (given, recording) = driven(&["--prompt", "driving at night, snowfall"]);
    let (again, _) = driven(&["--prompt", "driving at night, snowfall"]);
    // Ordinary words are told in those of training.
    let told = "driving at night, headlights on, snowfall, flakes in the air, snow covered road";
    assert_eq!(recording.scene().spec.prompt, told);
    let conditioning = |recording: &Recording| {
        recording.body::<Cache>(Slot::new(Topic::Cache, 0)).expect("the first chunk").conditioning
    };
    assert_ne!(conditioning(&recording), conditioning(default));
    assert!(frame(&recording, 0) == frame(default, 0) && frame(&recording, LAST_TICK) != frame(default, LAST_TICK));
    assert_eq!(given.digests(0), again.digests(0), "equal runs");
    assert_ne!(configuration(&given), configuration(plain));
    assert_ne!(recording.scene().spec.configuration, default.scene().spec.configuration);
}

struct Quiet;

impl Progress for Quiet {
    fn made(&self, _clips: u64, _of: u64) {}
}

/// Renders one clip of each shipped scenario in a condition, one second long.
fn clips(folder: &Path, condition: &str) -> ClipSet {
    let [model, files] = ["configs/models/smoke.toml", "scenarios/base"].map(|path| {
        let path = workspace().join(path).canonicalize().expect("is shipped");
        path.to_str().expect("UTF-8").to_owned()
    });
    let text = format!(
        "version = 1\nname = \"clips\"\nsplit = \"train\"\nsource = \"imported\"\nmodel = {model:?}\nfolder = \"clips\"\n\
         seed = 1\nframes = 11\nshard_clips = 8\n[scenarios]\nfiles = [{files:?}]\nclips_each = 1\n\
         [appearance]\nconditions = [{condition:?}]\n"
    );
    std::fs::write(folder.join("clips.toml"), text).expect("a recipe");
    let recipe = Recipe::load(&folder.join("clips.toml")).expect("the recipe is valid");
    ds_clips::render(&recipe, &folder.join("clips"), &Quiet).expect("renders");
    ClipSet::open(&folder.join("clips")).expect("opens")
}

#[test]
fn default_prompts_are_those_of_training() {
    for (condition, appearance) in [
        ("lighting=day,weather=clear,surface=dry", "day"),
        ("lighting=night,weather=rain,surface=puddles", "rain-night-7"),
    ] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let set = clips(folder.path(), condition);
        let arguments = ["scenarios/base", "--duration", "1", "--policy", "log-replay", "--appearance", appearance];
        // What words a drive is given does not depend on the model that reads them.
        let model = ["--model", "configs/models/smoke.toml", "--workers", "2"];
        let drive = drive(&[&arguments[..], &model].concat());
        for index in 0..8 {
            let recording = Recording::open(&drive.recording(index)).expect("a recording");
            let scene = recording.scene();
            let clip = (0..set.len()).find(|clip| set.info(*clip).scenario == scene.scene.name);
            assert_eq!(scene.prompt(), set.info(clip.expect("a clip of each scenario")).prompt);
        }
    }
}
