//! What may be chosen about a simulation: tracker, agents, dynamics, sub-steps. Checked once at its start.

use ds_effect::{Plant, Port, Setting, SettingError};
use ds_space::{Digest, DigestWriter};
use ds_topic::EpisodeSpec;
use ds_vehicle::IdmParameters;
use ds_world::{AgentMode, TrackerKind, VehicleParameters};

use crate::error::SimError;

/// Which agents react.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum IdmScope {
    /// Every moving vehicle and cyclist from its first tick on.
    All,
    /// Those that are, at some tick of the closed loop, behind the ego, within 100 m and heading within 90° of
    /// its heading; from that tick on.
    #[default]
    BehindEgo,
    /// Those that are, at some tick of the closed loop, within 50 m of the ego; from that tick on.
    Near,
}

impl IdmScope {
    /// Returns which agents react in a mode; none if all follow their log.
    #[must_use]
    pub fn of(mode: AgentMode) -> Option<Self> {
        match mode {
            AgentMode::LogReplay => None,
            AgentMode::IdmBehindEgo => Some(Self::BehindEgo),
            AgentMode::IdmAll | AgentMode::Interactive => Some(Self::All),
        }
    }
}

/// What reactive agents do besides following; all of it off by default.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Manners {
    /// Vehicles change lanes by MOBIL.
    pub lane_change: bool,
    /// Vehicles yield by right of way, and to people at crosswalks.
    pub yielding: bool,
    /// People on foot walk by themselves and wait for gaps.
    pub walking: bool,
}

impl Manners {
    /// Every model.
    pub const ALL: Self = Self { lane_change: true, yielding: true, walking: true };

    /// Returns what reactive agents do in a mode.
    #[must_use]
    pub fn of(mode: AgentMode) -> Self {
        if mode == AgentMode::Interactive { Self::ALL } else { Self::default() }
    }

    pub(crate) fn apply(self, plant: &mut Plant) {
        plant.agents.changes_lanes |= self.lane_change;
        plant.agents.yields |= self.yielding;
        plant.agents.walks |= self.walking;
    }
}

/// The model of the ego's motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DynamicsKind {
    /// Dynamic single-track with saturating tyre forces, blended into the kinematic one between 2 and 4 m/s.
    #[default]
    SingleTrack,
    /// Kinematic single-track at all speeds (no slip).
    Kinematic,
}

/// The choices of a simulation. The default is LQR tracking of a dynamic single-track car at 10 sub-steps a tick,
/// with IDM traffic behind the ego and log replay elsewhere.
#[derive(Debug, Clone, PartialEq)]
pub struct SimConfig {
    /// The controller that follows the plan.
    pub tracker: TrackerKind,
    /// Which agents drive along their own logged path under the intelligent driver model; pedestrians, standing agents
    /// and paths under 5 m are replayed, and with `None` all are.
    pub agents: Option<IdmScope>,
    /// How reactive agents drive.
    pub idm: IdmParameters,
    /// What they do besides following.
    pub manners: Manners,
    /// The model of the ego's motion.
    pub dynamics: DynamicsKind,
    /// Integration steps of the ego per tick, 1 to 1000.
    pub substeps: u32,
    /// Effects switched on, in the order in which they change the car.
    pub effects: Vec<Setting>,
    /// Whether the car records itself between ticks.
    pub vehicle_log: bool,
}

impl Default for SimConfig {
    fn default() -> Self {
        Self {
            tracker: TrackerKind::default(),
            agents: Some(IdmScope::default()),
            idm: IdmParameters::default(),
            manners: Manners::default(),
            dynamics: DynamicsKind::default(),
            substeps: 10,
            effects: Vec::new(),
            vehicle_log: false,
        }
    }
}

impl SimConfig {
    /// Returns the choices that the settings of an episode are.
    ///
    /// # Errors
    /// If an effect is refused.
    pub fn of_episode(spec: &EpisodeSpec) -> Result<Self, SettingError> {
        let effects = spec.effects.iter().filter(|effect| ds_effect::acts_on_the_world(&effect.id));
        Ok(Self {
            tracker: spec.tracker,
            agents: IdmScope::of(spec.agents),
            manners: Manners::of(spec.agents),
            effects: effects.map(|effect| Setting::new(&effect.id, &effect.values)).collect::<Result<_, _>>()?,
            vehicle_log: spec.vehicle_log,
            ..Self::default()
        })
    }

    /// Checks all numbers.
    ///
    /// # Errors
    /// [`SimError::Field`] names the first bad field.
    pub fn check(&self) -> Result<(), SimError> {
        let idm = &self.idm;
        if self.effects.iter().filter_map(Setting::law).any(|law| law.port() == Port::Follower) {
            return Err(SimError::FollowerLaw);
        }
        in_range("substeps", f64::from(self.substeps), 1.0..=1000.0, "1 to 1000")?;
        if let Some(value) = idm.desired_speed_mps {
            in_range("idm.desired_speed_mps", value, 0.1..=60.0, "0.1 to 60")?;
        }
        in_range("idm.minimum_gap_m", idm.minimum_gap_m, 0.0..=20.0, "0 to 20")?;
        in_range("idm.headway_secs", idm.headway_secs, 0.0..=10.0, "0 to 10")?;
        in_range("idm.acceleration_mps2", idm.acceleration_mps2, 0.1..=10.0, "0.1 to 10")?;
        in_range("idm.deceleration_mps2", idm.deceleration_mps2, 0.1..=10.0, "0.1 to 10")?;
        in_range("idm.emergency_deceleration_mps2", idm.emergency_deceleration_mps2, 0.1..=20.0, "0.1 to 20")
    }

