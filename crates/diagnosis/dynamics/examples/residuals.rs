//! Prints, per case and channel, the root mean square of what the nuisance fit leaves, in floor units, and the ratio to
//! the clean level; the figures by which worlds are compared.
//!
//! `cargo run -p ds-dynamics --example residuals -- CASES_DIR`
#![allow(clippy::print_stdout, reason = "the table is this example's answer")]

use std::collections::BTreeMap;

use ds_dynamics::case::{Case, PartModel};
use ds_dynamics::fit::point_loss;
use ds_dynamics::search::null_fit;
use ds_dynamics::space::Part;
use rayon::prelude::*;

fn main() {
    let root = std::env::args().nth(1).unwrap_or_default();
    let mut cases: Vec<_> = std::fs::read_dir(&root)
        .map(|entries| {
            entries.filter_map(|e| e.ok().map(|e| e.path())).filter(|p| p.join("meta.json").exists()).collect()
        })
        .unwrap_or_default();
    cases.sort();
    let lines: Vec<String> = cases.par_iter().map(|folder| line(folder)).collect();
    for line in lines {
        println!("{line}");
    }
}

fn line(folder: &std::path::Path) -> String {
    let case = match Case::read(folder) {
        Ok(case) => case,
        Err(error) => return format!("{}: {error}", folder.display()),
    };
    let mut text = folder.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    text += &format!(" noise {:.2?} {:.2?}", case.noise.ego, case.noise.follower);
    for part in [Part::Ego, Part::Following] {
        let model = PartModel::new(&case, part, &[0, 1, 2], &[]);
        if model.is_empty() {
            continue;
        }
        let fit = null_fit(&model, None);
        let mut sums: BTreeMap<&str, (f64, f64, f64)> = BTreeMap::new();
        for (tag, z) in model.tags.iter().zip(&fit.residuals).filter(|(_, z)| **z != 0.0) {
            let sum = sums.entry(tag.channel.name()).or_default();
            sum.0 += z * z;
            sum.1 += point_loss(*z);
            sum.2 += 1.0;
        }
        for (channel, (square, loss, count)) in sums {
            text += &format!(" {channel} {:.2}/{:.2}", (square / count).sqrt(), loss / count);
        }
        if std::env::args().any(|a| a == "--nuisances") {
            for (i, &k) in fit.free.iter().enumerate() {
                let c = model.space.coordinates[k];
                let z = c.nuisance.map_or(0.0, |n| (fit.vector[k] - n.mean) / n.sd);
                text += &format!(
                    "\n    {} {:.4} sd {:.4} z {z:.1}",
                    model.space.effects[c.effect].id,
                    fit.vector[k],
                    fit.covariance[(i, i)].sqrt()
                );
            }
        }
    }
    text
}
