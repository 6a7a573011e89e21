//! How far along the expert's path the ego is, when the drive ends, and what share of the path it completed.
//!
//! BS `core/base_evaluator.py:1922-1945,2047-2059`, MD `scenario_env.py:84,90-98,159-195,367-383`.

use super::lane::LaneLine;
use super::profile::{CompletionRule, Profile, ShortExpertRule};
use super::tick::LoopScene;
use crate::constants::bridgesim::{ARRIVED_SHARE, BACKWARDS_SHARE, LEFT_ROUTE_M};
use crate::constants::strict::SHORTEST_EXPERT_M;
use crate::error::ScoreError;
use ds_space::DVec2;

/// Why a drive ends. A crash is no reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// More than 95 % of the expert's path lie behind.
    Arrived,
    /// The ego is more than 4 m beside the expert's path.
    LeftRoute,
    /// The ego is behind the start by more than a tenth of the path.
    DroveBackwards,
}

impl Ending {
    /// Returns the ending's name, as results carry it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Arrived => "arrived",
            Self::LeftRoute => "left_route",
            Self::DroveBackwards => "drove_backwards",
        }
    }
}

/// The place of the ego on the expert's path, state by state.
#[derive(Debug, Clone)]
pub(crate) struct Route {
    line: LaneLine,
    window_share: Option<f64>,
    stands_still: bool,
    first: Option<f64>,
    last: f64,
    pub(crate) ended: Option<(u32, Ending)>,
}

impl Route {
    pub(crate) fn new(scene: &LoopScene, profile: &Profile) -> Result<Self, ScoreError> {
        let line = LaneLine::new(&scene.expert_path)
            .ok_or_else(|| ScoreError::BadPolygon { field: "expert_path".to_owned() })?;
        let length_m = line.length_m();
        let stands_still = length_m < SHORTEST_EXPERT_M;
        if stands_still && profile.short_expert == ShortExpertRule::Refused {
            return Err(ScoreError::ExpertStandsStill { length_m });
        }
        let window_share = scene.window_share.filter(|share| *share > 0.0);
        Ok(Self { line, window_share, stands_still, first: None, last: 0.0, ended: None })
    }

    pub(crate) fn length_m(&self) -> f64 {
        self.line.length_m()
    }

    pub(crate) fn stands_still(&self) -> bool {
        self.stands_still
    }

    /// Takes the next state; returns the share of the path behind the ego, unclamped, and why the drive ends here.
    pub(crate) fn observe(&mut self, tick: u32, centre: DVec2) -> (f64, Option<Ending>) {
        let (along_m, lateral_m) = self.line.coordinates(centre);
        let share = along_m / self.line.length_m();
        self.first.get_or_insert(share);
        self.last = share;
        let ending = if self.stands_still {
            None
        } else if share > ARRIVED_SHARE {
            Some(Ending::Arrived)
        } else if lateral_m.abs() > LEFT_ROUTE_M {
            Some(Ending::LeftRoute)
        } else if share < BACKWARDS_SHARE {
            Some(Ending::DroveBackwards)
        } else {
            None
        };
        if self.ended.is_none() {
            self.ended = ending.map(|ending| (tick, ending));
        }
        (share, ending)
    }

    /// Returns the route completion so far; `None` if the expert stands still.
    pub(crate) fn completion(&self, profile: &Profile) -> Option<f64> {
        let first = self.first.filter(|_| !self.stands_still)?;
        let gained = (self.last - first).max(0.0);
        Some(match (profile.completion, self.window_share) {
            (CompletionRule::WholePath, None) => gained,
            (CompletionRule::RestOfPath, _) if matches!(self.ended, Some((_, Ending::Arrived))) => 1.0,
            (_, Some(share)) => (gained / share).min(1.0),
            (CompletionRule::RestOfPath, None) => (gained / (1.0 - first).max(f64::EPSILON)).min(1.0),
        })
    }
}
