//! The age of what a policy sees, read off the stamps of its answers and of the frames behind them: `obs_latency`.
//!
//! The nominal bridge shows the newest frame. Stamps have no noise, so that the median age is the estimate, known to half
//! the distance of two frames; nothing else in a log shows this effect, and it takes no other effect's place.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use ds_diagnosis::schema::{Cell, CorrectedEffect, Finding, Regime};
use ds_diagnosis::{Diagnosis, Verdict};
use ds_record::vehicle_log::Planned;

const ID: &str = "obs_latency";
const ENDING: &str = ".plans.csv";
/// Ages below this are the nominal bridge's own, s.
const USUAL_SECS: f64 = 0.02;
/// At least so many answers are needed.
const FEWEST: usize = 5;
/// How sure stamps make, and what stays for everything else.
const SURE: f64 = 0.99;

/// Writes the stamps of a drive's answers; nothing where the bridge said none.
pub(super) fn write(plans: &[Planned], path: &Path) -> Result<()> {
    if plans.is_empty() {
        return Ok(());
    }
    let mut text = String::from("t,frame_t\n");
    for planned in plans {
        writeln!(text, "{},{}", planned.t, planned.frame_t)?;
    }
    std::fs::write(path, text).with_context(|| format!("write {}", path.display()))
}

/// Adds what the stamps of a case say to its diagnosis.
pub(super) fn add(case: &Path, diagnosis: &mut Diagnosis) -> Result<()> {
    let mut rows = read(case)?;
    rows.sort_by(|a, b| (a.t - a.frame_t).total_cmp(&(b.t - b.frame_t)));
    let age = |share: f64| rows.get((share * (rows.len().max(1) - 1) as f64) as usize).map(|row| row.t - row.frame_t);
    let (Some(low), Some(median), Some(high)) = (age(0.05), age(0.5), age(0.95)) else { return Ok(()) };
    if rows.len() < FEWEST || median < USUAL_SECS {
        return Ok(());
    }
    accuse(diagnosis, median, [low, high]);
    let last = rows.iter().map(|row| row.t).fold(0.0, f64::max);
    diagnosis.cells.push(Cell {
        channel: "observation age".to_owned(),
        regime: Regime::default(),
        effect_size: median / USUAL_SECS,
        q_value: 0.0,
        t: vec![[0.0, last]],
    });
    Ok(())
}

fn accuse(diagnosis: &mut Diagnosis, secs: f64, interval90: [f64; 2]) {
    // Beside another effect both are true; the list shares one among its suspects.
    let own = if diagnosis.verdict == Verdict::None { SURE } else { 0.5 };
    diagnosis.verdict = match diagnosis.verdict {
        Verdict::None => Verdict::Single,
        Verdict::Single | Verdict::Multiple => Verdict::Multiple,
        Verdict::Unknown => Verdict::Unknown,
    };
    for finding in &mut diagnosis.effects {
        finding.probability *= 1.0 - own;
    }
    diagnosis.p_none *= 1.0 - own;
    diagnosis.p_unknown *= 1.0 - own;
    let finding = Finding {
        id: ID.to_owned(),
        probability: own,
        value: secs,
        unit: "s".to_owned(),
        interval90,
        group: vec![ID.to_owned()],
        heldout_gain: 0.0,
        evidence_gain: 0.0,
        params: std::iter::once((ID.to_owned(), secs)).collect(),
    };
    let first = if own > 0.5 { 0 } else { diagnosis.effects.len().min(1) };
    diagnosis.effects.insert(first, finding);
    diagnosis.chosen.push(ID.to_owned());
    diagnosis.corrected_model.effects.push(CorrectedEffect { id: ID.to_owned(), value: secs, values: vec![secs] });
}

fn read(case: &Path) -> Result<Vec<Planned>> {
    let mut rows = Vec::new();
    let entries = std::fs::read_dir(case).with_context(|| format!("read {}", case.display()))?;
    for path in entries.flatten().map(|entry| entry.path()).filter(|path| path.to_string_lossy().ends_with(ENDING)) {
        let text = std::fs::read_to_string(&path).with_context(|| format!("read {}", path.display()))?;
        for line in text.lines().skip(1) {
            let row = line.split_once(',').and_then(|(t, frame_t)| Some((t.parse().ok()?, frame_t.parse().ok()?)));
            let (t, frame_t) = row.with_context(|| format!("{line:?} is no pair of stamps: {}", path.display()))?;
            rows.push(Planned { t, frame_t });
        }
    }
    Ok(rows)
}
