//! What every healthy drive of a vehicle has is no fault against their baseline, what one of them lacks is; a baseline of
//! another vehicle, of fewer channels or damaged is refused.

use std::path::Path;
use std::sync::Arc;

use ds_diagnosis::{CaseError, Diagnosis, Verdict};
use ds_dynamics::baseline::Baseline;
use ds_dynamics::case::Case;
use ds_dynamics::healthy::{Healthy, learn};
use ds_dynamics::{Options, diagnose, synthetic};
use ds_effect::find;
use serde_json::{Value, json};

/// A trait that all drives of the vehicle have: it pulls to one side.
const TRAIT: (&str, f64) = ("bank", 0.03);

fn case(folder: &Path, seed: u64, effects: &[(&str, f64)]) -> Case {
    let edit = |plant: &mut ds_effect::Plant| {
        for (id, value) in [TRAIT].iter().chain(effects) {
            let effect = find(id).expect("the effect is in the library");
            let mut values = effect.neutral();
            values[0] = *value;
            (effect.apply)(&values, plant);
        }
    };
    synthetic::write_case(folder, seed, &edit).expect("the case can be written");
    Case::read(folder).expect("the case can be read")
}

fn healthy(traits: &[(&str, f64)]) -> Vec<Healthy> {
    let root = tempfile::tempdir().expect("a folder");
    let one = |seed: u64| {
        let name = format!("day-{seed}");
        Healthy { case: case(&root.path().join(&name), seed, traits), name }
    };
    [41, 42, 43].map(one).into()
}

fn against(baseline: &Arc<Baseline>, effects: &[(&str, f64)]) -> Diagnosis {
    let root = tempfile::tempdir().expect("a folder");
    let case = case(root.path(), 51, effects).against(baseline.clone()).expect("a baseline of this vehicle");
    diagnose(&case, &Options { quick: true, ..Options::default() })
}

#[test]
fn a_trait_is_no_fault_and_a_fault_beside_it_is_found() {
    let root = tempfile::tempdir().expect("a folder");
    let alone = diagnose(&case(root.path(), 51, &[]), &Options { quick: true, ..Options::default() });
    assert_eq!(alone.chosen, [TRAIT.0], "without a baseline the trait is all there is to find");

    let baseline = learn(&healthy(&[]), &|| ()).expect("three healthy logs");
    assert!(baseline.warnings.is_empty(), "{:?}", baseline.warnings);
    let usual = baseline.spread[TRAIT.0][0].expect("a usual value");
    assert!((usual.mean - TRAIT.1).abs() < 0.005, "{usual:?}");
    // what is written is read back to the bit
    let file = root.path().join("baseline.json");
    baseline.write(&file).expect("it can be written");
    assert_eq!(Baseline::read(&file).expect("it can be read"), baseline);

    let baseline = Arc::new(baseline);
    let found = against(&baseline, &[]);
    assert_eq!((found.verdict, found.floor_source.as_str()), (Verdict::None, "baseline"), "{:?}", found.chosen);
    assert!(found.next_manoeuvre.is_empty(), "{:?}", found.next_manoeuvre);
    assert!(found.cells.is_empty(), "{:?}", found.cells);
    assert!(found.outside_domain_share.is_some_and(|share| share < 0.2), "{:?}", found.outside_domain_share);
    let found = against(&baseline, &[("steer_delay", 0.12)]);
    assert_eq!(found.chosen, ["steer_delay"], "{:?}", found.verdict);
    assert!((found.effects[0].value - 0.12).abs() < 0.02, "{}", found.effects[0].value);
    assert!(found.cells.iter().all(|cell| cell.q_value.is_some()) && !found.cells.is_empty());
    assert!(alone.cells.iter().all(|cell| cell.q_value.is_none()), "no healthy log says what is ordinary");
    // no run is shorter than its manoeuvre
    assert!(found.next_manoeuvre.iter().all(|run| run.secs_needed >= 6.0), "{:?}", found.next_manoeuvre);
    // the effect is told relative to the healthy drives
    let found = against(&baseline, &[("bank", 0.04)]);
    assert_eq!(found.chosen, [TRAIT.0]);
    assert!((found.effects[0].value - 0.04).abs() < 0.01, "{}", found.effects[0].value);
}

