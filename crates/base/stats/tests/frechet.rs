//! The distance equals that of `scipy.linalg.sqrtm` (`frechet.json`, made by `golden.py`) where rows are plenty, and the
//! exact value where it is known, deficient rank included; it is symmetric, and refuses what has none.

use ds_space::Draws;
use ds_stats::{Fitted, Moments, SampleError, frechet};
use nalgebra::{DMatrix, DVector, RowDVector};

fn matrix(value: &serde_json::Value) -> DMatrix<f64> {
    let rows: Vec<Vec<f64>> = serde_json::from_value(value.clone()).expect("a matrix");
    DMatrix::from_fn(rows.len(), rows[0].len(), |r, c| rows[r][c])
}

fn normal(rows: usize, columns: usize, seed: u64) -> DMatrix<f64> {
    let draws = Draws::from_seed(seed, "frechet test");
    DMatrix::from_fn(rows, columns, |r, c| draws.normal((r * columns + c) as u64))
}

/// Rows whose covariance is diagonal with these variances: plus and minus each axis in turn, mean zero.
fn axes(variances: &[f64]) -> DMatrix<f64> {
    let n = 2 * variances.len();
    let length = |c: usize| (variances[c] * (n as f64 - 1.0) / 2.0).sqrt();
    DMatrix::from_fn(n, variances.len(), |r, c| match (r / 2 == c, r % 2) {
        (false, _) => 0.0,
        (true, 0) => length(c),
        (true, _) => -length(c),
    })
}

/// Fails unless a value is what it should be to 1e-8 of the scale.
fn check(name: &str, value: f64, expected: f64, scale: f64) {
    assert!((value - expected).abs() <= 1e-8 * scale, "{name}: {value} instead of {expected}");
}

#[test]
fn equals_scipy_and_is_symmetric() {
    let rows: serde_json::Value = serde_json::from_str(include_str!("frechet.json")).expect("the golden file");
    for row in rows.as_array().expect("rows") {
        let (a, b, value) = (matrix(&row["a"]), matrix(&row["b"]), row["value"].as_f64().expect("a number"));
        assert!(a.nrows() > 2 * a.ncols() && b.nrows() > 2 * b.ncols(), "scipy is no reference at deficient rank");
        check("scipy", frechet(&a, &b, 0.0).expect("a distance"), value, value);
        check("back", frechet(&b, &a, 0.0).expect("a distance"), value, value);
    }
}

#[test]
fn exact_cases_are_exact() {
    let low_rank = normal(40, 3, 3) * normal(3, 128, 4);
    for (name, rows) in [("plenty", normal(400, 64, 1)), ("few", normal(20, 128, 2)), ("rank 3 in 128", low_rank)] {
        let fitted = Fitted::of(&rows, 0.0).expect("fits");
        let scale = fitted.variance();
        // Equal sets, in another order of rows.
        let turned = DMatrix::from_fn(rows.nrows(), rows.ncols(), |r, c| rows[(rows.nrows() - 1 - r, c)]);
        check(name, frechet(&rows, &turned, 0.0).expect("a distance"), 0.0, scale);
        // A shift c: |c|².
        let shift = RowDVector::from_fn(rows.ncols(), |_, c| 0.1 * (c as f64 + 1.0).sin());
        let mut moved = rows.clone();
        moved.row_iter_mut().for_each(|mut row| row += &shift);
        let expected = shift.norm_squared();
        check(name, frechet(&rows, &moved, 0.0).expect("a distance") / expected, 1.0, 1.0);
        // A scale s: (1 - s)² of the variance, for rows of mean zero.
        let mut centred = rows.clone();
        let mean = rows.row_mean();
        centred.row_iter_mut().for_each(|mut row| row -= &mean);
        check(name, frechet(&centred, &(&centred * 0.7), 0.0).expect("a distance") / (0.09 * scale), 1.0, 1.0);
    }
}

