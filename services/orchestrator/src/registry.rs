//! All runs: what was submitted, where each episode stands, and who watches. Kept in the ledger, so that finished
//! episodes stay finished and unfinished ones go on after a restart.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ds_episode::fleet::LedgerError;
use ds_space::{DigestWriter, RunId};
use ds_wire::control as pb;
use tokio::sync::{Notify, watch};

use crate::hub::Hub;
use crate::submission::Job;

/// One run.
pub(crate) struct Run {
    pub(crate) id: RunId,
    pub(crate) client_id: String,
    pub(crate) jobs: Vec<Job>,
    pub(crate) cancel: watch::Sender<bool>,
    pub(crate) cancel_reason: String,
    results: Vec<pb::EpisodeResult>,
    /// How many episodes have each status.
    tally: BTreeMap<i32, usize>,
    /// No episode before this one is queued.
    queued_from: usize,
    /// The number of each episode's last change, and the episodes by that number: what a watcher has not seen is found
    /// without a look at all the others.
    changes: Vec<u64>,
    by_change: BTreeMap<u64, usize>,
    /// Counts changes; watchers wait for it.
    changed: watch::Sender<u64>,
}

impl Run {
    fn new(client_id: &str, jobs: Vec<Job>, results: Vec<pb::EpisodeResult>) -> Self {
        let mut tally = BTreeMap::new();
        results.iter().for_each(|result| *tally.entry(result.status).or_default() += 1);
        Self {
            id: run_id(client_id),
            client_id: client_id.to_owned(),
            jobs,
            cancel: watch::Sender::new(false),
            cancel_reason: String::new(),
            tally,
            queued_from: 0,
            changes: vec![0; results.len()],
            by_change: BTreeMap::new(),
            results,
            changed: watch::Sender::new(0),
        }
    }

    pub(crate) fn status(&self) -> pb::Status {
        let count = |status: pb::Status| self.tally.get(&i32::from(status)).copied().unwrap_or_default();
        let [completed, failed, aborted] = [pb::Status::Completed, pb::Status::Failed, pb::Status::Aborted].map(count);
        let all = self.results.len();
        if count(pb::Status::Queued) == all {
            pb::Status::Queued
        } else if completed + failed + aborted < all {
            pb::Status::Running
        } else if completed == all {
            pb::Status::Completed
        } else if failed > 0 {
            pb::Status::Failed
        } else {
            pb::Status::Aborted
        }
    }

    /// Changes an episode's result and wakes the watchers.
    fn set(&mut self, index: usize, result: pb::EpisodeResult) {
        let before = std::mem::replace(&mut self.results[index], result).status;
        if let Some(count) = self.tally.get_mut(&before) {
            *count -= 1;
        }
        *self.tally.entry(self.results[index].status).or_default() += 1;
        let number = *self.changed.borrow() + 1;
        self.by_change.remove(&self.changes[index]);
        self.changes[index] = number;
        self.by_change.insert(number, index);
        self.changed.send_replace(number);
    }

    /// Returns the first queued episode, as running from now on.
    fn start_next(&mut self) -> Option<usize> {
        let queued = |result: &pb::EpisodeResult| result.status == i32::from(pb::Status::Queued);
        let next = self.results[self.queued_from..].iter().position(queued);
        self.queued_from = next.map_or(self.results.len(), |next| self.queued_from + next);
        let index = next.map(|_| self.queued_from)?;
        let result = pb::EpisodeResult { status: pb::Status::Running.into(), ..self.results[index].clone() };
        self.set(index, result);
        Some(index)
    }