    /// Returns the digest of all choices.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let idm = &self.idm;
        let agents = match self.agents {
            None => 0,
            Some(IdmScope::All) => 1,
            Some(IdmScope::BehindEgo) => 2,
            Some(IdmScope::Near) => 3,
        };
        let mut writer = DigestWriter::new();
        for setting in &self.effects {
            writer.text(&setting.id()).f64s(setting.values());
        }
        let Manners { lane_change, yielding, walking } = self.manners;
        if self.manners != Manners::default() {
            writer.text("manners").bool(lane_change).bool(yielding).bool(walking);
        }
        writer
            .bool(self.vehicle_log)
            .text("sim configuration 2")
            .u32(u32::from(self.tracker == TrackerKind::PurePursuit))
            .u32(agents)
            .u32(u32::from(self.dynamics == DynamicsKind::Kinematic))
            .u32(self.substeps)
            .bool(idm.desired_speed_mps.is_some())
            .f64(idm.desired_speed_mps.unwrap_or_default())
            .f64s(&[idm.minimum_gap_m, idm.headway_secs, idm.acceleration_mps2])
            .f64s(&[idm.deceleration_mps2, idm.emergency_deceleration_mps2])
            .finish()
    }
}

/// Checks the numbers of a vehicle.
pub(crate) fn check_vehicle(vehicle: &VehicleParameters) -> Result<(), SimError> {
    in_range("vehicle.wheel_base_m", vehicle.wheel_base_m, 0.2..=20.0, "0.2 to 20")?;
    in_range("vehicle.length_m", vehicle.size.length_m, 0.2..=40.0, "0.2 to 40")?;
    in_range("vehicle.width_m", vehicle.size.width_m, 0.2..=10.0, "0.2 to 10")?;
    in_range("vehicle.height_m", vehicle.size.height_m, 0.0..=10.0, "0 to 10")?;
    in_range("vehicle.rear_axle_to_centre_m", vehicle.rear_axle_to_centre_m, -20.0..=20.0, "-20 to 20")?;
    in_range("vehicle.max_steering_rad", vehicle.max_steering_rad, 0.01..=1.4, "0.01 to 1.4")?;
    in_range("vehicle.max_steering_rate_radps", vehicle.max_steering_rate_radps, 0.01..=20.0, "0.01 to 20")?;
    in_range("vehicle.max_acceleration_mps2", vehicle.max_acceleration_mps2, 0.1..=50.0, "0.1 to 50")?;
    in_range("vehicle.max_deceleration_mps2", vehicle.max_deceleration_mps2, 0.1..=50.0, "0.1 to 50")?;
    in_range("vehicle.mass_kg", vehicle.mass_kg, 1.0..=1e5, "1 to 100000")
}

fn in_range(
    field: &'static str,
    value: f64,
    allowed: std::ops::RangeInclusive<f64>,
    need: &'static str,
) -> Result<(), SimError> {
    if allowed.contains(&value) { Ok(()) } else { Err(SimError::Field { field, value, need }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(config: SimConfig, field: &str) {
        let error = config.check().expect_err(field).to_string();
        assert!(error.contains(field), "{error:?} does not name {field:?}");
    }

    #[test]
    fn refuses_with_the_name_of_the_field() {
        let base = SimConfig::default;
        let idm = IdmParameters::default();
        assert_eq!(base().check(), Ok(()));
        refused(SimConfig { substeps: 0, ..base() }, "substeps");
        refused(SimConfig { idm: IdmParameters { headway_secs: f64::NAN, ..idm }, ..base() }, "headway_secs");
        refused(SimConfig { idm: IdmParameters { desired_speed_mps: Some(0.0), ..idm }, ..base() }, "desired_speed");
    }

    #[test]
    fn every_choice_changes_the_digest() {
        let base = SimConfig::default;
        let delayed = Setting::new("steer_delay", &[0.1]).expect("a sound setting");
        let others = [
            SimConfig { tracker: TrackerKind::PurePursuit, ..base() },
            SimConfig { agents: None, ..base() },
            SimConfig { agents: Some(IdmScope::All), ..base() },
            SimConfig { dynamics: DynamicsKind::Kinematic, ..base() },
            SimConfig { substeps: 20, ..base() },
            SimConfig { idm: IdmParameters { headway_secs: 1.0, ..IdmParameters::default() }, ..base() },
            SimConfig { effects: vec![delayed], ..base() },
            SimConfig { vehicle_log: true, ..base() },
            SimConfig { manners: Manners::ALL, ..base() },
        ];
        for other in others {
            assert_ne!(base().digest(), other.digest(), "{other:?}");
        }
    }
}
