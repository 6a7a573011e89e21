//! A sequence of draws for generators: the stream is keyed by family, seed and attempt, and read in order.

use ds_space::Draws;

/// Draws numbers one after the other from a counter-based stream.
#[derive(Debug, Clone)]
pub(crate) struct Dice {
    draws: Draws,
    next: u64,
}

impl Dice {
    pub(crate) fn new(draws: Draws) -> Self {
        Self { draws, next: 0 }
    }

    fn step(&mut self) -> u64 {
        self.next += 1;
        self.next - 1
    }

    /// Returns a number in [low, high).
    pub(crate) fn range(&mut self, low: f64, high: f64) -> f64 {
        let index = self.step();
        self.draws.range(index, low, high)
    }

    /// Returns a whole number in low..=high.
    pub(crate) fn whole(&mut self, low: u32, high: u32) -> u32 {
        let index = self.step();
        low + u32::try_from(self.draws.below(index, u64::from(high - low) + 1)).unwrap_or(0)
    }

    /// Returns true with a probability.
    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        let index = self.step();
        self.draws.uniform(index) < probability
    }

    /// Returns -1 or 1.
    pub(crate) fn sign(&mut self) -> f64 {
        if self.chance(0.5) { 1.0 } else { -1.0 }
    }

    /// Returns one of the given values.
    pub(crate) fn pick<'a, T: ?Sized>(&mut self, values: &[&'a T]) -> &'a T {
        let index = self.step();
        values[self.draws.below(index, values.len() as u64) as usize]
    }
}
