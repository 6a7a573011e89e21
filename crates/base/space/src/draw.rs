//! Random draws as a pure function of a key and a counter (Philox4x32-10, Salmon et al. 2011).
//!
//! A draw depends on (scenario digest, appearance, seed) and (purpose, indices), never on the order of calls,
//! so that compared arms share their randomness and any worker can resume a rollout.

use std::f64::consts::TAU;

use crate::digest::{Digest, DigestWriter};

const MULTIPLIER: [u32; 2] = [0xD251_1F53, 0xCD9E_8D57];
const WEYL: [u32; 2] = [0x9E37_79B9, 0xBB67_AE85];

/// A stream of numbers that is wholly given by its key; every method takes the index of the wanted draw.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Draws {
    key: [u32; 2],
    stream: [u32; 2],
}

impl Draws {
    /// Keys a stream by an episode's draw key (see [`Draws::key`]), a purpose and indices such as tick and step.
    #[must_use]
    pub fn new(key: &Digest, purpose: &str, indices: &[u64]) -> Self {
        let mut writer = DigestWriter::new();
        writer.digest(key).text(purpose);
        for index in indices {
            writer.u64(*index);
        }
        let bytes = writer.finish().0;
        let word = |i: usize| u32::from_le_bytes([bytes[i], bytes[i + 1], bytes[i + 2], bytes[i + 3]]);
        Self { key: [word(0), word(4)], stream: [word(8), word(12)] }
    }

    /// Keys a stream by a plain number, for work outside any episode (generators, training).
    #[must_use]
    pub fn from_seed(seed: u64, purpose: &str) -> Self {
        Self::new(&DigestWriter::new().u64(seed).finish(), purpose, &[])
    }

    /// Returns the draw key of an episode: what its randomness may depend on, and nothing else.
    #[must_use]
    pub fn key(scenario: &Digest, appearance: &str, seed: u64) -> Digest {
        DigestWriter::new().digest(scenario).text(appearance).u64(seed).finish()
    }

    fn block(&self, index: u64) -> [u32; 4] {
        #[expect(clippy::cast_possible_truncation, reason = "the two halves of the counter")]
        let mut counter = [index as u32, (index >> 32) as u32, self.stream[0], self.stream[1]];
        let mut key = self.key;
        for _ in 0..10 {
            let low = u64::from(counter[0]) * u64::from(MULTIPLIER[0]);
            let high = u64::from(counter[2]) * u64::from(MULTIPLIER[1]);
            #[expect(clippy::cast_possible_truncation, reason = "the two halves of the product")]
            let next = [
                (high >> 32) as u32 ^ counter[1] ^ key[0],
                high as u32,
                (low >> 32) as u32 ^ counter[3] ^ key[1],
                low as u32,
            ];
            counter = next;
            key = [key[0].wrapping_add(WEYL[0]), key[1].wrapping_add(WEYL[1])];
        }
        counter
    }

    /// Returns draw `index`, uniform over all 64-bit numbers.
    #[must_use]
    pub fn u64(&self, index: u64) -> u64 {
        let block = self.block(index);
        u64::from(block[0]) | (u64::from(block[1]) << 32)
    }

    /// Returns draw `index`, uniform in [0, 1).
    #[must_use]
    pub fn uniform(&self, index: u64) -> f64 {
        (self.u64(index) >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Returns draw `index`, uniform in [low, high).
    #[must_use]
    pub fn range(&self, index: u64, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform(index)
    }

    /// Returns draw `index`, uniform over 0..count (`count` > 0).
    #[must_use]
    pub fn below(&self, index: u64, count: u64) -> u64 {
        ((u128::from(self.u64(index)) * u128::from(count)) >> 64) as u64
    }

    /// Returns draw `index` of the standard normal distribution (Box-Muller).
    #[must_use]
    pub fn normal(&self, index: u64) -> f64 {
        let block = self.block(index);
        let u = (f64::from(block[0]) + 0.5) * (1.0 / 4_294_967_296.0);
        let v = f64::from(block[1]) * (1.0 / 4_294_967_296.0);
        (-2.0 * u.ln()).sqrt() * (TAU * v).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Known-answer vectors of the reference implementation (Random123 `kat_vectors`, philox4x32 10).
    #[test]
    fn equals_the_reference_vectors() {
        let zero = Draws { key: [0, 0], stream: [0, 0] };
        assert_eq!(zero.block(0), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        let ones = Draws { key: [u32::MAX; 2], stream: [u32::MAX; 2] };
        assert_eq!(ones.block(u64::MAX), [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]);
    }

    #[test]
    fn normal_draws_have_mean_zero_and_unit_variance() {
        let draws = Draws::from_seed(7, "test");
        let values: Vec<f64> = (0..20_000).map(|i| draws.normal(i)).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.04, "mean {mean}, variance {variance}");
    }
}
