//! Training without rendering: settings, sample files, the loss and resuming; then one real sample of a scenario.

use std::collections::BTreeMap;

use ds_graph::panel::{Answer, Kind, Network, vocabulary as words};
use ds_graph::planner::{HEIGHT_PX, WIDTH_PX};
use ds_nn::{Array, Weights};
use ds_policy::camera::proposals::{MODES, OUTPUTS, TARGETS, knots_of};
use ds_space::{DVec2, Digest, Draws, PoseSe2, Tick};
use ds_world::RouteCommand;

use super::dataset::{Place, Sample};
use super::judge::Judge;
use super::rasters::Rasters;
use super::step_sample::StepSample;
use super::*;

const SHIPPED: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../configs/train/policy.toml"));

fn samples(count: u64) -> Samples {
    let sample = |index: u64| {
        let draws = Draws::from_seed(index, "samples of a test");
        #[expect(clippy::cast_possible_truncation, reason = "made-up pixels and poses")]
        Sample {
            rgb: (0..(WIDTH_PX * HEIGHT_PX * 3) as u64).map(|i| draws.u64(i) as u8).collect(),
            speed_mps: draws.range(0, 0.0, 12.0) as f32,
            yaw_rate_radps: 0.1,
            acceleration_mps2: [0.4, -0.3],
            command: RouteCommand::Left,
            place: Place { scenario: index, tick: Tick(10), pose: PoseSe2::new(1.0, -2.0, 0.3) },
            knots: std::array::from_fn(|k| draws.normal(k as u64) as f32),
        }
    };
    Samples((0..count).map(sample).collect())
}

#[test]
fn shipped_settings_are_sound_and_bad_ones_are_named() {
    let settings = PolicySettings::parse(SHIPPED).expect("the shipped settings are sound");
    assert!(settings.steps() > 0);
    for (from, to, says) in [
        ("version = 1", "version = 2", "version"),
        ("batch = 16", "batch = 0", "batch"),
        ("lateral_m = 1.5", "lateral_m = nan", "lateral_m"),
        ("seed = 1", "seed = 1\nsead = 2", "sead"),
    ] {
        let error = PolicySettings::parse(&SHIPPED.replacen(from, to, 1)).expect_err(says);
        let text = format!("{error}: {:?}", std::error::Error::source(&error));
        assert!(text.contains(says), "{text:?} does not say {says:?}");
    }
}

#[test]
fn the_gradient_of_the_loss_is_its_slope() {
    let draws = Draws::from_seed(5, "loss test");
    #[expect(clippy::cast_possible_truncation, reason = "single precision")]
    let normal = |index: u64| 0.5 * draws.normal(index) as f32;
    let values: Vec<f32> = (0..2 * OUTPUTS as u64).map(normal).collect();
    let targets: [[f32; TARGETS]; 2] =
        std::array::from_fn(|b| std::array::from_fn(|k| normal((1000 + 100 * b + k) as u64)));
    let speeds = [8.0, 0.5];
    let (_, slope) = loss::grade(&Array::new(&[2, OUTPUTS], values.clone()), &targets, &speeds);
    for index in [0, 7, TARGETS + 3, 2 * TARGETS + 5, MODES * TARGETS, OUTPUTS - 1, OUTPUTS + 4, 2 * OUTPUTS - 2] {
        let at = |offset: f32| {
            let mut moved = values.clone();
            moved[index] += offset;
            loss::grade(&Array::new(&[2, OUTPUTS], moved), &targets, &speeds).0
        };
        let numeric = (at(5e-3) - at(-5e-3)) / 1e-2;
        let analytic = f64::from(slope.values()[index]);
        assert!((numeric - analytic).abs() < 2e-3, "output {index}: {numeric} by difference, {analytic} by formula");
    }
}

