//! Body of `diagnosis`: what a gap diagnosis says of the last seconds of a drive.
//!
//! Values as the diagnosis gives them, in the units that it names; window ends in simulation time.

use ds_effect::Verdict;
use ds_space::{DigestWriter, SimTime};

/// One effect that was considered.
#[derive(Debug, Clone, PartialEq)]
pub struct DiagnosedEffect {
    /// Its id.
    pub id: String,
    /// Its probability.
    pub probability: f64,
    /// Its estimate; absent where it was not fitted or has no finite value.
    pub value: Option<f64>,
    /// Unit of estimate and interval.
    pub unit: String,
    /// Ends of the 90 % interval, absent where they are not finite.
    pub interval90: [Option<f64>; 2],
    /// Whether it belongs to the corrected model.
    pub chosen: bool,
}

/// A cell in which the gap is beyond the noise floor.
#[derive(Debug, Clone, PartialEq)]
pub struct GapCell {
    /// The channel.
    pub channel: String,
    /// What is binned and which bin, in rising order of the former, each once; what is absent means all.
    pub bins: Vec<(String, String)>,
    /// Root mean square in units of the noise floor.
    pub effect_size: f64,
    /// False-discovery controlled p-value; absent where nothing was tested.
    pub q_value: Option<f64>,
}

/// Body of `diagnosis`.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnosis {
    /// First and last moment of the window.
    pub window: (SimTime, SimTime),
    /// Whose log was diagnosed against the nominal simulator; empty for the episode's own.
    pub reference: String,
    /// What was found.
    pub verdict: Verdict,
    /// Probability that nothing is missing.
    pub p_none: f64,
    /// Probability that what is missing is not in the library.
    pub p_unknown: f64,
    /// Effects considered, likeliest first.
    pub effects: Vec<DiagnosedEffect>,
    /// Where the gap is, largest first.
    pub cells: Vec<GapCell>,
    /// Channel and root mean square of running drive minus reference, in SI units; empty without a reference.
    pub differences: Vec<(String, f64)>,
}

impl Diagnosis {
    /// Returns the effects of the corrected model, likeliest first.
    pub fn chosen(&self) -> impl Iterator<Item = &DiagnosedEffect> {
        self.effects.iter().filter(|effect| effect.chosen)
    }

    /// Adds the payload fields to a digest.
    pub fn digest_into(&self, writer: &mut DigestWriter) {
        writer.i64(self.window.0.0).i64(self.window.1.0).text(&self.reference).u32(self.verdict as u32);
        writer.f64(self.p_none).f64(self.p_unknown).u64(self.effects.len() as u64);
        for effect in &self.effects {
            writer.text(&effect.id).f64(effect.probability).text(&effect.unit).bool(effect.chosen);
            for number in [effect.value, effect.interval90[0], effect.interval90[1]] {
                writer.bool(number.is_some()).f64(number.unwrap_or(0.0));
            }
        }
        writer.u64(self.cells.len() as u64);
        for cell in &self.cells {
            writer
                .text(&cell.channel)
                .f64(cell.effect_size)
                .f64(cell.q_value.unwrap_or(-1.0))
                .u64(cell.bins.len() as u64);
            for (axis, bin) in &cell.bins {
                writer.text(axis).text(bin);
            }
        }
        writer.u64(self.differences.len() as u64);
        for (channel, rms) in &self.differences {
            writer.text(channel).f64(*rms);
        }
    }
}
