//! Diagnoses many pairs of frame streams: writes `DIR/<case>/diagnosis.json`, prints one line per case beside its label,
//! and the figures of all labelled cases.
//!
//! `frames-practice CASES_DIR [--out DIR] [--only NAME] [--nuisance DIR]`; cases run in parallel (RAYON_NUM_THREADS=1
//! for times).
#![allow(clippy::print_stdout, reason = "the table is this command's answer")]

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use ds_diagnosis::meta::Kind;
use ds_diagnosis::score::Share;
use ds_diagnosis::{Diagnosis, Verdict};
use ds_frames::{FramesError, Nuisance, Options, Streams};
use rayon::prelude::*;
use serde_json::Value;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let after = |flag: &str| arguments.iter().position(|a| a == flag).and_then(|k| arguments.get(k + 1)).cloned();
    let Some(root) = arguments.first().filter(|a| !a.starts_with("--")).map(PathBuf::from) else {
        println!("usage: frames-practice CASES_DIR [--out DIR] [--only NAME] [--without EFFECT] [--nuisance DIR]");
        return ExitCode::from(64);
    };
    let labels: Value = std::fs::read_to_string(root.join("labels.json"))
        .ok()
        .and_then(|text| serde_json::from_str(&text).ok())
        .unwrap_or_default();
    let mut cases: Vec<PathBuf> = std::fs::read_dir(&root)
        .map(|entries| {
            entries.filter_map(|e| e.ok().map(|e| e.path())).filter(|p| Kind::of(p) == Kind::Frames).collect()
        })
        .unwrap_or_default();
    cases.sort();
    if let Some(only) = after("--only") {
        cases.retain(|c| c.to_string_lossy().contains(&only));
    }
    let nuisance = match after("--nuisance").map(|folder| Nuisance::learn(Path::new(&folder))).transpose() {
        Ok(learned) => learned,
        Err(error) => {
            println!("{error}");
            return ExitCode::FAILURE;
        }
    };
    let without = after("--without").map(|w| w.split(',').map(str::to_owned).collect()).unwrap_or_default();
    let options = Options { without, nuisance };
    let results: Vec<(String, Result<Diagnosis, FramesError>)> = cases
        .par_iter()
        .map(|case| {
            let start = Instant::now();
            let name = case.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            let result = Streams::read(case).and_then(|case| case.diagnose(&options)).map(|mut d| {
                d.secs = start.elapsed().as_secs_f64();
                d
            });
            if let Ok(d) = &result {
                println!("{}", line(&name, d, &labels[&name]));
            }
            (name, result)
        })
        .collect();
    let mut counts = Counts::default();
    for (name, result) in &results {
        match result {
            Ok(diagnosis) => {
                if labels[name].is_object() {
                    counts.add(diagnosis, &labels[name]);
                }
                if let Some(out) = after("--out")
                    && let Err(error) = diagnosis.write(&Path::new(&out).join(name))
                {
                    println!("{name}: {error}");
                    return ExitCode::FAILURE;
                }
            }
            Err(error) => println!("{name}: {error}"),
        }
    }
    counts.print();
    ExitCode::SUCCESS
}

/// Figures of all labelled cases, each a list of hits.
#[derive(Default)]
struct Counts {
    rows: std::collections::BTreeMap<&'static str, Vec<bool>>,
    overlap: Vec<f64>,
    secs: Vec<f64>,
    relative: Vec<f64>,
    share_error: Vec<f64>,
}

