//! Labelled cases of the own simulator: the effect is found with its size, nothing is found where there is none, and a
//! spoiled case is refused by name.

use std::path::Path;
use std::sync::LazyLock;

use ds_diagnosis::meta::Kind;
use ds_diagnosis::{Diagnosis, Verdict};
use ds_effect::Setting;
use ds_traffic::{Case, Options, TrafficError, diagnose, synthetic};

#[path = "../../../../tests/mutation.rs"]
mod mutation;

/// Seeds that no reported figure uses.
const SEED: u64 = 77_000;

fn judged(folder: &Path) -> Result<Diagnosis, TrafficError> {
    diagnose(&Case::read(folder)?, &Options::default())
}

fn case(seed: u64, effects: &[(&str, &[f64])]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let settings: Vec<Setting> =
        effects.iter().map(|(id, values)| Setting::new(id, values).expect("a sound setting")).collect();
    synthetic::write_case(folder.path(), seed, &settings).expect("the case can be written");
    folder
}

#[test]
fn an_effect_is_found_with_its_size_and_explains_other_agents() {
    for (id, value) in [("tr_headway", 1.5), ("lane_offset", 0.7)] {
        let folder = case(SEED, &[(id, &[value])]);
        assert_eq!(Kind::of(folder.path()), Kind::Traffic);
        let diagnosis = judged(folder.path()).expect("the case is sound");
        let first = &diagnosis.effects[0];
        assert_eq!((diagnosis.verdict, first.id.as_str()), (Verdict::Single, id), "{:?}", diagnosis.chosen);
        assert!((first.value / value - 1.0).abs() < 0.1, "{id}: {}", first.value);
        let total: f64 = diagnosis.effects.iter().map(|effect| effect.probability).sum();
        assert!((total + diagnosis.p_none + diagnosis.p_unknown - 1.0).abs() < 1e-9);
        assert!(!diagnosis.cells.is_empty(), "nowhere");
        let metric = if id == "lane_offset" { "channel:agent_lateral" } else { "position_3s" };
        let shrink = diagnosis.how_far.iter().find(|shrink| shrink.metric == metric).expect("the metric");
        assert!(shrink.after < 0.5 * shrink.before, "{shrink:?}");
        // The headway leaves a gap near the floor once calibrated, of which no share is told.
        let told = shrink.share_explained.map_or(id == "tr_headway", |share| share > 0.5);
        assert!(told, "{shrink:?}");
    }
}

#[test]
fn nothing_is_found_where_nothing_is_missing() {
    let folder = case(SEED + 1, &[]);
    let diagnosis = judged(folder.path()).expect("the case is sound");
    assert_eq!((diagnosis.verdict, diagnosis.chosen.len()), (Verdict::None, 0), "{:?}", diagnosis.chosen);
}

#[test]
fn spoiled_cases_are_refused_by_name() {
    let refused = |spoil: &dyn Fn(&Path), word: &str| {
        let folder = case(SEED + 2, &[]);
        spoil(folder.path());
        let error = judged(folder.path()).expect_err(word);
        let text = format!("{error}: {error:?}");
        assert!(text.contains(word), "{text:?} does not name {word:?}");
    };
    let write = |folder: &Path, file: &str, text: &str| std::fs::write(folder.join(file), text).expect("written");
    refused(&|folder| write(folder, "0.csv", "t,id,x,y,v\n0,0,1,2,3\n"), "yaw");
    refused(&|folder| write(folder, "0.csv", "t,id,x,y,yaw,v\n0,0,1,NaN,0,3\n"), "NaN");
    refused(&|folder| write(folder, "meta.json", "{"), "meta.json");
    refused(&|folder| write(folder, "2.scenario.json", "{}"), "scenario.json");
    refused(&|folder| std::fs::remove_file(folder.join("3.csv")).expect("removed"), "3.csv");
    let absurd = r#"{"model":"traffic","recordings":[],"nominal":{"headway":-1.0}}"#;
    refused(&|folder| write(folder, "meta.json", absurd), "headway");
    refused(&|folder| write(folder, "meta.json", r#"{"model":"traffic","recordings":[]}"#), "nobody");
}

static WHOLE: LazyLock<tempfile::TempDir> = LazyLock::new(|| case(SEED + 3, &[]));

#[test]
fn mutated_cases_are_refused_or_diagnosed() {
    mutation::all_are_borne("mutated_cases_are_refused_or_diagnosed", |index| {
        let folder = tempfile::tempdir().expect("a folder");
        let mut files: Vec<_> =
            std::fs::read_dir(WHOLE.path()).expect("the sound case").flatten().map(|entry| entry.path()).collect();
        files.sort();
        for (file, at) in files.iter().zip(0u64..) {
            let name = file.file_name().expect("a name");
            let whole = std::fs::read(file).expect("a file");
            let changed = match std::str::from_utf8(&whole) {
                _ if index % files.len() as u64 != at => whole,
                Ok(text) => mutation::text(text, "traffic", index),
                Err(_) => mutation::bytes(&whole, "traffic", index),
            };
            std::fs::write(folder.path().join(name), changed).expect("written");
        }
        if let Ok(case) = Case::read(folder.path())
            && (index / files.len() as u64).is_multiple_of(10)
        {
            drop(diagnose(&case, &Options::default()));
        }
    });
}