#[test]
fn more_friction_than_on_the_road_of_the_healthy_drives_is_told() {
    const SLIPPERY: f64 = 0.3;
    let of_road = |mut case: Case| {
        case.meta.nominal.friction *= SLIPPERY;
        case
    };
    let logs = healthy(&[("mu", SLIPPERY)]).into_iter().map(|h| Healthy { case: of_road(h.case), ..h });
    let baseline = Arc::new(learn(&logs.collect::<Vec<_>>(), &|| ()).expect("three healthy logs"));
    let root = tempfile::tempdir().expect("a folder");
    let dry = of_road(case(root.path(), 51, &[("mu", 2.0 * SLIPPERY)]));
    let dry = dry.against(baseline).expect("a baseline of this vehicle");
    let found = diagnose(&dry, &Options { quick: true, ..Options::default() });
    assert_eq!(found.chosen, ["mu"], "{:?}", found.verdict);
    assert!((1.5..2.7).contains(&found.effects[0].value), "{}", found.effects[0].value);
}

/// One trait lies far beyond the range of the library, the other one is a fault to it.
#[test]
fn what_the_library_takes_for_a_fault_is_none_where_every_healthy_log_has_it() {
    const CROOKED: (&str, f64) = ("steer_offset", 0.05);
    const DEAD: (&str, f64) = ("deadzone_accel", 0.3);
    let baseline = Arc::new(learn(&healthy(&[CROOKED, DEAD]), &|| ()).expect("three healthy logs"));
    for ((id, value), off) in [(CROOKED, 0.002), (DEAD, 0.05)] {
        let usual = baseline.spread[id][0].expect("a usual value");
        assert!((usual.mean - value).abs() < off, "{id}: {usual:?}");
    }
    let found = against(&baseline, &[CROOKED, DEAD]);
    assert_eq!(found.verdict, Verdict::None, "{:?}", found.chosen);
    let found = against(&baseline, &[CROOKED, DEAD, ("steer_delay", 0.12)]);
    assert_eq!(found.chosen, ["steer_delay"], "{:?}", found.verdict);
    // and a little more of a trait is told
    let found = against(&baseline, &[("steer_offset", 0.062), DEAD]);
    assert_eq!(found.chosen, [CROOKED.0], "{:?}", found.verdict);
    assert!((found.effects[0].value - 0.012).abs() < 0.003, "{}", found.effects[0].value);
}

#[test]
fn a_faulty_log_among_healthy_ones_is_named() {
    let root = tempfile::tempdir().expect("a folder");
    let mut logs = healthy(&[]);
    let odd = case(root.path(), 44, &[("wheel_scale", 1.05)]);
    logs.push(Healthy { name: "odd".to_owned(), case: odd });
    let baseline = learn(&logs, &|| ()).expect("four logs");
    let least = baseline.influence.iter().min_by(|a, b| a.chance.total_cmp(&b.chance)).expect("four of them");
    assert_eq!(least.unit, "odd", "{:?}", baseline.influence);
    assert!(
        least.moves.is_some() && baseline.warnings.iter().any(|w| w.starts_with("odd is unlike")),
        "{:?}",
        baseline.warnings
    );
}

#[test]
fn a_baseline_of_little_worth_says_so() {
    let root = tempfile::tempdir().expect("a folder");
    let mut logs = healthy(&[]);
    let again = Healthy { name: "again".to_owned(), case: logs[0].case.clone() };
    logs.push(again);
    assert!(matches!(learn(&logs, &|| ()), Err(CaseError::SameLog { .. })));
    logs.pop();
    logs[2].case.meta.nominal.mass *= 1.1;
    let baseline = Arc::new(learn(&logs, &|| ()).expect("three healthy logs"));
    assert!(baseline.warnings.iter().any(|w| w.contains("2 nominal simulators")), "{:?}", baseline.warnings);
    let said = |case: Case| {
        let case = case.against(baseline.clone()).expect("one of several vehicles");
        diagnose(&case, &Options { quick: true, ..Options::default() }).warnings.join("; ")
    };
    let own = said(logs.remove(0).case);
    assert!(own.contains("learned from 4 of the 4 drives"), "{own}");
    let mut heavy = case(root.path(), 51, &[]);
    let fresh = said(heavy.clone());
    assert!(!fresh.contains("learned from") && !fresh.contains("is it of this vehicle"), "{fresh}");
    heavy.meta.nominal.mass *= 2.0;
    let heavy = said(heavy);
    assert!(heavy.contains("the mass is 3000.000 kg, the baseline's 1500.000 to 1650.000"), "{heavy}");
}