impl Counts {
    fn add(&mut self, d: &Diagnosis, label: &Value) {
        let truth: Vec<&str> =
            label["effects"].as_array().into_iter().flatten().filter_map(|e| e["id"].as_str()).collect();
        let kind = label["kind"].as_str().unwrap_or_default();
        let mut push = |name, hit| self.rows.entry(name).or_default().push(hit);
        let unknown = d.verdict == Verdict::Unknown;
        match kind {
            "none" => push("none: false alarms", d.verdict != Verdict::None),
            "single" if label["weak"] == true => {
                push(
                    "weak: first effect or none",
                    d.effects.first().is_some_and(|e| e.id == truth[0]) || d.chosen.is_empty(),
                );
                push("weak: found", d.chosen == truth);
            }
            "single" => {
                let first = d.effects.first().is_some_and(|e| e.id == truth[0]);
                if above_its_limit(d, &label["effects"][0]) {
                    push("singles: above their limit, first effect", first);
                }
                let untestable = d.detection_limits.iter().any(|l| l.id == truth[0] && l.limit.is_none());
                if !d.detection_limits.is_empty() {
                    let silent = d.chosen.is_empty() && !unknown;
                    push(
                        "singles: found, or none said where not testable",
                        if untestable { silent } else { d.chosen == truth },
                    );
                    push("singles: said to be testable", !untestable);
                    if !untestable {
                        push("singles: testable, first effect", first);
                    }
                }
                if label["stripped"].as_array().is_some_and(|s| !s.is_empty()) {
                    push("stripped: first effect", first);
                } else {
                    push("singles: first effect", first);
                    push(
                        "singles: in the first group",
                        d.effects.first().is_some_and(|e| e.group.iter().any(|g| g == truth[0])),
                    );
                    push("singles: strict", d.verdict == Verdict::Single && d.chosen == truth);
                }
            }
            "double" => {
                push("pairs: both", truth.iter().all(|t| d.chosen.iter().any(|c| c == t)));
                push("pairs: one at least", truth.iter().any(|t| d.chosen.iter().any(|c| c == t)));
            }
            _ => push("out of library: unknown", unknown),
        }
        let mut push = |name, hit| self.rows.entry(name).or_default().push(hit);
        for effect in label["effects"].as_array().into_iter().flatten() {
            if let (Some(found), Some(value)) =
                (d.effects.iter().find(|e| effect["id"] == *e.id), effect["value"].as_f64())
                && d.chosen.contains(&found.id)
            {
                push("intervals of chosen effects cover", found.interval90[0] <= value && value <= found.interval90[1]);
                self.relative.push((found.value - value).abs() / value.abs().max(1e-9));
            }
        }
        if kind != "out_of_library" {
            push("known or none called unknown", unknown);
        }
        let tiles: Vec<Vec<u64>> = serde_json::from_value(label["tiles"].clone()).unwrap_or_default();
        if kind != "none" && !tiles.is_empty() {
            let said: Vec<Vec<u64>> =
                d.cells.iter().filter_map(|c| c.regime.tile.map(|t| t.map(|v| v as u64).to_vec())).collect();
            let both = said.iter().filter(|t| tiles.contains(t)).count();
            self.overlap.push(both as f64 / (said.len() + tiles.len() - both) as f64);
        }
        if let Some(s) = d.how_far.first().filter(|s| s.before > 1.2 * s.floor) {
            self.share_error.extend(s.share_explained.zip(d.predicted_share).map(|(a, b)| (a - b).abs()));
        }
        self.secs.push(d.secs);
    }

    fn print(&self) {
        for (name, hits) in &self.rows {
            let s = Share::new(hits.iter().filter(|h| **h).count(), hits.len());
            println!(
                "{name:30} {:3} of {:3} = {:.2} [{:.2}, {:.2}]",
                s.hits, s.of, s.value, s.interval90[0], s.interval90[1]
            );
        }
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
        let median = |v: &[f64]| ds_stats::quantile(&mut v.to_vec(), 0.5);
        println!(
            "tiles IoU mean {:.2} median {:.2}; time mean {:.2} s; relative error median {:.3}; |predicted - realised share| median {:.3}",
            mean(&self.overlap),
            median(&self.overlap),
            mean(&self.secs),
            median(&self.relative),
            median(&self.share_error)
        );
    }
}

/// Tells whether an injected effect is at least as large as the diagnosis says that it must be to be found.
fn above_its_limit(d: &Diagnosis, injected: &Value) -> bool {
    let limit = d.detection_limits.iter().find(|l| injected["id"] == *l.id).and_then(|l| l.limit);
    let neutral = injected["id"].as_str().and_then(ds_effect::find_frame).map_or(0.0, |effect| effect.neutral()[0]);
    let value = injected["value"].as_f64().unwrap_or(neutral);
    limit.is_some_and(|limit| (value - neutral).abs() >= (limit - neutral).abs())
}

fn line(name: &str, d: &Diagnosis, label: &Value) -> String {
    let truth: Vec<String> = label["effects"]
        .as_array()
        .map(|list| list.iter().map(|e| format!("{} {}", e["id"].as_str().unwrap_or("?"), e["params"])).collect())
        .unwrap_or_default();
    let top: Vec<String> = d
        .effects
        .iter()
        .take(4)
        .map(|e| {
            format!(
                "{} {:.4} [{:.4}, {:.4}] p {:.2} gain {:.0}",
                e.id, e.value, e.interval90[0], e.interval90[1], e.probability, e.evidence_gain
            )
        })
        .collect();
    let above = label["effects"].get(0).filter(|e| above_its_limit(d, e)).map_or("", |_| ", above its limit");
    let far = d.how_far.first().map_or("-".to_owned(), |s| {
        format!(
            "{:.2}->{:.2} floor {:.2} share {:.2} (predicted {:.2})",
            s.before,
            s.after,
            s.floor,
            s.share_explained.unwrap_or(f64::NAN),
            d.predicted_share.unwrap_or(f64::NAN)
        )
    });
    format!(
        "{name} {:?} none {:.2} unknown {:.2} {:?} {:.2} s\n    truth {truth:?}{above}\n    {}\n    rmse {far}; tiles {}{}",
        d.verdict,
        d.p_none,
        d.p_unknown,
        d.chosen,
        d.secs,
        top.join("; "),
        d.cells.len(),
        d.unknown_description.as_ref().map(|u| format!("\n    {}", u.text)).unwrap_or_default(),
    )
}
