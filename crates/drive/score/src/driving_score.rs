//! Terms of a state to its score; scores to their mean, and with route completion to the driving score.
//!
//! LoopState: NC·DAC·DDC·TLC × (5·TTC + 2·LK + 2·HC + 2·EC)/11, no EP (BS `epdms_scorer_md.py:870-875`); terms that do not
//! apply drop out of product and weights. DS = RC × mean over ticks (BS `base_evaluator.py:2095-2098`).

use crate::closed_loop::Ending;
use crate::constants::CLOSED_LOOP_VERSION;
use crate::constants::navsim::{COMFORT_WEIGHT, EXTENDED_COMFORT_WEIGHT, LANE_WEIGHT, TTC_WEIGHT};
use crate::error::ScoreError;

/// The terms of a state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Term {
    /// NC.
    NoAtFaultCollision,
    /// DAC.
    DrivableArea,
    /// DDC.
    DrivingDirection,
    /// TLC.
    TrafficLight,
    /// TTC.
    TimeToCollision,
    /// LK.
    LaneKeeping,
    /// HC.
    HistoryComfort,
    /// EC.
    ExtendedComfort,
}

/// How many terms a state has.
pub const TERMS: usize = 8;
/// How many of them are multipliers; the rest is weighted.
const MULTIPLIERS: usize = 4;
const WEIGHTS: [f64; TERMS - MULTIPLIERS] = [TTC_WEIGHT, LANE_WEIGHT, COMFORT_WEIGHT, EXTENDED_COMFORT_WEIGHT];

impl Term {
    /// All terms, in the order of [`LoopScore::terms`].
    pub const ALL: [Self; TERMS] = [
        Self::NoAtFaultCollision,
        Self::DrivableArea,
        Self::DrivingDirection,
        Self::TrafficLight,
        Self::TimeToCollision,
        Self::LaneKeeping,
        Self::HistoryComfort,
        Self::ExtendedComfort,
    ];

    /// Returns the term's name, as results carry it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::NoAtFaultCollision => "no_at_fault_collision",
            Self::DrivableArea => "drivable_area",
            Self::DrivingDirection => "driving_direction",
            Self::TrafficLight => "traffic_light",
            Self::TimeToCollision => "time_to_collision",
            Self::LaneKeeping => "lane_keeping",
            Self::HistoryComfort => "history_comfort",
            Self::ExtendedComfort => "extended_comfort",
        }
    }
}

/// The score of one state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoopScore {
    /// The state's number.
    pub tick: u32,
    /// The terms in the order of [`Term::ALL`], each in 0..=1; `None` where one does not apply.
    pub terms: [Option<f64>; TERMS],
    /// The object at which the ego is at fault; the lowest id of several.
    pub at_fault_object: Option<u32>,
    /// The object that would be met within 1 s; the lowest id of several.
    pub ttc_object: Option<u32>,
    /// Share of the expert's path behind the ego, not clamped; `None` if the expert stands still.
    pub route_share: Option<f64>,
    /// Why the drive ends with this state.
    pub ending: Option<Ending>,
}

impl LoopScore {
    /// Returns a term; `None` if it does not apply.
    #[must_use]
    pub fn term(&self, term: Term) -> Option<f64> {
        self.terms[term as usize]
    }

    /// Returns the state's total in 0..=1; `None` if no weighted term applies.
    #[must_use]
    pub fn epdms(&self) -> Option<f64> {
        let (multipliers, weighted) = self.terms.split_at(MULTIPLIERS);
        let product: f64 = multipliers.iter().flatten().product();
        let applying = || weighted.iter().zip(WEIGHTS).filter_map(|(term, weight)| Some((term.as_ref()?, weight)));
        let weights: f64 = applying().map(|(_, weight)| weight).sum();
        let sum: f64 = applying().map(|(term, weight)| term * weight).sum();
        (weights > 0.0).then(|| product * (sum / weights))
    }
}