#[test]
fn diagonals_and_disjoint_supports_by_hand() {
    let (a, b) = ([4.0, 1.0, 0.25, 9.0], [1.0, 1.0, 2.25, 0.0]);
    let expected: f64 = a.iter().zip(b).map(|(x, y): (&f64, f64)| (x.sqrt() - y.sqrt()).powi(2)).sum();
    check("diagonals", frechet(&axes(&a), &axes(&b), 0.0).expect("a distance"), expected, expected);
    let apart = frechet(&axes(&[3.0, 2.0, 0.0, 0.0]), &axes(&[0.0, 0.0, 5.0, 7.0]), 0.0).expect("a distance");
    check("disjoint supports", apart, 17.0, 17.0);
    let mut spectrum = Fitted::of(&axes(&a), 0.0).expect("fits").spectrum();
    spectrum.sort_by(f64::total_cmp);
    for (found, expected) in spectrum.iter().zip([0.25, 1.0, 4.0, 9.0]) {
        check("spectrum", *found, expected, expected);
    }
}

#[test]
fn shrinkage_keeps_the_diagonal() {
    let rows = normal(50, 2, 5) * DMatrix::from_row_slice(2, 2, &[2.0, 1.0, 0.0, 0.5]);
    // All off the diagonal removed: the distance is that of the deviations of each column.
    let other = normal(60, 2, 6);
    let apart = |c: usize| {
        let (a, b) = (rows.column(c), other.column(c));
        let variance = |v: f64, n: usize| v * n as f64 / (n as f64 - 1.0);
        let deviations = variance(a.variance(), 50).sqrt() - variance(b.variance(), 60).sqrt();
        (a.mean() - b.mean()).powi(2) + deviations.powi(2)
    };
    let expected = apart(0) + apart(1);
    check("diagonal", frechet(&rows, &other, 1.0).expect("a distance"), expected, expected);
    check(
        "trace",
        Fitted::of(&rows, 0.3).expect("fits").variance(),
        Fitted::of(&rows, 0.0).expect("fits").variance(),
        1.0,
    );
}

#[test]
fn moments_of_parts_give_the_distance_of_the_rows() {
    let (a, b) = (normal(90, 6, 7), normal(90, 6, 8) * 1.3);
    let origin = DVector::from_element(6, 0.05);
    let parts = |rows: &DMatrix<f64>| {
        (0..9).map(|k| Moments::of(&rows.rows(10 * k, 10).into_owned(), &origin)).collect::<Vec<_>>()
    };
    let (parts_a, parts_b) = (parts(&a), parts(&b));
    let all: Vec<usize> = (0..9).collect();
    let moments = |parts: &[Moments], picks: &[usize]| Moments::drawn(parts, picks).expect("parts");
    let rooted = moments(&parts_a, &all).rooted().expect("rows");
    check("trace", rooted.variance(), Fitted::of(&a, 0.0).expect("fits").variance(), 6.0);
    let found = rooted.frechet(&moments(&parts_b, &all)).expect("rows");
    check("all", found, frechet(&a, &b, 0.0).expect("a distance"), 1.0);
    // A part drawn twice counts twice.
    let picks = [0, 0, 3];
    let stacked = |rows: &DMatrix<f64>| DMatrix::from_fn(30, 6, |r, c| rows[(10 * picks[r / 10] + r % 10, c)]);
    let found = moments(&parts_a, &picks).rooted().expect("rows").frechet(&moments(&parts_b, &picks)).expect("rows");
    check("drawn", found, frechet(&stacked(&a), &stacked(&b), 0.0).expect("a distance"), 1.0);
    assert_eq!(Moments::drawn(&[], &[]), None);
}

#[test]
fn refuses_what_has_no_distance() {
    let m = |r, c, v| DMatrix::from_element(r, c, v);
    assert_eq!(frechet(&m(5, 2, 0.0), &m(5, 3, 0.0), 0.0), Err(SampleError::Columns(2, 3)));
    assert_eq!(frechet(&m(1, 2, 0.0), &m(5, 2, 0.0), 0.0), Err(SampleError::Rows(1)));
    let mut spoiled = m(4, 2, 0.0);
    spoiled[(2, 1)] = f64::NAN;
    assert_eq!(frechet(&spoiled, &m(5, 2, 0.0), 0.0), Err(SampleError::NotFinite { row: 2, column: 1 }));
}
