//! All runs: what was submitted, where each episode stands, and who watches. Kept in the ledger, so that finished
//! episodes stay finished and unfinished ones go on after a restart.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ds_episode::fleet::LedgerError;
use ds_space::{DigestWriter, RunId};
use ds_wire::control as pb;
use tokio::sync::watch;

use crate::hub::Hub;
use crate::submission::Job;

/// One run.
pub(crate) struct Run {
    pub(crate) id: RunId,
    pub(crate) client_id: String,
    pub(crate) jobs: Vec<Job>,
    pub(crate) cancel: watch::Sender<bool>,
    pub(crate) cancel_reason: String,
    pub(crate) results: Vec<pb::EpisodeResult>,
    /// Counts changes; watchers compare.
    changed: watch::Sender<u64>,
}

impl Run {
    pub(crate) fn status(&self) -> pb::Status {
        let all = |status: pb::Status| self.results.iter().all(|result| result.status == i32::from(status));
        let any = |status: pb::Status| self.results.iter().any(|result| result.status == i32::from(status));
        if all(pb::Status::Queued) {
            pb::Status::Queued
        } else if !self.results.iter().all(|result| pb::has_ended(result.status)) {
            pb::Status::Running
        } else if all(pb::Status::Completed) {
            pb::Status::Completed
        } else if any(pb::Status::Failed) {
            pb::Status::Failed
        } else {
            pb::Status::Aborted
        }
    }

    pub(crate) fn message(&self, with_episodes: bool) -> pb::Run {
        pb::Run {
            run_id: self.id.to_string(),
            client_id: self.client_id.clone(),
            status: self.status().into(),
            episodes: if with_episodes { self.results.clone() } else { Vec::new() },
            insecure: false,
        }
    }
}

/// All runs by id, in order of submission.
pub(crate) struct Registry {
    hub: Arc<Hub>,
    runs: Mutex<Vec<Run>>,
}

const REQUEST: &str = "run/";
const RESULT: &str = "result/";

fn lock(mutex: &Mutex<Vec<Run>>) -> MutexGuard<'_, Vec<Run>> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the id of a run: a function of the client's own id, so that the same submission finds the same run.
pub(crate) fn run_id(client_id: &str) -> RunId {
    let digest = DigestWriter::new().text(client_id).finish().to_string();
    RunId::new(&format!("run-{}", &digest[..16])).expect("hexadecimal digits are an id")
}

impl Registry {
    pub(crate) fn new(hub: Arc<Hub>) -> Self {
        Self { hub, runs: Mutex::default() }
    }

    /// Returns the submissions that the ledger holds, encoded.
    pub(crate) fn stored(&self) -> Result<Vec<Vec<u8>>, LedgerError> {
        Ok(self.hub.entries(REQUEST)?.into_iter().map(|(_, request)| request).collect())
    }

    /// Records a run durably; returns whether it was there already, and how many episodes it has.
    pub(crate) fn add(&self, client_id: &str, request: Vec<u8>, jobs: Vec<Job>) -> Result<(bool, usize), LedgerError> {
        let id = run_id(client_id);
        let mut runs = lock(&self.runs);
        if let Some(run) = runs.iter().find(|run| run.id == id) {
            return Ok((true, run.jobs.len()));
        }
        let earlier: BTreeMap<String, Vec<u8>> = self.hub.entries(&format!("{RESULT}{id}/"))?.into_iter().collect();
        let results = (0usize..).zip(&jobs).map(|(index, job)| {
            let stored = earlier.get(&key(&id, index)).and_then(|bytes| pb::decode_message(bytes).ok());
            stored.unwrap_or_else(|| queued(job))
        });
        let results = results.collect();
        self.hub.commit(&[(format!("{REQUEST}{id}"), Some(request))])?;
        let count = jobs.len();
        runs.push(Run {
            id,
            client_id: client_id.to_owned(),
            jobs,
            cancel: watch::Sender::new(false),
            cancel_reason: String::new(),
            results,
            changed: watch::Sender::new(0),
        });
        Ok((false, count))
    }

    /// Takes the next queued episode, in order of submission.
    pub(crate) fn take(&self) -> Option<(RunId, usize, Job, watch::Receiver<bool>)> {
        let mut runs = lock(&self.runs);
        for run in runs.iter_mut() {
            let queued = |result: &pb::EpisodeResult| result.status == i32::from(pb::Status::Queued);
            if let Some(index) = run.results.iter().position(queued) {
                run.results[index].status = pb::Status::Running.into();
                return Some((run.id.clone(), index, run.jobs[index].clone(), run.cancel.subscribe()));
            }
        }
        None
    }

    /// Changes an episode's result and wakes the watchers; an ended one is recorded durably before.
    pub(crate) fn update(
        &self,
        run_id: &RunId,
        index: usize,
        change: impl FnOnce(&mut pb::EpisodeResult),
    ) -> Result<(), LedgerError> {
        let mut runs = lock(&self.runs);
        let Some(run) = runs.iter_mut().find(|run| run.id == *run_id) else { return Ok(()) };
        let Some(result) = run.results.get_mut(index) else { return Ok(()) };
        let mut changed = result.clone();
        change(&mut changed);
        if pb::has_ended(changed.status) {
            self.hub.commit(&[(key(run_id, index), Some(pb::encode_message(&changed)))])?;
        }
        *result = changed;
        run.changed.send_modify(|count| *count += 1);
        Ok(())
    }

    /// Cancels what has not ended.
    pub(crate) fn cancel(&self, run_id: &str, reason: &str) -> Option<pb::Run> {
        let mut runs = lock(&self.runs);
        let run = runs.iter_mut().find(|run| run.id.as_str() == run_id)?;
        run.cancel_reason = if reason.is_empty() { "cancelled".to_owned() } else { format!("cancelled: {reason}") };
        for result in &mut run.results {
            if result.status == i32::from(pb::Status::Queued) {
                result.status = pb::Status::Aborted.into();
                result.reason.clone_from(&run.cancel_reason);
            }
        }
        run.cancel.send_replace(true);
        run.changed.send_modify(|count| *count += 1);
        Some(run.message(true))
    }

    /// Returns a run.
    pub(crate) fn get(&self, run_id: &str) -> Option<pb::Run> {
        lock(&self.runs).iter().find(|run| run.id.as_str() == run_id).map(|run| run.message(true))
    }

    /// Lists the newest runs.
    pub(crate) fn list(&self, limit: usize) -> Vec<pb::Run> {
        lock(&self.runs).iter().rev().take(limit).map(|run| run.message(false)).collect()
    }

    /// Returns a run and a receiver that wakes at its changes.
    pub(crate) fn watch(&self, run_id: &str) -> Option<(pb::Run, watch::Receiver<u64>)> {
        let runs = lock(&self.runs);
        let run = runs.iter().find(|run| run.id.as_str() == run_id)?;
        Some((run.message(true), run.changed.subscribe()))
    }
}

fn key(run: &RunId, index: usize) -> String {
    format!("{RESULT}{run}/{index:06}")
}

fn queued(job: &Job) -> pb::EpisodeResult {
    let spec = &job.spec;
    pb::EpisodeResult {
        episode: spec.episode.to_string(),
        scenario: spec.scenario.clone(),
        policy: spec.policy.clone(),
        observation: pb::ObservationSource::from(spec.observation).into(),
        appearance: spec.appearance.clone(),
        seed: spec.seed,
        status: pb::Status::Queued.into(),
        ticks_due: spec.last_tick.0,
        category: job.category.clone(),
        scorer: spec.scorer.name().to_owned(),
        ..pb::EpisodeResult::default()
    }
}
