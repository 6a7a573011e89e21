//! Every expected value of every reference case against this implementation's answers, found by walking the case.
//!
//! Discrete values must be equal where the case is stable, all others within 1e-6. The cases lie outside the
//! repository; where they are absent the test says so and passes.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde_json::Value;

const TOLERANCE: f64 = 1e-6;

/// Keys whose values are not scores: they describe the case.
const METADATA: &[&str] = &["columns", "order"];

#[derive(Default)]
struct Comparison {
    compared: BTreeMap<String, usize>,
    skipped_unstable: usize,
    largest: BTreeMap<String, f64>,
    faults: Vec<String>,
}

impl Comparison {
    fn fault(&mut self, at: &str, expected: &Value, got: Option<&Value>) {
        if self.faults.len() < 40 {
            let short = |text: String| text.chars().take(120).collect::<String>();
            let got = got.map_or("nothing".to_owned(), Value::to_string);
            self.faults.push(format!("{at}: expected {}, got {}", short(expected.to_string()), short(got)));
        }
    }

    /// Looks for `expected…` keys in a case.
    fn search(&mut self, at: &str, schema: &str, case: &Value, got: Option<&Value>) {
        match case {
            Value::Object(fields) => {
                for (key, value) in fields {
                    let got = got.and_then(|got| got.get(key));
                    let at = format!("{at}.{key}");
                    if key.starts_with("expected") || key == "reference_simulated_states" {
                        let stable = value.get("stable").or(case.get("expected_v2").and_then(|v2| v2.get("stable")));
                        let stable = stable.and_then(Value::as_bool).unwrap_or(true);
                        self.compare(&at, (schema, stable), value, got);
                    } else {
                        self.search(&at, schema, value, got);
                    }
                }
            }
            Value::Array(entries) => {
                for (index, entry) in entries.iter().enumerate() {
                    self.search(&format!("{at}[{index}]"), schema, entry, got.and_then(|got| got.get(index)));
                }
            }
            _ => {}
        }
    }

    fn compare(&mut self, at: &str, of: (&str, bool), expected: &Value, got: Option<&Value>) {
        match (expected, got) {
            (Value::Object(fields), Some(Value::Object(_))) => {
                for (key, value) in fields {
                    self.compare(&format!("{at}.{key}"), of, value, got.and_then(|got| got.get(key)));
                }
            }
            (Value::Array(entries), Some(Value::Array(answers))) if entries.len() == answers.len() => {
                for (index, (entry, answer)) in entries.iter().zip(answers).enumerate() {
                    self.compare(&format!("{at}[{index}]"), of, entry, Some(answer));
                }
            }
            (Value::Number(expected_number), Some(Value::Number(number))) => {
                let difference = (as_f64(expected_number) - as_f64(number)).abs();
                *self.compared.entry(of.0.to_owned()).or_default() += 1;
                let largest = self.largest.entry(of.0.to_owned()).or_default();
                if !of.1 && difference > TOLERANCE {
                    self.skipped_unstable += 1;
                    return;
                }
                *largest = largest.max(difference);
                if difference > TOLERANCE || difference.is_nan() {
                    self.fault(at, expected, got);
                }
            }
            (Value::Object(_) | Value::Array(_), _) => self.fault(at, expected, got),
            _ => {
                *self.compared.entry(of.0.to_owned()).or_default() += 1;
                if got != Some(expected) {
                    if of.1 || METADATA.iter().any(|key| at.ends_with(key)) {
                        self.fault(at, expected, got);
                    } else {
                        self.skipped_unstable += 1;
                    }
                }
            }
        }
    }
}

fn as_f64(number: &serde_json::Number) -> f64 {
    number.as_f64().unwrap_or(f64::NAN)
}

#[test]
fn every_expected_value_is_met() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../../shared/golden/navsim");
    if !folder.join("cases").is_dir() {
        eprintln!("skipped: no reference cases beside this checkout");
        return;
    }
    let answers = ds_score_cases::answers(&folder).expect("the folder is readable");
    let mut comparison = Comparison::default();
    for (path, error) in &answers.failures {
        comparison.faults.push(format!("{} failed: {error:?}", path.display()));
    }
    let mut cases = 0;
    for entry in std::fs::read_dir(folder.join("cases")).expect("the folder is readable") {
        let path = entry.expect("an entry").path();
        let case: Value = serde_json::from_str(&std::fs::read_to_string(&path).expect("text")).expect("JSON");
        let id = case["case_id"].as_str().expect("a case has an id");
        let schema = case["schema"].as_str().expect("a case has a schema");
        comparison.search(id, schema, &case, answers.value.get(id));
        cases += 1;
    }
    let total: usize = comparison.compared.values().sum();
    eprintln!("{cases} cases, {total} values compared, {} unstable ones left out", comparison.skipped_unstable);
    for (schema, count) in &comparison.compared {
        eprintln!(
            "{schema}: {count} values, largest difference {:.1e}",
            comparison.largest.get(schema).unwrap_or(&0.0)
        );
    }
    assert!(comparison.faults.is_empty(), "{:#?}", comparison.faults);
    assert!(total > 0);
}
