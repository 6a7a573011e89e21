//! The study `fidelity` without a video model: the reference camera is at distance 0 from itself, other sources are not,
//! what was looked at is kept, and the same configuration gives the same figures.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use ds_evaluate::study::{self, Guests, Means, RecordedDrive, Study, StudyConfig, outcome::Outcome};
use ds_evaluate::{EvaluationError, Progress};
use ds_nn::Array;
use ds_policy::plan::evenly_spaced;
use ds_policy::{Context, Observation, Policy, PolicyAnswer, PolicyError, PrivilegedView, Restart};
use ds_raster::RgbImage;
use ds_space::{CameraModel, DVec2, PoseSe2, SimTime};

fn configs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs")
}

/// The shipped study, small, without the video model and two of the panel.
pub(crate) fn config(out: &Path) -> StudyConfig {
    let mut config = StudyConfig::load(&configs().join("study/fidelity.toml")).expect("the shipped study");
    config.sources.retain(|source| ["reference", "sim-rgb", "layout"].contains(&source.name()));
    let left: Vec<String> = config.sources.iter().map(|source| source.name().to_owned()).collect();
    config.ratios.retain(|pair| pair.iter().all(|name| left.contains(name)));
    config.panel.retain(|member| !["diffusiondrive", "rap"].contains(&member.name.as_str()));
    config.video = None;
    (config.size_px, config.scenarios, config.frames, config.draws) = ((160, 96), 6, 16, 10);
    config.out = out.to_path_buf();
    config.check().expect("sound");
    config
}

#[derive(Default)]
pub(crate) struct Counted {
    pub(crate) made: u32,
    pub(crate) kept: u32,
}

impl Progress for Counted {
    fn ahead(&mut self, _rollouts: u64) {}
    fn done(&mut self, _what: &str, stored: bool) {
        if stored { self.kept += 1 } else { self.made += 1 }
    }
    fn note(&mut self, _text: &str) {}
}

/// Runs a study to which no policy connects.
fn alone(study: Study, config: &StudyConfig, progress: &mut Counted) -> Result<Outcome, Box<EvaluationError>> {
    by(None, study, config, progress)
}

/// The same by so many workers.
pub(crate) fn by(
    workers: Option<usize>,
    study: Study,
    config: &StudyConfig,
    progress: &mut Counted,
) -> Result<Outcome, Box<EvaluationError>> {
    let guests: &Guests<'_> = &|name, _| Err(format!("{name} is not expected").into());
    study::run(study, config, &Means { guests, seconds: &|| 0.0, workers }, progress).map_err(Box::new)
}

fn run(study: Study, config: &StudyConfig) -> Result<Outcome, Box<EvaluationError>> {
    alone(study, config, &mut Counted::default())
}

/// The small study and what it found.
static STUDIED: LazyLock<(StudyConfig, Outcome, Counted)> = LazyLock::new(|| {
    let config = config(&tempfile::tempdir().expect("a temporary folder").keep());
    let (found, counted) = study(&config);
    (config, found, counted)
});

/// The same in another folder, with what was looked at before.
fn looked_at(out: &Path) -> StudyConfig {
    let [from, to] = [&STUDIED.0.out, out].map(|folder| folder.join("features"));
    std::fs::create_dir(&to).expect("a folder");
    for record in std::fs::read_dir(from).expect("records").map(|entry| entry.expect("an entry")) {
        std::fs::copy(record.path(), to.join(record.file_name())).expect("copied");
    }
    config(out)
}

fn study(config: &StudyConfig) -> (Outcome, Counted) {
    let mut progress = Counted::default();
    let outcome = alone(Study::Fidelity, config, &mut progress).expect("the study runs");
    (outcome, progress)
}

