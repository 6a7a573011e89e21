//! Reads numbers that may be `null`, which is how JSON writes those that are not finite; they become NaN.

use std::collections::BTreeMap;

use serde::{Deserialize as _, Deserializer};

fn or_nan(value: Option<f64>) -> f64 {
    value.unwrap_or(f64::NAN)
}

/// Reads a number.
pub(crate) fn number<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Option::deserialize(from).map(or_nan)
}

/// Reads a pair of numbers.
pub(crate) fn pair<'de, D: Deserializer<'de>>(from: D) -> Result<[f64; 2], D::Error> {
    <[Option<f64>; 2]>::deserialize(from).map(|pair| pair.map(or_nan))
}

/// Reads a pair of numbers that may not be known at all.
pub(crate) fn known_pair<'de, D: Deserializer<'de>>(from: D) -> Result<Option<[f64; 2]>, D::Error> {
    Ok(Option::<[Option<f64>; 2]>::deserialize(from)?.map(|pair| pair.map(or_nan)))
}

/// Reads a list of numbers.
pub(crate) fn list<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<f64>, D::Error> {
    Vec::deserialize(from).map(|list| list.into_iter().map(or_nan).collect())
}

/// Reads numbers by name.
pub(crate) fn table<'de, D: Deserializer<'de>>(from: D) -> Result<BTreeMap<String, f64>, D::Error> {
    let read = BTreeMap::<String, Option<f64>>::deserialize(from)?;
    Ok(read.into_iter().map(|(name, value)| (name, or_nan(value))).collect())
}

#[cfg(test)]
mod tests {
    use crate::schema::{CorrectedEffect, Diagnosis, Finding, Manoeuvre, Shrink};

    #[test]
    fn what_is_not_finite_comes_back_as_no_number() {
        let mut said = Diagnosis::blank("far");
        said.effects.push(Finding {
            id: "steer_rate".to_owned(),
            probability: 0.5,
            value: 0.2,
            unit: "rad/s".to_owned(),
            interval90: [0.1, f64::INFINITY],
            group: Vec::new(),
            heldout_gain: None,
            evidence_gain: 9.0,
            params: [("limit".to_owned(), f64::INFINITY)].into(),
        });
        said.next_manoeuvre.push(Manoeuvre {
            name: "coast".to_owned(),
            separates: [String::new(), String::new()],
            expected_log_bayes_factor: 0.0,
            secs_needed: f64::INFINITY,
        });
        said.corrected_model.effects.push(CorrectedEffect {
            id: String::new(),
            value: 0.2,
            values: vec![0.2, f64::NAN],
        });
        let text = serde_json::to_string(&said).expect("a diagnosis is JSON");
        let read: Diagnosis = serde_json::from_str(&text).expect("what was written can be read");
        assert!(read.effects[0].interval90[1].is_nan());
        for unknown in ["predicted_share", "heldout_gain", "unknown_description", "shares", "detection_limits"] {
            assert!(!text.contains(unknown), "{unknown} is written though it is not known");
        }
        assert!(text.contains("\"where\":[]"), "a list that is known to be empty is written");
        assert!(read.effects[0].params["limit"].is_nan() && read.next_manoeuvre[0].secs_needed.is_nan());
        assert_eq!((read.effects[0].value, read.effects[0].interval90[0]), (0.2, 0.1));
        assert!(read.corrected_model.effects[0].values[1].is_nan());
    }

    #[test]
    fn files_of_earlier_versions_are_read() {
        let old = r#"{"metric":"position_2s","before":0.5,"after":0.1,"floor":0.05,"share_explained":0.9,
            "interval90":[null,0.95],"data":"heldout"}"#;
        let read: Shrink = serde_json::from_str(old).expect("an earlier file");
        assert_eq!((read.nuisance, read.share_nuisance, read.share_explained), (None, None, Some(0.9)));
        assert!(read.interval90.is_some_and(|ends| ends[0].is_nan() && ends[1] == 0.95));
        let said = serde_json::to_string(&Diagnosis::blank("old")).expect("JSON");
        let said = said.replace(
            "\"how_far\":[]",
            "\"how_far\":[],\"predicted_share\":null,\"shares\":[],\"unknown_description\":null",
        );
        let read: Diagnosis = serde_json::from_str(&said).expect("an earlier file");
        assert!(read.predicted_share.is_none() && read.shares.is_empty() && read.unknown_description.is_none());
    }
}
