//! FDπ of one policy: FD = (|μ - μ̃|² + Tr(Σ + Σ̃ - 2 (ΣΣ̃)^½)) / Tr Σ, Σ being the real set's, divisor n - 1, nothing shrunk.
//!
//! Both sets hold the same moments of the same scenarios. FDπ is the mean of FD over a panel of policies. All values are
//! plain shares of the variance; tables state them × 100. FID and FVD are the same without the division ([`Unit::Features`]).

use ds_space::Draws;
use ds_stats::bootstrap::resamples;
use ds_stats::{Fitted, Moments};
use rayon::iter::{IntoParallelIterator as _, ParallelIterator as _};

use crate::error::FidelityError;
use crate::scenarios::Features;

/// Variance below this share of the squared mean is rounding.
const LEAST_VARIANCE: f64 = 1e-18;
/// Frames per feature below which a value is warned of.
const FRAMES_PER_FEATURE: usize = 8;
/// Numbers in the moments of all sets beyond which resamples are of rows: 1 GB.
const MOST_NUMBERS: usize = 130_000_000;
/// Share of a value that the bias may have before it is warned of.
const MOST_BIAS: f64 = 0.2;

/// What distances are stated in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Unit {
    /// Tr Σ of the real set.
    #[default]
    Variance,
    /// The features' own, squared.
    Features,
}

/// A policy's features of real frames, fit to be compared with.
#[derive(Debug, Clone, PartialEq)]
pub struct Compared {
    policy: String,
    real: Features,
    fitted: Fitted,
    unit: Unit,
}

/// A distance with what belongs beside it.
#[derive(Debug, Clone, PartialEq)]
pub struct Distance {
    /// The Fréchet distance over Tr Σ, or as it is: the [`Unit`].
    pub value: f64,
    /// Mean |φ - φ̃|² of the same unit of the paired frames, never below the value.
    pub bound: f64,
    /// What two independent sets of as many frames would have without any difference; paired sets have far less.
    pub bias: f64,
    /// The value extrapolated to infinitely many frames, linear in 1/n.
    pub extrapolated: f64,
    /// Frames in each set.
    pub frames: usize,
    /// Features of a frame.
    pub features: usize,
    /// Why the value is to be doubted, in words.
    pub warnings: Vec<String>,
}

impl Compared {
    /// Takes a policy's features of the real frames.
    ///
    /// # Errors
    /// If there are fewer than two frames, a feature is not finite, or all are constant.
    pub fn new(policy: &str, real: Features) -> Result<Self, FidelityError> {
        let all = real.all();
        let fitted = Fitted::of(&all, 0.0).map_err(sample(policy, "the real set"))?;
        if fitted.variance() <= LEAST_VARIANCE * all.row_mean().norm_squared() {
            return Err(FidelityError::Constant { policy: policy.to_owned() });
        }
        Ok(Self { policy: policy.to_owned(), real, fitted, unit: Unit::Variance })
    }

    /// States distances in a unit.
    #[must_use]
    pub fn stated_in(self, unit: Unit) -> Self {
        Self { unit, ..self }
    }

    /// Returns the policy's name.
    #[must_use]
    pub fn policy(&self) -> &str {
        &self.policy
    }

    /// Returns Tr Σ of the real set.
    #[must_use]
    pub fn variance(&self) -> f64 {
        self.fitted.variance()
    }

    /// Returns what a distance from a set of this variance is divided by.
    fn per(&self, variance: f64) -> f64 {
        match self.unit {
            Unit::Variance => variance,
            Unit::Features => 1.0,
        }
    }

    /// Measures a source.
    ///
    /// # Errors
    /// If the frames are not paired or a feature is not finite.
    pub fn distance(&self, set: &str, other: &Features) -> Result<Distance, FidelityError> {
        self.paired(set, other)?;
        let value = self.part(set, other, &self.all())?;
        let pairs: Vec<f64> = self.pairs(set, other)?.into_iter().flatten().collect();
        let (frames, features) = (pairs.len(), self.real.0.first().map_or(0, nalgebra::Matrix::ncols));
        let bound = pairs.iter().sum::<f64>() / frames as f64;
        let bias = self.bias(frames);
        let mut warnings = Vec::new();
        if frames < FRAMES_PER_FEATURE * features {
            warnings.push(format!("{frames} frames are fewer than {FRAMES_PER_FEATURE} × {features} features"));
        }
        if bias >= value {
            warnings.push("the bias of independent sets is not below the value".to_owned());
        } else if bias > MOST_BIAS * value {
            warnings.push(format!("the bias of independent sets is {:.0} % of the value", 100.0 * bias / value));
        }
        let extrapolated = self.extrapolated(set, other, value)?;
        Ok(Distance { value, bound, bias, extrapolated, frames, features, warnings })
    }

