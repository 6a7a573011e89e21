//! Applies a frozen diagnosis to drives it never saw, without any refit, and measures how far the gap shrinks there.

use crate::case::Case;
use crate::how_far::how_far;
use crate::space::{Part, Space};
use ds_diagnosis::schema::{Corrected, Diagnosis, Shrink};

/// Returns the shrink on some drives of a case (all of them if none are named), as data `unseen`.
#[must_use]
pub fn evaluate(diagnosis: &Diagnosis, case: &Case, drives: &[usize]) -> Vec<Shrink> {
    let all: Vec<usize> = (0..case.drives.len()).collect();
    let chosen: Vec<usize> =
        if drives.is_empty() { all } else { all.into_iter().filter(|d| drives.contains(d)).collect() };
    let plants = [Part::Ego, Part::Following].map(|part| {
        let space = Space::new(part, &case.meta.nominal, &[]);
        let after = vector(&space, &diagnosis.corrected_model, case.meta.nominal.mass);
        (space.plant(&space.neutral()), space.plant(&after))
    });
    how_far(case, &chosen, [(&plants[0].0, &plants[0].1), (&plants[1].0, &plants[1].1)], "unseen")
}

/// Returns the search vector of a corrected model; what it does not name is neutral.
pub(crate) fn vector(space: &Space, model: &Corrected, mass_kg: f64) -> Vec<f64> {
    let mut vector = space.neutral();
    for (effect, e) in space.effects.iter().enumerate() {
        for (place, k) in space.of(effect).into_iter().enumerate() {
            let key = if place == 0 { e.id.to_owned() } else { format!("{}.{}", e.id, place + 1) };
            let accepted = model.effects.iter().find(|c| c.id == e.id).and_then(|c| c.values.get(place));
            if let Some(value) = accepted.or_else(|| model.nuisance.get(&key)) {
                vector[k] = space.coordinates[k].parameter.searched(*value, mass_kg);
            }
        }
    }
    vector
}
