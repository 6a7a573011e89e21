//! The discriminator of a decoder as values: its sizes and the weights that they ask for.
//!
//! It sees a frame, the frame before and the layout as nine channels, and says for each block of 8×8 pixels how much it
//! looks like a true one: convolutions at 1/2, 1/4 and 1/8 resolution, each behind a space-to-depth step of two.

use crate::array::Declared;

/// Channels that it sees: frame, frame before, layout.
pub const SEEN: usize = 9;

/// Sizes of the discriminator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DiscriminatorShape {
    /// Widths at 1/2, 1/4 and 1/8 resolution.
    pub widths: [usize; 3],
}

impl DiscriminatorShape {
    /// Returns the input channels of each convolution; the last is the head, of one output.
    #[must_use]
    pub fn inputs(&self) -> [usize; 4] {
        let [half, quarter, eighth] = self.widths;
        [4 * SEEN, 4 * half, 4 * quarter, eighth]
    }

    /// Lists the weights.
    #[must_use]
    pub fn declare(&self) -> Vec<Declared> {
        let mut list = Vec::new();
        for (index, inputs) in self.inputs().into_iter().enumerate() {
            let (outputs, gain) = self.widths.get(index).map_or((1, 0.3), |width| (*width, 1.4));
            Declared::convolution(&mut list, &format!("layer.{index}"), inputs, outputs, gain);
        }
        list
    }
}
