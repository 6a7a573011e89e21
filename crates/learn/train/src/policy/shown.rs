//! A sample as one step of training shows it.

use ds_policy::EgoView;
use ds_policy::camera::proposals::TARGETS;
use ds_space::DVec2;

use super::dataset::Sample;
use super::loss;

/// A sample as a step shows it: at a speed of its own.
pub(super) struct Shown<'a> {
    pub(super) sample: &'a Sample,
    pub(super) speed_mps: f64,
    /// Whether the network is told how the car turns and accelerates.
    pub(super) motion: bool,
}

impl Shown<'_> {
    /// Returns the numbers that the network should answer.
    pub(super) fn target(&self) -> [f32; TARGETS] {
        loss::target_of(self.sample, self.speed_mps)
    }

    /// Returns what the car knows of its motion.
    pub(super) fn ego(&self) -> EgoView {
        let told = f64::from(u8::from(self.motion));
        let [along, across] = self.sample.acceleration_mps2.map(f64::from);
        EgoView {
            speed_mps: self.speed_mps,
            yaw_rate_radps: told * f64::from(self.sample.yaw_rate_radps),
            acceleration_mps2: told * DVec2::new(along, across),
            ..EgoView::default()
        }
    }
}
