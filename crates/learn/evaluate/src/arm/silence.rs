//! Weights to which every layout is "no layout": the null condition of training, whatever the layouts show.

use ds_nn::Weights;
use ds_nn::tiny_ae::AeShape;

/// Returns weights whose control latents are zero, and to which a guided decoder's view of the layout is zero.
pub(super) fn silenced(shape: &AeShape, weights: &Weights) -> Weights {
    let mut silent = weights.clone();
    for (name, array) in silent.iter_mut() {
        if name.starts_with("dit.control_embedding.") {
            array.values_mut().fill(0.0);
        }
    }
    for (name, seen) in shape.layout_inputs() {
        let Some(array) = silent.get_mut(&format!("vae.{name}.weight")) else { continue };
        // Each row holds, for each of nine taps, the decoder's own channels and then those of the layout.
        let inputs = array.values().len() / array.shape()[0] / 9;
        for tap in array.values_mut().chunks_exact_mut(inputs) {
            tap[inputs - seen..].fill(0.0);
        }
    }
    silent
}
