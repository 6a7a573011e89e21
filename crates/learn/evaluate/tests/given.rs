//! FID and FVD by networks that are given, and folders of pictures of the same states.

use std::path::{Path, PathBuf};

use ds_evaluate::study::config::Recorded;
use ds_evaluate::study::outcome::Outcome;
use ds_evaluate::study::{self, Study, StudyConfig};
use ds_raster::{Encoding, RgbImage};

use crate::study::{Counted, by, config};

#[path = "../../onnx/src/made.rs"]
mod made;

/// Writes a network of frames of 8×4 pixels, or clips of several, that gives `features` sums of them, with its manifest.
fn network(folder: &Path, frames: usize, features: usize, weight: impl Fn(usize, usize) -> f32) -> PathBuf {
    let name = format!("of-{frames}");
    let (layout, sides) = if frames == 1 { ("NCHW", vec![1, 3, 4, 8]) } else { ("NCTHW", vec![1, 3, frames, 4, 8]) };
    made::linear(&folder.join(format!("{name}.onnx")), &sides, features, weight);
    let image =
        format!("input = \"frames\"\nsize_px = [8, 4]\nlayout = {layout:?}\nhistory = {frames}\nscale = 0.01\n");
    let text =
        format!("version = 1\n[network]\nfile = \"{name}.onnx\"\n[image]\n{image}[feature]\noutput = \"features\"\n");
    let path = folder.join(format!("{name}.toml"));
    std::fs::write(&path, text).expect("writes");
    path
}

fn weight(row: usize, column: usize) -> f32 {
    ((row * (column + 3) * 7) % 11) as f32 - 5.0
}

/// The small study of one policy.
fn small(out: &Path) -> StudyConfig {
    let mut config = config(out);
    config.panel.retain(|member| member.name == "camera");
    config.panel[0].control = false;
    config
}

fn run(config: &StudyConfig) -> Result<Outcome, String> {
    by(None, Study::Fidelity, config, &mut Counted::default()).map_err(|error| words(&*error))
}

fn words(error: &(dyn std::error::Error + 'static)) -> String {
    let all = std::iter::successors(Some(error), |error| error.source());
    all.map(ToString::to_string).collect::<Vec<_>>().join(": ")
}

#[test]
fn fid_and_fvd_are_plain_and_stand_apart() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut config = small(folder.path());
    config.fid = Some(network(folder.path(), 1, 4, weight));
    config.fvd = Some(network(folder.path(), 4, 2, weight));
    let found = run(&config).expect("the study runs");
    let (fid, fvd) = (&found.given["fid"], &found.given["fvd"]);
    assert_eq!(
        (fid.features, fid.frames, fvd.features, fvd.frames),
        (4, 12, 2, 24),
        "2 frames, 4 clips of 6 scenarios"
    );
    for table in [fid, fvd] {
        let of = |source: &str| &table.sources[source];
        assert!(of("reference").fd.value.abs() < 1e-6 && of("layout").fd.value > 0.01, "{table:?}");
        let row = of("layout");
        assert!(row.fd.low < row.fd.high && row.fd.value <= row.bound * (1.0 + 1e-9) && row.placed.is_none());
    }
    assert!(fid.sources["layout"].warnings.iter().any(|warning| warning.contains("12 frames are fewer than 8 × 4")));
    assert!(found.others.keys().all(|name| name.starts_with("fd_look")) && !found.policies.contains_key("fid"));
    study::write(&config, &found).expect("writes");
    let page = std::fs::read_to_string(folder.path().join("index.html")).expect("a page");
    assert!(page.contains("By the networks given") && page.contains("FID by the network"), "they have a section");
    // Features twice as large are four times as far apart, which shares of a variance are not.
    config.fid = Some(network(folder.path(), 1, 4, |row, column| 2.0 * weight(row, column)));
    let twice = run(&config).expect("the study runs");
    let row = |found: &Outcome| found.given["fid"].sources["layout"].clone();
    let (one, four) = (row(&found), row(&twice));
    for (one, four) in [(one.fd.value, four.fd.value), (one.fd.low, four.fd.low), (one.bias, four.bias)] {
        assert!((four - 4.0 * one).abs() < 1e-6 * four.abs(), "{one} {four}");
    }
    assert_eq!(found.fd_pi, twice.fd_pi, "policies see what they saw");
}

