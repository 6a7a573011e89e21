//! The distance equals that of `scipy.linalg.sqrtm` (`frechet.json`, made by `golden.py`), is a symmetric distance, and
//! refuses what has none.

use ds_stats::{SampleError, frechet};
use nalgebra::DMatrix;

fn matrix(value: &serde_json::Value) -> DMatrix<f64> {
    let rows: Vec<Vec<f64>> = serde_json::from_value(value.clone()).expect("a matrix");
    DMatrix::from_fn(rows.len(), rows[0].len(), |r, c| rows[r][c])
}

#[test]
fn equals_scipy() {
    let rows: serde_json::Value = serde_json::from_str(include_str!("frechet.json")).expect("the golden file");
    for row in rows.as_array().expect("rows") {
        let (a, b, value) = (matrix(&row["a"]), matrix(&row["b"]), row["value"].as_f64().expect("a number"));
        let found = frechet(&a, &b, 0.0).expect("a distance");
        assert!((found - value).abs() < 1e-6 * value.max(1.0), "{found} instead of {value}");
        let back = frechet(&b, &a, 0.0).expect("a distance");
        assert!((found - back).abs() < 1e-9 * value.max(1.0), "{found} is not {back}");
        assert!(frechet(&a, &a, 0.0).expect("a distance").abs() < 1e-8);
    }
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
