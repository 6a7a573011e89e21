//! Diagnoses many cases.
#![allow(clippy::print_stdout)]
use ds_effect::Channel;
use ds_gap::case::*;
use ds_gap::fit::*;
use ds_gap::space::Part;
fn main() {
    let dir = std::env::args().nth(1).unwrap_or_default();
    let free = std::env::args().nth(2).unwrap_or_default();
    let case = Case::read(std::path::Path::new(&dir)).expect("case");
    for part in [Part::Ego, Part::Following] {
        let model = PartModel::new(&case, part, &[0, 1, 2], &[]);
        let t = std::time::Instant::now();
        let r = model.residuals(&model.space.usual());
        println!("{part:?} residuals {} in {:?} loss {}", r.len(), t.elapsed(), data_loss(&r));
        let eff: Vec<usize> = free.split(',').filter_map(|id| model.space.find(id)).collect();
        let priors = model.priors_with(&eff);
        let mut start = model.space.usual();
        for e in &eff {
            for k in model.space.of(*e) {
                start[k] = model.space.grid(k)[1];
            }
        }
        let t = std::time::Instant::now();
        let n = priors.len();
        let f = fit(
            &model,
            Plan { priors: &priors, start: &start, columns: vec![None; n], fresh: (0..n).collect(), iterations: 4 },
        );
        println!("fit {:?} loss {} evidence {}", t.elapsed(), f.data_loss, f.evidence);
        for (i, &k) in f.free.iter().enumerate() {
            let p = model.space.coordinates[k];
            println!(
                "  {:18} {:8.4} sd {:.4} z {:6.2}",
                model.space.effects[p.effect].id,
                f.vector[k],
                f.covariance[(i, i)].sqrt(),
                p.parameter.nuisance.map_or(0.0, |q| (f.vector[k] - q.mean) / q.sd)
            );
        }
        if part == Part::Ego {
            let nw = model.tags.last().unwrap().window + 1;
            let mut ws: Vec<(f64, usize)> = (0..nw)
                .map(|w| (f.residuals[w * 72..w * 72 + 72].iter().map(|z| point_loss(*z)).sum::<f64>(), w))
                .collect();
            ws.sort_by(|a, b| b.0.total_cmp(&a.0));
            for (l, w) in ws.iter().take(10) {
                let t = model.tags[w * 72];
                let a = case
                    .ego
                    .iter()
                    .find(|e| e.drive == t.drive)
                    .unwrap()
                    .anchors
                    .iter()
                    .find(|a| a.secs == t.secs)
                    .unwrap()
                    .regime;
                println!(
                    "   worst {l:.1} drive {} t {:.2} v {:.1} a {:.2} ay {:.2} sr {:.3} yr {:?} dyaw {:?} ay {:?}",
                    t.drive,
                    t.secs,
                    a.speed_mps,
                    a.accel_mps2,
                    a.lateral_mps2,
                    a.steer_rate,
                    f.residuals[w * 72 + 32..w * 72 + 40].iter().map(|z| (z * 10.).round() / 10.).collect::<Vec<_>>(),
                    f.residuals[w * 72 + 16..w * 72 + 24].iter().map(|z| (z * 10.).round() / 10.).collect::<Vec<_>>(),
                    f.residuals[w * 72 + 48..w * 72 + 56].iter().map(|z| (z * 10.).round() / 10.).collect::<Vec<_>>()
                );
            }
        }
        for d in 0..3 {
            for c in Channel::ALL {
                let line: Vec<String> = (0..10)
                    .filter_map(|b| {
                        let mut v: Vec<f64> = model
                            .tags
                            .iter()
                            .zip(&f.residuals)
                            .filter(|(t, _)| t.channel == c && t.block == b && t.drive == d)
                            .map(|(_, z)| z.abs())
                            .collect();
                        if v.is_empty() {
                            return None;
                        }
                        v.sort_by(f64::total_cmp);
                        let rms = (v.iter().map(|z| z * z).sum::<f64>() / v.len() as f64).sqrt();
                        Some(format!("{:5.2}/{:5.2}", v[(v.len() as f64 * 0.683) as usize], rms))
                    })
                    .collect();
                if !line.is_empty() {
                    println!("{d} {:10} {}", c.name(), line.join(" "));
                }
            }
        }
    }
}
