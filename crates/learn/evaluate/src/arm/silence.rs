//! Weights to which every layout is "no layout": the null condition of training, whatever the layouts show.

use ds_nn::Weights;

/// Channels of a layout as a guided decoder sees it: 2×2 pixels of three colours.
const GUIDE_CHANNELS: usize = 12;

/// Returns weights whose control latents are zero, and to which a guided decoder's view of the layout is zero.
pub(super) fn silenced(weights: &Weights) -> Weights {
    let mut silent = weights.clone();
    for (name, array) in silent.iter_mut() {
        if name.starts_with("dit.control_embedding.") {
            array.values_mut().fill(0.0);
        }
        if name.starts_with("vae.decoder.guide.") && name.ends_with(".weight") {
            // Each row holds, for each of nine taps, the decoder's own channels and then those of the layout.
            let inputs = array.values().len() / array.shape()[0] / 9;
            for tap in array.values_mut().chunks_exact_mut(inputs) {
                tap[inputs - GUIDE_CHANNELS..].fill(0.0);
            }
        }
    }
    silent
}
