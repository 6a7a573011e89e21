//! Applies a frozen diagnosis to drives it never saw, without any refit, and measures how far the gap shrinks there.

use crate::case::Case;
use crate::how_far::how_far;
use crate::space::{Part, Space};
use ds_diagnosis::schema::{Corrected, Diagnosis, Lines, Shrink};
use ds_effect::Plant;

/// Returns the shrink on some drives of a case (all of them if none are named), as data `unseen`.
#[must_use]
pub fn evaluate(diagnosis: &Diagnosis, case: &Case, drives: &[usize]) -> Vec<Shrink> {
    let all: Vec<usize> = (0..case.drives.len()).collect();
    let chosen: Vec<usize> =
        if drives.is_empty() { all } else { all.into_iter().filter(|d| drives.contains(d)).collect() };
    let plants = [Part::Ego, Part::Following].map(|part| {
        plants(&Space::new(part, &case.meta.nominal, &[]), &diagnosis.corrected_model, case.meta.nominal.mass)
    });
    how_far(case, &chosen, [&plants[0].each_ref(), &plants[1].each_ref()], "unseen")
}

/// Returns the simulators of a corrected model: nominal, with its ordinary mismatch alone, with its effects and laws as well.
pub(crate) fn plants(space: &Space, model: &Corrected, mass_kg: f64) -> [Plant; 3] {
    let [nominal, alone, corrected] = states(space, model, mass_kg).map(|vector| space.plant(&vector));
    [nominal, alone, Plant { laws: model.obeyed(), ..corrected }]
}

/// Returns the search vectors of a corrected model: nominal, with its ordinary mismatch alone, with its effects as well.
fn states(space: &Space, model: &Corrected, mass_kg: f64) -> [Vec<f64>; 3] {
    let corrected: Lines = model.mismatch().into_iter().chain(model.added()).collect();
    let alone = if model.effects.is_empty() { corrected.clone() } else { model.mismatch_alone() };
    [vector(space, &Lines::new(), mass_kg), vector(space, &alone, mass_kg), vector(space, &corrected, mass_kg)]
}

/// Returns a search vector; what is not named is neutral.
fn vector(space: &Space, lines: &Lines, mass_kg: f64) -> Vec<f64> {
    let mut vector = space.neutral();
    for (id, values) in lines {
        let Some(effect) = space.find(id) else { continue };
        for (k, value) in space.of(effect).into_iter().zip(values) {
            vector[k] = space.coordinates[k].parameter.searched(*value, mass_kg);
        }
    }
    vector
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use ds_effect::Setting;

    use super::*;
    use ds_diagnosis::meta::Nominal;
    use ds_diagnosis::schema::CorrectedEffect;

    /// What `gap apply` writes, switched on as a run does it, is the simulator that is measured.
    #[test]
    fn the_applied_simulator_is_the_measured_one() {
        let table = |rows: &[(&str, f64)]| -> BTreeMap<String, f64> {
            rows.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect()
        };
        let model = Corrected {
            effects: vec![CorrectedEffect { id: "steer_delay".to_owned(), value: 0.12, values: vec![0.12] }],
            nuisance: table(&[("payload", 21.0), ("front_grip", 0.97), ("wind_steady.2", -1.5), ("tr_headway", 1.02)]),
            ordinary: table(&[("payload", 30.0)]),
            laws: vec!["steering: 0.02*delta*abs(ay[-3;3])".to_owned()],
        };
        let nominal: Nominal = serde_json::from_str(NOMINAL).expect("a nominal simulator");
        for part in [Part::Ego, Part::Following] {
            let space = Space::new(part, &nominal, &[]);
            let [neutral, alone, measured] = states(&space, &model, nominal.mass);
            assert_ne!(measured, neutral);
            let lines: Lines = model.mismatch().into_iter().chain(model.added()).collect();
            let mut applied = nominal.plant();
            for (id, values) in lines.iter().filter(|(id, _)| space.find(id).is_some()) {
                Setting::new(id, values).expect("a sound setting").apply(&mut applied);
            }
            model.laws.iter().for_each(|text| Setting::new(text, &[]).expect("a sound law").apply(&mut applied));
            let [.., plant] = plants(&space, &model, nominal.mass);
            assert_eq!(applied.laws, plant.laws);
            // logarithms and shares of the mass are searched, so that the last digits may differ
            assert_eq!(format!("{:.9?}", applied.vehicle), format!("{:.9?}", plant.vehicle));
            for (k, coordinate) in space.coordinates.iter().enumerate() {
                let id = space.effects[coordinate.effect].id;
                if lines.iter().all(|line| line.0 != id) {
                    assert_eq!(measured[k].to_bits(), neutral[k].to_bits(), "{id}");
                }
                if id != "payload" {
                    assert_eq!(alone[k].to_bits(), neutral[k].to_bits(), "{id}");
                }
            }
        }
    }

    const NOMINAL: &str = r#"{ "mass": 1610.0, "yaw_inertia": 2650.0, "lf": 1.33, "lr": 1.48,
        "cornering_stiffness_front": 89100.0, "cornering_stiffness_rear": 103300.0, "steer_lag": 0.065,
        "accel_lag": 0.115, "rolling_decel": 0.103, "drag_decel_per_v2": 0.000239 }"#;
}
