//! The ego's rectangle: its size and where the rear axle lies in it.

use ds_space::plane::OrientedBox;
use ds_space::{DVec2, PoseSe2};
use ds_world::VehicleParameters;

use crate::constants::navsim_car;
use crate::error::{ScoreError, finite, sized};

/// Size of the ego and the place of its rear axle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    /// Length, in metres.
    pub length_m: f64,
    /// Width, in metres.
    pub width_m: f64,
    /// From the rear axle forward to the centre of the box, in metres.
    pub rear_axle_to_centre_m: f64,
    /// Distance between the axles, in metres.
    pub wheel_base_m: f64,
}

impl Footprint {
    /// The car that NAVSIM scores, whatever was driven.
    pub const NAVSIM: Self = Self {
        length_m: navsim_car::LENGTH_M,
        width_m: navsim_car::WIDTH_M,
        rear_axle_to_centre_m: navsim_car::AXLE_TO_CENTRE_M,
        wheel_base_m: navsim_car::WHEEL_BASE_M,
    };

    /// Checks that the box has an area.
    ///
    /// # Errors
    /// [`ScoreError::NoSize`] or [`ScoreError::NotFinite`].
    pub fn check(&self) -> Result<(), ScoreError> {
        sized(self.length_m, self.width_m, || "ego".to_owned())?;
        finite(self.rear_axle_to_centre_m, || "ego.rear_axle_to_centre".to_owned())?;
        finite(1.0 / self.wheel_base_m, || "ego.wheel_base".to_owned())
    }

    /// Returns the box of an ego whose rear axle is at a pose.
    #[must_use]
    pub fn at(&self, rear_axle: &PoseSe2) -> OrientedBox {
        let forward = rear_axle.forward();
        OrientedBox {
            centre: rear_axle.position + forward * self.rear_axle_to_centre_m,
            forward,
            half_length_m: 0.5 * self.length_m,
            half_width_m: 0.5 * self.width_m,
        }
    }

    /// Returns the position of the rear axle of a box, in metres.
    #[must_use]
    pub fn rear_axle(&self, footprint: &OrientedBox) -> DVec2 {
        footprint.centre - footprint.forward * self.rear_axle_to_centre_m
    }
}

impl From<&VehicleParameters> for Footprint {
    fn from(vehicle: &VehicleParameters) -> Self {
        Self {
            length_m: vehicle.size.length_m,
            width_m: vehicle.size.width_m,
            rear_axle_to_centre_m: vehicle.rear_axle_to_centre_m,
            wheel_base_m: vehicle.wheel_base_m,
        }
    }
}
