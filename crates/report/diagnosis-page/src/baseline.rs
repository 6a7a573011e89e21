//! A baseline in words for a terminal: what it was learned from, what it says of the vehicle, what it cannot tell.

use std::fmt::Write as _;

use ds_dynamics::baseline::Baseline;
use ds_effect::Parameter;

/// Parameters named: those farthest from what the library takes for usual.
const NAMED: usize = 5;

/// Returns the text.
pub(crate) fn text(baseline: &Baseline) -> String {
    let units = &baseline.units;
    let mut text = format!(
        "baseline of {} healthy logs or drives of {} vehicles on {} days: {}",
        units.drive.len(),
        units.vehicle.len(),
        units.day.len(),
        units.drive.join(", ")
    );
    let mut traits: Vec<(f64, String)> = Vec::new();
    for (id, all) in &baseline.spread {
        let (Some(effect), Some(Some(usual))) = (ds_effect::find(id), all.first()) else { continue };
        // A length is unlike those of cars of its size.
        let sized = |parameter: &Parameter| baseline.wheelbase_m.map_or(*parameter, |base_m| parameter.sized(base_m));
        let Some(library) = effect.parameters.first().and_then(|parameter| sized(parameter).nuisance) else { continue };
        let off = (usual.mean - library.mean) / library.sd;
        traits.push((off.abs(), format!("{id} {off:+.1}")));
    }
    traits.sort_by(|a, b| b.0.total_cmp(&a.0));
    let named: Vec<String> = traits.into_iter().take(NAMED).filter(|t| t.0 > 1.0).map(|t| t.1).collect();
    if !named.is_empty() {
        let _infallible = write!(text, "\nunlike the library's cars, in its standard deviations: {}", named.join(", "));
    }
    let noisy: Vec<String> = baseline
        .noise
        .iter()
        .filter_map(|(channel, table)| {
            let largest = table.iter().copied().fold(0.0, f64::max);
            (largest > 1.5).then(|| format!("{channel} {largest:.1}"))
        })
        .collect();
    if !noisy.is_empty() {
        let _infallible = write!(text, "\nresiduals beyond the library's floor, as a factor: {}", noisy.join(", "));
    }
    for (part, gain) in &baseline.detection_limits {
        let _infallible = write!(text, "\n{part}: an effect needs a log evidence of {gain:.1}");
    }
    for warning in &baseline.warnings {
        let _infallible = write!(text, "\n! {warning}");
    }
    text
}
