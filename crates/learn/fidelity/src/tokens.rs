//! Where two frames of one state differ for a policy: |c − c̃|² of each of its tokens, in units of the variance of a token
//! from one real frame to another.

/// Sums of all tokens over real frames, number by number.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TokenSpread {
    /// Sums, and sums of squares.
    sums: Vec<[f64; 2]>,
    frames: f64,
}

impl TokenSpread {
    /// Adds the tokens of a real frame, one behind the other.
    pub fn add(&mut self, tokens: &[f32]) {
        self.sums.resize(tokens.len(), [0.0; 2]);
        for (sums, value) in self.sums.iter_mut().zip(tokens.iter().copied().map(f64::from)) {
            *sums = [sums[0] + value, sums[1] + value * value];
        }
        self.frames += 1.0;
    }

    /// Returns the trace of the covariance of a token of so many channels, the mean of all tokens; no number for a
    /// single frame.
    #[must_use]
    pub fn of_a_token(&self, channels: usize) -> f64 {
        let variance = |sums: &[f64; 2]| (sums[1] - sums[0] * sums[0] / self.frames).max(0.0) / (self.frames - 1.0);
        self.sums.iter().map(variance).sum::<f64>() / (self.sums.len() / channels.max(1)).max(1) as f64
    }
}

/// Returns |c − c̃|² of each token of two frames.
pub fn token_squares<'a>(real: &'a [f32], other: &'a [f32], channels: usize) -> impl Iterator<Item = f64> + 'a {
    let square = |(a, b): (&[f32], &[f32])| a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    real.chunks_exact(channels).zip(other.chunks_exact(channels)).map(square)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_by_hand() {
        let (first, second) = ([1.0, 0.0, 5.0, 5.0], [3.0, 2.0, 5.0, 6.0]);
        assert_eq!(token_squares(&first, &second, 2).collect::<Vec<_>>(), [8.0, 1.0]);
        let mut spread = TokenSpread::default();
        [first, second].iter().for_each(|tokens| spread.add(tokens));
        // Variances 2, 2 and 0, ½.
        assert!((spread.of_a_token(2) - 4.5 / 2.0).abs() < 1e-12);
        assert!(TokenSpread::default().of_a_token(2) == 0.0);
    }
}
