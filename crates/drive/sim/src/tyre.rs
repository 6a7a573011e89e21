//! Side forces of the two axles: linear in the slip angle up to friction times load, with load transfer and relaxation.

use ds_effect::plant::Vehicle;

use crate::plant::GRAVITY_MPS2;

/// An axle's side force.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tyre {
    pub(crate) force_n: f64,
    /// Change of the force with the slip angle of now; 0 when saturated.
    pub(crate) stiffness_n: f64,
}

/// Both axles' side forces.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Forces {
    pub(crate) front: Tyre,
    pub(crate) rear: Tyre,
}

/// Stiffness and limit of both axles under their load of now.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tyres {
    stiffness_n: [f64; 2],
    limit_n: [f64; 2],
    knee: f64,
    relaxation_m: f64,
}

impl Tyres {
    /// Loads the axles by weight and by the drive force, given over nominal mass.
    pub(crate) fn under(car: &Vehicle, drive_mps2: f64) -> Self {
        let base_m = car.front_arm_m + car.rear_arm_m;
        let weight_n = car.mass_kg * GRAVITY_MPS2;
        let load_n = [weight_n * (car.rear_arm_m / base_m), weight_n * (car.front_arm_m / base_m)];
        let moved_n = car.nominal_mass_kg * drive_mps2 * car.load_height_m / base_m;
        let factor = [1.0 - moved_n / load_n[0], 1.0 + moved_n / load_n[1]].map(|factor| factor.clamp(0.3, 1.7));
        let limit_n = [car.friction * load_n[0] * factor[0], car.friction * load_n[1] * factor[1]];
        let circle = car.friction_circle;
        let left = circle.map_or([1.0; 2], |circle| circle.left(car.nominal_mass_kg * drive_mps2, limit_n));
        Self {
            stiffness_n: [car.front_stiffness_n * factor[0] * left[0], car.rear_stiffness_n * factor[1] * left[1]],
            limit_n: [limit_n[0] * left[0], limit_n[1] * left[1]],
            knee: car.tyre_knee,
            relaxation_m: car.relaxation_m,
        }
    }

    /// Returns the forces at slip angles; with a relaxation length they build up over the distance driven.
    pub(crate) fn forces(&self, slip_rad: [f64; 2], (driven_m, built_rad): (f64, &mut [f64; 2])) -> Forces {
        let share = if self.relaxation_m > 1e-3 { 1.0 - (-driven_m / self.relaxation_m).exp() } else { 1.0 };
        for (built, slip) in built_rad.iter_mut().zip(slip_rad) {
            *built = if share < 1.0 { *built + share * (slip - *built) } else { slip };
        }
        let axle = |i: usize| {
            let tyre = self.tyre(built_rad[i], i);
            Tyre { stiffness_n: share * tyre.stiffness_n, ..tyre }
        };
        Forces { front: axle(0), rear: axle(1) }
    }

    fn tyre(&self, slip_rad: f64, axle: usize) -> Tyre {
        let (stiffness_n, limit_n) = (self.stiffness_n[axle], self.limit_n[axle]);
        let linear_n = stiffness_n * slip_rad;
        if self.knee.is_finite() {
            let n = self.knee.max(1.0);
            let ratio = 1.0 + (linear_n / limit_n).abs().powf(n);
            return Tyre {
                force_n: linear_n * ratio.powf(-1.0 / n),
                stiffness_n: stiffness_n * ratio.powf(-1.0 - 1.0 / n),
            };
        }
        if linear_n.abs() <= limit_n {
            Tyre { force_n: linear_n, stiffness_n }
        } else {
            Tyre { force_n: limit_n.copysign(linear_n), stiffness_n: 0.0 }
        }
    }
}
