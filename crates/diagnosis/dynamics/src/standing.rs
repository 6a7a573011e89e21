//! Which explanations of a car's drives a diagnosis leaves, with their fits: what an experiment is to tell apart.
//!
//! Explanations exclude each other: nothing but the ordinary mismatch, each effect alone, the accepted effects together.
//! What no library effect explains predicts nothing and is not among them; neither are effects on other drivers and on
//! stamps, which no manoeuvre of the car shows.

use nalgebra::DMatrix;

use crate::choice::{Candidate, Outcome};
use crate::fit::Fit;
use crate::space::SCATTER;

/// One explanation.
#[derive(Debug, Clone)]
pub struct Standing {
    /// Its effects; none for the ordinary mismatch.
    pub effects: Vec<String>,
    /// Probability among the explanations; they sum to one.
    pub probability: f64,
    /// The fitted vector of the car's space.
    pub vector: Vec<f64>,
    /// Coordinates that were fitted.
    pub free: Vec<usize>,
    /// Covariance of those.
    pub covariance: DMatrix<f64>,
}

impl Standing {
    fn of(effects: Vec<String>, probability: f64, fit: &Fit) -> Self {
        let (vector, free) = (fit.vector.clone(), fit.free.clone());
        Self { effects, probability, vector, free, covariance: fit.covariance.clone() }
    }

    /// Returns a root of the covariance: its product with normal draws scatters as the fitted coordinates do.
    #[must_use]
    pub fn root(&self) -> DMatrix<f64> {
        let eigen = self.covariance.clone().symmetric_eigen();
        &eigen.eigenvectors * DMatrix::from_diagonal(&eigen.eigenvalues.map(|value| value.max(0.0).sqrt()))
    }
}

/// Returns the explanations that a ranking leaves of the car, likeliest first.
pub(crate) fn standing(car: &Outcome<'_, '_>, ranking: &[Candidate]) -> Vec<Standing> {
    let own = |c: &&Candidate| c.part == Some(0) && !SCATTER.contains(&c.id);
    let none = 1.0 - ranking.iter().filter(own).map(|c| c.probability).sum::<f64>();
    let mut found = vec![Standing::of(Vec::new(), none.max(0.0), &car.search.null)];
    for candidate in ranking.iter().filter(own) {
        if let Some(single) = car.search.singles.get(candidate.single) {
            found.push(Standing::of(vec![candidate.id.to_owned()], candidate.alone, &single.fit));
        }
    }
    // what is left of the accepted effects is that they act together, or with one that is not the car's
    let together: f64 = ranking.iter().filter(own).map(|c| c.probability - c.alone).sum();
    if let Some(model) = &car.accepted {
        let id = |effect: &usize| car.search.model.space.effects[*effect].id.to_owned();
        let effects: Vec<String> = model.effects.iter().map(id).collect();
        match found.iter_mut().find(|standing| standing.effects == effects) {
            Some(alone) => *alone = Standing::of(effects, alone.probability + together, &model.fit),
            None => found.push(Standing::of(effects, together, &model.fit)),
        }
    }
    let total: f64 = found.iter().map(|standing| standing.probability).sum();
    found.iter_mut().for_each(|standing| standing.probability /= total.max(1e-12));
    found.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    found
}