#[test]
fn other_vehicles_other_channels_and_damaged_files_are_refused() {
    let root = tempfile::tempdir().expect("a folder");
    let logs: Vec<Healthy> = healthy(&[]).into_iter().take(1).collect();
    let baseline = Arc::new(learn(&logs, &|| ()).expect("one log of four drives"));
    let mut other = case(root.path(), 51, &[]);
    other.meta.nominal.mass += 100.0;
    assert!(matches!(other.against(baseline.clone()), Err(CaseError::OtherBaseline { .. })));
    let fewer = Arc::new(Baseline { channels: vec!["x".to_owned()], ..(*baseline).clone() });
    let refused = Case::read(root.path()).expect("a case").against(fewer);
    let text = refused.err().expect("it has more channels").to_string();
    assert!(text.contains("no healthy drive had a channel"), "{text}");

    let file = root.path().join("baseline.json");
    let text = serde_json::to_string(&*baseline).expect("JSON");
    for (from, to, why) in [
        ("\"schema_version\":1", "\"schema_version\":7", "schema_version is 7"),
        ("\"sd\":0.", "\"sd\":-0.", "spread of"),
        ("\"correlation\":{\"rows\":[", "\"correlation\":{\"rows\":[99", "correlation is none"),
        ("\"noise\":{\"agent_gap\":[", "\"noise\":{\"agent_gap\":[-1.0,", "noise of \"agent_gap\" is not positive"),
        ("\"noise\":{\"agent_gap\":[", "\"noise\":{\"agent_gap\":[1.0,", "noise of \"agent_gap\" has 11 blocks"),
        ("\"noise\":{\"agent_gap\"", "\"noise\":{\"nonsense\"", "noise of \"nonsense\" is of no channel"),
        ("\"spread\":{", "\"spread\":{\"nonsense\":[null],", "spread of \"nonsense\" is of no effect"),
        ("\"mu\":[", "\"mu\":[null,", "spread of \"mu\" has"),
        (
            "\"nulls\":[{",
            "\"nulls\":[{\"statistic\":\"a\",\"z\":[1e300],\"control\":\"parametric\"},{",
            "the null of \"a\"",
        ),
        ("\"sensors\":{\"noise\":[", "\"sensors\":{\"noise\":[-1.0,", "windows.sensors has noise"),
    ] {
        assert!(text.contains(from), "{from}");
        std::fs::write(&file, text.replacen(from, to, 1)).expect("it can be written");
        let refused = Baseline::read(&file).expect_err("a damaged file").to_string();
        assert!(refused.contains(why), "{refused}");
    }
    assert!(matches!(learn(&[], &|| ()), Err(CaseError::NoHealthy)));
}

/// Parts that files of earlier versions lack.
const LATER: [&str; 6] = ["correlation", "sampling", "cells", "windows", "wheelbase_m", "mass_kg"];

