//! What a `diagnosis` must not hold is refused by field and value; the largest one that may be sent is read.

use ds_effect::Verdict;
use ds_space::SimTime;
use ds_topic::{DiagnosedEffect, Diagnosis, GapCell};
use ds_wire::{Body, v1};

fn diagnosis() -> Diagnosis {
    let effect = DiagnosedEffect {
        id: "gyro_bias".to_owned(),
        probability: 0.9,
        value: Some(0.02),
        unit: "rad/s".to_owned(),
        interval90: [Some(0.019), Some(0.021)],
        chosen: true,
    };
    let cell = GapCell { channel: "yaw_rate".to_owned(), bins: Vec::new(), effect_size: 3.0, q_value: Some(0.01) };
    Diagnosis {
        window: (SimTime(1_000_000_000), SimTime(7_500_000_000)),
        reference: String::new(),
        verdict: Verdict::Single,
        p_none: 0.04,
        p_unknown: 0.06,
        effects: vec![effect],
        cells: vec![cell],
        differences: vec![("position".to_owned(), 0.2)],
    }
}

fn bad(change: &dyn Fn(&mut v1::Diagnosis), says: &str) {
    let mut message = v1::Diagnosis::from(&diagnosis());
    change(&mut message);
    let bytes = prost::Message::encode_to_vec(&message);
    let error = Diagnosis::from_bytes(&bytes).expect_err("is refused").to_string();
    assert!(error.contains(says), "{error:?} does not say {says:?}");
}

#[test]
fn a_bad_diagnosis_is_refused_by_field_and_value() {
    bad(&|m| m.verdict = 0, "diagnosis.verdict is unspecified");
    bad(&|m| m.verdict = 9, "diagnosis.verdict is 9, no known value");
    bad(&|m| m.to_ns = m.from_ns - 1, "diagnosis.to_ns is 999999999, before from_ns 1000000000");
    bad(&|m| m.p_none = Some(1.5), "diagnosis.p_none is 1.5, must be 0 to 1");
    bad(&|m| m.p_unknown = None, "diagnosis.p_unknown is missing");
    bad(&|m| m.effects[0].id.clear(), "diagnosis.effects[0].id is empty");
    bad(&|m| m.effects[0].probability = Some(f64::NAN), "diagnosis.effects[0].probability is NaN");
    bad(&|m| m.effects[0].high = Some(f64::INFINITY), "diagnosis.effects[0].high is inf");
    bad(&|m| m.effects = vec![v1::DiagnosedEffect::default(); 257], "diagnosis.effects has more than 256 elements");
    bad(&|m| m.cells[0].effect_size = Some(-1.0), "diagnosis.cells[0].effect_size is -1, below 0");
    let bin = v1::RegimeBin { axis: "speed".to_owned(), bin: "low".to_owned() };
    bad(&|m| m.cells[0].bins = vec![bin.clone(), bin.clone()], "diagnosis.cells[0].bins[1].axis is \"speed\"");
    bad(&|m| m.cells[0].bins = vec![bin.clone(); 9], "diagnosis.cells[0].bins has 9 elements");
    bad(&|m| m.differences[0].rms = None, "diagnosis.differences[0].rms is missing");
    bad(&|m| m.reference = "x".repeat(257), "diagnosis.reference has 257 bytes");
}

#[test]
fn the_largest_diagnosis_is_not_too_long() {
    let mut largest = diagnosis();
    let long = "x".repeat(64);
    largest.effects[0].id.clone_from(&long);
    largest.effects[0].unit = "u".repeat(32);
    let bin = |axis: u8| (format!("{axis}{}", &long[1..]), long.clone());
    largest.cells[0] = GapCell { channel: long.clone(), bins: (0..8).map(bin).collect(), ..largest.cells[0].clone() };
    largest.effects = vec![largest.effects[0].clone(); 256];
    largest.cells = vec![largest.cells[0].clone(); 128];
    largest.differences = vec![(long.clone(), 1.0); 64];
    largest.reference = "r".repeat(256);
    assert_eq!(Diagnosis::from_bytes(&largest.to_bytes()), Ok(largest));
}