#[test]
fn the_reference_is_at_zero_and_what_was_looked_at_is_kept() {
    let (config, found, first) = &*STUDIED;
    assert_eq!((first.made, first.kept), (18, 6), "6 scenarios × 3 sets; the reference as a source is the real set");
    let row = |policy: &str, source: &str| &found.policies[policy].sources[source];
    let panel = ["drivor", "ltf", "sparsedrive"];
    for policy in panel.into_iter().chain(["camera", "camera-drawn"]) {
        assert!(row(policy, "reference").fd.value.abs() < 1e-6, "equal pixels");
        for source in ["sim-rgb", "layout"] {
            let row = row(policy, source);
            assert!(row.fd.value > 0.1 && row.fd.value <= row.bound * (1.0 + 1e-9), "{policy} {source}: {row:?}");
            assert!(row.fd.low < row.fd.high && row.placed.is_some() && row.bias > 0.0);
            assert!(row.warnings.iter().any(|warning| warning.contains("fewer")), "12 frames are few");
        }
    }
    // FDπ is of the panel alone, without its controls.
    let mean = panel.iter().map(|policy| row(policy, "layout").fd.value).sum::<f64>() / 3.0;
    assert!((found.fd_pi["layout"].value - mean).abs() < 1e-9);
    assert_eq!(found.others["fd_look_clip"].features, 128);
    assert_eq!(found.worst["layout"].len(), 6);
    assert!(found.worst["layout"].windows(2).all(|pair| pair[0].apart >= pair[1].apart));
    study::write(config, found).expect("writes");
    let page = std::fs::read_to_string(config.out.join("index.html")).expect("a page");
    assert!(page.contains("sim-to-reference") && page.contains("camera-drawn") && page.contains("held-out"));
    let seen = Outcome { held_out: Some(false), ..found.clone() };
    study::write(config, &seen).expect("writes");
    let page = std::fs::read_to_string(config.out.join("index.html")).expect("a page");
    assert!(found.held_out == Some(true) && page.contains("below those held out") && !page.contains("held-out"));
    // Where policies whose tokens are places attend to something else: of the picture, or of the ground.
    let laid: Vec<(&str, bool)> = found.attended.iter().map(|(name, all)| (name.as_str(), all[0].ground)).collect();
    assert_eq!(laid, [("camera", false), ("camera-drawn", false), ("ltf", true), ("sparsedrive", false)]);
    let [worst, middle, ..] = &found.attended["camera"][..] else { panic!("two scenes of each source") };
    assert!(worst.source == "layout" && worst.worst && !middle.worst && worst.apart >= middle.apart, "{worst:?}");
    assert!(worst.places.len() == 60 && worst.places.iter().any(|place| *place > 0.1), "{:?}", worst.places);
    assert!(page.contains("Where in them") && page.contains(&worst.picture), "the page lays them over the frames");
    assert!(config.out.join("scenes").join(&worst.picture).exists());
    let picture = found.worst["layout"][0].picture.as_ref().expect("the worst scene is shown");
    assert!(config.out.join("scenes").join(picture).exists());
    let (again, second) = study(config);
    assert_eq!((second.made, second.kept), (0, 24));
    assert_eq!(again, *found);
}

fn source(text: &str) -> study::config::Source {
    let value = if text.starts_with('{') {
        toml::from_str::<toml::Table>(&format!("it = {text}")).expect("readable")["it"].clone()
    } else {
        toml::Value::String(text.to_owned())
    };
    study::config::Source::try_from(value).expect("a sound source")
}

#[test]
fn figures_do_not_depend_on_how_many_look() {
    let alone = |workers: usize| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut config = config(folder.path());
        config.scenarios = 4;
        let mut counted = Counted::default();
        let found = by(Some(workers), Study::Fidelity, &config, &mut counted).expect("the study runs");
        let pictures = found.worst["layout"].iter().filter_map(|scene| scene.picture.as_ref());
        let names = pictures.chain(found.looks.iter().map(|(_, name)| name));
        let read = |name: &String| std::fs::read(folder.path().join("scenes").join(name)).expect("a picture");
        let pictures: Vec<Vec<u8>> = names.map(read).collect();
        assert_eq!((counted.made, counted.kept, pictures.len()), (12, 4, 7));
        (serde_json::to_string(&found).expect("plain values"), pictures)
    };
    assert!(alone(1) == alone(3), "one thread and three");
}

#[test]
fn far_sources_are_correlated_with_plans() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut config = config(folder.path());
    config.sources.extend([
        source("{ name = \"blurred\", from = \"reference\", blur_px = 3.0 }"),
        source("logged"),
        source("reprojected"),
        source("second-camera"),
    ]);
    let found = run(Study::Correlation, &config).expect("the study runs");
    let correlation = found.correlation.as_ref().expect("asked for");
    assert_eq!(correlation.sources, 6, "the real set is none");
    let metric = &correlation.metrics["fd_pi"];
    assert!(
        metric.r.low >= -1.0 && metric.r.high <= 1.0 && metric.points.len() == 18 && metric.each.len() == 3,
        "{metric:?}"
    );
    // By hand: r of one policy with the mean distance of the other two.
    let fd = |policy: &str, source: &str| found.policies[policy].sources[source].fd.value;
    for point in metric.points.iter().filter(|point| point.policy == "ltf") {
        let mean = 0.5 * (fd("drivor", &point.source) + fd("sparsedrive", &point.source));
        assert!((point.distance - mean).abs() < 1e-9);
        assert!((0.0..=1.0).contains(&point.pdms) && point.pdms == correlation.pdms["ltf"][&point.source]);
    }
    assert!(correlation.apart.contains_key("fd_look") && correlation.apart.contains_key("camera-drawn"));
    assert!(fd("camera", "blurred") > 0.1 && fd("camera", "logged") > 0.1, "displaced frames are not the log's");
    study::write(&config, &found).expect("writes");
    let page = std::fs::read_to_string(folder.path().join("index.html")).expect("a page");
    assert!(page.contains("look-second-camera.png") && folder.path().join("correlation.json").exists());
}

