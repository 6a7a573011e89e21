//! A sample as one step of training shows it.

use ds_graph::panel::Kind;
use ds_policy::EgoView;
use ds_policy::camera::proposals::TARGETS;
use ds_policy::panel::noise_of;
use ds_space::{DVec2, Draws};

use super::dataset::Sample;
use super::loss;

/// The draw of the time.
const TIME: u64 = 103;
/// The first of the draws of noise.
const FIRST_NOISE: u64 = 1_000;

/// A sample as a step shows it: at a speed of its own.
pub(super) struct StepSample<'a> {
    pub(super) sample: &'a Sample,
    pub(super) speed_mps: f64,
    /// Whether the network is told how the car turns and accelerates.
    pub(super) motion: bool,
    /// Whether it is shown the layout image instead of the frame.
    pub(super) raster: bool,
    /// The draws of this sample in this step.
    pub(super) draws: Draws,
}

impl StepSample<'_> {
    /// Returns the numbers that the network should answer.
    pub(super) fn target(&self) -> [f32; TARGETS] {
        loss::target_of(self.sample, self.speed_mps)
    }

    /// Returns the noise that a network gets.
    pub(super) fn noise(&self, kind: Kind) -> Vec<f32> {
        noise_of(kind, &self.draws, FIRST_NOISE)
    }

    /// Returns how strongly the noise is mixed in, for a network that knows times.
    #[expect(clippy::cast_possible_truncation, reason = "below the number of times")]
    pub(super) fn time(&self, kind: Kind) -> Option<u32> {
        kind.times().map(|times| self.draws.below(TIME, u64::from(times)) as u32)
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
