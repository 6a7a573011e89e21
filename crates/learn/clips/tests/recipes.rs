//! The shipped recipes: sizes of the sets, conditions, and road networks that no two splits share.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use ds_clips::{ClipPlan, Recipe, Source, Split, network_id, scene_of};
use rayon::prelude::*;

fn recipes() -> Vec<(PathBuf, Recipe)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/data");
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(folder).expect("the folder").map(|entry| entry.expect("an entry").path()).collect();
    paths.sort();
    paths.into_iter().map(|path| (path.clone(), Recipe::load(&path).expect("a valid recipe"))).collect()
}

fn named(name: &str) -> Recipe {
    recipes().into_iter().map(|(_, recipe)| recipe).find(|recipe| recipe.name == name).expect("a shipped recipe")
}

#[test]
fn recipes_are_named_after_their_files_and_have_folders_and_seeds_of_their_own() {
    let (mut folders, mut seeds) = (BTreeSet::new(), BTreeSet::new());
    for (path, recipe) in recipes() {
        assert_eq!(path.file_stem().and_then(|stem| stem.to_str()), Some(recipe.name.as_str()));
        assert!(folders.insert(recipe.folder.clone()) && seeds.insert(recipe.seed), "{}", recipe.name);
        assert!(recipe.digest().is_ok() && ClipPlan::new(&recipe).is_ok(), "{}", recipe.name);
    }
}

#[test]
fn there_are_enough_scenarios_and_the_conditions_that_are_promised() {
    assert!(named("narrow").scenarios.count >= 300 && named("test").scenarios.count >= 80);
    let count = |name: &str| named(name).conditions().expect("conditions").len();
    assert_eq!((count("narrow"), count("broad"), count("test_conditions")), (2, 105, 105));
    let diverse: BTreeSet<_> = named("diverse").conditions().expect("conditions").into_iter().collect();
    let narrow: BTreeSet<_> = named("narrow").conditions().expect("conditions").into_iter().collect();
    assert!(diverse.is_disjoint(&narrow));
    let all: BTreeSet<_> = named("broad").conditions().expect("conditions").into_iter().collect();
    let held_out: Vec<String> =
        all.iter().filter(|c| !diverse.contains(c) && !narrow.contains(c)).map(ToString::to_string).collect();
    assert!(held_out.iter().any(|name| name.starts_with("night-fog")), "{held_out:?}");
    assert!(held_out.iter().any(|name| name.contains("sand")), "{held_out:?}");
    // Every clip of a set has a condition of its recipe, and they are even.
    let plan = ClipPlan::new(&named("test_conditions")).expect("a plan");
    let mut clips = BTreeMap::new();
    for index in 0..plan.clips() {
        *clips.entry(plan.clip(index).appearance.condition.expect("a condition")).or_insert(0) += 1;
    }
    assert_eq!((clips.len(), clips.values().min(), clips.values().max()), (105, Some(&2), Some(&2)));
}

/// Network ids of a plan's scenarios; all of them, or the first and last sixteen.
fn networks(plan: &ClipPlan, all: bool) -> Vec<String> {
    let count = plan.scenarios();
    let ids = (0..count).filter(|i| all || *i < 16 || *i + 16 >= count).collect::<Vec<_>>();
    ids.into_par_iter().map(|i| network_id(&scene_of(&plan.scenario(i)).expect("generated").map)).collect()
}

#[test]
fn no_two_splits_share_a_road_network_and_no_set_has_one_twice() {
    let all = std::env::var_os("DREAMSTREAM_SLOW_TESTS").is_some();
    if !all {
        eprintln!("DREAMSTREAM_SLOW_TESTS is not set: the first and last sixteen scenarios of each recipe only");
    }
    let mut owners: BTreeMap<String, (String, Split)> = BTreeMap::new();
    let mut ranges: Vec<(u64, u64, String)> = Vec::new();
    // The second world shows the scenarios of the tests again, what is for `road` shows others in its size, `long` whole drives of them, `looks` longer ones of `broad`.
    let again = |recipe: &Recipe| recipe.name.starts_with("road_") || ["long", "looks"].contains(&recipe.name.as_str());
    let own = |recipe: &Recipe| {
        recipe.edit.is_none()
            && recipe.source == Source::Reference
            && recipe.scenarios.generator.is_none()
            && !again(recipe)
    };
    for (_, recipe) in recipes().into_iter().filter(|(_, recipe)| again(recipe) && recipe.edit.is_none()) {
        let shown = |of: &Recipe| {
            let (all, part) = (&of.scenarios, &recipe.scenarios);
            all.first_seed == part.first_seed && part.count <= all.count && of.split == recipe.split
        };
        assert!(recipes().iter().any(|(_, of)| own(of) && shown(of)), "{} has scenarios of its own", recipe.name);
    }
    for (_, recipe) in recipes().into_iter().filter(|(_, recipe)| own(recipe)) {
        let plan = ClipPlan::new(&recipe).expect("a plan");
        let first = recipe.scenarios.first_seed;
        ranges.push((first, first + recipe.scenarios.count.div_ceil(8), recipe.name.clone()));
        for id in networks(&plan, all) {
            if let Some((name, _)) = owners.insert(id.clone(), (recipe.name.clone(), recipe.split)) {
                panic!("network {id} is in {name} and in {}", recipe.name);
            }
        }
    }
    // Scenarios that were not looked at have seeds that no other recipe has: the generator draws their roads from them.
    ranges.sort();
    for pair in ranges.windows(2) {
        assert!(pair[0].1 <= pair[1].0, "{} and {} share seeds", pair[0].2, pair[1].2);
    }
    assert!(ranges[0].0 >= 5_000_000, "the seeds below are those of other trainings and tests");
}
