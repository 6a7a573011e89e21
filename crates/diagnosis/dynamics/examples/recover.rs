//! Makes one synthetic case per effect of the library and prints what the diagnosis says of it.
//!
//! `cargo run -p ds-dynamics --example recover -- DIR [EFFECT…]`
#![allow(clippy::print_stdout, reason = "the table is this example's answer")]

use ds_dynamics::case::Case;
use ds_dynamics::{Options, diagnose, synthetic};
use ds_effect::Scale;
use rayon::prelude::*;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let root = std::path::PathBuf::from(arguments.first().cloned().unwrap_or_else(|| "recover".to_owned()));
    let wanted: Vec<_> = ds_effect::library()
        .iter()
        .filter(|e| {
            e.suspect && !e.channels.is_empty() && (arguments.len() < 2 || arguments[1..].contains(&e.id.to_owned()))
        })
        .collect();
    let lines: Vec<String> = wanted
        .par_iter()
        .map(|effect| {
            let p = &effect.parameters[0];
            let at = match p.scale {
                Scale::Limit => 0.35,
                _ if p.slab.0 < p.neutral => 0.75,
                _ => 0.3,
            };
            let value = p.reported(p.slab.0 + at * p.width(), 1500.0);
            let neutral: Vec<f64> = effect.parameters.iter().map(|p| p.reported(p.neutral, 1500.0)).collect();
            let mut values = neutral;
            values[0] = value;
            let folder = root.join(effect.id);
            let made = synthetic::write_case(&folder, 7, &|plant| (effect.apply)(&values, plant));
            let options = Options { quick: true, ..Options::default() };
            match made.and_then(|()| Ok(diagnose(&Case::read(&folder)?, &options))) {
                Ok(d) => {
                    let top: Vec<String> = d
                        .effects
                        .iter()
                        .take(3)
                        .map(|e| format!("{} {:.4} ({:.1})", e.id, e.value, e.evidence_gain))
                        .collect();
                    let right = if d.chosen == [effect.id] { "ok " } else { "BAD" };
                    format!(
                        "{right} {:18} {value:.4} {:?} {:?} unknown {:.2}: {}",
                        effect.id,
                        d.verdict,
                        d.chosen,
                        d.p_unknown,
                        top.join(", ")
                    )
                }
                Err(error) => format!("BAD {}: {error}", effect.id),
            }
        })
        .collect();
    for line in lines {
        println!("{line}");
    }
}
