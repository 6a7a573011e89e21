//! The workers of a study: sets of frames are made and looked at side by side, each by one thread.
//!
//! Every worker has networks of its own, read from the same files, so nothing that is found depends on how many there are.
//! A policy that connects cannot be there twice: with one in the panel frames are made side by side and shown in turn.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use ds_nn::team::Team;
use ds_perception::look::LookReader;

use super::config::StudyConfig;
use super::features::Lookers;
use super::given;
use super::panel::{self, Guests};
use crate::error::EvaluationError;

/// What carries a study out.
pub struct Means<'a> {
    /// Policies that connect.
    pub guests: &'a Guests<'a>,
    /// A running clock, in seconds.
    pub seconds: &'a dyn Fn() -> f64,
    /// How many sets are made and looked at side by side, one a thread; as many as there are cores without it. No figure depends on it.
    pub workers: Option<usize>,
}

/// Workers, with the networks that they look with.
pub(super) struct Crew {
    team: Team,
    /// One for each worker, or a single one for all.
    lookers: Vec<Mutex<Lookers>>,
}

impl Crew {
    /// Gathers workers with their networks.
    ///
    /// # Errors
    /// As of [`panel::load`], or if the look network cannot be read.
    pub(super) fn gather(config: &StudyConfig, means: &Means<'_>) -> Result<Self, EvaluationError> {
        let team = means.workers.map_or_else(Team::of_all_cores, Team::new);
        let given = given::load(config)?;
        given::check(&given, config)?;
        let one = || {
            let (panel, given) = (panel::load(config, means.guests)?, given.clone());
            let look = LookReader::load(&config.path(&config.look_weights))?;
            Ok::<_, EvaluationError>(Lookers { panel, look, given })
        };
        let mut lookers = vec![one()?];
        if !lookers[0].panel.iter().any(|member| member.guest) {
            for _ in 1..team.workers() {
                lookers.push(one()?);
            }
        }
        Ok(Self { team, lookers: lookers.into_iter().map(Mutex::new).collect() })
    }

    /// Lends networks that nobody looks with; waits where there are none.
    pub(super) fn lookers(&self) -> MutexGuard<'_, Lookers> {
        let free = self.lookers.iter().find_map(|lookers| lookers.try_lock().ok());
        free.unwrap_or_else(|| self.lookers[0].lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Does a job for each number below `count`, side by side, and returns the results in order.
    ///
    /// # Errors
    /// If a job fails: no other is begun then, and the first failure in order is returned.
    pub(super) fn each<T: Send>(
        &self,
        count: usize,
        job: impl Fn(usize) -> Result<T, EvaluationError> + Sync,
    ) -> Result<Vec<T>, EvaluationError> {
        let failed = AtomicBool::new(false);
        let done = self.team.run(count, |at| {
            let done = (!failed.load(Ordering::Relaxed)).then(|| job(at));
            failed.fetch_or(matches!(done, Some(Err(_))), Ordering::Relaxed);
            done
        });
        done.into_iter().flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_that_fails_is_the_last() {
        let crew = Crew { team: Team::new(2), lookers: Vec::new() };
        assert_eq!(crew.each(9, Ok).expect("none fails"), (0..9).collect::<Vec<_>>());
        let begun = Mutex::new(0);
        let job = |at: usize| {
            *begun.lock().expect("nobody panics") += 1;
            if at < 2 { Err(EvaluationError::config(format!("job {at}"), "fails")) } else { Ok(at) }
        };
        let error = crew.each(1000, job).expect_err("a job fails").to_string();
        assert!(error.contains("job 0") || error.contains("job 1"), "{error}");
        assert!(*begun.lock().expect("nobody panics") < 1000);
    }
}
