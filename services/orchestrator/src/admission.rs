//! Gives each queued episode a conductor, so many at a time, and tries again after infrastructure faults.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use ds_episode::FaultClass;
use ds_episode::driver::Status;
use ds_process::Drain;
use ds_process::maker::chain;
use ds_space::{AttemptId, RunId};
use ds_topic::{EpisodeSpec, ReplanAlignment};
use ds_wire::control as pb;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;

use crate::conductor::{self, ConductError, Outcome, Progress, Stand};
use crate::registry::Registry;
use crate::submission::Job;

/// How admission is limited.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    pub(crate) episodes: usize,
    pub(crate) attempts: u32,
    /// How long to wait for a member that has the model an episode needs.
    pub(crate) vacancy: Duration,
}

/// Admits episodes until `drain`; those under way are left to their journals.
pub(crate) async fn admit(stand: Stand, registry: Arc<Registry>, limits: Limits, drain: Drain) {
    let mut under_way = JoinSet::new();
    let mut beat = tokio::time::interval(Duration::from_millis(50));
    loop {
        tokio::select! {
            () = drain.cancelled() => break,
            Some(ended) = under_way.join_next() => {
                if let Err(error) = ended {
                    tracing::error!(%error, "an episode's task panicked");
                }
            }
            () = registry.arrival() => {}
            _ = beat.tick() => {}
        }
        while under_way.len() < limits.episodes {
            let Some((run, index, job, cancel)) = registry.take() else { break };
            let (stand, registry) = (stand.clone(), Arc::clone(&registry));
            under_way.spawn(async move { Episode { stand, registry, run, index, limits }.drive(job, cancel).await });
        }
    }
    under_way.shutdown().await;
}

struct Episode {
    stand: Stand,
    registry: Arc<Registry>,
    run: RunId,
    index: usize,
    limits: Limits,
}

impl Episode {
    /// Changes the episode's result; after a failed write nothing is said of a drive any more.
    fn update(&self, change: impl FnOnce(&mut pb::EpisodeResult)) {
        if self.stand.storage.has_failed() {
            return;
        }
        if let Err(error) = self.registry.update(&self.run, self.index, change) {
            tracing::error!(%error, "result cannot be recorded");
        }
    }

    async fn drive(self, mut job: Job, cancel: watch::Receiver<bool>) {
        if let Err(reason) = self.equip(&mut job, &cancel).await {
            return self.update(|result| {
                result.status = pb::Status::Aborted.into();
                result.reason = reason;
            });
        }
        for attempt in 1..=self.limits.attempts {
            let spec = &job.spec;
            self.update(|result| {
                result.attempts = attempt;
                result.video_model = spec.video_model.0.to_vec().into();
                result.policy_model = spec.policy_model.0.to_vec().into();
            });
            let (progress, mut seen) = mpsc::channel::<Progress>(64);
            let conducted = conductor::conduct(&self.stand, &job, AttemptId(attempt), progress, cancel.clone());
            tokio::pin!(conducted);
            let outcome = loop {
                tokio::select! {
                    outcome = &mut conducted => break outcome,
                    Some(Progress { ticks, awaits }) = seen.recv() => self.update(|result| {
                        result.ticks = ticks.unwrap_or(result.ticks);
                        result.awaits = awaits;
                    }),
                }
            };
            let again = matches!(&outcome, Ok(outcome) if outcome.ending.class == Some(FaultClass::Infrastructure));
            if again && attempt < self.limits.attempts && !*cancel.borrow() {
                tracing::warn!(episode = %job.spec.episode, attempt, "tried again after an infrastructure fault");
                continue;
            }
            return self.conclude(outcome);
        }
    }

