//! Draws labelled cases of recorded traffic from the own simulator, diagnoses them blind, and prints how often it was
//! right, with Wilson intervals.
//!
//! `traffic-practice OUT --seed N [--each 5] [--none 10] [--only EFFECT] [--keep]`; also `--case DIR` diagnoses one case.
#![allow(clippy::print_stdout, reason = "the table is this command's answer")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ds_diagnosis::Verdict;
use ds_diagnosis::schema::Diagnosis;
use ds_effect::{Effect, Insertion, Parameter, Setting, library};
use ds_space::Draws;
use ds_traffic::{Case, Options, diagnose, synthetic};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let after = |flag: &str| arguments.iter().position(|a| a == flag).and_then(|k| arguments.get(k + 1)).cloned();
    let number = |flag: &str, usual: u64| after(flag).and_then(|text| text.parse().ok()).unwrap_or(usual);
    if let Some(case) = after("--case") {
        return one(Path::new(&case));
    }
    let Some(out) = arguments.first().filter(|a| !a.starts_with("--")).map(PathBuf::from) else {
        println!("usage: traffic-practice OUT --seed N [--each 5] [--none 10] [--only EFFECT] | --case DIR");
        return ExitCode::from(64);
    };
    let seed = number("--seed", 1);
    let mut score = Score::default();
    for (index, (effect, values)) in draw(seed, number("--each", 5), number("--none", 10)).into_iter().enumerate() {
        let id = effect.map_or("none", |effect| effect.id);
        if after("--only").is_some_and(|only| !only.split(',').any(|wanted| wanted == id)) {
            continue;
        }
        let folder = out.join(format!("{index:03}"));
        let settings: Vec<Setting> = effect.into_iter().filter_map(|e| Setting::new(e.id, &values).ok()).collect();
        if let Err(error) = synthetic::write_case(&folder, seed * 1000 + index as u64, &settings) {
            println!("{index:03} {id}: {error}: {error:?}");
            return ExitCode::FAILURE;
        }
        match Case::read(&folder).and_then(|case| diagnose(&case, &Options::default())) {
            Ok(diagnosis) => score.add(index, effect, &values, &diagnosis),
            Err(error) => println!("{index:03} {id}: {error}"),
        }
    }
    score.print();
    ExitCode::SUCCESS
}

fn one(case: &Path) -> ExitCode {
    match Case::read(case).and_then(|case| diagnose(&case, &Options::default())) {
        Ok(diagnosis) => {
            println!("{}", serde_json::to_string_pretty(&diagnosis).unwrap_or_default());
            ExitCode::SUCCESS
        }
        Err(error) => {
            println!("{error}");
            ExitCode::FAILURE
        }
    }
}

/// Draws effects with their values: `each` of every effect on agents or the map, and cases without.
fn draw(seed: u64, each: u64, none: u64) -> Vec<(Option<&'static Effect>, Vec<f64>)> {
    let draws = Draws::from_seed(seed, "withheld effects on traffic");
    let ours = |e: &&&'static Effect| e.suspect && matches!(e.insertion, Insertion::Agent | Insertion::Map);
    let mut cases = Vec::new();
    let mut index = 0;
    // Round by round, so that the first part of a draw is a whole one.
    for round in 0..each {
        for effect in library().iter().filter(ours) {
            let values = effect.parameters.iter().map(|parameter| {
                index += 1;
                parameter.reported(search_value(parameter, draws.uniform(index)), 1.0)
            });
            cases.push((Some(*effect), values.collect()));
        }
        let without = none * (round + 1) / each - none * round / each;
        cases.extend((0..without).map(|_| (None, Vec::new())));
    }
    cases
}

/// Returns a value away from neutral by at least a third of the way to the end of the searched range.
fn search_value(parameter: &Parameter, u: f64) -> f64 {
    let (low, high) = parameter.slab;
    if high <= low {
        return high;
    }
    let both = parameter.neutral > low + 1e-9 && parameter.neutral < high - 1e-9;
    let (side, v) = match (both, u < 0.5) {
        (true, true) => (low, 2.0 * u),
        (true, false) => (high, 2.0 * u - 1.0),
        (false, _) if parameter.neutral >= high => (low, u),
        (false, _) => (high, u),
    };
    parameter.neutral + (0.35 + 0.65 * v) * (side - parameter.neutral)
}