    /// Returns |φ - φ̃|²/Tr Σ of every frame, by scenario.
    ///
    /// # Errors
    /// If the frames are not paired.
    pub fn pairs(&self, set: &str, other: &Features) -> Result<Vec<Vec<f64>>, FidelityError> {
        self.paired(set, other)?;
        let unit = self.per(self.variance());
        let of = |(real, other): (&nalgebra::DMatrix<f64>, &nalgebra::DMatrix<f64>)| {
            let apart = real - other;
            apart.row_iter().map(|row| row.norm_squared() / unit).collect()
        };
        Ok(self.real.0.iter().zip(&other.0).map(of).collect())
    }

    /// Returns the distance of two halves of the real set, chosen by scenario: what no source can be told from.
    ///
    /// # Errors
    /// If a half has fewer than two frames.
    pub fn halves(&self) -> Result<f64, FidelityError> {
        let order = shuffled(self.real.0.len());
        let (first, second) = order.split_at(order.len() / 2);
        let fit =
            |picks| Fitted::of(&self.real.stacked(picks), 0.0).map_err(sample(&self.policy, "half of the real set"));
        let raw = fit(first)?.frechet(&fit(second)?).map_err(sample(&self.policy, "half of the real set"))?;
        Ok(raw / self.per(self.variance()))
    }

    /// Returns the distance over some of the scenarios, in units of the variance of the whole real set.
    ///
    /// # Errors
    /// If the frames are not paired or the scenarios hold fewer than two.
    pub fn over(&self, set: &str, other: &Features, scenarios: &[usize]) -> Result<f64, FidelityError> {
        self.paired(set, other)?;
        self.part(set, other, scenarios)
    }

    /// Returns the distance of each of `times` resamples of scenarios, for each source, no number where the drawn ones
    /// hold no variance; the scenarios of [`picks`] are drawn for both sets, all sources and all policies. Moments and eigenvalues (`ds_stats::Moments`),
    /// or the rows themselves where they are fewer than their features, or moments would take too much memory.
    ///
    /// # Errors
    /// If the frames of a source are not paired.
    pub fn resampled(&self, sources: &[(&str, &Features)], times: u64) -> Result<Vec<Vec<f64>>, FidelityError> {
        for (set, other) in sources {
            self.paired(set, other)?;
        }
        let all = self.real.all();
        let origin = all.row_mean().transpose();
        let parts = |features: &Features| features.0.iter().map(|rows| Moments::of(rows, &origin)).collect::<Vec<_>>();
        let numbers = (sources.len() + 1) * self.real.0.len() * all.ncols().pow(2);
        let moments = (all.nrows() >= all.ncols() && numbers <= MOST_NUMBERS).then(|| {
            let others: Vec<Vec<Moments>> = sources.iter().map(|(_, other)| parts(other)).collect();
            (parts(&self.real), others)
        });
        let by_moments = |(real, others): &(Vec<Moments>, Vec<Vec<Moments>>), picks: &[usize]| -> Vec<Option<f64>> {
            let rooted = Moments::drawn(real, picks).and_then(|all| all.rooted());
            let distance = |other: &Vec<Moments>| {
                let (all, rooted) = Moments::drawn(other, picks).zip(rooted.as_ref())?;
                Some(rooted.frechet(&all)? / self.per(rooted.variance()))
            };
            others.iter().map(distance).collect()
        };
        let draw = |picks: Vec<usize>| -> Vec<f64> {
            let raw = moments.as_ref().map_or_else(|| self.by_rows(sources, &picks), |all| by_moments(all, &picks));
            // A draw of one scenario over and over may hold no variance: it has no distance for any source.
            raw.into_iter().map(|raw| raw.filter(|value| value.is_finite()).unwrap_or(f64::NAN)).collect()
        };
        let draws: Vec<Vec<f64>> =
            picks(times, self.real.0.len()).collect::<Vec<_>>().into_par_iter().map(draw).collect();
        Ok((0..sources.len()).map(|source| draws.iter().map(|draw| draw[source]).collect()).collect())
    }

