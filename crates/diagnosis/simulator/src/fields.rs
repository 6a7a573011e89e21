//! The single track's parameters by name: what a simulator may declare, and how a value of ours becomes one of its own.

use ds_effect::Plant;
use ds_effect::plant::FrictionCircle;

use crate::message::{Hello, ParameterEntry};

/// A parameter of vehicle or road.
pub(crate) struct Field {
    /// Its name in a simulator's hello.
    pub(crate) name: &'static str,
    /// Its unit.
    pub(crate) unit: &'static str,
    /// Whether it acts along the car.
    pub(crate) along: bool,
    /// Whether it acts across the car.
    pub(crate) across: bool,
    /// Typical size of a change, by which changes are compared.
    pub(crate) scale: f64,
    /// Reads it.
    pub(crate) get: fn(&Plant) -> f64,
    /// Sets it.
    pub(crate) set: fn(&mut Plant, f64),
}

macro_rules! field {
    ($name:literal, $unit:literal, $along:literal, $across:literal, $scale:literal, $($path:ident).+) => {
        Field { name: $name, unit: $unit, along: $along, across: $across, scale: $scale,
            get: |plant| plant.$($path).+, set: |plant, value| plant.$($path).+ = value }
    };
}

/// Every parameter of vehicle and road.
pub(crate) const FIELDS: &[Field] = &[
    field!("mass_kg", "kg", true, true, 150.0, vehicle.mass_kg),
    field!("yaw_inertia_kg_m2", "kg m^2", false, true, 300.0, vehicle.yaw_inertia_kg_m2),
    field!("front_arm_m", "m", false, true, 0.1, vehicle.front_arm_m),
    field!("rear_arm_m", "m", false, true, 0.1, vehicle.rear_arm_m),
    field!("front_stiffness_n", "N/rad", false, true, 2e4, vehicle.front_stiffness_n),
    field!("rear_stiffness_n", "N/rad", false, true, 2e4, vehicle.rear_stiffness_n),
    field!("friction", "1", true, true, 0.2, vehicle.friction),
    field!("tyre_knee", "1", false, true, 1.0, vehicle.tyre_knee),
    field!("load_height_m", "m", false, true, 0.2, vehicle.load_height_m),
    field!("relaxation_m", "m", false, true, 0.2, vehicle.relaxation_m),
    Field {
        name: "front_drive",
        unit: "1",
        along: false,
        across: true,
        scale: 0.3,
        get: |plant| plant.vehicle.friction_circle.map_or(-1.0, |circle| circle.front_drive),
        set: |plant, value| {
            plant.vehicle.friction_circle = (value >= 0.0).then_some(FrictionCircle { front_drive: value });
        },
    },
    field!("rolling_mps2", "m/s^2", true, false, 0.05, vehicle.rolling_mps2),
    field!("drag_n_s2_m2", "N s^2/m^2", true, false, 0.2, vehicle.drag_n_s2_m2),
    field!("grade_rad", "rad", true, false, 0.02, road.grade_rad),
    field!("bank_rad", "rad", false, true, 0.02, road.bank_rad),
    field!("wind_x_mps", "m/s", true, true, 4.0, road.wind_x_mps),
    field!("wind_y_mps", "m/s", true, true, 4.0, road.wind_y_mps),
];

/// Tells whether a change of a field is one.
fn moved(field: &Field, a: &Plant, b: &Plant) -> bool {
    ((field.get)(a) - (field.get)(b)).abs() > 1e-12 * field.scale
}

/// Returns the names of fields in which two plants differ.
pub(crate) fn differing<'a>(a: &'a Plant, b: &'a Plant) -> impl Iterator<Item = &'static Field> + 'a {
    FIELDS.iter().filter(|field| moved(field, a, b))
}

/// Returns a simulator's value for what differs between a plant and the one that the simulator stands for: in the same
/// ratio to its own nominal value, or by the same difference where either is 0.
#[must_use]
pub(crate) fn declared(entry: &ParameterEntry, field: &Field, plant: &Plant, reference: &Plant) -> f64 {
    let (value, usual) = ((field.get)(plant), (field.get)(reference));
    let asked = if usual > 0.0 && entry.nominal > 0.0 {
        // exact where both mean the same
        if usual.to_bits() == entry.nominal.to_bits() { value } else { entry.nominal * (value / usual) }
    } else {
        entry.nominal + (value - usual)
    };
    asked.clamp(entry.low, entry.high)
}

/// Returns what a simulator declares for a field.
#[must_use]
pub(crate) fn entry<'a>(hello: &'a Hello, field: &Field) -> Option<&'a ParameterEntry> {
    hello.parameters.iter().find(|parameter| parameter.name == field.name)
}
