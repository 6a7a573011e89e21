//! Laws injected into the diagnosis's own car are found at their port, applied and evaluated; nothing is found where nothing
//! was injected.

use ds_diagnosis::discovery::Discovery;
use ds_diagnosis::{Diagnosis, Verdict};
use ds_discover::discover;
use ds_dynamics::case::Case;
use ds_dynamics::{Options, diagnose, synthetic};
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
    // injected, its insertion, a term of what is found, its coefficient and a tolerance; logs begin half a second after the
    // world, so that what oscillates has another phase there
    let rows = [
        ("steering.linkage: 0.008*pos(accel)", "steering", "pos(accel)", 0.008, 0.0015),
        ("drive: 0.6*sin(0.45)", "drive", "cos(0.45)", 0.592, 0.05),
        ("sensor.yaw_rate: 0.012*sin(0.2)", "sensor.yaw_rate", "sin(0.2)", 0.0097, 0.002),
    ];
    for (text, insertion, expression, coefficient, tolerance) in rows {
        let diagnosis = discovered(4150, &[text]);
        let found = found(&diagnosis);
        assert_eq!(diagnosis.verdict, Verdict::Unknown, "{text}: {:?}", diagnosis.chosen);
        assert_eq!(found.insertion[0].id, insertion, "{text}: {found:?}");
        let sum: f64 = found.insertion.iter().map(|place| place.probability).sum::<f64>() + found.p_none;
        assert!((sum - 1.0).abs() < 0.01, "{sum}");
        let law = found.law.as_ref().unwrap_or_else(|| panic!("{text}: {:?}", found.note));
        let term = law.terms.iter().find(|term| term.expression == expression);
        let term = term.unwrap_or_else(|| panic!("{text}: {}", law.text));
        assert!((term.coefficient - coefficient).abs() < tolerance, "{text}: {}", law.text);
        assert!(found.share_explained.as_ref().is_some_and(|share| share.value > 0.7), "{text}: {found:?}");
        assert_eq!(diagnosis.corrected_model.laws.as_slice(), std::slice::from_ref(&law.text));
    }
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
fn no_law_is_found_where_there_is_none() {
    let diagnosis = discovered(4153, &[]);
    let found = found(&diagnosis);
    assert_eq!((diagnosis.verdict, found.law.is_none()), (Verdict::None, true));
    assert!(found.note.is_some() && diagnosis.corrected_model.laws.is_empty());
}
