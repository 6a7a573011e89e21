//! Laws injected into the diagnosis's own car are found at their port, applied and evaluated; nothing is found where nothing
//! was injected.

use ds_diagnosis::discovery::{Discovery, LawKind};
use ds_diagnosis::{Diagnosis, Verdict};
use ds_discover::{discover, extrapolated_share};
use ds_dynamics::case::Case;
use ds_dynamics::{Options, diagnose, synthetic};
use ds_effect::law::Felt;
use ds_effect::{Law, Plant};

fn case(seed: u64, laws: &[&str]) -> Case {
    let folder = tempfile::tempdir().expect("a folder");
    let edit = |plant: &mut Plant| plant.laws.extend(laws.iter().map(|text| Law::parse(text).expect("a law")));
    synthetic::write_case(folder.path(), seed, &edit).expect("the case can be written");
    Case::read(folder.path()).expect("the case can be read")
}

fn discovered(seed: u64, laws: &[&str]) -> Diagnosis {
    let (case, quick) = (case(seed, laws), Options { quick: true, ..Options::default() });
    let mut diagnosis = diagnose(&case, &quick);
    discover(&case, &mut diagnosis, &[]);
    diagnosis
}

fn found(diagnosis: &Diagnosis) -> &Discovery {
    diagnosis.discovery.as_ref().expect("a law was looked for")
}

#[test]
fn laws_are_found_at_their_ports() {
    // injected, its insertion, how a term of what is found begins, its coefficient and a tolerance; logs begin half a second after the
    // world, so that what oscillates has another phase there
    let rows = [
        ("steering.linkage: 0.008*pos(accel)", "steering", "pos(accel)", 0.008, 0.0015),
        ("drive: 0.6*sin(0.45)", "drive", "cos(0.45", 0.592, 0.05),
        ("lateral.body.side: 600*v*v*ring(delta,1.5)", "lateral.body", "v*v*ring(delta,", 600.0, 250.0),
        ("sensor.yaw_rate: 0.012*sin(0.2)", "sensor.yaw_rate", "sin(0.20", 0.0097, 0.002),
    ];
    for (text, insertion, expression, coefficient, tolerance) in rows {
        let diagnosis = discovered(4150, &[text]);
        let found = found(&diagnosis);
        assert_eq!(diagnosis.verdict, Verdict::Unknown, "{text}: {:?}", diagnosis.chosen);
        assert_eq!(found.insertion[0].id, insertion, "{text}: {found:?}");
        let sum: f64 = found.insertion.iter().map(|place| place.probability).sum::<f64>() + found.p_none;
        assert!((sum - 1.0).abs() < 0.01, "{sum}");
        let law = found.law.as_ref().unwrap_or_else(|| panic!("{text}: {:?}", found.note));
        let term = law.terms.iter().find(|term| term.expression.starts_with(expression));
        let term = term.unwrap_or_else(|| panic!("{text}: {}", law.text));
        assert!((term.coefficient - coefficient).abs() < tolerance, "{text}: {}", law.text);
        assert!(found.share_explained.as_ref().is_some_and(|share| share.value > 0.7), "{text}: {found:?}");
        assert_eq!(diagnosis.corrected_model.laws.as_slice(), std::slice::from_ref(&law.text));
    }
}

/// What no sum of products tells is found as a table: a steering gain that goes up and down with the speed, and a drive that lacks force at one speed.
#[test]
fn tables_are_found_where_sums_fail() {
    let gain = [(6, -0.25), (9, 0.25), (12, -0.25), (15, 0.25), (18, -0.25)];
    let knots = gain.map(|(v, height)| format!("{height}*delta*hat(v;{};{v};{})", v - 3, v + 3));
    let by_speed = format!("steering.linkage: {}", knots.join(" + ").replace("+ -", "- "));
    let hole = "drive: -0.9*hat(v;9;11;13)";
    let rows = [(by_speed.as_str(), "steering", "delta", 0.25), (hole, "drive", "hat(v;", 0.9)];
    for (text, insertion, carrier, height) in rows {
        let diagnosis = discovered(4154, &[text]);
        let found = found(&diagnosis);
        assert_eq!(found.insertion[0].id, insertion, "{text}: {found:?}");
        let law = found.law.as_ref().unwrap_or_else(|| panic!("{text}: {:?}", found.note));
        assert_eq!(law.kind, LawKind::Table, "{text}: {}", law.text);
        assert!(law.terms.iter().all(|term| term.expression.starts_with(carrier)), "{text}: {}", law.text);
        // a steering gain falls on the angle that the actuator makes, so that the felt part is that of the curve
        let (truth, told) = (Law::parse(text).expect("a law"), Law::parse(&law.text).expect("a law"));
        for v in [9.0, 11.0, 12.0, 15.0] {
            let [truth, told] = [&truth, &told].map(|law| law.at(|_| 1.0, &Felt { v, ..Felt::default() }));
            assert!((truth - told).abs() < 0.35 * height, "{v} m/s: {told} for {truth} of {}", law.text);
        }
    }
}

/// A range that the drives leave at once is told of.
#[test]
fn what_lies_beyond_a_law_is_told() {
    let case = case(4155, &[]);
    let beyond = |text: &str| extrapolated_share(&case, &Law::parse(text).expect("a law"), &[0]);
    assert_eq!(beyond("drive: 1*v[0;0.1]"), Some(1.0));
    assert_eq!(beyond("drive: 1*v[0;100]"), Some(0.0));
    assert_eq!(beyond("drive: 1*hat(v;0;50;100) + 1*v"), Some(0.0));
    assert_eq!(beyond("drive: 1*v"), None);
}

#[test]
fn a_law_closes_the_gap_of_drives_it_never_saw() {
    let text = "steering.linkage: 0.008*pos(accel)";
    let diagnosis = discovered(4151, &[text]);
    let shrinks = ds_dynamics::evaluate(&diagnosis, &case(4152, &[text]), &[]);
    let position = shrinks.iter().find(|shrink| shrink.metric == "position_2s").expect("the metric is there");
    assert!(position.share_explained.is_some_and(|share| share > 0.7), "{position:?}");
    let mut without = diagnosis;
    without.corrected_model.laws.clear();
    let bare = ds_dynamics::evaluate(&without, &case(4152, &[text]), &[]);
    let position = bare.iter().find(|shrink| shrink.metric == "position_2s").expect("the metric is there");
    assert!(position.share_explained.is_none_or(|share| share.abs() < 0.05), "{position:?}");
}

#[test]
fn who_asks_is_told_a_strong_law_though_nothing_was_found_missing() {
    let case = case(4151, &["steering.linkage: 0.008*pos(accel)"]);
    let mut overlooked = diagnose(&case, &Options { quick: true, ..Options::default() });
    (overlooked.verdict, overlooked.effects) = (Verdict::None, Vec::new());
    discover(&case, &mut overlooked, &[]);
    let law = found(&overlooked).law.as_ref().unwrap_or_else(|| panic!("{:?}", found(&overlooked).note));
    assert!(law.text.contains("pos(accel"), "{}", law.text);
}

#[test]
fn no_law_is_found_where_there_is_none() {
    let diagnosis = discovered(4153, &[]);
    let found = found(&diagnosis);
    assert_eq!((diagnosis.verdict, found.law.is_none()), (Verdict::None, true));
    assert!(found.note.is_some() && diagnosis.corrected_model.laws.is_empty());
}
