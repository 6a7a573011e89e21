//! A search of adversaries → the figures that lie beside its set, with the bars of the specification.

use std::collections::BTreeMap;

use ds_adverse::{Apart, Built, Refusal, Rejection, Variant, broken_rules};
use ds_benchmark::Entry;
use ds_benchmark::quality::{Figure, Severity};
use ds_stats::wilson;
use ds_world::{CrashClass, Scene};

use crate::adverse;

/// What came of one base scenario.
pub(crate) type Searched = Result<Built, Refusal>;

/// The normal quantile of a 95 % interval.
const NORMAL: f64 = 1.96;
/// A solution that misses the adversary by less is a narrow one.
const NARROW_SECS: f64 = 0.5 - 1e-9;

/// Returns how hard each variant of a search is, by name.
pub(crate) fn severities(found: &[(Scene, Searched)]) -> BTreeMap<String, Severity> {
    let variants = found.iter().filter_map(|(_, built)| built.as_ref().ok()).flat_map(|built| &built.variants);
    let one = |variant: &Variant| {
        let (measures, broken) = (&variant.measures, broken_rules(&variant.scene).unwrap_or_default());
        let severity = Severity {
            closing_mps: measures.met.closing_mps,
            delta_v_mps: measures.delta_v_mps,
            required_mps2: measures.required_mps2,
            least_ttc_secs: measures.least_ttc_secs(),
            margin_secs: variant.margin_ticks.map(|ticks| secs(variant, ticks)),
            post_encroachment_secs: missed_by_secs(variant),
            red_light: broken.red_light.is_some(),
            wrong_way_m: broken.wrong_way_m,
        };
        (variant.scene.name.clone(), severity)
    };
    variants.map(one).collect()
}

fn secs(variant: &Variant, ticks: u32) -> f64 {
    f64::from(ticks) * variant.scene.dt.secs()
}

/// Returns the post-encroachment time of the expert's drive; none without a drive or a place where both come.
fn missed_by_secs(variant: &Variant) -> Option<f64> {
    variant.solution.as_ref()?.post_encroachment_ticks.map(|ticks| secs(variant, ticks))
}

/// Returns the figures of a search; `entries` are those that the set took.
pub(crate) fn figures(found: &[(Scene, Searched)], entries: &[Entry]) -> Vec<Figure> {
    let built: Vec<&Built> = found.iter().filter_map(|(_, built)| built.as_ref().ok()).collect();
    let with = built.iter().filter(|built| !built.variants.is_empty()).count();
    let variants: Vec<&Variant> = built.iter().flat_map(|built| &built.variants).collect();
    let fallen = |reason: Rejection| -> usize {
        built
            .iter()
            .flat_map(|built| &built.rejected)
            .filter(|((_, why), _)| *why == reason)
            .map(|(_, count)| count)
            .sum()
    };
    let solved = variants.iter().filter(|variant| variant.solution.is_some()).count();
    let proven = fallen(Rejection::Unavoidable);
    let meet = variants.len() + proven + fallen(Rejection::Unsolved);
    let careful = variants.iter().filter(|variant| variant.careful).count();
    let narrow =
        variants.iter().filter(|variant| missed_by_secs(variant).is_some_and(|secs| secs < NARROW_SECS)).count();
    let mut figures = vec![
        // Where the ego stands, or the log is too short to be searched, no variant is missing.
        share("bases with a moving ego that have a variant", with, built.len(), Some(0.77), None),
        share(
            "candidates of the intended class, of those that meet the ego",
            meet,
            meet + fallen(Rejection::Class),
            Some(0.9),
            None,
        ),
        share("candidates that an expert solves, of those that meet as intended", solved, meet, Some(0.6), None),
        share("candidates that are proven unavoidable, of those that meet as intended", proven, meet, None, None),
        share("variants that an expert solves", solved, variants.len(), Some(1.0), None),
        share("solutions that miss the adversary by less than 0.5 s where both come", narrow, solved, None, None),
        share("variants that a driver who only brakes survives", careful, variants.len(), Some(0.5), Some(0.95)),
    ];
    figures.extend(classes(entries));
    figures.extend(compared(found));
    figures
}

fn share(what: &str, hits: usize, of: usize, least: Option<f64>, most: Option<f64>) -> Figure {
    let there = of > 0;
    Figure {
        what: what.to_owned(),
        value: there.then(|| hits as f64 / of as f64),
        interval: there.then(|| wilson(hits, of, NORMAL)),
        least,
        most,
    }
}

/// Returns the share of each class in the set, and their entropy over that of equal shares.
fn classes(entries: &[Entry]) -> Vec<Figure> {
    let mut counts: BTreeMap<&str, usize> = CrashClass::ALL.map(|class| (class.name(), 0)).into();
    entries.iter().for_each(|entry| *counts.entry(&entry.category).or_default() += 1);
    let of_class = |(class, count): (&&str, &usize)| {
        share(&format!("entries of class {class}"), *count, entries.len(), Some(0.08), None)
    };
    let mut figures: Vec<Figure> = counts.iter().map(of_class).collect();
    let part = |count: &usize| {
        let share = *count as f64 / entries.len().max(1) as f64;
        if share > 0.0 { -share * share.ln() } else { 0.0 }
    };
    let entropy = counts.values().map(part).sum::<f64>() / (counts.len() as f64).ln();
    figures.push(figure("entropy of the classes, of that of equal shares", Some(entropy), Some(0.85), None));
    figures
}

fn figure(what: &str, value: Option<f64>, least: Option<f64>, most: Option<f64>) -> Figure {
    Figure { what: what.to_owned(), value, least, most, ..Figure::default() }
}

/// Returns how adversaries compare with the logged vehicles of their scenarios.
fn compared(found: &[(Scene, Searched)]) -> Vec<Figure> {
    let quality = adverse::compared(found);
    let ratio = |apart: Apart| apart.divergence_nats / apart.floor_nats;
    let mut figures = Vec::new();
    for it in &quality.resemblances {
        let name = it.quantity;
        figures.push(figure(
            &format!("{name}: divergence before the attack ÷ floor"),
            it.before.map(ratio),
            None,
            Some(1.5),
        ));
        figures.push(figure(
            &format!("{name}: divergence in the attack ÷ floor"),
            it.attack.map(ratio),
            None,
            Some(3.0),
        ));
        let outside = it.attack.map(|apart| apart.outside);
        figures.push(figure(
            &format!("{name}: share of the attack outside logged 0.1–99.9 %"),
            outside,
            None,
            Some(0.05),
        ));
    }
    figures.push(Figure {
        interval: quality.telling.map(|telling| telling.interval),
        ..figure("area under the curve of telling them", quality.telling.map(|telling| telling.area), None, Some(0.8))
    });
    let spread = quality.spread;
    figures.push(figure("starts of one base's variants apart, m (median)", spread.starts_apart_m, Some(10.0), None));
    figures.push(figure("eighths around the ego at the start", Some(spread.start_sectors as f64), None, None));
    figures.push(figure("eighths around the ego at the contact", Some(spread.contact_sectors as f64), Some(6.0), None));
    figures
}
