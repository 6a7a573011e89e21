//! Products and attention against their plain formulas.

use ds_nn::Array;
use ds_space::Draws;

use super::arch::Arch;
use super::attention::{Keys, Seen, Tiles, attend};
use super::panels::Packed;
use super::product::{Finish, Source, Target, product};

fn draw(name: &str, shape: &[usize]) -> Array {
    Array::normal(shape, &Draws::from_seed(7, name))
}

/// Returns the largest difference over the largest expected value.
fn distance(found: &[f32], expected: &[f32]) -> f32 {
    assert_eq!(found.len(), expected.len());
    let largest = expected.iter().fold(0.0f32, |w, x| w.max(x.abs()));
    let worst = found.iter().zip(expected).fold(0.0f32, |w, (a, b)| if (a - b).abs() <= w { w } else { (a - b).abs() });
    worst / largest
}

#[test]
fn products_equal_the_plain_sum_on_every_set_of_vectors() {
    let arches = || {
        let mut arches = vec![Arch::Scalar, Arch::new()];
        #[cfg(target_arch = "x86_64")]
        arches.extend(pulp::x86::V3::try_new().map(Arch::V3));
        arches
    };
    for (rows, depth, columns) in [(1, 3, 1), (5, 17, 12), (8, 64, 48), (30, 96, 60), (72, 33, 97)] {
        let (x, w) = (draw("x", &[rows, depth]), draw("w", &[columns, depth]));
        let bias = draw("bias", &[columns]);
        let packed = Packed::linear(w.values(), Some(bias.values()), depth);
        let expected: Vec<f32> = (0..rows * columns)
            .map(|at| {
                let (row, column) = (at / columns, at % columns);
                let pairs = x.values()[row * depth..][..depth].iter().zip(&w.values()[column * depth..][..depth]);
                pairs.map(|(a, b)| a * b).sum::<f32>() + bias.values()[column]
            })
            .collect();
        let mut results = Vec::new();
        for arch in arches() {
            let mut y = vec![0.0; rows * columns];
            let source = Source::rows(x.values(), depth);
            product(arch, rows, &[source], &packed, Target::rows(&mut y, columns), Finish::Plain);
            assert!(distance(&y, &expected) < 1e-5, "{arch:?}, {rows}x{depth}x{columns}");
            if !matches!(arch, Arch::Scalar) {
                results.push(y);
            }
        }
        assert!(results.windows(2).all(|pair| pair[0] == pair[1]), "{rows}x{depth}x{columns}");
    }
}

#[test]
fn attention_equals_the_plain_formula_however_keys_are_grouped() {
    let (rows, head_dim, heads) = (11, 20, 3);
    let dim = heads * head_dim;
    let (q, k, v) = (draw("q", &[rows, dim]), draw("k", &[50, dim]), draw("v", &[50, dim]));
    let mut expected = vec![0.0f32; rows * dim];
    for (row, head) in (0..rows).flat_map(|row| (0..heads).map(move |head| (row, head))) {
        let at = |x: &Array, row: usize, i: usize| f64::from(x.values()[row * dim + head * head_dim + i]);
        let score = |key: usize| (0..head_dim).map(|i| at(&q, row, i) * at(&k, key, i)).sum::<f64>().exp2();
        let total: f64 = (0..50).map(score).sum();
        for i in 0..head_dim {
            let sum: f64 = (0..50).map(|key| score(key) * at(&v, key, i)).sum();
            expected[row * dim + head * head_dim + i] = (sum / total) as f32;
        }
    }
    for cuts in [vec![50], vec![7, 43], vec![33, 1, 16]] {
        let mut first = 0;
        let mut groups: Vec<Keys> = Vec::new();
        for count in cuts {
            let mut keys = Keys::default();
            keys.reset(count, heads, head_dim);
            let range = first * dim..(first + count) * dim;
            keys.fill(0, &k.values()[range.clone()], &v.values()[range], dim, head_dim);
            groups.push(keys);
            first += count;
        }
        let window = groups.remove(0);
        let seen = Seen { window: Some(&window), blocks: &groups };
        let mut out = vec![0.0; rows * dim];
        attend(Arch::new(), Source::rows(q.values(), dim), seen, head_dim, &mut Tiles::default(), &mut out);
        assert!(distance(&out, &expected) < 1e-5);
    }
}