#[test]
fn samples_come_back_from_their_file_and_broken_files_are_named() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let path = folder.path().join("some.samples");
    let made = samples(3);
    made.write(&path).expect("the file can be written");
    assert_eq!(Samples::read(&path).expect("the file is whole"), made);
    let whole = fs::read(&path).expect("the file was written");
    let numbers_at = 16 + 8 + WIDTH_PX * HEIGHT_PX * 3;
    let mut wrong_command = whole.clone();
    wrong_command[numbers_at + 4 * (4 + TARGETS)] = 9;
    let mut wrong_number = whole.clone();
    wrong_number[numbers_at + 4..numbers_at + 8].copy_from_slice(&f32::NAN.to_le_bytes());
    let mut wrong_count = whole.clone();
    wrong_count[16..24].copy_from_slice(&u64::MAX.to_le_bytes());
    for (bytes, says) in [
        (whole[..whole.len() - 1].to_vec(), "claims 3 samples"),
        (b"something else".to_vec(), "does not begin"),
        (whole[..20].to_vec(), "ends before"),
        (wrong_command, "command 9 in sample 0"),
        (wrong_number, "not finite in sample 0"),
        (wrong_count, "claims 18446744073709551615"),
    ] {
        fs::write(&path, bytes).expect("the file can be written");
        let error = Samples::read(&path).expect_err(says).to_string();
        assert!(error.contains(says) && error.contains("some.samples"), "{error:?} does not say {says:?}");
    }
}

#[test]
fn a_resumed_run_equals_one_that_was_not_stopped() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let settings =
        PolicySettings { batch: 2, ..PolicySettings::parse(SHIPPED).expect("the shipped settings are sound") };
    let samples = samples(4);
    for student in [Learned::Camera, Learned::Panel(Kind::Ltf), Learned::Panel(Kind::Diffusiondrive)] {
        let checkpoint = folder.path().join(student.file_name());
        let mut straight =
            Learner::resume(student, &settings, &samples, &checkpoint, &checkpoint).expect("starts anew");
        let mut stopped = Learner::resume(student, &settings, &samples, &checkpoint, &checkpoint).expect("starts anew");
        for step in 0..4 {
            straight.step(&settings, &samples).expect("learns");
            if step == 2 {
                stopped.save(&checkpoint).expect("saves");
                stopped = Learner::resume(student, &settings, &samples, &checkpoint, &checkpoint).expect("goes on");
            }
            stopped.step(&settings, &samples).expect("learns");
        }
        assert_eq!(straight.average().digest(), stopped.average().digest(), "{}", student.name());
        assert_eq!(straight.steps(), 4);
    }
}

#[test]
fn the_judge_tells_good_plans_from_bad_and_the_gradient_of_the_panel_is_its_slope() {
    let settings =
        PolicySettings { scenarios: 1, states_per_scenario: 4, ..PolicySettings::parse(SHIPPED).expect("sound") };
    let made = dataset::beside_the_expert(&settings, ScenarioSplit::Training).expect("the scenario can be simulated");
    let sample = &made.0[0];
    let mut judge = Judge::default();
    let shown = [StepSample {
        sample,
        speed_mps: f64::from(sample.speed_mps),
        motion: true,
        raster: false,
        draws: Draws::from_seed(1, "shown in a test"),
    }];
    let target = shown[0].target();
    // The teacher's plan, and one that leaves the road.
    let aside: Vec<f32> = target.iter().enumerate().map(|(k, v)| if k % 3 == 1 { v + 8.0 } else { *v }).collect();
    let knots = |numbers: &[f32]| knots_of(shown[0].speed_mps, numbers);
    let terms = judge.terms(&[(sample, vec![knots(&target), knots(&aside)])]).expect("scored").remove(0);
    let total = |terms: [f32; 8]| ds_graph::panel::total(terms.map(f64::from));
    assert!(total(terms[0]) > 0.3 && total(terms[1]) < 0.1, "{terms:?}");
    let plans = Array::new(&[1, 2, TARGETS], [target.as_slice(), &aside].concat());
    let scores = Array::new(&[1, 2, 8], (0..16).map(|k| 0.1 * k as f32 - 0.7).collect());
    let answer = Answer { plans: vec![plans], scores: vec![scores] };
    let (loss, slope) = panel_loss::grade(&answer, &shown, &mut judge).expect("graded");
    for index in [0, 5, 9, 15] {
        let mut moved = answer.clone();
        moved.scores[0].values_mut()[index] += 1e-2;
        let numeric = (panel_loss::grade(&moved, &shown, &mut judge).expect("graded").0 - loss) / 1e-2;
        let analytic = f64::from(slope.scores[0].values()[index]);
        assert!((numeric - analytic).abs() < 1e-3, "score {index}: {numeric} by difference, {analytic} by formula");
    }
}

