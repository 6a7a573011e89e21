//! A guest by the wall clock: each plan is due one replan period of real time after its observation was shown, and the drive
//! goes no faster than real time. Whoever is late is not waited for: the newest answer there is is driven on.
//!
//! A busy policy is shown nothing new until it has answered, so that it never falls behind by more than it is slow. What comes
//! of it depends on the machine; nothing here runs in any other episode.

use std::time::Duration;

use ds_bus::{FromBridge, FromPolicy};
use ds_policy::Observation;
use ds_process::maker::Fault;
use ds_space::{PoseSe2, SimTime};
use ds_topic::{Answered, Plan};
use ds_world::{EgoState, Trajectory, TrajectoryPoint};
use tokio::time::{Instant, sleep_until, timeout_at};

use super::External;

/// The clock of one episode.
pub(super) struct Pace {
    period: Duration,
    /// Plans asked for so far.
    asked: u32,
    /// What the policy is busy with.
    busy: Option<SentObservation>,
    newest: Option<Answer>,
    /// How long each answer took that came since the last plan was handed on.
    latency_nanos: Vec<u64>,
    /// When the last plan was handed on.
    handed_on: Option<Instant>,
}

/// An observation that was shown.
struct SentObservation {
    message: FromBridge,
    sequence: u64,
    /// Which of the plans asked for it is for.
    asked: u32,
    at: Instant,
    moment: Moment,
}

/// When and where a plan begins, and how old its newest frame is.
#[derive(Clone, Copy)]
struct Moment {
    now: SimTime,
    pose: PoseSe2,
    observed: Option<SimTime>,
}

/// An answer with what it is for.
struct Answer {
    plan: Plan,
    asked: u32,
    moment: Moment,
}

impl Pace {
    /// Begins with so much real time for a plan.
    pub(super) fn new(period: Duration) -> Self {
        Self { period, asked: 0, busy: None, newest: None, latency_nanos: Vec::new(), handed_on: None }
    }
}

impl External {
    /// Shows an observation of `now` and returns the newest answer when its time is over, or as soon as it is there and
    /// real time allows.
    ///
    /// # Errors
    /// `policy_deadline` where there is no answer at all within the ordinary deadline, or none that reaches until now; else
    /// as [`External::plan`].
    pub(super) async fn ask_by_the_clock(
        &mut self,
        observation: &Observation,
        states: &[EgoState],
        now: SimTime,
        pace: &mut Pace,
    ) -> Result<Plan, Fault> {
        let pose = states.last().map_or(PoseSe2::default(), |state| state.pose);
        let moment = Moment { now, pose, observed: observation.stamps.last().copied() };
        let (asked, began) = (pace.asked, Instant::now());
        pace.asked += 1;
        let patience = if pace.newest.is_some() { pace.period } else { self.outside.deadline };
        let mut unshown = Some(self.shown(observation, states));
        while pace.newest.as_ref().is_none_or(|newest| newest.asked != asked) {
            let shown = match (pace.busy.take(), unshown.take()) {
                (Some(busy), waiting) => {
                    unshown = waiting;
                    busy
                }
                (None, Some(observation)) => {
                    let (sequence, at) = (observation.sequence, Instant::now());
                    self.sequence += 1;
                    SentObservation {
                        message: FromBridge::Observation(Box::new(observation)),
                        sequence,
                        asked,
                        at,
                        moment,
                    }
                }
                (None, None) => break,
            };
            let wanted = |said| match said {
                FromPolicy::Plan(plan) if plan.for_sequence == shown.sequence => Some(plan.plan),
                FromPolicy::Plan(_) | FromPolicy::Ready(_) | FromPolicy::Leave(_) => None,
            };
            match timeout_at(began + patience, self.until(&shown.message, wanted)).await {
                Ok(plan) => {
                    let SentObservation { asked, at, moment, .. } = shown;
                    pace.newest = Some(Answer { plan: plan?, asked, moment });
                    pace.latency_nanos.push(u64::try_from(at.elapsed().as_nanos()).unwrap_or(u64::MAX));
                }
                Err(_late) => {
                    pace.busy = Some(shown);
                    break;
                }
            }
        }
        if let Some(before) = pace.handed_on {
            sleep_until(before + pace.period).await;
        }
        pace.handed_on = Some(Instant::now());
        let none = || Fault::policy("policy_deadline", format!("no plan within {} s", patience.as_secs_f64()));
        let plan = driven_on(pace.newest.as_ref().ok_or_else(none)?, asked, moment)?;
        let latency_nanos = std::mem::take(&mut pace.latency_nanos);
        Ok(Plan { answered: plan.answered.map(|answered| Answered { latency_nanos, ..answered }), ..plan })
    }
}

