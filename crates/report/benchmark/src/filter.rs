//! Which scenarios of a set tell policies apart, in the manner in which NAVSIM filters its scenes: out goes what a constant
//! velocity solves, and what the privileged expert does not. The share of each reason is told by the set's recipe.

use crate::judge::Judged;

/// A constant velocity that scores as much in either profile has solved the scenario.
pub const SOLVED: f64 = 0.7;
/// An expert that scores less in either profile has not.
pub const UNSOLVED: f64 = 0.8;
/// Where a constant velocity fails within so many ticks of the hand-over, the first moment decides.
pub const MOMENT: u32 = 15;

/// Why a scenario is left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reason {
    /// A drive was aborted or could not be scored.
    NotDriven,
    /// The expert does not arrive on the road without a collision by its own fault, or scores below [`UNSOLVED`].
    UnsolvedByExpert,
    /// A constant velocity succeeds, or scores at least [`SOLVED`].
    SolvedByConstantVelocity,
    /// A constant velocity fails within [`MOMENT`] ticks of the hand-over.
    DecidedAtOnce,
}

impl Reason {
    /// Returns the name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::NotDriven => "not_driven",
            Self::UnsolvedByExpert => "unsolved_by_expert",
            Self::SolvedByConstantVelocity => "solved_by_constant_velocity",
            Self::DecidedAtOnce => "decided_at_once",
        }
    }
}

/// Says why a scenario is left out, given how the expert and a constant velocity drove it and when they took over; nothing
/// if it stays.
#[must_use]
pub fn left_out(expert: Option<&Judged>, blind: Option<&Judged>, hand_over: u32) -> Option<Reason> {
    let (Some(expert), Some(blind)) = (expert, blind) else { return Some(Reason::NotDriven) };
    let scores = |judged: &Judged| judged.scores.values().map(|s| s.driving_score).collect::<Option<Vec<f64>>>();
    let (Some(expert_scores), Some(blind_scores)) = (scores(expert), scores(blind)) else {
        return Some(Reason::NotDriven);
    };
    if !expert.outcome.success() || expert_scores.iter().any(|score| *score < UNSOLVED) {
        Some(Reason::UnsolvedByExpert)
    } else if blind.outcome.success() || blind_scores.iter().any(|score| *score >= SOLVED) {
        Some(Reason::SolvedByConstantVelocity)
    } else if blind.outcome.first_fault.is_some_and(|tick| tick < hand_over + MOMENT) {
        Some(Reason::DecidedAtOnce)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judge::{Outcome, PROFILES, Scores};

    fn judged(score: f64, success: bool, first_fault: Option<u32>) -> Judged {
        let scores = Scores { driving_score: Some(score), ..Scores::default() };
        Judged {
            scores: PROFILES.map(|profile| (profile.to_owned(), scores.clone())).into(),
            outcome: Outcome { arrived: success, off_road: first_fault.is_some(), first_fault, ..Outcome::default() },
        }
    }

    #[test]
    fn what_tells_policies_apart_stays() {
        let expert = judged(0.95, true, None);
        for (expert, blind, expected) in [
            (Some(&expert), Some(judged(0.3, false, Some(40))), None),
            (Some(&expert), Some(judged(0.3, false, None)), None),
            (Some(&expert), Some(judged(0.3, false, Some(25))), Some(Reason::DecidedAtOnce)),
            (Some(&expert), Some(judged(0.9, false, Some(70))), Some(Reason::SolvedByConstantVelocity)),
            (Some(&expert), Some(judged(0.6, true, None)), Some(Reason::SolvedByConstantVelocity)),
            (Some(&judged(0.7, true, None)), Some(judged(0.3, false, None)), Some(Reason::UnsolvedByExpert)),
            (Some(&judged(0.9, false, None)), Some(judged(0.9, true, None)), Some(Reason::UnsolvedByExpert)),
            (None, Some(judged(0.3, false, None)), Some(Reason::NotDriven)),
            (Some(&expert), None, Some(Reason::NotDriven)),
        ] {
            assert_eq!(left_out(expert, blind.as_ref(), 20), expected, "{blind:?}");
        }
    }
}