#[test]
fn edits_are_answered_and_drift_is_measured() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut config = looked_at(folder.path());
    config.sources.push(source("{ name = \"bare\", from = \"sim-rgb\", no_lines = true }"));
    config.sources.push(source("{ name = \"aside\", from = \"reference\", aside_m = 2.0 }"));
    config.edits = [["sim-rgb", "bare"], ["reference", "aside"]].map(|pair| pair.map(str::to_owned)).to_vec();
    let found = run(Study::Sensitivity, &config).expect("the study runs");
    let sensitivity = found.sensitivity.expect("asked for");
    let [bare, aside] = sensitivity.responses.as_slice() else { panic!("two edits") };
    let own = found.fd_pi["bare"].value / found.fd_pi["sim-rgb"].value - 1.0;
    assert!(!bare.in_deviations && (bare.answers["fd_pi"].response.value - own).abs() < 1e-9);
    assert!(aside.in_deviations && aside.answers["fd_pi"].response.value > 0.0);
    assert_eq!((sensitivity.hard.len(), sensitivity.hard[0].scenarios), (4, 2));
    assert!(sensitivity.hard.iter().all(|hard| hard.value > 0.0 && hard.p > 0.0 && hard.p <= 1.0));

    // Looking at many moments is what takes long: four drives and the sources that are asked of.
    config.edits.clear();
    config.sources.retain(|source| !["bare", "aside"].contains(&source.name()));
    config.scenarios = 4;
    (config.marks, config.ratios) = (vec![10, 16], vec![["layout", "sim-rgb"].map(str::to_owned)]);
    let found = run(Study::Rollout, &config).expect("the study runs");
    let rollout = found.rollout.expect("asked for");
    let curve = rollout.curves.iter().find(|curve| curve.source == "layout").expect("a source");
    assert_eq!(curve.marks.iter().map(|mark| mark.frame).collect::<Vec<_>>(), [10, 16]);
    assert!((curve.marks[1].fd_pi.value - curve.marks[0].fd_pi.value - curve.rise.value).abs() < 1e-9);
    assert_eq!(rollout.removed.len(), 1);
    // What a study does not find in its configuration is named.
    let error = run(Study::Sensitivity, &config).expect_err("no edits");
    assert!(error.to_string().contains("edits"), "{error}");
}

#[test]
fn wrong_studies_are_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let base = config(folder.path());
    let check = |change: fn(&mut StudyConfig), words: &str| {
        let mut config = base.clone();
        change(&mut config);
        let error = config.check_for(Study::Fidelity).expect_err(words).to_string();
        assert!(error.contains(words), "{error}");
    };
    check(|config| config.every = 4, "every");
    check(|config| config.scenarios = 1, "scenarios");
    check(|config| config.scenarios = 3, "scenarios: are too few");
    check(|config| config.first_seed = u64::MAX - 2, "first_seed");
    check(
        |config| config.sources[0] = source("{ name = \"reference\", from = \"layout\" }"),
        "\"reference\" is the name",
    );
    check(|config| config.sources.push(source("{ name = \"fd_pi\", from = \"layout\" }")), "\"fd_pi\" is the name");
    check(|config| config.panel[1].name = "own features".to_owned(), "panel: \"own features\" is the name");
    check(|config| config.panel[1].name = config.panel[0].name.clone(), "twice");
    check(
        |config| config.recorded = recorded(&config.out, (96, 64), [5, 17], ["reference", "far"]),
        "recorded: \"reference\"",
    );
    check(|config| config.panel.iter_mut().for_each(|member| member.control = true), "panel");
    check(|config| config.sources.push(source("layout")), "twice");
    check(|config| config.sources.push(source("dreamstream")), "video");
    check(|config| config.ratios.push(["dreamstream", "layout"].map(str::to_owned)), "ratios");
    check(|config| config.marks = vec![5, 16], "marks");
    let mut config = base.clone();
    config.sources.extend(["logged", "reprojected", "second-camera"].map(source));
    config.panel.iter_mut().skip(1).for_each(|member| member.control = true);
    config.panel[0].control = false;
    let error = config.check_for(Study::Correlation).expect_err("a panel of one").to_string();
    assert!(error.contains("panel: must name 2 policies"), "{error}");
    let mut config = base.clone();
    config.panel[0].policy = "lattice".to_owned();
    let error = run(Study::Fidelity, &config).expect_err("no features").to_string();
    assert!(error.contains("lattice") && error.contains("no features"), "{error}");
}

