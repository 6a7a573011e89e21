//! Laws of the generator, over many seeds; the shipped files are what it makes.

use super::*;
use crate::store::{load, to_text, warnings};
use ds_space::Tick;
use ds_space::plane::IndexedPolygon;
use proptest::prelude::*;

/// Where the shipped scenarios lie.
const SCENARIOS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../scenarios");

fn standstill(scene: &Scene) -> bool {
    scene.ego_log.iter().any(|state| state.speed_mps() < 0.3)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 16, failure_persistence: None, ..Default::default() })]

    #[test]
    fn every_scene_is_valid_and_plausible(seed in any::<u64>(), index in 0usize..8) {
        let scene = generate(Family::ALL[index], seed);
        prop_assert_eq!(check::fault(&scene), None);
        prop_assert_eq!(scene.ego_log.len(), stage::TICKS as usize);
        prop_assert!(warnings(&scene).is_empty(), "{:?}", warnings(&scene));
        let text = to_text(&scene, FilePath::new("generated"));
        // Half a megabyte. Of 1,500 of the largest family, signalised-crossing, the median has 306 kB and the largest 453 kB.
        prop_assert!(text.is_ok_and(|text| text.len() < 500_000));
    }
}

#[test]
fn scenes_are_given_by_family_and_seed() {
    for family in Family::ALL {
        let digest = generate(family, 5).digest;
        assert_eq!(digest, generate(family, 5).digest);
        assert_ne!(digest, generate(family, 6).digest);
        assert_eq!(family.name().parse(), Ok(family));
    }
    let error = "cut-inn".parse::<Family>().expect_err("no such family").to_string();
    assert!(error.contains("cut-inn") && error.contains("cut-in, "), "{error}");
}

#[test]
fn families_show_what_they_are_named_for() {
    let some = |family: Family, shows: fn(&Scene) -> bool| {
        let scenes = (0..4).filter(|seed| shows(&generate(family, *seed))).count();
        assert!(scenes > 0, "no scene of {family} shows it");
    };
    let turned = |scene: &Scene| {
        let sum =
            |pair: &[ds_world::EgoState]| ds_space::angle::turn(pair[0].pose.heading_rad, pair[1].pose.heading_rad);
        scene.ego_log.windows(2).map(sum).sum::<f64>()
    };
    for seed in 0..3 {
        let left = turned(&generate(Family::UnprotectedLeft, seed));
        assert!((1.0..2.2).contains(&left) || left.abs() < 0.4, "an unprotected left turn turns by {left} rad");
    }
    some(Family::SignalisedCrossing, standstill);
    some(Family::PedestrianCrossing, standstill);
    some(Family::LeadBraking, |scene| scene.ego_log.iter().any(|state| state.acceleration_mps2.x < -1.5));
    some(Family::FreeCurve, |scene| scene.ego_log.iter().any(|state| state.yaw_rate_radps.abs() > 0.08));
    some(Family::Roundabout, |scene| scene.ego_log.iter().any(|state| state.yaw_rate_radps > 0.2));
    some(Family::ParkedNarrowing, |scene| {
        scene.tracks.iter().any(|track| {
            track.at(Tick(0)).is_some_and(|point| point.velocity_mps.length() < 0.01)
                && track.class == ds_world::AgentClass::Vehicle
        })
    });
    some(Family::CutIn, |scene| scene.ego_log.len() == 151 && scene.tracks.len() > 2);
}

#[test]
fn houses_and_trees_stand_clear_of_the_road_and_of_all_that_moves() {
    for family in Family::ALL {
        let scene = generate(family, 7);
        let structures = &scene.map.structures;
        let buildings =
            structures.iter().filter(|structure| structure.kind == ds_world::StructureKind::Building).count();
        assert!(buildings > 5 && structures.len() > 50, "{family}: {buildings} buildings of {}", structures.len());
        let tracked =
            scene.tracks.iter().flat_map(|track| track.points.iter().flatten()).map(|point| point.pose.position);
        let moved: Vec<_> = tracked.chain(scene.ego_log.iter().map(|ego| ego.pose.position)).collect();
        let roads: Vec<_> = scene.map.drivable.iter().filter_map(|area| IndexedPolygon::new(area, &[])).collect();
        for structure in structures {
            let clear = |corner| !roads.iter().any(|road| road.holds(corner));
            assert!(structure.outline.iter().copied().all(clear), "{family}: {structure:?} stands on the road");
            let outline = IndexedPolygon::new(&structure.outline, &[]).expect("an outline is a polygon");
            assert!(!moved.iter().any(|place| outline.holds(*place)), "{family}: {structure:?} is driven through");
        }
    }
}

#[test]
fn a_set_has_one_file_for_each_scene() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let paths = generate_set(None, 40, 9, folder.path()).expect("the set can be written");
    let names: Vec<String> = paths.iter().map(|path| load(path).expect("it loads").0.name).collect();
    assert_eq!(
        (names[0].as_str(), names[7].as_str(), names[8].as_str()),
        ("free-curve-40", "roundabout-40", "free-curve-41")
    );
}

#[test]
fn shipped_files_are_what_the_generator_makes() {
    for (family, seed) in SHIPPED {
        let path = FilePath::new(SCENARIOS).join(format!("base/{family}.scenario.json"));
        let (scene, warnings) = load(&path).expect("shipped scenarios load");
        assert_eq!(warnings, []);
        assert_eq!(scene, shipped(family, seed), "{family}: cargo run -p ds-scenario --example ship rewrites it");
    }
    let (scene, _) =
        load(&FilePath::new(SCENARIOS).join("tiny/straight.scenario.json")).expect("the tiny scenario loads");
    assert_eq!(scene, tiny());
}
