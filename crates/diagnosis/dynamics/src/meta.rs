//! Reads `meta.json`: the nominal simulator that the user has, the drives and which of them are for fitting.

use std::path::Path;

use ds_effect::plant::{
    Agents, Chart, Clock, Follower, FrictionCircle, Plant, Road, Sensors, Steering, Traction, Vehicle,
};
use serde::Deserialize;

use crate::error::GapError;

/// Sharpness of the nominal tyre's saturation; 3 lies between a brush and an ideal clip.
const TYRE_KNEE: f64 = 3.0;

/// A case's description.
#[derive(Debug, Clone, Deserialize)]
pub struct Meta {
    /// Name of the case.
    #[serde(default)]
    pub case: String,
    /// Its drives.
    pub drives: Vec<DriveEntry>,
    /// Channels known to be absent.
    #[serde(default)]
    pub channels_missing: Vec<String>,
    /// The nominal simulator.
    pub nominal: Nominal,
    /// Which drives to fit and which to keep.
    #[serde(default)]
    pub suggested_split: Option<Split>,
}

/// One drive of a case.
#[derive(Debug, Clone, Deserialize)]
pub struct DriveEntry {
    /// Log of the ego vehicle.
    pub file: String,
    /// Log of the followers.
    #[serde(default)]
    pub agents: Option<String>,
    /// Desired speed of the followers, m/s.
    #[serde(default)]
    pub agents_desired_speed: Option<f64>,
}

/// Drives for the fit and drives kept back.
#[derive(Debug, Clone, Default, Deserialize)]
pub struct Split {
    /// Indices of the drives to fit.
    pub fit: Vec<usize>,
    /// Indices of the drives kept back.
    #[serde(default)]
    pub held_out: Vec<usize>,
}

/// Parameters of the linear single track.
#[derive(Debug, Clone, Deserialize)]
pub struct Nominal {
    /// kg.
    pub mass: f64,
    /// kg m².
    pub yaw_inertia: f64,
    /// Front axle to centre of gravity, m.
    pub lf: f64,
    /// Rear axle to centre of gravity, m.
    pub lr: f64,
    /// N/rad.
    pub cornering_stiffness_front: f64,
    /// N/rad.
    pub cornering_stiffness_rear: f64,
    /// First order, s.
    pub steer_lag: f64,
    /// First order, s.
    pub accel_lag: f64,
    /// m/s².
    pub rolling_decel: f64,
    /// 1/m.
    pub drag_decel_per_v2: f64,
    /// Friction coefficient.
    #[serde(default = "one")]
    pub friction: f64,
    /// The nominal follower.
    #[serde(default)]
    pub idm: Idm,
}

/// Parameters of the nominal follower.
#[derive(Debug, Clone, Deserialize)]
#[serde(default)]
pub struct Idm {
    headway: f64,
    min_gap: f64,
    max_accel: f64,
    comfort_decel: f64,
    exponent: f64,
}

impl Default for Idm {
    fn default() -> Self {
        Self { headway: 1.4, min_gap: 2.5, max_accel: 1.5, comfort_decel: 2.0, exponent: 4.0 }
    }
}

fn one() -> f64 {
    1.0
}

impl Meta {
    /// Reads and checks `meta.json` of a case folder.
    ///
    /// # Errors
    /// If the file is absent, is not such a description, or describes no vehicle that could drive.
    pub fn read(case: &Path) -> Result<Self, GapError> {
        let path = case.join("meta.json");
        let text = std::fs::read_to_string(&path).map_err(|source| GapError::Read { path: path.clone(), source })?;
        let mut meta: Self = serde_json::from_str(&text).map_err(|source| GapError::Json { path, source })?;
        if meta.case.is_empty() {
            meta.case = case.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        }
        meta.nominal.check()?;
        if meta.drives.is_empty() {
            return Err(GapError::NoDrive { case: meta.case });
        }
        Ok(meta)
    }

    /// Returns the indices of the drives to fit and of those kept back; without a split the last of several is kept.
    #[must_use]
    pub fn split(&self) -> (Vec<usize>, Vec<usize>) {
        let count = self.drives.len();
        match &self.suggested_split {
            Some(split) if split.fit.iter().any(|&d| d < count) => (
                split.fit.iter().copied().filter(|&d| d < count).collect(),
                split.held_out.iter().copied().filter(|&d| d < count).collect(),
            ),
            _ if count > 1 => ((0..count - 1).collect(), vec![count - 1]),
            _ => (vec![0], Vec::new()),
        }
    }
}