    /// Waits until the fleet has what the episode needs and writes the models' digests into its settings.
    async fn equip(&self, job: &mut Job, cancel: &watch::Receiver<bool>) -> Result<(), String> {
        let began = Instant::now();
        loop {
            let abilities = self.stand.hub.abilities();
            let source = job.spec.observation;
            let model = abilities.video.as_ref().and_then(|video| video.model_of(source));
            let ready = model.is_some() || !source.is_generated();
            if ready
                && abilities.policy.is_some()
                && let Some(video) = &abilities.video
            {
                if let Some(model) = model.filter(|_| source.is_generated()) {
                    job.spec.video_model = model;
                    if source.has_cache() {
                        job.spec.chunk_ticks = video.chunk_ticks;
                        job.spec.layout_memory_ticks = video.layout_memory_ticks;
                        job.spec.layout_geometry = video.layout_geometry;
                    }
                    job.frame_px = Some(video.frame_px).filter(|size| size.iter().all(|side| *side > 0));
                    aligned(&job.spec)?;
                }
                if job.spec.policy == "camera" {
                    job.spec.policy_model = abilities.policy.unwrap_or_default();
                }
                return Ok(());
            }
            if *cancel.borrow() {
                return Err("cancelled".to_owned());
            }
            if began.elapsed() > self.limits.vacancy {
                return Err(format!("no_member: the fleet has {abilities:?}"));
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    fn conclude(&self, outcome: Result<Outcome, ConductError>) {
        match outcome {
            Ok(outcome) => self.update(|result| fill(result, &outcome)),
            Err(ConductError::Journal(error)) if error.of_storage() => self.stand.storage.fail(chain(&error)),
            Err(error) => {
                let text = chain(&error);
                tracing::error!(episode = self.index, "{text}");
                self.update(|result| {
                    result.status = pb::Status::Failed.into();
                    result.reason = text;
                });
            }
        }
    }
}

/// Refuses a replan period that cuts chunks where the episode asks for whole ones.
fn aligned(spec: &EpisodeSpec) -> Result<(), String> {
    let (period, chunk) = (spec.replan_period, spec.chunk_ticks);
    if spec.alignment == ReplanAlignment::Exact && chunk > 0 && !period.is_multiple_of(chunk) {
        return Err(format!(
            "not_aligned: replan period {period} is no multiple of the video model's chunk of {chunk} ticks"
        ));
    }
    Ok(())
}

fn fill_scores(result: &mut pb::EpisodeResult, outcome: &Outcome) {
    let (score, proposals) = &outcome.scores;
    result.driving_score = score.driving_score;
    result.mean_score = score.mean;
    result.route_completion = score.route_completion;
    score.reason.clone_into(&mut result.score_reason);
    score.profile.clone_into(&mut result.score_profile);
    score.version.clone_into(&mut result.score_version);
    let scored = score.sub_scores.iter().filter_map(|(name, value)| Some(((*name).to_owned(), (*value)?)));
    result.sub_scores = scored.collect();
    result.lost = score.lost.iter().map(|(name, points)| ((*name).to_owned(), *points)).collect();
    result.first_violations = score.first_violations.iter().map(|(name, tick)| ((*name).to_owned(), *tick)).collect();
    result.proposals = (proposals.ticks > 0).then(|| pb::ProposalStats {
        best_mean: proposals.best_mean(),
        ticks_without_positive: proposals.without_positive,
        ticks: proposals.ticks,
    });
}

fn fill(result: &mut pb::EpisodeResult, outcome: &Outcome) {
    result.status = match outcome.ending.status {
        Status::Completed => pb::Status::Completed,
        Status::Failed => pb::Status::Failed,
        Status::Aborted => pb::Status::Aborted,
    }
    .into();
    result.reason.clone_from(&outcome.ending.reason);
    result.awaits.clear();
    result.ticks = outcome.ticks;
    result.wall_clock.clone_from(&outcome.wall_clock);
    fill_scores(result, outcome);
    let wall = outcome.wall.as_secs_f64();
    result.wall_secs = wall;
    result.frames_per_second = f64::from(outcome.ticks) / wall.max(1e-9);
    result.overhead_micros.clone_from(&outcome.overhead_micros);
    let counted = outcome.counts.list().into_iter().filter(|(.., count)| *count > 0);
    result.counts = counted.map(|(name, _, count)| (name.to_owned(), count)).collect();
    result.time_share = shares(outcome.work_secs, outcome.journal_secs, wall);
    let [world, layout, frame] = outcome.digests.map(|digest| digest.0.to_vec().into());
    (result.world_digest, result.layout_digest, result.frame_digest) = (world, layout, frame);
    result.recording = outcome.recording.display().to_string();
}

/// Divides the wall time between the makers, the journal (`other`) and what is left (`bus`); the shares sum to 1.
fn shares(work_secs: [f64; 4], journal_secs: f64, wall_secs: f64) -> BTreeMap<String, f64> {
    let used = work_secs.iter().sum::<f64>() + journal_secs;
    let total = wall_secs.max(used).max(1e-9);
    let [sim, layout, video, policy] = work_secs.map(|secs| secs / total);
    let other = journal_secs / total;
    let bus = 1.0 - (sim + layout + video + policy + other);
    let named =
        [("sim", sim), ("layout", layout), ("video", video), ("policy", policy), ("other", other), ("bus", bus)];
    named.into_iter().map(|(name, share)| (name.to_owned(), share)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_sum_to_one_even_when_makers_overlap() {
        for (work, journal, wall) in [([0.1, 0.2, 3.0, 0.4], 0.1, 5.0), ([1.0; 4], 1.0, 2.0), ([0.0; 4], 0.0, 0.0)] {
            let sum: f64 = shares(work, journal, wall).values().sum();
            assert!((sum - 1.0).abs() < 1e-12, "{work:?} {journal} {wall} sum to {sum}");
        }
    }
}
