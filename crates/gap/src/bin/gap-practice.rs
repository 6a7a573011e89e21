//! Diagnoses many cases.
#![allow(clippy::print_stdout)]
use ds_effect::Channel;
use ds_gap::case::*;
use ds_gap::fit::*;
use ds_gap::search::*;
use ds_gap::space::Part;
fn main() {
    let root = std::env::args().nth(1).unwrap_or_default();
    let labels: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(format!("{root}/labels.json")).expect("labels")).expect("json");
    for (name, label) in labels.as_object().expect("object") {
        if let Some(w) = std::env::args().nth(2) {
            if !name.contains(&w) {
                continue;
            }
        }
        let case = Case::read(&std::path::Path::new(&root).join(name)).expect("case");
        println!("=== {name} {}", label["effects"]);
        println!("  {:?}", case.scatter);
        for part in [Part::Ego, Part::Following] {
            let t = std::time::Instant::now();
            let model = PartModel::new(&case, part, &[0, 1, 2], &[]);
            let s = Search::run(&model, Effort::Quick);
            let quick = t.elapsed();
            let line = |h: &Hypothesis| {
                h.effects
                    .iter()
                    .map(|&e| {
                        let k = model.space.of(e)[0];
                        let i = h.fit.free.iter().position(|f| *f == k);
                        format!(
                            "{} {:.4} ({:.4}){}",
                            model.space.effects[e].id,
                            model.space.reported(k, h.fit.vector[k]),
                            i.map_or(0.0, |i| h.fit.covariance[(i, i)].sqrt()),
                            if s.outside(h, e) { "" } else { "-" }
                        )
                    })
                    .collect::<Vec<_>>()
                    .join(" + ")
            };
            println!("  {part:?} null loss {:.1} ev {:.1} in {quick:?}", s.null.data_loss, s.null.evidence);
            for h in s.singles.iter().take(4) {
                println!(
                    "     {:8.2}  {} heldout {:?}",
                    h.gain,
                    line(h),
                    held_out_gains(&model, &s.null, h, &[0, 1, 2])
                        .iter()
                        .map(|g| (g * 10.).round() / 10.)
                        .collect::<Vec<_>>()
                );
            }
            let mut best_fit = s.null.clone();
            if let Some(first) = s.singles.first() {
                if first.gain > 0.0 {
                    best_fit = first.fit.clone();
                }
                if first.gain > 3.0 {
                    if let Some(p) = s.extend(first) {
                        println!(
                            "     pair {:8.2} (+{:.2}) {} heldout {:?}",
                            p.gain,
                            p.gain - first.gain,
                            line(&p),
                            held_out_gains(&model, &first.fit, &p, &[0, 1, 2])
                        );
                    }
                }
            }
            let mut out = String::new();
            for c in Channel::ALL {
                let v: Vec<f64> = model
                    .tags
                    .iter()
                    .zip(&best_fit.residuals)
                    .filter(|(t, _)| t.channel == c)
                    .map(|(_, z)| *z)
                    .collect();
                if v.is_empty() || v.iter().all(|z| *z == 0.0) {
                    continue;
                }
                let m = v.iter().map(|z| point_loss(*z)).sum::<f64>() / v.len() as f64;
                let nb = if part == Part::Ego { 8 } else { 10 };
                let mut w: Vec<f64> =
                    v.chunks(nb).map(|c| c.iter().map(|z| point_loss(*z)).sum::<f64>() / nb as f64).collect();
                w.sort_by(|a, b| b.total_cmp(a));
                out += &format!("{} {:.2}/{:.1} ", c.name(), m, w[0]);
            }
            println!("     rest total {:.1}: {out}", best_fit.data_loss);
        }
    }
}
