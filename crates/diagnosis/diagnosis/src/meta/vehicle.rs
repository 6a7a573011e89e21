//! The description of a case of logs of a vehicle, and its nominal simulator.

use std::path::Path;

use ds_effect::plant::{
    Agents, Chart, Clock, Follower, FrictionCircle, Plant, Road, Sensors, Steering, Traction, Vehicle,
};
use serde::{Deserialize, Serialize};

use crate::error::CaseError;
use crate::json;
use crate::meta::{FILE, name_of};

/// Name of the model of nominal vehicles.
pub const SINGLE_TRACK: &str = "linear_single_track";
/// Sharpness of the nominal tyre's saturation; 3 lies between a brush and an ideal clip.
const TYRE_KNEE: f64 = 3.0;

/// Relative difference up to which two sizes of a vehicle are the same.
const SAME_SIZE: f64 = 0.02;

/// A case of logs of a vehicle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VehicleMeta {
    /// Name of the case.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub case: String,
    /// Name of the vehicle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vehicle: Option<String>,
    /// Day of the drives, by any name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub day: Option<String>,
    /// Software that drove, by any name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub software: Option<String>,
    /// Whether the logs are of this project's own simulator, which has none of the mismatch that real vehicles have.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub simulated: bool,
    /// Its drives.
    pub drives: Vec<DriveEntry>,
    /// Channels known to be absent.
    #[serde(default)]
    pub channels_missing: Vec<String>,
    /// Channels that were computed from others.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub channels_derived: Vec<String>,
    /// Samples per second of the drives.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<f64>,
    /// The nominal simulator.
    pub nominal: Nominal,
    /// Which drives to fit and which to keep.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub suggested_split: Option<Split>,
    /// Cameras of the vehicle.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cameras: Vec<CameraEntry>,
    /// How the simulator's other road users drove.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agents: Option<String>,
    /// From when on they reacted to the vehicle, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from_secs: Option<f64>,
}

/// One drive of a case.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct DriveEntry {
    /// Log of the ego vehicle.
    pub file: String,
    /// Log of the followers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agents: Option<String>,
    /// Desired speed of the followers, m/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agents_desired_speed: Option<f64>,
    /// The log that it was cut from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log: Option<String>,
    /// Where in that log it begins, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from_secs: Option<f64>,
}

/// A camera by its pinhole and its height over the road.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraEntry {
    /// Its name.
    pub name: String,
    /// Columns, px.
    pub width: u32,
    /// Rows, px.
    pub height: u32,
    /// Focal length across, px.
    pub fx: f64,
    /// Focal length down, px.
    pub fy: f64,
    /// Column of the axis, px.
    pub cx: f64,
    /// Row of the axis, px.
    pub cy: f64,
    /// Height over the road, m.
    pub height_m: f64,
}

/// Drives for the fit and drives kept back.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Split {
    /// Indices of the drives to fit.
    pub fit: Vec<usize>,
    /// Indices of the drives kept back.
    #[serde(default)]
    pub held_out: Vec<usize>,
}

/// Parameters of the linear single track.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Nominal {
    /// Name of the model.
    #[serde(default = "single_track")]
    pub model: String,
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
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Idm {
    /// Time gap, s.
    pub headway: f64,
    /// Gap at standstill, m.
    pub min_gap: f64,
    /// m/s².
    pub max_accel: f64,
    /// m/s².
    pub comfort_decel: f64,
    /// Exponent of the free acceleration.
    pub exponent: f64,
}

impl Default for Idm {
    fn default() -> Self {
        Self { headway: 1.4, min_gap: 2.5, max_accel: 1.5, comfort_decel: 2.0, exponent: 4.0 }
    }
}

fn single_track() -> String {
    SINGLE_TRACK.to_owned()
}

fn one() -> f64 {
    1.0
}

impl VehicleMeta {
    /// Describes a case by its drives and its nominal simulator alone.
    #[must_use]
    pub fn new(drives: Vec<DriveEntry>, nominal: Nominal) -> Self {
        Self {
            case: String::new(),
            vehicle: None,
            day: None,
            software: None,
            simulated: false,
            drives,
            channels_missing: Vec::new(),
            channels_derived: Vec::new(),
            rate_hz: None,
            nominal,
            suggested_split: None,
            cameras: Vec::new(),
            agents: None,
            from_secs: None,
        }
    }

