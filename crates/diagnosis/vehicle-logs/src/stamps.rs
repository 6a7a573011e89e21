//! Time stamps: what looks wrong with them, and which rows can be used.

use ds_diagnosis::table::STEP_SECS;
use ds_diagnosis::unevenness::{Gaps, gaps, scatter};

use crate::channel;
use crate::finding::LogFinding;

/// Longest hole in the stamps that is bridged, s; a longer one ends a drive.
pub(crate) const LONGEST_HOLE_SECS: f64 = 0.8;
/// Steps between samples that any vehicle log has, s: 5 kHz to 2 Hz.
pub(crate) const USUAL_STEP_SECS: std::ops::RangeInclusive<f64> = 2e-4..=0.5;

/// Slower messages are sent when something happens, s.
const SAMPLED_SECS: f64 = 0.1;

/// Stamps of a file or of one of its topics, in its own order.
pub(crate) struct Clock {
    /// `time`, or the topic.
    pub name: String,
    /// Seconds after the first stamp of the log.
    pub t: Vec<f64>,
    /// Its messages are sorted by stamp before they are used.
    pub sorted: bool,
}

/// Returns the rows whose stamps grow.
pub(crate) fn growing(t: &[f64]) -> Vec<usize> {
    let mut last = f64::NEG_INFINITY;
    (0..t.len())
        .filter(|&row| {
            let grows = t[row].is_finite() && t[row] > last;
            last = if grows { t[row] } else { last };
            grows
        })
        .collect()
}

/// Returns from when to when growing stamps have no hole longer than so many seconds.
pub(crate) fn spans(t: &[f64], longest_hole_secs: f64) -> Vec<(f64, f64)> {
    t.chunk_by(|a, b| b - a <= longest_hole_secs).filter_map(|part| Some((*part.first()?, *part.last()?))).collect()
}

/// Returns the longest hole that growing stamps of such a rate may have, s: slow ones are not cut at each step.
pub(crate) fn longest_hole_secs(t: &[f64]) -> f64 {
    let mut steps: Vec<f64> = t.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if steps.is_empty() { f64::INFINITY } else { LONGEST_HOLE_SECS.max(5.0 * ds_stats::quantile(&mut steps, 0.5)) }
}

/// Returns what two lists of spans have in common.
pub(crate) fn both(a: &[(f64, f64)], b: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let pairs = a.iter().flat_map(|x| b.iter().map(move |y| (x.0.max(y.0), x.1.min(y.1))));
    pairs.filter(|(from, to)| from < to).collect()
}

/// Says what is wrong with stamps; `unit` is the one that the mapping says they are in, where they have none of their own.
pub(crate) fn findings(file: &str, clock: &Clock, unit: Option<&str>) -> Vec<LogFinding> {
    let t = &clock.t;
    let finding = |problem: &str, evidence: String, proposal: String| LogFinding {
        file: file.to_owned(),
        channel: clock.name.clone(),
        problem: problem.to_owned(),
        evidence,
        proposal,
    };
    let mut found = Vec::new();
    if clock.sorted && t.len() < 2 {
        // a command that was sent once is in force from then on
        return found;
    }
    let steps: Vec<f64> = t.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| step.is_finite()).collect();
    let mut forward: Vec<f64> = steps.iter().copied().filter(|step| *step > 0.0).collect();
    if forward.is_empty() {
        let evidence = format!("none of {} stamps is later than the one before", t.len());
        let cure = if clock.sorted { "stamp = \"log\"" } else { "map another column as time.column" };
        return vec![finding("stamps do not grow", evidence, cure.to_owned())];
    }
    let median = ds_stats::quantile(&mut forward, 0.5);
    if let Some(unit) = unit.filter(|_| !USUAL_STEP_SECS.contains(&median)) {
        let raw = median / channel::seconds(unit).unwrap_or(1.0);
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
        let proposal = match clock.sorted {
            true => "nothing to do: messages are sorted by stamp",
            false => "sort the log, or split it into one file per drive; rows that go back are dropped",
        };
        found.push(finding("reversed stamps", evidence, proposal.to_owned()));
    }
    if count(&hole) > 0 {
        let longest = steps.iter().copied().fold(0.0, f64::max);
        let evidence = format!("{} holes, the longest {longest:.2} s, first before row {}", count(&hole), row(&hole));
        found.push(finding("gaps", evidence, "nothing to do: the drive is cut there".to_owned()));
    }
    let used: Vec<f64> = growing(t).into_iter().map(|row| t[row]).collect();
    let whole: Vec<&[f64]> = used.chunk_by(|a, b| !hole(b - a)).collect();
    let bridged: Vec<Gaps> = whole.iter().filter_map(|part| gaps(part, median, STEP_SECS)).collect();
    if let Some(first) = bridged.first() {
        let (count, longest) = (
            bridged.iter().map(|g| g.count).sum::<usize>(),
            bridged.iter().map(|g| g.longest_secs).fold(0.0, f64::max),
        );
        let evidence = format!("{count} of up to {longest:.3} s, the first after {:.3} s", first.after_secs);
        found.push(finding("short gaps", evidence, "nothing to do: straight lines bridge them".to_owned()));
    }
    if let Some([low, high]) = scatter(&used, median).filter(|_| median <= SAMPLED_SECS) {
        let evidence = format!("steps scatter from {low:.4} to {high:.4} s about {median:.4} s");
        let cure = if clock.sorted {
            "stamp = \"header\" if the messages have one, and it was \"log\""
        } else {
            "the stamp of the measurement, if there is one beside that of its receipt"
        };
        found.push(finding("uneven stamps", evidence, cure.to_owned()));
    }
    found
}