#[test]
fn a_vocabulary_is_the_teachers_and_its_words_are_chosen_but_not_trained() {
    let shipped = PolicySettings::parse(SHIPPED).expect("the shipped settings are sound");
    let settings = PolicySettings { scenarios: 2, states_per_scenario: 4, batch: 2, ..shipped };
    let made = dataset::beside_the_expert(&settings, ScenarioSplit::Training).expect("the scenario can be simulated");
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let (kind, checkpoint) = (Kind::Sparsedrive, folder.path().join("checkpoint"));
    let mut learner =
        Learner::resume(Learned::Panel(kind), &settings, &made, &checkpoint, &checkpoint).expect("starts anew");
    let given = |learner: &Learner| -> Vec<f32> {
        let arrays = kind.given().iter().filter_map(|name| learner.average().get(name));
        arrays.flat_map(|array| array.values().to_vec()).collect()
    };
    let (before, fresh) = (given(&learner), learner.average().clone());
    for _ in 0..2 {
        assert!(learner.step(&settings, &made).expect("learns").is_finite());
    }
    // What is averaged with itself is the same but for rounding.
    assert!(given(&learner).iter().zip(&before).all(|(after, before)| (after - before).abs() < 1e-4));
    assert_ne!(learner.average().get("paths1.map.out.weight"), fresh.get("paths1.map.out.weight"));
    // With words of these very samples some pair of them is each sample's drive.
    let [paths, profiles] = [0, 1].map(|which: usize| fresh.get(kind.given()[which]).expect("a vocabulary").values());
    for sample in &made.0 {
        let driven = sample.poses().map(|pose| pose.position);
        let apart_m = |path: &[f32], profile: &[f32]| {
            let along_m = words::along_m(profile, f64::from(sample.speed_mps));
            let places = words::places(path, &along_m).map(|[x, y, _]| DVec2::new(f64::from(x), f64::from(y)));
            places.iter().zip(&driven).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
        };
        let pairs = paths.chunks_exact(48).flat_map(|path| profiles.chunks_exact(8).map(move |word| (path, word)));
        let nearest_m = pairs.map(|(path, word)| apart_m(path, word)).fold(f64::INFINITY, f64::min);
        assert!(nearest_m < 0.3, "{nearest_m}");
    }
}

#[test]
fn a_network_that_goes_on_from_another_leaves_its_weights_as_they_are() {
    let shipped = PolicySettings::parse(SHIPPED).expect("the shipped settings are sound");
    let settings = PolicySettings { scenarios: 1, states_per_scenario: 4, batch: 2, ..shipped };
    let made = dataset::beside_the_expert(&settings, ScenarioSplit::Training).expect("the scenario can be simulated");
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let [checkpoint, begun] = ["checkpoint", "begun"].map(|name| folder.path().join(name));
    let student = Learned::Panel(Kind::DiffusiondriveV2);
    let resume = || Learner::resume(student, &settings, &made, &checkpoint, &begun);
    let error = resume().err().expect("there is nothing to go on from").to_string();
    assert!(error.contains("train policy --kind diffusiondrive`") && error.contains("begun"), "{error}");
    let before = Weights::initialised(&Kind::Diffusiondrive.declared(), &Digest::of(b"a generator"));
    WeightsFile { weights: before.clone(), metadata: BTreeMap::new() }.write_half(&begun).expect("writes");
    let before = WeightsFile::read(&begun).expect("reads").weights;
    let (mut straight, mut stopped) = (resume().expect("starts anew"), resume().expect("starts anew"));
    let fresh = straight.average().clone();
    for step in 0..3 {
        assert!(straight.step(&settings, &made).expect("learns").is_finite());
        if step == 1 {
            stopped.save(&checkpoint).expect("saves");
            stopped = resume().expect("goes on");
        }
        stopped.step(&settings, &made).expect("learns");
    }
    assert_eq!(straight.average().digest(), stopped.average().digest());
    let learned = straight.average();
    assert_ne!(learned.get("selector.fine.read.1.weight"), fresh.get("selector.fine.read.1.weight"));
    // As they are written, in half precision, the generator's weights are those that it began with, and so is what it sees.
    WeightsFile { weights: learned.clone(), metadata: BTreeMap::new() }.write_half(&checkpoint).expect("writes");
    let learned = WeightsFile::read(&checkpoint).expect("reads").weights;
    assert!(before.iter().all(|(name, array)| learned.get(name) == Some(array)));
    let image = Array::new(&[1, HEIGHT_PX, WIDTH_PX, 3], vec![0.3; HEIGHT_PX * WIDTH_PX * 3]);
    let context = |kind, weights: &Weights| Network::new(kind, weights).expect("fits").context(&image);
    assert_eq!(context(Kind::DiffusiondriveV2, &learned), context(Kind::Diffusiondrive, &before));
}