/// A policy in another process, as a study sees it: it goes straight on and tells means of the frame.
struct Guest {
    tells: bool,
    weight: f32,
}

impl Policy for Guest {
    fn name(&self) -> &str {
        "guest"
    }

    fn privileged(&self) -> bool {
        false
    }

    fn plan(&mut self, seen: &Observation, _: Option<&PrivilegedView>) -> Result<PolicyAnswer, PolicyError> {
        let poses: Vec<_> = (1..=40).map(|tick| PoseSe2::new(0.1 * f64::from(tick), 0.0, 0.0)).collect();
        let trajectory = evenly_spaced("guest", &poses, SimTime::from_secs(0.1))?;
        let newest: Vec<RgbImage> = seen.frames.iter().map(|frames| frames[0].clone()).collect();
        Ok(PolicyAnswer { context: self.context(&seen.cameras, &newest)?, ..PolicyAnswer::single(trajectory) })
    }

    fn context(&mut self, _: &[CameraModel], frames: &[RgbImage]) -> Result<Option<Context>, PolicyError> {
        let quarter = frames[0].rgb().len() / 4;
        let mean = |part: &[u8]| self.weight * part.iter().map(|byte| f32::from(*byte)).sum::<f32>() / quarter as f32;
        let tokens = Array::new(&[2, 2], frames[0].rgb().chunks_exact(quarter).map(mean).collect());
        Ok(self.tells.then_some(Context { tokens, grid: None }))
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

#[test]
fn a_policy_that_connects_is_a_member_and_another_one_is_looked_at_anew() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut config = config(folder.path());
    config.first_seed = 29_999_999;
    config.panel = vec![study::config::MemberConfig {
        name: "mine".to_owned(),
        policy: "guest".to_owned(),
        listen: Some("tcp/127.0.0.1:7448".to_owned()),
        weights: None,
        control: false,
    }];
    let with = |config: &StudyConfig, tells: bool, weight: f32| {
        let mut counted = Counted::default();
        let connect = |name: &str, listen: &str| {
            assert_eq!((name, listen), ("guest", "tcp/127.0.0.1:7448"));
            Ok(Box::new(Guest { tells, weight }) as Box<dyn Policy>)
        };
        let means = Means { guests: &connect, seconds: &|| 0.0, workers: Some(3) };
        let found = study::run(Study::Fidelity, config, &means, &mut counted);
        found.map(|found| (found, counted)).map_err(|error| error.to_string())
    };
    let (found, first) = with(&config, true, 1.0).expect("the study runs");
    assert_eq!((first.made, first.kept, found.held_out), (18, 6, Some(false)));
    let table = &found.policies["mine"];
    assert_eq!(table.features, 2, "the mean over two tokens of two numbers");
    assert!(table.sources["reference"].fd.value.abs() < 1e-6 && table.sources["layout"].fd.value > 0.1);
    assert_eq!(found.fd_pi["layout"], table.sources["layout"].fd, "a panel of one");
    let (again, kept) = with(&config, true, 1.0).expect("the study runs");
    assert_eq!((again, kept.made), (found, 0));
    assert_eq!(with(&config, true, 0.5).expect("the study runs").1.made, 18, "another network answers otherwise");
    let error = with(&config, false, 1.0).map(|_| ()).expect_err("no context");
    assert!(error.contains("panel.mine") && error.contains("no features"), "{error}");
    config.panel[0].policy = "camera".to_owned();
    let error = with(&config, true, 1.0).map(|_| ()).expect_err("runs inside");
    assert!(error.contains("panel.mine.listen"), "{error}");
}

/// Writes pictures of stripes, wider in one folder than in the other, and names them as recorded sets.
fn recorded(folder: &Path, size_px: (u32, u32), widths: [u32; 2], names: [&str; 2]) -> Vec<study::config::Recorded> {
    let mut text = String::new();
    for (name, width) in names.into_iter().zip(widths) {
        std::fs::create_dir_all(folder.join(name)).expect("a folder");
        for frame in 0..6 {
            let level = |x: u32, y: u32| (((x + 7 * frame) / width + y / (width + frame)) * 53 % 256) as u8;
            let rgb =
                (0..size_px.1).flat_map(|y| (0..size_px.0).flat_map(move |x| [level(x, y), level(y, x), 90])).collect();
            let image = ds_raster::RgbImage::new(size_px.0, size_px.1, rgb).expect("the size fits");
            let bytes = image.encode(ds_raster::Encoding::Png).expect("encodes");
            std::fs::write(folder.join(format!("{name}/{frame}.png")), bytes).expect("writes");
        }
        text += &format!(
            "[[recorded]]\nname = {name:?}\nframes = {name:?}\nfocal_px = [90.0, 90.0]\ncentre_px = [48.0, 32.0]\n"
        );
    }
    std::fs::write(folder.join("frames.toml"), text).expect("writes");
    study::config::Recorded::load(&folder.join("frames.toml")).expect("recorded sets")
}

#[test]
fn recorded_frames_are_the_unit() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut config = looked_at(folder.path());
    config.scenarios = 4;
    let run = |config: &StudyConfig| run(Study::Anchor, config).map_err(Box::new);
    assert!(run(&config).expect_err("no recorded sets").to_string().contains("recorded"));
    config.recorded = recorded(folder.path(), (96, 64), [5, 17], ["near", "far"]);
    let found = run(&config).expect("the study runs");
    study::write(&config, &found).expect("writes");
    let anchor = found.anchor.expect("an anchor");
    assert_eq!(anchor.unit, ["near", "far"]);
    assert!((anchor.recorded_to["far"] - 1.0).abs() < 1e-9, "{anchor:?}");
    assert!(anchor.reference_to["reference"].abs() < 1e-6 && anchor.reference_to["layout"] > 0.0, "{anchor:?}");
    assert!(anchor.policies.values().all(|policy| (0.0..=1.0).contains(&policy.shrinkage) && policy.unit > 0.0));
    let page = std::fs::read_to_string(folder.path().join("index.html")).expect("a page");
    assert!(page.find("Real frames as unit") < page.find("FDπ, the mean"));