/// Returns what is left of an answer at a later plan's moment, as seen from there, and how late that is.
fn driven_on(answer: &Answer, asked: u32, at: Moment) -> Result<Plan, Fault> {
    let iterations_late = asked - answer.asked;
    let answered = Some(Answered { latency_nanos: Vec::new(), iterations_late });
    let moment = answer.moment;
    let plan = Plan { observed: moment.observed, answered, ..answer.plan.clone() };
    if iterations_late == 0 {
        return Ok(plan);
    }
    let age = at.now - moment.now;
    let later = |point: &TrajectoryPoint| TrajectoryPoint {
        after: point.after - age,
        pose: at.pose.relative(&moment.pose.compose(&point.pose)),
    };
    let moved = |trajectory: &Trajectory| {
        let points = trajectory.points().iter().map(later).filter(|point| point.after > SimTime(0));
        Trajectory::new(points.collect()).ok()
    };
    let over =
        || Fault::policy("policy_deadline", format!("late by {iterations_late} iterations, the last plan is over"));
    let trajectory = moved(&plan.trajectory).ok_or_else(over)?;
    let moved_proposal = |proposal: &ds_world::Proposal| {
        Some(ds_world::Proposal { trajectory: moved(&proposal.trajectory)?, score: proposal.score })
    };
    let proposals = plan.proposals.iter().filter_map(moved_proposal).collect();
    Ok(Plan { trajectory, proposals, ..plan })
}

#[cfg(test)]
mod tests {
    use ds_space::DVec2;

    use super::*;

    #[test]
    fn a_late_plan_is_driven_on_from_where_it_was_made() {
        let point = |secs: f64, x_m: f64| TrajectoryPoint {
            after: SimTime::from_secs(secs),
            pose: PoseSe2::new(x_m, 0.0, 0.0),
        };
        let trajectory = Trajectory::new(vec![point(0.5, 5.0), point(1.0, 10.0), point(1.5, 15.0)]).expect("sound");
        let made =
            Moment { now: SimTime::from_secs(2.0), pose: PoseSe2::new(100.0, 7.0, 0.0), observed: Some(SimTime(9)) };
        let plan = Plan { trajectory, proposals: Vec::new(), observed: None, answered: None, context: None };
        let answer = Answer { plan, asked: 4, moment: made };
        let now =
            Moment { now: SimTime::from_secs(2.5), pose: PoseSe2::new(104.0, 7.5, 0.0), observed: Some(SimTime(10)) };
        let on_time = driven_on(&answer, 4, made).expect("all of it");
        assert_eq!((on_time.trajectory.points().len(), on_time.answered.map(|a| a.iterations_late)), (3, Some(0)));
        let late = driven_on(&answer, 5, now).expect("two points are left");
        let [first, second] = late.trajectory.points() else { panic!("{late:?}") };
        assert_eq!((first.after, second.after), (SimTime::from_secs(0.5), SimTime::from_secs(1.0)));
        assert!((first.pose.position - DVec2::new(6.0, -0.5)).length() < 1e-9, "{first:?}");
        assert_eq!(late.answered, Some(Answered { latency_nanos: Vec::new(), iterations_late: 1 }));
        assert_eq!(late.observed, Some(SimTime(9)), "the frame that it was made from");
        let over = Moment { now: SimTime::from_secs(3.5), ..now };
        assert_eq!(driven_on(&answer, 7, over).expect_err("nothing is left").name, "policy_deadline");
    }
}
