//! Time stamps: what looks wrong with them.

use super::LogFinding;
use crate::channel;
use crate::mapping::Mapping;
use crate::resample::LONGEST_HOLE_SECS;

/// Steps between samples that any vehicle log has, s: 5 kHz to 2 Hz.
const USUAL_STEP_SECS: std::ops::RangeInclusive<f64> = 2e-4..=0.5;

/// Says what is wrong with the stamps of a file, given in seconds.
pub(super) fn findings(file: &str, t: &[f64], mapping: &Mapping) -> Vec<LogFinding> {
    let finding = |problem: &str, evidence: String, proposal: String| LogFinding {
        file: file.to_owned(),
        channel: "time".to_owned(),
        problem: problem.to_owned(),
        evidence,
        proposal,
    };
    let mut found = Vec::new();
    let steps: Vec<f64> = t.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| step.is_finite()).collect();
    let mut forward: Vec<f64> = steps.iter().copied().filter(|step| *step > 0.0).collect();
    if forward.is_empty() {
        let evidence = format!("none of {} stamps is later than the one before", t.len());
        return vec![finding("stamps do not grow", evidence, "map another column as time.column".to_owned())];
    }
    let median = ds_stats::quantile(&mut forward, 0.5);
    if !USUAL_STEP_SECS.contains(&median) {
        let raw = median / channel::seconds(&mapping.time.unit).unwrap_or(1.0);
        let better = ["s", "ms", "us", "ns"]
            .into_iter()
            .find(|unit| channel::seconds(unit).is_some_and(|s| USUAL_STEP_SECS.contains(&(raw * s))));
        let evidence = format!("the usual step would be {median:.3e} s");
        let proposal = better.map_or("map another column as time.column".to_owned(), |u| format!("time.unit = {u:?}"));
        found.push(finding("wrong time unit", evidence, proposal));
        return found;
    }
    let row = |wanted: &dyn Fn(f64) -> bool| steps.iter().position(|s| wanted(*s)).map_or(0, |k| k + 2);
    let count = |wanted: &dyn Fn(f64) -> bool| steps.iter().filter(|s| wanted(**s)).count();
    let (same, back) = (|step: f64| step == 0.0, |step: f64| step < 0.0);
    let hole = |step: f64| step > LONGEST_HOLE_SECS.max(5.0 * median);
    if count(&same) > 0 {
        let evidence = format!("{} rows repeat the stamp before, first row {}", count(&same), row(&same));
        found.push(finding("duplicated stamps", evidence, "nothing to do: the later row is dropped".to_owned()));
    }
    if count(&back) > 0 {
        let evidence = format!("{} rows go back in time, first row {}", count(&back), row(&back));
        let proposal = "sort the log, or split it into one file per drive; rows that go back are dropped".to_owned();
        found.push(finding("reversed stamps", evidence, proposal));
    }
    if count(&hole) > 0 {
        let longest = steps.iter().copied().fold(0.0, f64::max);
        let evidence = format!("{} holes, the longest {longest:.2} s, first before row {}", count(&hole), row(&hole));
        found.push(finding("gaps", evidence, "nothing to do: the drive is cut there".to_owned()));
    }
    found
}