    config.recorded = recorded(folder.path(), (96, 64), [5, 5], ["near", "far"]);
    assert!(run(&config).expect_err("equal sets").to_string().contains("look the same"));
    std::fs::write(folder.path().join("near/3.png"), b"no picture").expect("writes");
    assert!(run(&config).expect_err("a damaged picture").to_string().contains("3.png"));
    config.recorded[0].focal_px[1] = f64::NAN;
    assert!(run(&config).expect_err("no lens").to_string().contains("focal_px"));
    config.recorded.truncate(1);
    assert!(run(&config).expect_err("one set").to_string().contains("two sets"));
}

#[test]
fn recorded_drives_are_as_far_as_their_frames_differ() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let config = config(folder.path());
    let names = ["real", "same", "darker"].map(str::to_owned);
    let guests = |name: &str, _: &str| Err(format!("{name} is not expected").into());
    let camera = ds_policy::camera::eye::known_camera();
    // Four frames of six drives of bars whose place and colour differ; the third set shows them darker and stands 3 m aside.
    let mut drive = |set: usize, index: usize| {
        let frame = |at: usize| {
            let bar = |x: u32| u8::try_from(40 * ((x as usize / 16 + index + at) % 5) + 30).expect("a level");
            let level = |x: u32| if set == 2 { bar(x) / 2 } else { bar(x) };
            let pixels = (0..96).flat_map(|_| (0..160).flat_map(|x| [level(x), level(x + 16), 90])).collect();
            RgbImage::new(160, 96, pixels).expect("160×96 pixels")
        };
        let places = vec![DVec2::new(0.0, if set == 2 { 3.0 } else { 0.0 }); 4];
        let frames = (0..4).map(frame).collect();
        Ok(RecordedDrive { name: format!("drive {index}"), camera: camera.clone(), frames, every: 1, places })
    };
    let found = study::drives(&config, &guests, &names, 6, &mut drive, &mut Counted::default()).expect("compared");
    assert!(found.fd_pi["same"].value.abs() < 1e-6 && found.fd_pi["darker"].value > 1.0, "{:?}", found.fd_pi);
    assert_eq!((found.apart_m["same"], found.apart_m["darker"]), (0.0, 3.0));
    assert!(found.policies["camera-drawn"].control && found.policies["drivor"].frames == 24);
    study::write_json(folder.path(), &found).expect("writes");
    assert!(folder.path().join("drives.json").exists());
    let mut absent = |set: usize, _: usize| if set == 1 { Err("no such recording".into()) } else { drive(0, 0) };
    let error = study::drives(&config, &guests, &names, 6, &mut absent, &mut Counted::default()).expect_err("absent");
    assert!(error.to_string().contains("\"same\""), "{error}");
}
