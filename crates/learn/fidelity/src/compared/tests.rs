//! FDπ of one policy against exact values, its bound, its bias and its interval against draws.

use super::*;
use nalgebra::{DMatrix, DVector};

/// Features of some scenarios of eight frames; those of a scenario resemble each other.
fn drawn(scenarios: usize, features: usize, seed: u64) -> Features {
    let draws = Draws::from_seed(seed, "compared test");
    let one = |k: usize| {
        DMatrix::from_fn(8, features, |r, c| {
            let of = |purpose: u64, at: usize| draws.normal(purpose * 1_000_000 + at as u64);
            0.7 * of(1, k * features + c) + of(2, (k * 8 + r) * features + c) + c as f64
        })
    };
    Features((0..scenarios).map(one).collect())
}

fn changed(features: &Features, change: impl Fn(&DMatrix<f64>) -> DMatrix<f64>) -> Features {
    Features(features.0.iter().map(change).collect())
}

#[test]
fn equal_sets_shifts_and_scales() {
    let real = drawn(40, 6, 1);
    let compared = Compared::new("p", real.clone()).expect("features vary");
    let same = compared.distance("same", &real).expect("paired");
    assert!(same.value.abs() < 1e-8 && same.bound.abs() < 1e-12 && same.extrapolated.abs() < 1e-8, "{same:?}");
    let shift = DVector::from_fn(6, |c, _| 0.1 * (c as f64 + 1.0));
    let moved = changed(&real, |rows| {
        let mut rows = rows.clone();
        rows.row_iter_mut().for_each(|mut row| row += shift.transpose());
        rows
    });
    let (found, expected) =
        (compared.distance("moved", &moved).expect("paired"), shift.norm_squared() / compared.variance());
    assert!((found.value / expected - 1.0).abs() < 1e-8, "{found:?}, {expected}");
    assert!((found.bound / expected - 1.0).abs() < 1e-8, "a shift is the same for every frame");
    assert!((found.extrapolated / expected - 1.0).abs() < 1e-6, "{found:?}");
    let resampled = compared.resampled(&[("moved", &moved), ("same", &real)], 50).expect("paired");
    assert_eq!(resampled[0].len(), 50);
    assert!(resampled[1].iter().all(|value| *value < 1e-6));
}

#[test]
fn in_the_unit_of_features_nothing_is_divided() {
    let (real, other) = (drawn(20, 4, 6), drawn(20, 4, 106));
    let shares = Compared::new("p", real).expect("features vary");
    let plain = shares.clone().stated_in(Unit::Features);
    let [share, whole] = [&shares, &plain].map(|compared| compared.distance("other", &other).expect("paired"));
    let variance = shares.variance();
    for (share, whole) in [
        (share.value, whole.value),
        (share.bound, whole.bound),
        (share.bias, whole.bias),
        (share.extrapolated, whole.extrapolated),
    ] {
        assert!((whole - share * variance).abs() < 1e-9 * whole, "{share} {whole}");
    }
    assert_eq!(share.warnings, whole.warnings);
    let drawn = |compared: &Compared| compared.resampled(&[("other", &other)], 200).expect("paired").remove(0);
    let (shares, plain) = (drawn(&shares), drawn(&plain));
    // Each resample has a variance of its own.
    assert!(shares.iter().zip(&plain).all(|(share, whole)| (whole / share / variance - 1.0).abs() < 0.5));
}

#[test]
fn no_distance_is_above_its_bound() {
    for (seed, share) in [(2, 0.05), (3, 0.3), (4, 1.0), (5, 3.0)] {
        let (real, noise) = (drawn(20, 12, seed), drawn(20, 12, seed + 100));
        let other = Features(real.0.iter().zip(&noise.0).map(|(a, b)| a * (1.0 - 0.2 * share) + b * share).collect());
        let found = Compared::new("p", real).expect("features vary").distance("other", &other).expect("paired");
        assert!(found.value <= found.bound * (1.0 + 1e-9) && found.value > 0.0, "{found:?}");
    }
}

#[test]
fn the_bias_is_what_independent_sets_have() {
    // White features: b(n) = (2.5 + D/2)/n of the variance; simulated with rows that are independent.
    let (d, n) = (32, 400);
    let rows = |seed: u64| {
        let draws = Draws::from_seed(seed, "bias test");
        Features(
            (0..n / 8).map(|k| DMatrix::from_fn(8, d, |r, c| draws.normal(((k * 8 + r) * d + c) as u64))).collect(),
        )
    };
    let found: Vec<Distance> = (0..8)
        .map(|k| Compared::new("p", rows(2 * k)).expect("vary").distance("other", &rows(2 * k + 1)).expect("paired"))
        .collect();
    let mean = |of: fn(&Distance) -> f64| found.iter().map(of).sum::<f64>() / 8.0;
    let (value, bias) = (mean(|d| d.value), mean(|d| d.bias));
    assert!((bias * n as f64 / (2.5 + 0.5 * d as f64) - 1.0).abs() < 0.1, "{bias}");
    assert!((value / bias - 1.0).abs() < 0.15, "{value} beside {bias}");
    assert!(mean(|d| d.extrapolated).abs() < 0.35 * value, "extrapolation takes most of the bias away");
    assert!(found[0].warnings.iter().any(|warning| warning.contains("bias")), "{:?}", found[0].warnings);
}

#[test]
fn intervals_hold_the_value_of_another_draw_of_scenarios() {
    let pair = |seed: u64| {
        let (real, noise) = (drawn(60, 4, seed), drawn(60, 4, seed + 500));
        let other = Features(real.0.iter().zip(&noise.0).map(|(a, b)| a + b * 0.5).collect());
        (Compared::new("p", real).expect("features vary"), other)
    };
    let truth = (20..40).map(|seed| {
        let (compared, other) = pair(seed);
        compared.distance("other", &other).expect("paired").value
    });
    let truth = truth.sum::<f64>() / 20.0;
    let covered = (0..20).filter(|seed| {
        let (compared, other) = pair(*seed);
        let value = compared.distance("other", &other).expect("paired").value;
        let drawn = compared.resampled(&[("other", &other)], 200).expect("paired").remove(0);
        let found = crate::recentred(value, drawn);
        (found.low..=found.high).contains(&truth)
    });
    assert!(covered.count() >= 15);
}

#[test]
fn what_cannot_be_compared_is_named() {
    let constant = Features(vec![DMatrix::from_element(4, 3, 2.5); 3]);
    let error = Compared::new("drivor", constant).expect_err("nothing varies");
    assert_eq!(error, FidelityError::Constant { policy: "drivor".to_owned() });
    assert!(error.to_string().contains("drivor"));
    let real = drawn(5, 3, 9);
    let compared = Compared::new("p", real.clone()).expect("features vary");
    let mut fewer = real.clone();
    fewer.0.pop();
    let error = compared.distance("layout", &fewer).expect_err("a scenario is missing").to_string();
    assert!(error.contains("layout") && error.contains("scenario 4"), "{error}");
    let mut spoiled = real;
    spoiled.0[1][(0, 0)] = f64::NAN;
    assert!(matches!(compared.distance("x", &spoiled), Err(FidelityError::Sample { .. })));
    assert!(compared.halves().expect("two halves") > 0.0);
}
