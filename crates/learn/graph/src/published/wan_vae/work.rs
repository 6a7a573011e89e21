//! Floating-point operations of Wan's autoencoders, two per multiply-add of convolutions and attention.

use super::WanVaeShape;
use super::shape::Part;

/// Frames, rows and columns of a piece.
type Size = [f64; 3];

impl WanVaeShape {
    /// Counts encoding one step of four frames of `rows`×`columns` pixels after the first.
    #[must_use]
    pub fn encode_operations(&self, rows: usize, columns: usize) -> f64 {
        let fold = self.fold() as f64;
        count(&self.encoder(), &mut [4.0, rows as f64 / fold, columns as f64 / fold])
    }

    /// Counts decoding one latent of `h`×`w` pixels after the first.
    #[must_use]
    pub fn decode_operations(&self, h: usize, w: usize) -> f64 {
        count(&self.decoder(), &mut [1.0, h as f64, w as f64])
    }
}

fn count(parts: &[Part], size: &mut Size) -> f64 {
    parts.iter().map(|part| of(part, size)).sum()
}

/// Counts a layer and moves the size on.
fn of(part: &Part, size: &mut Size) -> f64 {
    let pixels = |size: &Size| size.iter().product::<f64>();
    let product = |inputs: usize, outputs: usize, taps: usize| 2.0 * (inputs * outputs * taps) as f64;
    match part {
        Part::Convolution { inputs, outputs, side, .. } => product(*inputs, *outputs, side.pow(3)) * pixels(size),
        Part::Norm { .. } => 0.0,
        Part::Residual { inputs, outputs, .. } => {
            let shortcut = if inputs == outputs { 0.0 } else { product(*inputs, *outputs, 1) };
            (product(*inputs, *outputs, 27) + product(*outputs, *outputs, 27) + shortcut) * pixels(size)
        }
        Part::Attention { width, .. } => {
            product(*width, 4 * width, 1) * pixels(size) + 4.0 * *width as f64 * pixels(size) * size[1] * size[2]
        }
        Part::Down { width, time, .. } => {
            *size = [size[0], size[1] / 2.0, size[2] / 2.0];
            let mut total = product(*width, *width, 9) * pixels(size);
            if *time {
                size[0] /= 2.0;
                total += product(*width, *width, 3) * pixels(size);
            }
            total
        }
        Part::Up { width, outputs, time, .. } => {
            let mut total = 0.0;
            if *time {
                total += product(*width, 2 * width, 3) * pixels(size);
                size[0] *= 2.0;
            }
            *size = [size[0], size[1] * 2.0, size[2] * 2.0];
            total + product(*width, *outputs, 9) * pixels(size)
        }
        Part::Average { inner, .. } | Part::Repeat { inner, .. } => count(inner, size),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_figures_at_832_by_480() {
        let shape = WanVaeShape::WAN21;
        let close = |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 0.02, "{found:e}");
        close(shape.decode_operations(60, 104), 13.55e12);
        close(shape.encode_operations(480, 832), 8.05e12);
    }
}