    /// Returns what changed after a change, and the number of the last one.
    fn since(&self, number: u64) -> (pb::RunProgress, u64) {
        let episodes = self.by_change.range(number + 1..).map(|(_, index)| self.results[*index].clone()).collect();
        let progress = pb::RunProgress { run_id: self.id.to_string(), status: self.status().into(), episodes };
        (progress, *self.changed.borrow())
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

/// All runs, in order of submission.
#[derive(Default)]
struct Runs {
    all: Vec<Run>,
    by_id: BTreeMap<RunId, usize>,
    /// No run before this one has a queued episode.
    queued_from: usize,
}

impl Runs {
    fn get(&self, id: &str) -> Option<&Run> {
        self.by_id.get(&RunId::new(id).ok()?).map(|place| &self.all[*place])
    }

    fn get_mut(&mut self, id: &RunId) -> Option<&mut Run> {
        self.by_id.get(id).map(|place| &mut self.all[*place])
    }
}

/// All runs by id.
pub(crate) struct Registry {
    hub: Arc<Hub>,
    runs: Mutex<Runs>,
    arrived: Notify,
}

/// All that an episode may be.
const STATUSES: [pb::Status; 5] =
    [pb::Status::Queued, pb::Status::Running, pb::Status::Completed, pb::Status::Failed, pb::Status::Aborted];
const REQUEST: &str = "run/";
const RESULT: &str = "result/";

fn lock(mutex: &Mutex<Runs>) -> MutexGuard<'_, Runs> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the id of a run: a function of the client's own id, so that the same submission finds the same run.
pub(crate) fn run_id(client_id: &str) -> RunId {
    let digest = DigestWriter::new().text(client_id).finish().to_string();
    RunId::new(&format!("run-{}", &digest[..16])).expect("hexadecimal digits are an id")
}

impl Registry {
    pub(crate) fn new(hub: Arc<Hub>) -> Self {
        Self { hub, runs: Mutex::default(), arrived: Notify::new() }
    }

    /// Returns the submissions that the ledger holds, encoded.
    pub(crate) fn stored(&self) -> Result<Vec<Vec<u8>>, LedgerError> {
        Ok(self.hub.entries(REQUEST)?.into_iter().map(|(_, request)| request).collect())
    }

    /// Records a run durably; returns whether it was there already, and how many episodes it has.
    pub(crate) fn add(&self, client_id: &str, request: Vec<u8>, jobs: Vec<Job>) -> Result<(bool, usize), LedgerError> {
        let id = run_id(client_id);
        let mut runs = lock(&self.runs);
        if let Some(run) = runs.get_mut(&id) {
            return Ok((true, run.jobs.len()));
        }
        let earlier: BTreeMap<String, Vec<u8>> = self.hub.entries(&format!("{RESULT}{id}/"))?.into_iter().collect();
        let results = (0usize..).zip(&jobs).map(|(index, job)| {
            let stored = earlier.get(&key(&id, index)).and_then(|bytes| pb::decode_message(bytes).ok());
            stored.unwrap_or_else(|| queued(job))
        });
        let results = results.collect();
        self.hub.commit(&[(format!("{REQUEST}{id}"), Some(request))])?;
        let (count, place) = (jobs.len(), runs.all.len());
        runs.all.push(Run::new(client_id, jobs, results));
        runs.by_id.insert(id, place);
        self.arrived.notify_one();
        Ok((false, count))
    }

    /// Waits until a run arrives; one that arrived while nobody waited counts.
    pub(crate) async fn arrival(&self) {
        self.arrived.notified().await;
    }

    /// Takes the next queued episode, in order of submission.
    pub(crate) fn take(&self) -> Option<(RunId, usize, Job, watch::Receiver<bool>)> {
        let mut runs = lock(&self.runs);
        let Runs { all, queued_from, .. } = &mut *runs;
        while let Some(run) = all.get_mut(*queued_from) {
            if let Some(index) = run.start_next() {
                return Some((run.id.clone(), index, run.jobs[index].clone(), run.cancel.subscribe()));
            }
            *queued_from += 1;
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
        let Some(run) = runs.get_mut(run_id) else { return Ok(()) };
        let Some(result) = run.results.get(index) else { return Ok(()) };
        let mut changed = result.clone();
        change(&mut changed);
        if pb::has_ended(changed.status) {
            self.hub.commit(&[(key(run_id, index), Some(pb::encode_message(&changed)))])?;
        }
        run.set(index, changed);
        Ok(())
    }

    /// Cancels what has not ended.
    pub(crate) fn cancel(&self, run_id: &str, reason: &str) -> Option<pb::Run> {
        let mut runs = lock(&self.runs);
        let run = runs.get_mut(&RunId::new(run_id).ok()?)?;
        run.cancel_reason = if reason.is_empty() { "cancelled".to_owned() } else { format!("cancelled: {reason}") };
        for index in run.queued_from..run.results.len() {
            let result = &run.results[index];
            if result.status == i32::from(pb::Status::Queued) {
                let (status, reason) = (pb::Status::Aborted.into(), run.cancel_reason.clone());
                run.set(index, pb::EpisodeResult { status, reason, ..result.clone() });
            }
        }
        run.cancel.send_replace(true);
        Some(run.message(true))
    }

    /// Returns a run.
    pub(crate) fn get(&self, run_id: &str) -> Option<pb::Run> {
        lock(&self.runs).get(run_id).map(|run| run.message(true))
    }

    /// Lists the newest runs.
    pub(crate) fn list(&self, limit: usize) -> Vec<pb::Run> {
        lock(&self.runs).all.iter().rev().take(limit).map(|run| run.message(false)).collect()
    }

    /// Counts the episodes of all runs by their status.
    pub(crate) fn episodes(&self) -> BTreeMap<&'static str, u64> {
        let mut counts: BTreeMap<_, _> = STATUSES.map(|status| (pb::status_name(status.into()), 0)).into();
        for result in lock(&self.runs).all.iter().flat_map(|run| &run.results) {
            *counts.entry(pb::status_name(result.status)).or_default() += 1;
        }
        counts
    }

    /// Returns where a run stands, with all its episodes, the number of the last change, and a receiver that wakes at
    /// changes.
    pub(crate) fn watch(&self, run_id: &str) -> Option<(pb::RunProgress, u64, watch::Receiver<u64>)> {
        let runs = lock(&self.runs);
        let run = runs.get(run_id)?;
        let all =
            pb::RunProgress { run_id: run.id.to_string(), status: run.status().into(), episodes: run.results.clone() };
        let changed = run.changed.subscribe();
        let number = *changed.borrow();
        Some((all, number, changed))
    }

    /// Returns the episodes of a run that changed after a change, and the number of the last one.
    pub(crate) fn since(&self, run_id: &str, number: u64) -> Option<(pb::RunProgress, u64)> {
        lock(&self.runs).get(run_id).map(|run| run.since(number))
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

#[cfg(test)]
mod tests {
    use super::*;

    fn run(episodes: usize) -> Run {
        let one = |index: usize| pb::EpisodeResult {
            episode: format!("episode-{index}"),
            status: pb::Status::Queued.into(),
            ..pb::EpisodeResult::default()
        };
        Run::new("some", Vec::new(), (0..episodes).map(one).collect())
    }

    fn end(run: &mut Run, index: usize, status: pb::Status) {
        let result = pb::EpisodeResult { status: status.into(), ..run.results[index].clone() };
        run.set(index, result);
    }

    #[test]
    fn a_watcher_is_told_what_changed_and_nothing_twice() {
        let names = |progress: &pb::RunProgress| -> Vec<String> {
            progress.episodes.iter().map(|result| result.episode.clone()).collect()
        };
        let mut run = run(4);
        assert_eq!([run.start_next(), run.start_next()], [Some(0), Some(1)]);
        end(&mut run, 0, pb::Status::Completed);
        let (progress, seen) = run.since(0);
        assert_eq!((names(&progress), seen), (vec!["episode-1".to_owned(), "episode-0".to_owned()], 3));
        assert!(names(&run.since(seen).0).is_empty());
        end(&mut run, 1, pb::Status::Completed);
        assert_eq!(names(&run.since(seen).0), ["episode-1"]);
        assert_eq!(run.by_change.len(), 2);
    }

    #[test]
    fn the_status_of_a_run_follows_its_episodes() {
        let mut run = run(3);
        assert_eq!(run.status(), pb::Status::Queued);
        while let Some(index) = run.start_next() {
            assert_eq!(run.status(), pb::Status::Running);
            end(&mut run, index, pb::Status::Completed);
        }
        assert_eq!((run.status(), run.start_next()), (pb::Status::Completed, None));
        end(&mut run, 1, pb::Status::Aborted);
        assert_eq!(run.status(), pb::Status::Aborted);
        end(&mut run, 2, pb::Status::Failed);
        assert_eq!(run.status(), pb::Status::Failed);
    }
}
