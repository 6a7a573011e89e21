//! The repository's own reference world: at least the mismatch and about the residuals of the practice cases, and a small
//! blind protocol with stated minimum figures. Skipped where Python with numpy, or the practice cases, are absent.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use ds_diagnosis::score::{read_labels, score};
use ds_dynamics::case::{Case, PartModel};
use ds_dynamics::search::null_fit;
use ds_dynamics::space::Part;
use ds_dynamics::{Options, diagnose};
use rayon::prelude::*;

/// Spread from vehicle to vehicle that the practice README states.
const README: &[(&str, f64)] = &[
    ("mass", 0.012),
    ("yaw_inertia", 0.03),
    ("front_stiffness", 0.02),
    ("friction", 0.03),
    ("rolling", 0.05),
    ("steer_gain", 0.004),
    ("steer_zero", 0.0006),
    ("steer_dead", 0.016 / 3.464),
    ("pose_age", 0.012 / 3.464),
    ("gyro_zero", 0.0006),
    ("ax_zero", 0.02),
    ("wheel", 0.0012),
    ("crown", 0.001_745),
    ("wind", 0.5),
    ("headway", 0.01),
    ("follower_speed", 0.01),
];

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../..")
}

/// Runs the world; `None`, with a message, where it cannot run.
#[expect(clippy::disallowed_methods, reason = "which Python has numpy is the test machine's business, not a setting")]
fn world(arguments: &[&str]) -> Option<String> {
    let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let numpy = Command::new(&python).args(["-c", "import numpy"]).output();
    if !numpy.is_ok_and(|o| o.status.success()) {
        eprintln!("skipped: {python} has no numpy; set PYTHON to one that has");
        return None;
    }
    let script = root().join("tests/worlds/own_world.py");
    let output = Command::new(&python).arg(script).args(arguments).output().expect("python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8_lossy(&output.stdout).into_owned())
}

#[test]
fn its_vehicles_differ_from_their_nominal_as_much_as_the_practice_ones() {
    let Some(text) = world(&["--spreads"]) else { return };
    let spreads: BTreeMap<String, f64> = serde_json::from_str(&text).expect("a table of spreads");
    for (name, least) in README {
        // two thousand draws know a spread to about two percent
        assert!(spreads[*name] > 0.94 * least, "{name}: {} is less than {least}", spreads[*name]);
    }
}

/// Root mean square of what the nuisance fit leaves, by channel, in floor units.
fn left(folder: &Path) -> BTreeMap<&'static str, f64> {
    let case = Case::read(folder).expect("the case can be read");
    let mut found = BTreeMap::new();
    for part in [Part::Ego, Part::Following] {
        let model = PartModel::new(&case, part, &[0, 1, 2], &[]);
        let mut sums: BTreeMap<&str, (f64, f64)> = BTreeMap::new();
        for (tag, z) in model.tags.iter().zip(null_fit(&model, None).residuals).filter(|(_, z)| *z != 0.0) {
            let sum = sums.entry(tag.channel.name()).or_default();
            *sum = (sum.0 + z * z, sum.1 + 1.0);
        }
        found.extend(sums.into_iter().map(|(name, (square, count))| (name, (square / count).sqrt())));
    }
    found
}

fn mean_by_channel(cases: &[BTreeMap<&'static str, f64>]) -> BTreeMap<&'static str, f64> {
    let names = cases.iter().flat_map(BTreeMap::keys).copied();
    let mean = |name| {
        let values: Vec<f64> = cases.iter().filter_map(|c| c.get(name).copied()).collect();
        values.iter().sum::<f64>() / values.len() as f64
    };
    names.map(|name| (name, mean(name))).collect()
}

#[test]
fn its_effect_free_residuals_are_about_those_of_the_practice_cases() {
    let practice = root().join("../shared/data/gap-practice");
    let Ok(labels) = read_labels(&practice.join("labels.json")) else {
        eprintln!("skipped: the practice cases are not at {}", practice.display());
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().to_string_lossy().into_owned();
    if world(&["--out", &out, "--seed", "103", "--singles", "0", "--none", "6", "--pairs", "0", "--unknown", "0"])
        .is_none()
    {
        return;
    }
    let clean: Vec<PathBuf> =
        labels.iter().filter(|(_, l)| l.kind == "none").map(|(name, _)| practice.join(name)).collect();
    let drawn: Vec<PathBuf> = (0..6).map(|k| folder.path().join(format!("case_{k:03}"))).collect();
    let [there, here] =
        [clean, drawn].map(|cases| mean_by_channel(&cases.par_iter().map(|c| left(c)).collect::<Vec<_>>()));
    for (channel, expected) in there {
        let ratio = here[channel] / expected;
        assert!((0.7..=1.3).contains(&ratio), "{channel}: {:.2} against {expected:.2}", here[channel]);
    }
}

#[test]
fn a_small_blind_protocol_reaches_its_minimum() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().to_string_lossy().into_owned();
    if world(&["--out", &out, "--seed", "104", "--singles", "8", "--none", "4", "--pairs", "0", "--unknown", "2"])
        .is_none()
    {
        return;
    }
    let labels = read_labels(&folder.path().join("labels.json")).expect("labels");
    let names: Vec<&String> = labels.keys().collect();
    let options = Options { quick: true, ..Options::default() };
    let run =
        |name: &&String| ((*name).clone(), diagnose(&Case::read(&folder.path().join(name)).expect("a case"), &options));
    let scores = score(&names.par_iter().map(run).collect(), &labels);
    let hits = |name: &str| scores.shares.get(name).copied().flatten().map_or(0, |s| s.hits);
    assert!(hits("singles: first") >= 6, "{:#?}", scores.shares);
    assert!(hits("singles: strict") >= 5, "{:#?}", scores.shares);
    assert!(hits("false alarms") <= 1, "{:#?}", scores.shares);
    assert!(hits("unknown called so") >= 1, "{:#?}", scores.shares);
}