#[derive(Default)]
struct Score {
    /// By effect: first, in the group, strictly right, interval covers, cases.
    counts: BTreeMap<String, [u64; 5]>,
    errors: Vec<f64>,
    shares: Vec<(f64, f64)>,
}

impl Score {
    fn add(&mut self, index: usize, effect: Option<&Effect>, values: &[f64], diagnosis: &Diagnosis) {
        let id = effect.map_or("none", |effect| effect.id);
        let counts = self.counts.entry(id.to_owned()).or_default();
        counts[4] += 1;
        let first = diagnosis.effects.first();
        let strict = match effect {
            None => diagnosis.verdict == Verdict::None,
            Some(effect) => diagnosis.verdict == Verdict::Single && diagnosis.chosen == [effect.id],
        };
        counts[2] += u64::from(strict);
        if let (Some(effect), Some(first)) = (effect, first) {
            counts[0] += u64::from(first.id == effect.id);
            counts[1] += u64::from(first.group.iter().any(|member| member == effect.id));
            if first.id == effect.id {
                let [low, high] = first.interval90;
                counts[3] += u64::from(low <= values[0] && values[0] <= high);
                self.errors.push(((first.value - values[0]) / values[0].abs().max(1e-3)).abs());
            }
        }
        let share = diagnosis.how_far.iter().find(|shrink| shrink.metric == "position_2s");
        let realised = share.filter(|_| strict && effect.is_some()).and_then(|share| share.share_explained);
        self.shares.extend(diagnosis.predicted_share.zip(realised));
        let told: Vec<String> = diagnosis.effects.iter().take(3).map(tell).collect();
        println!(
            "{index:03} {id} {values:.2?} → {:?} {:?} | {} | none {:.2} unknown {:.2} | {:.2} → {:?}",
            diagnosis.verdict,
            diagnosis.chosen,
            told.join(", "),
            diagnosis.p_none,
            diagnosis.p_unknown,
            diagnosis.predicted_share.unwrap_or(f64::NAN),
            share.map(|share| (share.before, share.after)),
        );
    }

    fn print(&self) {
        println!("\n| effect | first | in the group of the first | verdict and choice right | 90 % interval covers |");
        println!("|---|---|---|---|---|");
        let mut singles = [0; 5];
        for (id, counts) in &self.counts {
            if id != "none" {
                singles.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
            }
            println!("| {id} | {} |", (0..4).map(|k| cell(counts, k)).collect::<Vec<_>>().join(" | "));
        }
        println!("| all singles | {} |", (0..4).map(|k| cell(&singles, k)).collect::<Vec<_>>().join(" | "));
        let median = |mut values: Vec<f64>| ds_stats::upper_median(&mut values).unwrap_or(f64::NAN);
        let off = self.shares.iter().map(|(predicted, realised)| (predicted - realised).abs()).collect();
        println!(
            "median relative error {:.3}, median |predicted − realised share| {:.3} over {}",
            median(self.errors.clone()),
            median(off),
            self.shares.len()
        );
    }
}

fn tell(finding: &ds_diagnosis::schema::Finding) -> String {
    let [low, high] = finding.interval90;
    format!(
        "{} {:.2} [{low:.2}, {high:.2}] p {:.2} g {:.1}",
        finding.id, finding.value, finding.probability, finding.evidence_gain
    )
}

/// Returns a count with its 95 % Wilson interval.
fn cell(counts: &[u64; 5], which: usize) -> String {
    let of = if which == 3 { counts[0] } else { counts[4] };
    if of == 0 {
        return "–".to_owned();
    }
    let (n, p, z) = (of as f64, counts[which] as f64 / of as f64, 1.96_f64);
    let middle = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
    let half = z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt() / (1.0 + z * z / n);
    format!("{} of {of} [{:.2}, {:.2}]", counts[which], middle - half, middle + half)
}
