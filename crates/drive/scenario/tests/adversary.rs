//! Scenario files with an adversary: version 2, loaded as saved, nonsense refused by place and value.

use std::path::Path;

use ds_scenario::{Family, generate, parse, store::to_text};
use ds_space::{AgentId, Tick};
use ds_world::{Adversary, AdversaryMode, AgentClass, Budget, CrashClass, Map, Scene};
use serde_json::{Value, json};

/// A generated scene whose first vehicle that is always there is named an adversary.
fn scene() -> Scene {
    let mut scene = generate(Family::LeadBraking, 1);
    let is = |track: &&ds_world::Track| track.class == AgentClass::Vehicle && track.points.iter().all(Option::is_some);
    let (index, track) = scene.tracks.iter().enumerate().find(|(_, track)| is(track)).expect("there is a lead");
    let corridor = track.points.iter().flatten().step_by(10).map(|point| point.pose.position).collect();
    scene.adversary = Some(Adversary {
        track: AgentId(index as u32),
        class: CrashClass::RearEnd,
        mode: AdversaryMode::Reactive,
        attack: Tick(40),
        contact: Tick(70),
        budget: Budget::default(),
        corridor,
    });
    scene
}

fn load(text: &str) -> Result<Scene, String> {
    parse(text.as_bytes(), Path::new("variant.scenario.json"))
        .map(|(scene, _)| scene)
        .map_err(|error| error.to_string())
}

#[test]
fn an_adversary_is_loaded_as_saved_in_version_2() {
    let scene = scene();
    let text = to_text(&scene, Path::new("variant.scenario.json")).expect("a sound scene");
    let value: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(value["version"], 2);
    let loaded = load(&text).expect("its own file");
    assert_eq!(to_text(&loaded, Path::new("variant.scenario.json")).expect("a sound scene"), text);
    assert_eq!(loaded.adversary.as_ref().map(|one| one.contact), Some(Tick(70)));
    let ordinary = generate(Family::LeadBraking, 1);
    assert_ne!(loaded.digest, ordinary.digest);
    let text = to_text(&ordinary, Path::new("base.scenario.json")).expect("a sound scene");
    let value: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(value["version"], 2, "it has structures");
    assert!(value.get("adversary").is_none(), "files without one are as before");
    let bare = Scene { map: Map { structures: Vec::new(), ..ordinary.map.clone() }, ..ordinary };
    let text = to_text(&bare, Path::new("base.scenario.json")).expect("a sound scene");
    let value: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!((&value["version"], value["map"].get("structures")), (&serde_json::json!(1), None));
}

#[test]
fn nonsense_is_refused_by_place_and_value() {
    let text = to_text(&scene(), Path::new("variant.scenario.json")).expect("a sound scene");
    let whole: Value = serde_json::from_str(&text).expect("JSON");
    for (field, bad, says) in [
        ("/adversary/track", json!(9999), "\"adversary.track\" is 9999"),
        ("/adversary/class", json!("ramming"), "\"adversary.class\" is \"ramming\""),
        ("/adversary/mode", json!("angry"), "\"adversary.mode\" is \"angry\""),
        ("/adversary/attack_tick", json!(70), "\"adversary.attack_tick\" is 70, not before the contact at 70"),
        ("/adversary/contact_tick", json!(151), "\"adversary.contact_tick\" is 151, the last tick is 150"),
        ("/adversary/budget/aside_m", json!(-1.0), "\"adversary.budget.aside_m\" is -1"),
        ("/adversary/budget/attack_secs", json!(1e9), "\"adversary.budget.attack_secs\""),
        ("/adversary/budget/reaims", json!(100_000), "\"adversary.budget.reaims\" is 100000"),
        ("/adversary/corridor_m", json!([[0.0, 0.0]]), "\"adversary.corridor_m\" has 1 points"),
        ("/version", json!(1), "\"version\" is 1, with an adversary it must be 2"),
        ("/version", json!(3), "\"version\" is 3"),
    ] {
        let mut value = whole.clone();
        *value.pointer_mut(field).expect("the field is there") = bad;
        let error = load(&value.to_string()).expect_err(field);
        assert!(error.contains(says), "{field}: {error:?} does not say {says:?}");
    }
}
