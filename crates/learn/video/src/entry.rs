//! The tensors of the cache log, what a successor needs to continue a rollout, as arrays and back.

use ds_nn::Array;
use ds_space::Digest;
use ds_topic::body::Tensor;

pub(crate) fn tensor(array: &Array) -> Tensor {
    Tensor { shape: array.shape().iter().map(|side| *side as u32).collect(), values: array.values().to_vec() }
}

pub(crate) fn digest(tensor: &Tensor) -> Digest {
    let shape: Vec<usize> = tensor.shape.iter().map(|side| *side as usize).collect();
    Array::new(&shape, tensor.values.clone()).digest()
}

/// Returns the array if it has the expected shape and is finite.
pub(crate) fn checked(tensor: &Tensor, shape: &[usize]) -> Result<Array, String> {
    let fits = tensor.shape.len() == shape.len() && tensor.shape.iter().zip(shape).all(|(a, b)| *a as usize == *b);
    if !fits || tensor.values.len() != shape.iter().product::<usize>() {
        let count = tensor.values.len();
        return Err(format!("has shape {:?} and {count} values, {shape:?} expected", tensor.shape));
    }
    match tensor.values.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(format!("holds {} at index {index}", tensor.values[index])),
        None => Ok(Array::new(shape, tensor.values.clone())),
    }
}
