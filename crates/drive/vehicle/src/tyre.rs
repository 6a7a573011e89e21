//! Side forces of the two axles: linear in the slip angle up to friction times load, with load transfer and relaxation.
//!
//! F = C·α·(1 + |C·α/F_max|ⁿ)^(−1/n) with the tyre's knee n, a clip where it is infinite. C and F_max go with the axle's
//! load of now and with what drive and brakes leave of its friction. Slip angles, and how they build up in time, are
//! the integrator's.

use ds_effect::plant::Vehicle;

use crate::force::{GRAVITY_MPS2, held};

/// Load transfer leaves an axle at least and at most these shares of its static load.
const LOAD_SHARES: [f64; 2] = [0.3, 1.7];

/// Stiffness and limit of an axle under its load of now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axle {
    /// Side force over slip angle where it is small, in newtons per radian.
    pub stiffness_n: f64,
    /// Largest side force, in newtons.
    pub limit_n: f64,
}

/// An axle's side force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tyre {
    /// The force to the left, in newtons.
    pub force_n: f64,
    /// Change of the force with the slip angle of now, in newtons per radian; 0 when a clip is saturated.
    pub tangent_n: f64,
}

/// Loads the axles by weight and by the realised request, given over nominal mass; front and rear.
#[inline]
#[must_use]
pub fn axles(car: &Vehicle, request_mps2: f64) -> [Axle; 2] {
    let base_m = car.front_arm_m + car.rear_arm_m;
    let weight_n = car.mass_kg * GRAVITY_MPS2;
    let load_n = [weight_n * car.rear_arm_m / base_m, weight_n * car.front_arm_m / base_m];
    let request_n = car.nominal_mass_kg * request_mps2;
    let moved_n = request_n * car.load_height_m / base_m;
    let [least, most] = LOAD_SHARES;
    let shares = [1.0 - moved_n / load_n[0], 1.0 + moved_n / load_n[1]].map(|share| share.clamp(least, most));
    let limit_n = [car.friction * load_n[0] * shares[0], car.friction * load_n[1] * shares[1]];
    let left = match car.friction_circle {
        Some(circle) => circle.left(held(request_n, car.friction, weight_n), limit_n),
        None => [1.0; 2],
    };
    let stiffness_n = [car.front_stiffness_n * shares[0], car.rear_stiffness_n * shares[1]];
    [0, 1].map(|k| Axle { stiffness_n: left[k] * stiffness_n[k], limit_n: left[k] * limit_n[k] })
}

/// Returns the share of a change of slip that a tyre has built up after a time at a speed; 1 without a relaxation length.
#[inline]
#[must_use]
pub fn built_share(relaxation_m: f64, speed_mps: f64, secs: f64) -> f64 {
    if relaxation_m > 1e-3 { 1.0 - (-(speed_mps / relaxation_m) * secs).exp() } else { 1.0 }
}

impl Axle {
    /// Returns the force over slip angle at a slip angle, in newtons per radian.
    #[inline]
    #[must_use]
    pub fn secant_n(&self, slip_rad: f64, saturation: &Saturation) -> f64 {
        self.stiffness_n * saturation.factor((self.stiffness_n * slip_rad / self.limit_n).abs())
    }

    /// Returns the force at a slip angle, by the law itself.
    #[must_use]
    pub fn tyre(&self, slip_rad: f64, knee: f64) -> Tyre {
        let linear_n = self.stiffness_n * slip_rad;
        if knee.is_finite() {
            let knee = knee.max(SOFTEST);
            let ratio = (linear_n / self.limit_n).abs();
            let tangent = (1.0 + ratio.powf(knee)).powf(-1.0 - 1.0 / knee);
            return Tyre { force_n: linear_n * smooth(ratio, knee), tangent_n: self.stiffness_n * tangent };
        }
        if linear_n.abs() <= self.limit_n {
            Tyre { force_n: linear_n, tangent_n: self.stiffness_n }
        } else {
            Tyre { force_n: self.limit_n.copysign(linear_n), tangent_n: 0.0 }
        }
    }
}

/// The lowest knee.
const SOFTEST: f64 = 1.0;

fn smooth(ratio: f64, knee: f64) -> f64 {
    (1.0 + ratio.powf(knee)).powf(-1.0 / knee)
}

/// The factor by which an axle's stiffness falls with its linear force over its limit, tabulated for one knee: the powers
/// would take a third of the time of a fit.
#[derive(Debug, Clone)]
pub struct Saturation {
    knee: f64,
    table: Vec<f64>,
}

impl Saturation {
    const PER_UNIT: f64 = 64.0;
    const LARGEST: f64 = 4.0;

    /// Tabulates the factor of a knee.
    #[must_use]
    pub fn new(knee: f64) -> Self {
        let knee = knee.max(SOFTEST);
        let count = (Self::LARGEST * Self::PER_UNIT) as usize + 2;
        let table = (0..count).map(|k| Self::exact(k as f64 / Self::PER_UNIT, knee)).collect();
        Self { knee, table }
    }

    fn exact(ratio: f64, knee: f64) -> f64 {
        if knee.is_finite() { smooth(ratio, knee) } else { 1.0 / ratio.max(1.0) }
    }

    #[inline]
    fn factor(&self, ratio: f64) -> f64 {
        if ratio >= Self::LARGEST || ratio.is_nan() {
            return Self::exact(ratio, self.knee);
        }
        let at = ratio * Self::PER_UNIT;
        let low = at as usize;
        self.table[low] + (at - low as f64) * (self.table[low + 1] - self.table[low])
    }
}

#[cfg(test)]
mod tests;