impl Nominal {
    fn check(&self) -> Result<(), GapError> {
        let bounds: [(&'static str, f64, f64, f64, &'static str); 11] = [
            ("mass", self.mass, 0.02, 80_000.0, "0.02 to 80 000 kg"),
            ("yaw_inertia", self.yaw_inertia, 1e-6, 2e6, "0.000001 to 2 000 000 kg m2"),
            ("lf", self.lf, 0.01, 10.0, "0.01 to 10 m"),
            ("lr", self.lr, 0.01, 10.0, "0.01 to 10 m"),
            ("cornering_stiffness_front", self.cornering_stiffness_front, 0.1, 5e6, "0.1 to 5 000 000 N/rad"),
            ("cornering_stiffness_rear", self.cornering_stiffness_rear, 0.1, 5e6, "0.1 to 5 000 000 N/rad"),
            ("steer_lag", self.steer_lag, 0.0, 2.0, "0 to 2 s"),
            ("accel_lag", self.accel_lag, 0.0, 3.0, "0 to 3 s"),
            ("rolling_decel", self.rolling_decel, 0.0, 3.0, "0 to 3 m/s2"),
            ("drag_decel_per_v2", self.drag_decel_per_v2, 0.0, 0.1, "0 to 0.1 1/m"),
            ("friction", self.friction, 0.02, 4.0, "0.02 to 4"),
        ];
        for (field, value, low, high, range) in bounds {
            if !(low..=high).contains(&value) {
                return Err(GapError::AbsurdVehicle { field, value, range });
            }
        }
        let radius2 = self.yaw_inertia / self.mass / (self.lf * self.lr);
        if !(0.1..=10.0).contains(&radius2) {
            let range = "0.1 to 10 times mass lf lr";
            return Err(GapError::AbsurdVehicle { field: "yaw_inertia", value: self.yaw_inertia, range });
        }
        let understeer = self.mass
            * (self.lr * self.cornering_stiffness_rear - self.lf * self.cornering_stiffness_front)
            / (self.cornering_stiffness_front * self.cornering_stiffness_rear * (self.lf + self.lr));
        if !(-0.02..=0.05).contains(&understeer) {
            let range = "an understeer gradient of -0.02 to 0.05 rad s2/m";
            return Err(GapError::AbsurdVehicle { field: "cornering_stiffness_rear", value: understeer, range });
        }
        Ok(())
    }

    /// Returns the nominal simulator, every effect absent.
    #[must_use]
    pub fn plant(&self) -> Plant {
        Plant {
            steering: Steering { lag_secs: self.steer_lag, operators: Vec::new() },
            traction: Traction { lag_secs: self.accel_lag, operators: Vec::new() },
            vehicle: Vehicle {
                nominal_mass_kg: self.mass,
                mass_kg: self.mass,
                yaw_inertia_kg_m2: self.yaw_inertia,
                front_arm_m: self.lf,
                rear_arm_m: self.lr,
                front_stiffness_n: self.cornering_stiffness_front,
                rear_stiffness_n: self.cornering_stiffness_rear,
                friction: self.friction,
                tyre_knee: TYRE_KNEE,
                load_height_m: 0.0,
                relaxation_m: 0.0,
                friction_circle: Some(FrictionCircle::default()),
                rolling_mps2: self.rolling_decel,
                drag_n_s2_m2: self.drag_decel_per_v2 * self.mass,
            },
            road: Road::default(),
            sensors: Sensors::default(),
            clock: Clock::default(),
            follower: Follower {
                headway_secs: self.idm.headway,
                min_gap_m: self.idm.min_gap,
                max_accel_mps2: self.idm.max_accel,
                comfort_decel_mps2: self.idm.comfort_decel,
                exponent: self.idm.exponent,
                desired_speed_factor: 1.0,
                delay_secs: 0.0,
                lag_secs: 0.0,
            },
            agents: Agents::default(),
            chart: Chart::default(),
        }
    }
}