#[test]
fn rap_is_shown_rasters_of_the_expert_samples_and_resumes() {
    let shipped = PolicySettings::parse(SHIPPED).expect("the shipped settings are sound");
    let settings = PolicySettings { scenarios: 1, states_per_scenario: 4, batch: 4, ..shipped };
    let made = dataset::beside_the_expert(&settings, ScenarioSplit::Training).expect("the scenario can be simulated");
    let mut rasters = Rasters::open().expect("opens");
    let drawn = rasters.image(&made.0[0].place).expect("drawn");
    assert_eq!(drawn.rgb().len(), made.0[0].rgb.len());
    assert!(drawn.rgb() != made.0[0].rgb && drawn.rgb().iter().min() < drawn.rgb().iter().max());
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let checkpoint = folder.path().join("checkpoint");
    let student = Learned::Panel(Kind::Rap);
    let resume =
        || Learner::resume(student, &settings, &made, &checkpoint, &checkpoint).expect("starts anew or goes on");
    let (mut straight, mut stopped) = (resume(), resume());
    for step in 0..3 {
        assert!(straight.step(&settings, &made).expect("learns").is_finite());
        if step == 1 {
            stopped.save(&checkpoint).expect("saves");
            stopped = resume();
        }
        stopped.step(&settings, &made).expect("learns");
    }
    assert_eq!(straight.average().digest(), stopped.average().digest());
}

#[test]
fn a_step_beside_the_expert_is_labelled_with_the_way_back() {
    let settings =
        PolicySettings { scenarios: 1, states_per_scenario: 4, ..PolicySettings::parse(SHIPPED).expect("sound") };
    let made = dataset::beside_the_expert(&settings, ScenarioSplit::Training).expect("the scenario can be simulated");
    assert!(!made.0.is_empty() && made.len() <= 4);
    assert_eq!(dataset::beside_the_expert(&settings, ScenarioSplit::Training).expect("again"), made);
    assert_ne!(dataset::beside_the_expert(&settings, ScenarioSplit::HeldOut).expect("held out"), made);
    for sample in &made.0 {
        let reach_m = sample.poses()[7].position.length();
        assert!(reach_m < 80.0 && sample.speed_mps < 30.0, "{reach_m} m from {} m/s", sample.speed_mps);
        let (low, high) = (sample.rgb.iter().min(), sample.rgb.iter().max());
        assert!(low < high, "the frame is of one colour");
    }
}

#[test]
fn states_of_one_scenario_are_shown_in_looks_of_their_own() {
    let settings =
        PolicySettings { scenarios: 1, states_per_scenario: 12, ..PolicySettings::parse(SHIPPED).expect("sound") };
    let samples = dataset::beside_the_expert(&settings, ScenarioSplit::Training).expect("samples can be made").0;
    let sky = |sample: &Sample| <[u8; 3]>::try_from(&sample.rgb[..3]).expect("a pixel");
    let skies: std::collections::BTreeSet<[u8; 3]> = samples.iter().map(sky).collect();
    assert!(samples.len() > 6 && 2 * skies.len() > samples.len(), "{skies:?} of {} states", samples.len());
}
