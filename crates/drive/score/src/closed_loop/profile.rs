//! The switches between the closed-loop score as BridgeSim computes it and as the definitions mean it.
//!
//! Every deviation is one named switch. [`Profile::bridgesim`] reproduces the implementation to the digit and is the
//! default for comparison with published tables; [`Profile::strict`] is what the terms say they measure.

/// Whose size the ego has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EgoSize {
    /// 4.515 × 1.852 m, whatever drives (BS `:11-12`).
    Fixed,
    /// The vehicle's own.
    Own,
}

/// Which touches are the ego's fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CollisionRule {
    /// All, unless the ego stands or the other's centre is more than 1 m behind; value 0.
    CentreBehind,
    /// The classes of NC in `scoring.md` §4, with the live speed of the other; 0 with agents, ½ with static objects. A
    /// touch that began without fault is ignored until it ends.
    FaultClasses,
}

/// What happens to objects that touch the ego in the first state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OverlapRule {
    /// They count.
    Counted,
    /// They are left out for the whole drive, as NAVSIM v2 does.
    LeftOut,
}

/// When too short a time to collision counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TtcRule {
    /// Five steps of 0.2 s along both velocity vectors, whatever is in the half plane ahead; 0 with any NC of 0.
    HalfPlane,
    /// Look-aheads and angles of TTC in `scoring.md` §4, others moved on at their velocity and both moved before it is
    /// asked who is ahead.
    Cone,
}

/// On which surfaces the ego may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DrivableRule {
    /// Lanes near by only.
    Lanes,
    /// The drivable layers of the map: surfaces and junctions.
    Layers,
}

/// When driving against a lane counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DirectionRule {
    /// If the best lane is opposed; but opposed lanes are no candidates above 1 m/s, so it never fails. 1 off the road.
    BestLane,
    /// By the distance driven within 1 s where every lane under the centre is opposed, outside junctions: ½ from 2 m,
    /// 0 from 6 m, as DDC in `scoring.md` §4.
    OpposedTravel,
}

/// Which lane the ego should keep to, and when it is judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KeepingRule {
    /// The best lane near by, junctions included; longer than 2 s; 1 and on hold off the road.
    Everywhere,
    /// The same lane; 20 states of 0.1 s, on hold inside junctions, counted off the road too.
    OutsideJunctions,
}

/// When a red light is run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LightRule {
    /// Above 1 m/s on a red lane that is short or near its end.
    NearEnd,
    /// On any red connector of the route, as TLC in `scoring.md` §4.
    RouteConnectors,
}

/// Which state of the lights a state of the world is judged by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LightTick {
    /// That of the tick before (the implementation steps first and looks up the old index).
    Before,
    /// That of the same tick.
    Same,
}

/// How comfort is judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LoopComfortRule {
    /// Differences of velocity and heading between states; 0 where history is missing.
    Differences,
    /// HC: the features of `scoring.md` §5 over the last 1.5 s; EC: differences as above. Neither before there is history.
    Filtered,
}

/// What a term that does not apply is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MissingRule {
    /// 1.
    One,
    /// Nothing: it drops out of product and weights.
    LeftOut,
}

/// What route completion is a share of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CompletionRule {
    /// The whole recorded path, counted from the first scored state; below 1 even for a perfect drive.
    WholePath,
    /// What was left of it at the first scored state; arriving completes it.
    RestOfPath,
}

/// What becomes of a drive whose expert path is shorter than 1 m.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShortExpertRule {
    /// It is refused with an error.
    Refused,
    /// Route completion does not apply, the driving score is the mean, and both are flagged.
    Flagged,
}

/// Whether the state before the first step is scored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FirstStateRule {
    /// No: scores are taken after each step.
    Skipped,
    /// Yes.
    Scored,
}

/// A closed-loop score definition: one choice per switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Profile {
    /// Whose size the ego has.
    pub ego_size: EgoSize,
    /// Which touches are the ego's fault.
    pub collisions: CollisionRule,
    /// What happens to objects that touch the ego in the first state.
    pub overlap_at_start: OverlapRule,
    /// When too short a time to collision counts.
    pub time_to_collision: TtcRule,
    /// On which surfaces the ego may be.
    pub drivable: DrivableRule,
    /// When driving against a lane counts.
    pub direction: DirectionRule,
    /// Which lane the ego should keep to, and when.
    pub keeping: KeepingRule,
    /// When a red light is run.
    pub lights: LightRule,
    /// Which state of the lights counts.
    pub light_tick: LightTick,
    /// How comfort is judged.
    pub comfort: LoopComfortRule,
    /// What a term that does not apply is worth.
    pub missing: MissingRule,
    /// What route completion is a share of.
    pub completion: CompletionRule,
    /// What becomes of a drive whose expert stands still.
    pub short_expert: ShortExpertRule,
    /// Whether the state before the first step is scored.
    pub first_state: FirstStateRule,
}

impl Profile {
    /// Returns the definition that reproduces BridgeSim, deviations included.
    #[must_use]
    pub fn bridgesim() -> Self {
        Self {
            ego_size: EgoSize::Fixed,
            collisions: CollisionRule::CentreBehind,
            overlap_at_start: OverlapRule::Counted,
            time_to_collision: TtcRule::HalfPlane,
            drivable: DrivableRule::Lanes,
            direction: DirectionRule::BestLane,
            keeping: KeepingRule::Everywhere,
            lights: LightRule::NearEnd,
            light_tick: LightTick::Before,
            comfort: LoopComfortRule::Differences,
            missing: MissingRule::One,
            completion: CompletionRule::WholePath,
            short_expert: ShortExpertRule::Refused,
            first_state: FirstStateRule::Skipped,
        }
    }

    /// Returns the definition that the terms mean.
    #[must_use]
    pub fn strict() -> Self {
        Self {
            ego_size: EgoSize::Own,
            collisions: CollisionRule::FaultClasses,
            overlap_at_start: OverlapRule::LeftOut,
            time_to_collision: TtcRule::Cone,
            drivable: DrivableRule::Layers,
            direction: DirectionRule::OpposedTravel,
            keeping: KeepingRule::OutsideJunctions,
            lights: LightRule::RouteConnectors,
            light_tick: LightTick::Same,
            comfort: LoopComfortRule::Filtered,
            missing: MissingRule::LeftOut,
            completion: CompletionRule::RestOfPath,
            short_expert: ShortExpertRule::Flagged,
            first_state: FirstStateRule::Scored,
        }
    }

    /// Returns the profile of a name, `bridgesim` or `strict`.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "bridgesim" => Some(Self::bridgesim()),
            "strict" => Some(Self::strict()),
            _ => None,
        }
    }

    /// Returns the name that results carry; `custom` if any switch differs from both named profiles.
    #[must_use]
    pub fn label(&self) -> &'static str {
        if *self == Self::bridgesim() {
            "bridgesim"
        } else if *self == Self::strict() {
            "strict"
        } else {
            "custom"
        }
    }
}

impl Default for Profile {
    fn default() -> Self {
        Self::bridgesim()
    }
}
