//! Statistics that more than one crate needs, each defined once: quantiles, bootstrap, tails, corrections for many
//! tests, permutation test, Shapley values, shares of an error explained, the Fréchet distance, divergence of histograms, agreement of two judges, correlations.
//!
//! Values in, values out. Levels, numbers of draws and random streams are arguments; what a figure means is said by who
//! asks for it.

mod agreement;
pub mod bootstrap;
mod correlation;
mod discovery;
mod divergence;
mod frechet;
mod normal;
mod permutation;
mod quantile;
mod shapley;
mod share;
mod student;
mod wilson;

pub use agreement::kappa;
pub use correlation::{fisher, pearson, ranks, spearman};
pub use discovery::{false_discovery, holm};
pub use divergence::jensen_shannon;
pub use frechet::{Fitted, Moments, Rooted, SampleError, frechet, shrinkage};
pub use normal::normal_tail;
pub use permutation::{Chance, EXACT_UP_TO, PATTERNS, sign_flip};
pub use quantile::{percentiles, quantile, sorted_quantile, upper_median};
pub use shapley::shapley;
pub use share::{Explained, explained, explained_elsewhere, share};
pub use student::{Pooled, student_tail};
pub use wilson::wilson;

/// Returns the mean in order of the values; nothing for no values.
#[must_use]
pub fn mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.into_iter().fold((0.0, 0u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// Returns the logarithm of the sum of values given by their logarithms; negative infinity for none.
#[must_use]
pub fn log_sum(logs: impl IntoIterator<Item = f64>) -> f64 {
    let logs: Vec<f64> = logs.into_iter().collect();
    let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if top.is_finite() { top + logs.iter().map(|log| (log - top).exp()).sum::<f64>().ln() } else { top }
}
