//! Diagnoses many cases: writes `DIR/<case>/diagnosis.json` and prints one line per case, beside its label if there is one.
//!
//! `dynamics-practice CASES_DIR --out DIR [--quick] [--only NAME] [--without EFFECT] [--score]`; cases run in parallel;
//! `--score` only scores what an earlier run wrote.
#![allow(clippy::print_stdout, reason = "the table is this command's answer")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use ds_diagnosis::score::{Scores, confidence, read_labels, score};
use ds_diagnosis::{CaseError, Diagnosis};
use ds_dynamics::case::Case;
use ds_dynamics::size::{effect_size, twin_size, with_twin};
use ds_dynamics::{Options, diagnose};
use rayon::prelude::*;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let after = |flag: &str| arguments.iter().position(|a| a == flag).and_then(|k| arguments.get(k + 1)).cloned();
    let Some(root) = arguments.first().filter(|a| !a.starts_with("--")).map(PathBuf::from) else {
        println!("usage: dynamics-practice CASES_DIR [--out DIR] [--quick] [--only NAME] [--without EFFECT] [--score]");
        return ExitCode::from(64);
    };
    let options = Options {
        quick: arguments.iter().any(|a| a == "--quick"),
        without: after("--without").map(|w| w.split(',').map(str::to_owned).collect()).unwrap_or_default(),
    };
    let labels: serde_json::Value = std::fs::read_to_string(root.join("labels.json"))
        .ok()
        .and_then(|text| serde_json::from_str(&text).ok())
        .unwrap_or_default();
    if arguments.iter().any(|a| a == "--leave-one-out") {
        return left_out(&root, &options);
    }
    let mut cases: Vec<PathBuf> = std::fs::read_dir(&root)
        .map(|entries| {
            entries.filter_map(|e| e.ok().map(|e| e.path())).filter(|p| p.join("meta.json").exists()).collect()
        })
        .unwrap_or_default();
    cases.sort();
    if let Some(only) = after("--only") {
        cases.retain(|c| c.ends_with(&only) || c.to_string_lossy().contains(&only));
    }
    let out = after("--out").map(PathBuf::from);
    let scoring = arguments.iter().any(|a| a == "--score");
    if let (true, Some(out)) = (scoring, &out) {
        cases.retain(|c| c.file_name().is_some_and(|name| out.join(name).join("diagnosis.json").exists()));
    }
    let one = |case: &PathBuf| Ok(diagnose(&Case::read(case)?, &options));
    let results: Vec<(String, Result<Diagnosis, CaseError>)> = cases
        .par_iter()
        .map(|case| {
            let name = case.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            let start = Instant::now();
            if scoring {
                return (name.clone(), out.as_ref().map_or_else(|| one(case), |out| Diagnosis::read(&out.join(&name))));
            }
            let result = one(case).and_then(|mut d| {
                d.secs = start.elapsed().as_secs_f64();
                unseen(&root, &name, &mut d)?;
                if let Some(out) = &out {
                    d.write(&out.join(&name))?;
                }
                Ok(d)
            });
            (name, result)
        })
        .collect();
    for (name, result) in &results {
        match result {
            Ok(diagnosis) => println!("{}", line(name, diagnosis, &labels[name])),
            Err(error) => println!("{name}: {error}"),
        }
    }
    scores(&results, &root);
    ExitCode::SUCCESS
}

/// Adds the shrink on the drives that lie apart under `unseen`, if there are any.
fn unseen(root: &Path, name: &str, diagnosis: &mut Diagnosis) -> Result<(), CaseError> {
    let folder = root.join("unseen").join(name);
    if folder.join("meta.json").exists() {
        diagnosis.how_far.extend(ds_dynamics::evaluate(diagnosis, &Case::read(&folder)?, &[]));
    }
    Ok(())
}