    /// Reads and checks `meta.json` of a case folder.
    ///
    /// # Errors
    /// If the file is absent, is not such a description, or describes no vehicle that could drive.
    pub fn read(case: &Path) -> Result<Self, CaseError> {
        let mut meta: Self = json::read(&case.join(FILE))?;
        if meta.case.is_empty() {
            meta.case = name_of(case);
        }
        meta.check()?;
        let Stated { nominal: StatedNominal { wheelbase } } = json::read(&case.join(FILE))?;
        let own = meta.nominal.lf + meta.nominal.lr;
        match wheelbase.filter(|stated| (stated - own).abs() > SAME_SIZE * own) {
            Some(stated) => Err(meta.refused(format!("nominal.wheelbase is {stated} m, lf and lr make {own:.3} m"))),
            None => Ok(meta),
        }
    }

    fn refused(&self, why: String) -> CaseError {
        CaseError::Description { why, case: self.case.clone() }
    }

    /// Writes `meta.json` into a case folder.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, case: &Path) -> Result<(), CaseError> {
        json::write(self, &case.join(FILE))
    }

    /// Checks what the types do not say.
    ///
    /// # Errors
    /// If there is no drive or one twice, no such vehicle could drive, its model is another one, or the split names drives
    /// that are not there or one twice.
    pub fn check(&self) -> Result<(), CaseError> {
        self.nominal.check()?;
        if self.nominal.model != SINGLE_TRACK {
            let model = &self.nominal.model;
            return Err(self.refused(format!("nominal.model is {model:?}, there is {SINGLE_TRACK:?}")));
        }
        if self.drives.is_empty() {
            return Err(CaseError::NoDrive { case: self.case.clone() });
        }
        let files: Vec<&str> = self.drives.iter().map(|drive| drive.file.as_str()).collect();
        if let Some(file) = twice(&files) {
            return Err(self.refused(format!("drives name {file:?} twice")));
        }
        let Some(split) = &self.suggested_split else { return Ok(()) };
        let named: Vec<usize> = split.fit.iter().chain(&split.held_out).copied().collect();
        if let Some(drive) = twice(&named) {
            return Err(self.refused(format!("suggested_split names drive {drive} twice")));
        }
        match named.iter().find(|drive| **drive >= files.len()) {
            Some(drive) => {
                Err(self.refused(format!("suggested_split names drive {drive}, the last one is {}", files.len() - 1)))
            }
            None => Ok(()),
        }
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

/// Returns the first that is among those before it.
fn twice<T: PartialEq>(all: &[T]) -> Option<&T> {
    all.iter().enumerate().find(|(k, one)| all[..*k].contains(one)).map(|(_, one)| one)
}

/// What a description may say of its vehicle and the nominal simulator has no parameter for.
#[derive(Deserialize)]
struct Stated {
    nominal: StatedNominal,
}

#[derive(Deserialize)]
struct StatedNominal {
    #[serde(default)]
    wheelbase: Option<f64>,
}

impl Nominal {
    fn check(&self) -> Result<(), CaseError> {
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
                return Err(CaseError::AbsurdVehicle { field, value, range });
            }
        }
        let radius2 = self.yaw_inertia / self.mass / (self.lf * self.lr);
        if !(0.1..=10.0).contains(&radius2) {
            let range = "0.1 to 10 times mass lf lr";
            return Err(CaseError::AbsurdVehicle { field: "yaw_inertia", value: self.yaw_inertia, range });
        }
        let understeer = self.mass
            * (self.lr * self.cornering_stiffness_rear - self.lf * self.cornering_stiffness_front)
            / (self.cornering_stiffness_front * self.cornering_stiffness_rear * (self.lf + self.lr));
        if !(-0.02..=0.05).contains(&understeer) {
            let range = "an understeer gradient of -0.02 to 0.05 rad s2/m";
            return Err(CaseError::AbsurdVehicle { field: "cornering_stiffness_rear", value: understeer, range });
        }
        Ok(())
    }

    /// Describes a nominal simulator; what the linear single track has no parameter for is left out.
    #[must_use]
    pub fn of(plant: &Plant) -> Self {
        let (car, follower) = (&plant.vehicle, &plant.follower);
        Self {
            model: single_track(),
            mass: car.mass_kg,
            yaw_inertia: car.yaw_inertia_kg_m2,
            lf: car.front_arm_m,
            lr: car.rear_arm_m,
            cornering_stiffness_front: car.front_stiffness_n,
            cornering_stiffness_rear: car.rear_stiffness_n,
            steer_lag: plant.steering.lag_secs,
            accel_lag: plant.traction.lag_secs,
            rolling_decel: car.rolling_mps2,
            drag_decel_per_v2: car.drag_n_s2_m2 / car.mass_kg,
            friction: car.friction,
            idm: Idm {
                headway: follower.headway_secs,
                min_gap: follower.min_gap_m,
                max_accel: follower.max_accel_mps2,
                comfort_decel: follower.comfort_decel_mps2,
                exponent: follower.exponent,
            },
        }
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
            laws: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn meta() -> VehicleMeta {
        let nominal = Nominal {
            model: single_track(),
            mass: 1500.0,
            yaw_inertia: 2500.0,
            lf: 1.3,
            lr: 1.45,
            cornering_stiffness_front: 85_000.0,
            cornering_stiffness_rear: 98_000.0,
            steer_lag: 0.07,
            accel_lag: 0.12,
            rolling_decel: 0.1,
            drag_decel_per_v2: 0.01 / 3.0,
            friction: 1.0,
            idm: Idm::default(),
        };
        let drive = DriveEntry {
            file: "a.csv".to_owned(),
            agents_desired_speed: Some(14.0),
            from_secs: Some(1.0 / 3.0),
            ..DriveEntry::default()
        };
        VehicleMeta {
            case: "van".to_owned(),
            channels_missing: vec!["ay".to_owned()],
            suggested_split: Some(Split { fit: vec![0], held_out: Vec::new() }),
            agents: Some("idm-all".to_owned()),
            ..VehicleMeta::new(vec![drive], nominal)
        }
    }

    #[test]
    fn what_was_written_is_read_to_the_bit() {
        let folder = tempfile::tempdir().expect("a folder");
        meta().write(folder.path()).expect("it can be written");
        assert_eq!(VehicleMeta::read(folder.path()).expect("it can be read"), meta());
    }

    #[test]
    fn what_is_damaged_is_refused_by_its_key() {
        let text = serde_json::to_string(&meta()).expect("a description is JSON");
        let rows = [
            (r#""mass":1500.0"#, r#""mass":"heavy""#, "nominal.mass"),
            (r#""file":"a.csv""#, r#""file":7"#, "drives[0].file"),
            (r#""fit":[0]"#, r#""fit":[-1]"#, "suggested_split.fit[0]"),
            (r#""lr":1.45,"#, "", "lr"),
        ];
        for (sound, damaged, key) in rows {
            assert!(text.contains(sound), "{sound}");
            let error = json::parse::<VehicleMeta>(&text.replace(sound, damaged)).expect_err(key);
            assert!(error.to_string().contains(key), "{key}: {error}");
        }
    }

    #[test]
    fn what_names_nothing_or_one_thing_twice_is_refused_by_its_key() {
        let text = serde_json::to_string(&meta()).expect("a description is JSON");
        let folder = tempfile::tempdir().expect("a folder");
        let read = |text: &str| {
            std::fs::write(folder.path().join(FILE), text).expect("it can be written");
            VehicleMeta::read(folder.path())
        };
        let file = r#"{"file":"a.csv","agents_desired_speed":14.0,"from_secs":0.3333333333333333}"#;
        let fit = r#""fit":[0]"#;
        let rows = [
            (file, format!("{file},{file}"), r#"drives name "a.csv" twice"#),
            (fit, r#""fit":[0,0]"#.to_owned(), "suggested_split names drive 0 twice"),
            (r#""held_out":[]"#, r#""held_out":[0]"#.to_owned(), "suggested_split names drive 0 twice"),
            (fit, r#""fit":[0,9]"#.to_owned(), "suggested_split names drive 9, the last one is 0"),
            (SINGLE_TRACK, "multibody".to_owned(), "nominal.model"),
            (r#""lr":1.45,"#, r#""lr":1.45,"wheelbase":9.9,"#.to_owned(), "nominal.wheelbase is 9.9"),
        ];
        for (sound, damaged, why) in rows {
            assert!(text.contains(sound), "{sound} in {text}");
            let error = read(&text.replacen(sound, &damaged, 1)).expect_err(why);
            assert!(error.to_string().contains(why), "{why}: {error}");
        }
        read(&text.replace(r#""lr":1.45,"#, r#""lr":1.45,"wheelbase":2.75,"#)).expect("arms that make the wheelbase");
    }

    #[test]
    fn an_absurd_vehicle_is_refused_by_its_key() {
        let mut meta = meta();
        meta.nominal.lf = 40.0;
        assert!(matches!(meta.check(), Err(CaseError::AbsurdVehicle { field: "lf", .. })));
    }
}