#[test]
fn networks_that_do_not_fit_are_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let of = |frames: usize, weight: fn(usize, usize) -> f32| Some(network(folder.path(), frames, 4, weight));
    let with = |fid: Option<PathBuf>, fvd: Option<PathBuf>| {
        let mut config = StudyConfig { fid, fvd, scenarios: 4, ..small(folder.path()) };
        config.sources.retain(|source| source.name() == "layout");
        config.ratios.clear();
        run(&config).map(|_| ()).expect_err("it does not fit")
    };
    let error = with(Some(folder.path().join("none.toml")), None);
    assert!(error.contains("fid") && error.contains("none.toml"), "{error}");
    let error = with(of(4, weight), None);
    assert!(error.contains("fid: ") && error.contains("FID is of single frames"), "{error}");
    let error = with(None, of(1, weight));
    assert!(error.contains("fvd: ") && error.contains("FVD is of clips"), "{error}");
    let error = with(None, of(32, weight));
    assert!(error.contains("fvd: sees 32 frames at once, scenarios have 16"), "{error}");
    let error = with(of(1, |_, _| 0.0), None);
    assert!(error.contains("features of \"fid\" are constant"), "{error}");
    let error = with(of(1, |_, _| f32::NAN), None);
    assert!(error.contains("fid cannot look at") && error.contains("number 0 of output"), "{error}");
    let parts = StudyConfig { fid: of(1, weight), ..small(folder.path()) };
    let error = parts.check_for(Study::Parts).expect_err("plans have no features").to_string();
    assert!(error.contains("fid and fvd"), "{error}");
}

/// Writes four pictures of each of three scenes, bars that stand elsewhere in each; `dark` halves what they show.
fn pictures(folder: &Path, set: &str, dark: bool) {
    for scene in 0..3 {
        std::fs::create_dir_all(folder.join(format!("{set}/{scene}"))).expect("a folder");
        for at in 0..4 {
            let bar = |x: u32| u8::try_from(40 * ((x as usize / 12 + scene + 2 * at) % 5) + 30).expect("a level");
            let level = |x: u32| if dark { bar(x) / 2 } else { bar(x) };
            let pixels = (0..64).flat_map(|_| (0..96).flat_map(|x| [level(x), level(x + 16), 90])).collect();
            let image = RgbImage::new(96, 64, pixels).expect("96×64 pixels");
            let bytes = image.encode(Encoding::Png).expect("encodes");
            std::fs::write(folder.join(format!("{set}/{scene}/{at}.png")), bytes).expect("writes");
        }
    }
}

#[test]
fn folders_of_pictures_are_compared_by_name() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (at, names) = (folder.path(), ["real", "same", "dark"]);
    let set = |name: &&str| {
        let lens = "focal_px = [90.0, 90.0]\ncentre_px = [48.0, 32.0]\n";
        format!("[[recorded]]\nname = {name:?}\nframes = {name:?}\n{lens}")
    };
    names.iter().for_each(|name| pictures(at, name, *name == "dark"));
    std::fs::write(at.join("frames.toml"), names.iter().map(set).collect::<String>()).expect("writes");
    let sets = Recorded::load(&at.join("frames.toml")).expect("recorded sets");
    let mut config = small(at);
    config.fid = Some(network(at, 1, 3, weight));
    config.fvd = Some(network(at, 2, 2, weight));
    let guests = |name: &str, _: &str| Err(format!("{name} is not expected").into());
    let compared = |config: &StudyConfig, sets: &[Recorded]| {
        let mut counted = Counted::default();
        study::pictures(config, &guests, sets, &mut counted).map_err(|error| words(&error))
    };
    let found = compared(&config, &sets).expect("compared");
    assert!(found.fd_pi["same"].value.abs() < 1e-6 && found.fd_pi["dark"].value > 1.0, "{:?}", found.fd_pi);
    assert_eq!((found.scenarios, found.policies["camera"].frames), (3, 12));
    assert_eq!((found.given["fid"].frames, found.given["fvd"].frames), (12, 6));
    assert!(found.given["fvd"].sources["dark"].fd.value > found.given["fvd"].sources["same"].fd.value + 0.01);
    assert!(found.apart_m.is_empty() && found.kind == "from the pictures of real", "{}", found.kind);

    // Without folders within each picture is a drive of its own, which is said.
    let flat = |name: &str| Recorded { frames: at.join(name).join("0"), ..sets[0].clone() };
    let flat = [flat("real"), Recorded { name: "dark".to_owned(), ..flat("dark") }];
    (config.fid, config.fvd) = (None, None);
    let found = compared(&config, &flat).expect("compared");
    assert!(found.scenarios == 4 && found.kind.contains("each drawn by itself"), "{}", found.kind);

    let refused = |sets: &[Recorded], says: &str| {
        let error = compared(&config, sets).map(|_| ()).expect_err(says);
        assert!(error.contains(says), "{error:?} does not say {says:?}");
    };
    refused(&sets[..1], "must name two sets");
    refused(&[sets[0].clone(), sets[0].clone()], "\"real\" stands twice");
    refused(&[sets[0].clone(), Recorded { height_m: 0.0, ..sets[1].clone() }], "recorded.same: height_m");
    refused(&[sets[0].clone(), Recorded { frames: at.join("none"), ..sets[1].clone() }], "none");
    std::fs::copy(at.join("same/1/0.png"), at.join("same/1/0.jpg")).expect("copied");
    refused(&sets, "have one name");
    std::fs::remove_file(at.join("same/1/0.jpg")).expect("removed");
    std::fs::remove_file(at.join("same/1/3.png")).expect("removed");
    refused(&sets, "\"1/3\" is a picture of \"real\" alone");
}