/// What is put in the place of a part, null where it is taken away, and what is said of it.
fn absurd() -> Vec<(&'static str, Value, &'static str)> {
    vec![
        ("/nominal_hash", json!([]), "nominal_hash is empty"),
        ("/channels", json!([]), "channels is empty"),
        ("/units/drive", json!([]), "units.drive is empty"),
        ("/rate_hz", json!(5.0), "rate_hz is 5.0"),
        ("/wheelbase_m", json!(-2.0), "wheelbase_m is none"),
        ("/mass_kg", json!([1500.0, 1.0]), "mass_kg is none"),
        ("/noise", json!({}), "noise of \"dx\" is missing"),
        ("/noise/ay", Value::Null, "noise of \"ay\" is missing"),
        ("/noise/ay/0", json!(1e300), "noise of \"ay\" is not positive"),
        ("/spread", json!({}), "spread is empty"),
        ("/spread/mu/0/mean", json!(1e300), "spread of \"mu\" is none"),
        ("/sampling/jitter_secs/mean", json!(-1.0), "sampling is none"),
        ("/discrepancy/coefficients", Value::Null, "coefficients"),
        ("/discrepancy/coefficients", json!([]), "discrepancy.inverse has 1764 numbers, not 0"),
        ("/discrepancy/coefficients", json!([[0.1]]), "discrepancy.coefficients has 1 channels, not 9"),
        ("/discrepancy/coefficients/3", json!([0.1]), "discrepancy.coefficients has a channel of 1 numbers, not 42"),
        ("/discrepancy/coefficients/3/7", json!(1e300), "discrepancy.coefficients holds"),
        ("/discrepancy/inverse", Value::Null, "inverse"),
        ("/discrepancy/inverse", json!([]), "discrepancy.inverse has 0 numbers, not 1764"),
        ("/discrepancy/inverse/0", json!(-0.01), "discrepancy.inverse is that of no ridge"),
        ("/discrepancy/inverse/0", json!(1e6), "discrepancy.inverse is that of no ridge"),
        ("/discrepancy/inverse/1", json!(0.005), "discrepancy.inverse is that of no ridge"),
        ("/correlation/below", json!([]), "correlation is none"),
        ("/correlation/below/0", json!(0.99), "correlation is none"),
        ("/nulls", json!([]), "nulls are missing"),
        ("/nulls/0/z", json!([]), "is of 0 logs, not 1 to 3"),
        ("/nulls/0/z", json!([0.1, 0.2, 0.3, 0.4]), "is of 4 logs, not 1 to 3"),
        ("/cells/0/z", json!([]), "the cells of"),
        ("/cells/0/z/0", json!(1e300), "holds what no log reaches"),
        ("/detection_limits/gain:ego", Value::Null, "detection_limits of \"gain:ego\" is missing"),
        ("/influence/0/chance", json!(7.0), "is no chance"),
        ("/domain", json!({}), "domain of \"one\" is missing"),
        ("/domain/v2", Value::Null, "domain of \"v2\" is missing"),
        ("/domain/v2", json!([3.0, 1.0]), "domain of \"v2\" is no range"),
        ("/domain/v2", json!([0.0, 1e9]), "domain of \"v2\" is no range"),
        ("/windows/sensors/noise", json!([1.0]), "windows.sensors.noise has 1 channels, not 11"),
        ("/windows/logs", json!([]), "windows.logs has 0 logs, not 3"),
        ("/windows/logs/0/0/channels", json!([]), "windows.logs holds"),
    ]
}

/// Every part of a file that is missing, empty or beyond what healthy logs can leave is refused by its name and the file's.
#[test]
fn missing_and_absurd_parts_are_refused_by_name() {
    let root = tempfile::tempdir().expect("a folder");
    let file = root.path().join("baseline.json");
    let mut whole = serde_json::to_value(learn(&healthy(&[]), &|| ()).expect("three healthy logs")).expect("JSON");
    let diagonal: Vec<f64> = (0..42 * 42).map(|k| if k % 43 == 0 { 0.01 } else { 0.0 }).collect();
    whole["discrepancy"] = json!({ "coefficients": vec![vec![0.1; 42]; 9], "inverse": diagonal });
    let read = |value: &Value| {
        std::fs::write(&file, value.to_string()).expect("it can be written");
        Baseline::read(&file)
    };
    read(&whole).expect("the whole is sound");
    for part in LATER {
        let mut earlier = whole.clone();
        assert!(earlier.as_object_mut().expect("a table").remove(part).is_some(), "{part}");
        read(&earlier).expect("files of earlier versions are read");
    }
    let refused = |value: &Value, named: &str| {
        let error = read(value).expect_err(named);
        let why = std::error::Error::source(&error).map(ToString::to_string).unwrap_or_default();
        let said = format!("{error}: {why}");
        assert!(said.contains(named) && said.contains("baseline.json"), "{named}: {said}");
    };
    for part in whole.as_object().expect("a table").keys().filter(|part| !LATER.contains(&part.as_str())) {
        let mut lacking = whole.clone();
        lacking.as_object_mut().expect("a table").remove(part);
        refused(&lacking, part);
    }
    for (pointer, value, named) in absurd() {
        let mut changed = whole.clone();
        // null takes the part away
        match value {
            Value::Null => {
                let (table, key) = pointer.rsplit_once('/').expect("a part of a table");
                let table = changed.pointer_mut(table).and_then(Value::as_object_mut).expect("a table");
                assert!(table.remove(key).is_some(), "{pointer}");
            }
            value => *changed.pointer_mut(pointer).expect(pointer) = value,
        }
        refused(&changed, named);
    }
    let mut silent = whole.clone();
    silent["nulls"].as_array_mut().expect("a list").retain(|null| null["statistic"] != "gain:ego");
    refused(&silent, "the null of all logs of \"gain:ego\" is missing");
    let mut odd = whole;
    odd["domain"]["nonsense"] = json!([0.0, 1.0]);
    refused(&odd, "domain of \"nonsense\" is of no quantity");
}
