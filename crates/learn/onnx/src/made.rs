//! An ONNX file for tests, written byte by byte: `features` = `frames`, laid flat, times a matrix.
//!
//! Tests of other crates take this file in by its path, as only `onnx` knows the messages of the format by name.

use std::path::Path;

/// Writes the file for an input of some sides, the first of which is 1; `weight` tells the matrix by row and column.
pub(crate) fn linear(path: &Path, sides: &[usize], features: usize, weight: impl Fn(usize, usize) -> f32) {
    let rows: usize = sides.iter().product();
    let values = (0..rows * features).flat_map(|at| weight(at / features, at % features).to_le_bytes());
    let dims = [rows, features].map(|side| number(1, side)).concat();
    let matrix = [dims, number(2, 1), text(8, "matrix"), part(9, &values.collect::<Vec<u8>>())].concat();
    let graph = [
        part(1, &node("Flatten", &["frames"], "flat")),
        part(1, &node("MatMul", &["flat", "matrix"], "features")),
        text(2, "linear"),
        part(5, &matrix),
        part(11, &tensor("frames", sides)),
        part(12, &tensor("features", &[1, features])),
    ];
    let model = [number(1, 8), part(8, &number(2, 17)), part(7, &graph.concat())];
    std::fs::write(path, model.concat()).expect("the file can be written");
}

fn node(operator: &str, inputs: &[&str], output: &str) -> Vec<u8> {
    let inputs = inputs.iter().flat_map(|input| text(1, input)).collect();
    [inputs, text(2, output), text(3, output), text(4, operator)].concat()
}

fn tensor(name: &str, sides: &[usize]) -> Vec<u8> {
    let shape: Vec<u8> = sides.iter().flat_map(|side| part(1, &number(1, *side))).collect();
    [text(1, name), part(2, &part(1, &[number(1, 1), part(2, &shape)].concat()))].concat()
}

fn text(field: usize, words: &str) -> Vec<u8> {
    part(field, words.as_bytes())
}

fn part(field: usize, bytes: &[u8]) -> Vec<u8> {
    [varint(8 * field + 2), varint(bytes.len()), bytes.to_vec()].concat()
}

fn number(field: usize, value: usize) -> Vec<u8> {
    [varint(8 * field), varint(value)].concat()
}

fn varint(mut value: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    while value > 127 {
        bytes.push((value % 128 + 128).to_le_bytes()[0]);
        value /= 128;
    }
    bytes.push(value.to_le_bytes()[0]);
    bytes
}
