//! What is unknown where no baseline tells what is usual: the remainder of a vehicle of another family, or structure that no
//! such vehicle has?
//!
//! The model is fitted again with every usual spread times the factor that the drives ask for. What then still remains is
//! compared with what effect-free vehicles of other authors' engines leave; only more than almost all of them leave counts
//! as structure. Whatever is below asks for healthy drives: a constant fault and a trait of another family look alike.

use crate::case::{Case, PartModel};
use crate::choice::Outcome;
use crate::fit::{Fit, FitOptions, fit};
use crate::remainder::left;
use crate::settings::{STRUCTURE_RATIO, STRUCTURE_WIDTH};
use crate::space::Part;

/// Factors on the library's spreads, each half as likely as the one before.
const FACTORS: [f64; 4] = [1.0, 2.0, 4.0, 8.0];

/// Returns the probability that the remainder is structure and no trait of a foreign vehicle.
#[must_use]
pub fn structure(case: &Case, outcomes: &[Outcome<'_, '_>], drives: &[usize], without: &[String]) -> f64 {
    let of = |(part, outcome): (Part, &Outcome<'_, '_>)| remaining(case, part, outcome, drives, without);
    let largest = [Part::Ego, Part::Following].into_iter().zip(outcomes).map(of).fold(0.0, f64::max);
    1.0 / (1.0 + (-(largest.max(1e-9).ln() - STRUCTURE_RATIO.ln()) / STRUCTURE_WIDTH).exp())
}

/// Returns how many times the clean level is left by the fit with the spreads that a part's drives ask for.
fn remaining(case: &Case, part: Part, outcome: &Outcome<'_, '_>, drives: &[usize], without: &[String]) -> f64 {
    let effects = outcome.accepted.as_ref().map(|h| h.effects.clone()).unwrap_or_default();
    let wide = |(k, factor): (usize, &f64)| -> (f64, PartModel<'_>, Fit) {
        let mut model = PartModel::new(case, part, drives, without);
        for coordinate in &mut model.space.coordinates {
            coordinate.nuisance.iter_mut().for_each(|n| n.sd *= factor);
        }
        let priors = model.priors_with(&effects);
        let columns = vec![None; priors.len()];
        let start = &outcome.fit().vector;
        let plan = FitOptions { priors: &priors, start, columns, fresh: (0..priors.len()).collect(), iterations: 3 };
        let found = fit(&model, plan);
        (found.evidence - k as f64 * std::f64::consts::LN_2, model, found)
    };
    let best = FACTORS.iter().enumerate().map(wide).max_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or(0.0, |(_, model, fit)| left(&model, &fit, &fit, !effects.is_empty()).ratio)
}
