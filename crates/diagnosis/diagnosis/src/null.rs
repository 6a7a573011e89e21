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
    use crate::schema::{CorrectedEffect, Diagnosis, Finding, Manoeuvre};

    #[test]
    fn what_is_not_finite_comes_back_as_no_number() {
        let mut said = Diagnosis::blank("far");
        said.predicted_share = f64::NAN;
        said.effects.push(Finding {
            id: "steer_rate".to_owned(),
            probability: 0.5,
            value: 0.2,
            unit: "rad/s".to_owned(),
            interval90: [0.1, f64::INFINITY],
            group: Vec::new(),
            heldout_gain: f64::NEG_INFINITY,
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
        assert!(read.predicted_share.is_nan() && read.effects[0].interval90[1].is_nan());
        assert!(read.effects[0].params["limit"].is_nan() && read.next_manoeuvre[0].secs_needed.is_nan());
        assert_eq!((read.effects[0].value, read.effects[0].interval90[0]), (0.2, 0.1));
        assert!(read.corrected_model.effects[0].values[1].is_nan());
    }
}