    /// Returns the distance of a resample for each source from its rows, none where these cannot be fitted.
    fn by_rows(&self, sources: &[(&str, &Features)], picks: &[usize]) -> Vec<Option<f64>> {
        let fit = |features: &Features| Fitted::of(&features.stacked(picks), 0.0).ok();
        let real = fit(&self.real);
        let distance = |other: &Features| {
            let real = real.as_ref()?;
            Some(real.frechet(&fit(other)?).ok()? / self.per(real.variance()))
        };
        sources.iter().map(|(_, other)| distance(other)).collect()
    }

    /// Returns the bias of two independent sets of n frames each of the real distribution, λ being its eigenvalues:
    /// (2.5 Tr Σ + Σ_ij λ_i λ_j / (λ_i + λ_j)) / (n Tr Σ), without Tr Σ below where distances are not in units of it.
    fn bias(&self, frames: usize) -> f64 {
        let (spectrum, variance) = (self.fitted.spectrum(), self.variance());
        let pair = |a: f64, b: f64| if a + b > 0.0 { a * b / (a + b) } else { 0.0 };
        let pairs: f64 = spectrum.iter().flat_map(|a| spectrum.iter().map(move |b| pair(*a, *b))).sum();
        (2.5 * variance + pairs) / (frames as f64 * self.per(variance))
    }

    /// Extrapolates to infinitely many frames by the line through the values of all, of halves and of quarters of the
    /// scenarios over 1/n (Chong and Forsyth 2020); the value itself below eight scenarios.
    fn extrapolated(&self, set: &str, other: &Features, value: f64) -> Result<f64, FidelityError> {
        let order = shuffled(self.real.0.len());
        if order.len() < 8 {
            return Ok(value);
        }
        let mut points = vec![(1.0, value)];
        for parts in [2, 4] {
            for part in 0..parts {
                let picks = &order[part * order.len() / parts..(part + 1) * order.len() / parts];
                points.push((order.len() as f64 / picks.len() as f64, self.part(set, other, picks)?));
            }
        }
        let count = points.len() as f64;
        let (x, y) = points.iter().fold((0.0, 0.0), |(x, y), point| (x + point.0 / count, y + point.1 / count));
        let along: f64 = points.iter().map(|point| (point.0 - x) * (point.1 - y)).sum();
        let spread: f64 = points.iter().map(|point| (point.0 - x).powi(2)).sum();
        Ok(y - x * along / spread)
    }

    /// The distance over some scenarios, in units of the variance of the whole real set.
    fn part(&self, set: &str, other: &Features, picks: &[usize]) -> Result<f64, FidelityError> {
        let fit = |features: &Features| Fitted::of(&features.stacked(picks), 0.0).map_err(sample(&self.policy, set));
        let raw = fit(&self.real)?.frechet(&fit(other)?).map_err(sample(&self.policy, set))?;
        Ok(raw / self.per(self.variance()))
    }

    fn all(&self) -> Vec<usize> {
        (0..self.real.0.len()).collect()
    }

    fn paired(&self, set: &str, other: &Features) -> Result<(), FidelityError> {
        let rows = |features: &Features, at: usize| features.0.get(at).map_or(0, nalgebra::Matrix::nrows);
        let most = self.real.0.len().max(other.0.len());
        match (0..most).find(|at| rows(&self.real, *at) != rows(other, *at)) {
            None => Ok(()),
            Some(scenario) => Err(FidelityError::Unpaired {
                policy: self.policy.clone(),
                set: set.to_owned(),
                scenario,
                expected: rows(&self.real, scenario),
                found: rows(other, scenario),
            }),
        }
    }
}

/// Draws the scenarios of each resample: the same for every policy over as many scenarios.
pub fn picks(times: u64, scenarios: usize) -> impl Iterator<Item = Vec<usize>> {
    resamples(&Draws::from_seed(0, "fd pi bootstrap"), times, scenarios).collect::<Vec<_>>().into_iter()
}

fn sample(policy: &str, set: &str) -> impl FnOnce(ds_stats::SampleError) -> FidelityError {
    let (policy, set) = (policy.to_owned(), set.to_owned());
    move |source| FidelityError::Sample { policy, set, source }
}

/// Returns the scenarios in an order that follows nothing.
fn shuffled(count: usize) -> Vec<usize> {
    let draws = Draws::from_seed(0, "fd pi parts");
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by_key(|scenario| draws.u64(*scenario as u64));
    order
}

#[cfg(test)]
mod tests;