/// Prints, per labelled case, what thresholds from the other cases make of it.
fn left_out(root: &Path, options: &Options) -> ExitCode {
    let found = read_labels(&root.join("labels.json"))
        .and_then(|labels| Ok((ds_dynamics::leave_out::leave_one_out(root, &labels, options)?, labels)));
    let (found, labels) = match found {
        Ok(found) => found,
        Err(error) => {
            println!("{error}");
            return ExitCode::FAILURE;
        }
    };
    println!("| case | truth | verdict | chosen | p | single gain | temperature |\n|---|---|---|---|---|---|---|");
    for (name, (thresholds, d)) in &found {
        let truth: Vec<&str> = labels[name].effects.iter().map(|e| e.id.as_str()).collect();
        let (p, right) = confidence(d, &labels[name]);
        println!(
            "| {name} | {} {} | {:?} | {} | {p:.2}{} | {:.1} | {} |",
            labels[name].kind,
            truth.join(", "),
            d.verdict,
            d.chosen.join(", "),
            if right { "" } else { " (wrong)" },
            thresholds.single_gain,
            thresholds.temperature
        );
    }
    print_scores(&score(&found.into_iter().map(|(name, (_, d))| (name, d)).collect(), &labels));
    ExitCode::SUCCESS
}

/// Prints the figures of all labelled cases.
fn scores(results: &[(String, Result<Diagnosis, CaseError>)], root: &Path) {
    let Ok(labels) = read_labels(&root.join("labels.json")) else { return };
    let found = results.iter().filter_map(|(name, r)| r.as_ref().ok().map(|d| (name.clone(), d.clone()))).collect();
    let mut labels: BTreeMap<_, _> =
        labels.into_iter().filter(|(name, _)| results.iter().any(|(n, _)| n == name)).collect();
    for (name, label) in labels.iter_mut().filter(|(_, label)| label.kind == "single") {
        if let Ok(case) = Case::read(&root.join(name)) {
            label.effects.iter_mut().for_each(|e| e.floor_units = effect_size(&case, &e.id, e.value));
        }
    }
    // what no library contains has a size where the world wrote the same drives without it
    for (name, label) in labels.iter_mut().filter(|(_, label)| label.kind == "out_of_library") {
        if let Ok(Some([case, twin])) = with_twin(root, name) {
            let size = twin_size(&case, &twin);
            println!("{name}: {:.1} floor units", size.unwrap_or(f64::NAN));
            label.effects.iter_mut().for_each(|e| e.floor_units = size);
        }
    }
    print_scores(&score(&found, &labels));
}

fn print_scores(scores: &Scores) {
    for (name, share) in &scores.shares {
        if let Some(s) = share {
            println!(
                "{name:36} {:3} of {:3} = {:.2} [{:.2}, {:.2}]",
                s.hits, s.of, s.value, s.interval90[0], s.interval90[1]
            );
        }
    }
    println!(
        "Brier {:.3}, calibration error {:.3}, median relative error {:.3}, median |predicted - realised share| {:.3}",
        scores.brier, scores.calibration_error, scores.relative_error, scores.share_error
    );
}

fn line(name: &str, d: &Diagnosis, label: &serde_json::Value) -> String {
    let truth: Vec<String> = label["effects"]
        .as_array()
        .map(|list| list.iter().map(|e| format!("{} {}", e["id"].as_str().unwrap_or("?"), e["value"])).collect())
        .unwrap_or_default();
    let top: Vec<String> = d
        .effects
        .iter()
        .take(3)
        .map(|e| {
            format!(
                "{} {:.4} [{:.4}, {:.4}] p {:.3} gain {:.1} held {:.1}",
                e.id,
                e.value,
                e.interval90[0],
                e.interval90[1],
                e.probability,
                e.evidence_gain,
                e.heldout_gain.unwrap_or(f64::NAN)
            )
        })
        .collect();
    let shrink = d.how_far.iter().find(|s| s.metric == "position_2s");
    let share = shrink.map_or("-".to_owned(), |s| {
        format!(
            "{:.3}->{:.3} floor {:.3} share {:.2} (predicted {:.2})",
            s.before,
            s.after,
            s.floor,
            s.share_explained.unwrap_or(f64::NAN),
            d.predicted_share.unwrap_or(f64::NAN)
        )
    });
    format!(
        "{name} [{}] {:?} none {:.3} unknown {:.3} chosen {:?} {:.1} s\n    truth {truth:?}\n    {}\n    position_2s {share}; cells {}{}",
        label["kind"].as_str().unwrap_or("-"),
        d.verdict,
        d.p_none,
        d.p_unknown,
        d.chosen,
        d.secs,
        top.join("\n    "),
        d.cells.len(),
        d.unknown_description.as_ref().map(|u| format!("\n    {}", u.text)).unwrap_or_default(),
    )
}