impl LoopScore {
    /// Returns what each term takes from the total, of 1: the weighted terms by their weights, then the multipliers below 1
    /// share what was left by how far they are below it. Zeros where there is no total.
    #[must_use]
    pub fn lost(&self) -> [f64; TERMS] {
        let mut lost = [0.0; TERMS];
        let Some(total) = self.epdms() else { return lost };
        let (multipliers, weighted) = self.terms.split_at(MULTIPLIERS);
        let weights: f64 = weighted.iter().zip(WEIGHTS).filter_map(|(term, weight)| term.map(|_| weight)).sum();
        let mut left = 1.0;
        for (index, (term, weight)) in weighted.iter().zip(WEIGHTS).enumerate() {
            lost[MULTIPLIERS + index] = term.map_or(0.0, |term| weight * (1.0 - term) / weights);
            left -= lost[MULTIPLIERS + index];
        }
        let below: f64 = multipliers.iter().flatten().map(|term| 1.0 - term).sum();
        for (index, term) in multipliers.iter().enumerate() {
            let share = term.map_or(0.0, |term| 1.0 - term) / below.max(f64::MIN_POSITIVE);
            lost[index] = share * (left - total).max(0.0);
        }
        lost
    }
}

/// One term over a drive.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TermSummary {
    /// Its mean over the ticks in which it applies; `None` if there are none.
    pub mean: Option<f64>,
    /// In how many ticks it applies.
    pub ticks: u32,
    /// In how many of them it is below 1.
    pub ticks_lost: u32,
    /// The first state in which it is below 1.
    pub first_lost: Option<u32>,
}

/// The score of a drive.
#[derive(Debug, Clone, PartialEq)]
pub struct DrivingScore {
    /// The score definition.
    pub version: &'static str,
    /// The profile: `bridgesim`, `strict` or `custom`.
    pub profile: &'static str,
    /// How many ticks were scored.
    pub ticks: u32,
    /// Mean of the ticks' totals; `None` if none has one.
    pub mean_epdms: Option<f64>,
    /// Route completion; `None` if the expert stands still.
    pub route_completion: Option<f64>,
    /// Route completion times mean; the mean alone if the expert stands still, which is flagged.
    pub driving_score: Option<f64>,
    /// Whether the expert's path is shorter than 1 m.
    pub expert_stands_still: bool,
    /// Length of the expert's path, in metres.
    pub route_length_m: f64,
    /// The first state that ends the drive, and why.
    pub ended: Option<(u32, Ending)>,
    /// Each term over the drive, in the order of [`Term::ALL`].
    pub terms: [TermSummary; TERMS],
}

/// Sums over the ticks so far.
#[derive(Debug, Clone, Default)]
pub(crate) struct Summary {
    ticks: u32,
    sum: f64,
    summed: u32,
    term_sums: [f64; TERMS],
    terms: [TermSummary; TERMS],
}

impl Summary {
    pub(crate) fn add(&mut self, state: &LoopScore) {
        self.ticks += 1;
        if let Some(epdms) = state.epdms() {
            self.sum += epdms;
            self.summed += 1;
        }
        for (index, value) in state.terms.iter().enumerate() {
            let Some(value) = value else { continue };
            self.term_sums[index] += value;
            let term = &mut self.terms[index];
            term.ticks += 1;
            if *value < 1.0 {
                term.ticks_lost += 1;
                term.first_lost.get_or_insert(state.tick);
            }
        }
    }

    pub(crate) fn finish(
        &self,
        profile: &'static str,
        route_completion: Option<f64>,
    ) -> Result<DrivingScore, ScoreError> {
        if self.ticks < 2 {
            return Err(ScoreError::TooFewStates { what: "drive", found: self.ticks as usize, needed: 2 });
        }
        let mean_epdms = (self.summed > 0).then(|| self.sum / f64::from(self.summed));
        let mut terms = self.terms;
        for (term, sum) in terms.iter_mut().zip(self.term_sums) {
            term.mean = (term.ticks > 0).then(|| sum / f64::from(term.ticks));
        }
        Ok(DrivingScore {
            version: CLOSED_LOOP_VERSION,
            profile,
            ticks: self.ticks,
            mean_epdms,
            route_completion,
            driving_score: mean_epdms.map(|mean| mean * route_completion.unwrap_or(1.0)),
            expert_stands_still: route_completion.is_none(),
            route_length_m: 0.0,
            ended: None,
            terms,
        })
    }
}
