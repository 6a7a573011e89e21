//! Three scores as pure functions over plain data: `navsim_v2` (EPDMS), `navsim_v1` (PDMS), `closed_loop` (DS).
//!
//! Each equals its public reference implementation, quirks included; each result names its score definition. World
//! frame, SI units, radians. No files, no serde, no clock: same input, same bits. What is computed and why stands in
//! `docs/scoring.md`.

pub mod comfort;
pub mod constants;

mod closed_loop;
mod collision_type;
mod drive;
mod driving_score;
mod ego_area;
mod epdms;
mod error;
mod footprint;
mod lane_marks;
mod metric;
mod motion;
mod oracle;
mod pdms;
mod planner;
mod proposal;
#[cfg(test)]
mod road;
mod scene;
mod smoothing;
mod two_stage;

pub use closed_loop::{
    ClosedLoop, CollisionRule, CompletionRule, DirectionRule, DrivableRule, EgoSize, Ending, FirstStateRule,
    KeepingRule, LightRule, LightTick, LiveScorer, LoopAdapter, LoopComfortRule, LoopEgo, LoopLane, LoopObject,
    LoopScene, LoopState, MissingRule, OverlapRule, Profile, ShortExpertRule, TtcRule, Window, closed_loop, loop_scene,
    window_share,
};
pub use collision_type::CollisionType;
pub use drive::{DriveScore, DriveScorer};
pub use driving_score::{DrivingScore, LoopScore, TERMS, Term, TermSummary};
pub use ego_area::{EgoAreas, StepFlags};
pub use epdms::{FirstViolations, Measured, NavsimV2, SubScores, Yardstick, navsim_v2};
pub use error::ScoreError;
pub use footprint::Footprint;
pub use metric::extended_comfort::{DIFFERENCE_NAMES, ExtendedComfort, extended_comfort};
pub use motion::{Coverage, Executed, Executor, PlannedPoses, VehicleState};
pub use oracle::{OracleRanking, OracleScore, Rollout, rank_plans, rank_rollouts};
pub use pdms::{NavsimV1, navsim_v1, navsim_v1_executed};
pub use planner::{ReferencePlan, reference_plan};
pub use proposal::Violation;
pub use scene::{
    AgentTrack, AreaKind, GovernedLanes, MapArea, MovingBox, ObjectClass, OpenLoopMap, OpenLoopScene, PastState,
    PreparedMap, PreparedScene, SceneNow, Traffic, TrafficAgent, expert_path, log_tracks, open_loop_map, scene_now,
};
pub use two_stage::{StageColumns, StageMapping, StageRow, TwoStage, two_stage};
