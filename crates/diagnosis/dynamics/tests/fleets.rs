//! Nobody says which vehicles of a fleet are healthy: those that differ are found, by their effect, and no other is.

use std::path::Path;

use ds_diagnosis::CaseError;
use ds_dynamics::case::Case;
use ds_dynamics::fleet::fleet;
use ds_dynamics::healthy::Healthy;
use ds_dynamics::{Options, synthetic};
use ds_effect::find;

/// Every vehicle pulls to one side; two of the five are late to steer as well.
const TRAIT: (&str, f64) = ("bank", 0.03);
const ILL: [u64; 2] = [62, 64];

fn case(folder: &Path, seed: u64) -> Healthy {
    let own = ILL.contains(&seed).then_some(("steer_delay", 0.12));
    let edit = |plant: &mut ds_effect::Plant| {
        for (id, value) in [TRAIT].into_iter().chain(own) {
            let effect = find(id).expect("the effect is in the library");
            let mut values = effect.neutral();
            values[0] = value;
            (effect.apply)(&values, plant);
        }
    };
    synthetic::write_case(folder, seed, &edit).expect("the case can be written");
    Healthy { name: format!("log-{seed}"), case: Case::read(folder).expect("the case can be read") }
}

#[test]
fn vehicles_that_differ_are_told_from_the_others() {
    let root = tempfile::tempdir().expect("a folder");
    let seeds = [61, 62, 63, 64, 65];
    let logs: Vec<Healthy> = seeds.iter().map(|s| case(&root.path().join(s.to_string()), *s)).collect();
    let of: Vec<String> = seeds.iter().map(|s| format!("car-{s}")).collect();
    let quick = Options { quick: true, ..Options::default() };
    let (found, diagnoses) = fleet(logs, "vehicle", &of, &quick, &|| ()).expect("five vehicles");
    let affected: Vec<&str> = found.members.iter().filter(|m| m.affected).map(|m| m.name.as_str()).collect();
    assert_eq!(affected.len(), ILL.len(), "{:?}", found.members);
    for member in &found.members {
        let ill = ILL.iter().any(|s| member.name == format!("car-{s}"));
        assert_eq!(member.affected, ill, "{member:?}");
        if ill {
            assert_eq!(member.effects[0].id, "steer_delay", "{member:?}");
            assert!((member.effects[0].value - 0.12).abs() < 0.02 && member.p_none < 0.01, "{member:?}");
        } else {
            assert!(member.p_none > 0.9, "{member:?}");
        }
    }
    let common = &found.effects[0];
    assert_eq!((common.id.as_str(), common.members.len()), ("steer_delay", 2));
    assert!((0.25..0.6).contains(&common.share), "{common:?}");
    // the page links the diagnoses by their names
    assert_eq!(diagnoses.iter().map(|d| d.case.as_str()).collect::<Vec<_>>(), seeds.map(|s| format!("log-{s}")));
}

#[test]
fn too_few_vehicles_are_refused() {
    let root = tempfile::tempdir().expect("a folder");
    let logs = vec![case(&root.path().join("a"), 61)];
    let refused = fleet(logs, "vehicle", &["a".to_owned()], &Options::default(), &|| ());
    assert!(matches!(refused, Err(CaseError::SmallFleet { members: 1, .. })));
}
