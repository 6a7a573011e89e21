//! What a network of others takes and gives: names, shapes, units and axes, read from TOML and checked.

mod calibration;
mod image;

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use ds_space::{Digest, DigestWriter};
use serde::Deserialize;

pub use calibration::CalibrationSection;
pub use image::{Camera, Colour, ImageSection, Layout, Resize};

use crate::error::OnnxError;
use crate::form::{self, VERSION};
use crate::network::{Named, Network};

/// No answer has more candidates.
const MOST_PROPOSALS: usize = 1_024;
/// No two poses lie nearer or farther apart, in seconds.
const SPACING_S: RangeInclusive<f64> = 0.01..=60.0;

/// A policy of one's own.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    version: u32,
    /// Name and file.
    pub policy: PolicySection,
    /// The frames, if the network sees any.
    pub image: Option<ImageSection>,
    /// What the car knows of its motion.
    pub state: Option<StateSection>,
    /// What the navigation says.
    pub command: Option<CommandSection>,
    /// How the camera of the frames sees.
    pub calibration: Option<CalibrationSection>,
    /// The answer.
    pub plan: PlanSection,
    /// All candidates.
    pub proposals: Option<ProposalsSection>,
    /// What the network attends to.
    pub feature: Option<FeatureSection>,
    /// Where it was read from, and what was there.
    #[serde(skip)]
    path: PathBuf,
    #[serde(skip)]
    digest: Digest,
}

/// `[policy]`
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicySection {
    /// The policy's name in results.
    pub name: String,
    /// The network's file, beside the manifest.
    pub file: PathBuf,
    /// The digest of the network, if it is to be no other: see [`Network::digest`].
    pub digest: Option<String>,
}

/// `[state]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StateSection {
    /// The input's name; [1, fields].
    pub input: String,
    /// What stands in it.
    pub fields: Vec<StateField>,
    /// What each is multiplied with; 1 where the list is left out.
    #[serde(default)]
    pub scale: Vec<f32>,
}

/// One number of the state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StateField {
    /// Forward speed, in metres per second.
    SpeedMps,
    /// Forward acceleration, in metres per second squared.
    AccelerationForwardMps2,
    /// Acceleration to the left, in metres per second squared.
    AccelerationLeftMps2,
    /// Yaw rate, left positive, in radians per second.
    YawRateRadps,
    /// Road-wheel angle, left positive, in radians.
    SteeringRad,
    /// 1 if the command is to turn left.
    CommandLeft,
    /// 1 if the command is to follow the road.
    CommandStraight,
    /// 1 if the command is to turn right.
    CommandRight,
    /// 0: what the network asks for and no car knows.
    Zero,
}

/// `[command]`
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandSection {
    /// The input's name; [1, directions].
    pub input: String,
    /// Which direction each place stands for.
    pub one_hot: Vec<Direction>,
}

/// A direction of the navigation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// To the left.
    Left,
    /// Along the road.
    Straight,
    /// To the right.
    Right,
    /// Never said here.
    Unknown,
}

/// `[plan]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanSection {
    /// The output's name; its last side holds 2 or 3 numbers, the one before it the poses, all others are 1.
    pub output: String,
    /// When the first pose is due, in seconds: 0, or `spacing_s`.
    pub first_s: f64,
    /// Time between poses, 0.01 to 60 s.
    pub spacing_s: f64,
    /// What the first two numbers of a pose are.
    #[serde(default)]
    pub axes: Axes,
    /// The unit of the third.
    #[serde(default)]
    pub angle: Angle,
    /// How far before the rear axle the poses lie, in metres: 0 for poses of the rear axle.
    #[serde(default)]
    pub origin_ahead_m: f64,
    /// How a plan goes on that ends before the asked horizon.
    #[serde(default)]
    pub beyond: Beyond,
}

/// What the first two numbers of a pose are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axes {
    /// Forward, left.
    #[default]
    ForwardLeft,
    /// Forward, right; headings turn right.
    ForwardRight,
    /// Left, forward; headings from straight on, left positive.
    LeftForward,
    /// Right, forward; headings from straight on, right positive.
    RightForward,
}

/// The unit of headings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
pub enum Angle {
    /// Radians.
    #[default]
    #[serde(rename = "rad")]
    Radians,
    /// Degrees.
    #[serde(rename = "deg")]
    Degrees,
}

/// How a plan goes on that ends early.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Beyond {
    /// At the last speed and curvature.
    #[default]
    Curvature,
    /// Not at all: the last pose is held.
    Hold,
}

/// `[proposals]`
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProposalsSection {
    /// The output with the poses, as of the plan, with one more side before them: [.., proposals, poses, 2 or 3].
    pub poses: String,
    /// The output with a score each, larger being better: [.., proposals].
    pub scores: String,
}

/// `[feature]`
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FeatureSection {
    /// The output: [.., tokens, channels] or [1, channels].
    pub output: String,
}

impl Manifest {
    /// Reads a manifest; the network is not touched.
    ///
    /// # Errors
    /// [`OnnxError`] names the field and its value.
    pub fn read(path: &Path) -> Result<Self, OnnxError> {
        let (manifest, digest) = form::read::<Self>(path)?;
        let manifest = Self { path: path.to_path_buf(), digest, ..manifest };
        manifest.check().map_err(|(field, problem)| OnnxError::Field { field: field.to_owned(), problem })?;
        Ok(manifest)
    }

    fn check(&self) -> Result<(), (&'static str, String)> {
        let (policy, plan) = (&self.policy, &self.plan);
        let word = |letter: char| letter.is_ascii_lowercase() || letter.is_ascii_digit() || "-_.".contains(letter);
        let plain = (1..=64).contains(&policy.name.len()) && policy.name.chars().all(word);
        let rules = [
            (self.version == VERSION, "version", format!("is {}, known is {VERSION}", self.version)),
            (plain, "policy.name", format!("is {:?}: 1 to 64 of a-z, 0-9, - _ . are allowed", policy.name)),
            (
                SPACING_S.contains(&plan.spacing_s),
                "plan.spacing_s",
                format!("is {}, it must be {} to {} s", plan.spacing_s, SPACING_S.start(), SPACING_S.end()),
            ),
            (
                plan.first_s == 0.0 || (plan.first_s - plan.spacing_s).abs() < 1e-9,
                "plan.first_s",
                format!("is {}, it must be 0 (poses start at now) or plan.spacing_s", plan.first_s),
            ),
            (
                plan.origin_ahead_m.abs() < 10.0,
                "plan.origin_ahead_m",
                format!("is {}, it must be within 10 m of the rear axle", plan.origin_ahead_m),
            ),
        ];
        if let Some((_, field, problem)) = rules.into_iter().find(|(kept, ..)| !kept) {
            return Err((field, problem));
        }
        let names: Vec<String> = self.inputs().into_iter().map(|input| input.name).collect();
        if let Some(twice) =
            names.iter().enumerate().find_map(|(index, name)| names[..index].contains(name).then_some(name))
        {
            return Err(("input", format!("{twice:?} stands in two tables")));
        }
        self.image.as_ref().map_or(Ok(()), ImageSection::check)?;
        self.state.as_ref().map_or(Ok(()), StateSection::check)?;
        if self.calibration.is_some() && self.image.is_none() {
            return Err(("calibration", "is of the camera of [image], and there is none".to_owned()));
        }
        let directions = self.command.as_ref().is_none_or(|command| !command.one_hot.is_empty());
        if directions { Ok(()) } else { Err(("command.one_hot", "is empty".to_owned())) }
    }

    /// Returns the inputs of the network: image, state, command and calibration, those that there are.
    #[must_use]
    pub fn inputs(&self) -> Vec<Named> {
        let image = self.image.as_ref().map(|image| Named { name: image.input.clone(), shape: image.shape() });
        let state = self.state.as_ref();
        let state = state.map(|state| Named { name: state.input.clone(), shape: vec![1, state.fields.len()] });
        let command = self.command.as_ref();
        let command = command.map(|of| Named { name: of.input.clone(), shape: vec![1, of.one_hot.len()] });
        let calibration = self.calibration.iter().flat_map(CalibrationSection::inputs);
        image.into_iter().chain(state).chain(command).chain(calibration).collect()
    }

    /// Returns the outputs that are asked for: the plan, then poses and scores of the proposals, then the feature.
    fn outputs(&self) -> Vec<String> {
        let proposals = self.proposals.iter().flat_map(|proposals| [&proposals.poses, &proposals.scores]);
        let feature = self.feature.iter().map(|feature| &feature.output);
        std::iter::once(&self.plan.output).chain(proposals).chain(feature).cloned().collect()
    }

    /// Reads the network for several observations at once, the first side of each input.
    ///
    /// # Errors
    /// [`OnnxError`] if it takes no such batch.
    pub fn network_of(&self, batch: usize) -> Result<Network, OnnxError> {
        let mut inputs = self.inputs();
        inputs.iter_mut().for_each(|input| input.shape[0] = batch);
        Network::read(&self.path.with_file_name(&self.policy.file), &inputs, &self.outputs())
    }

    /// Reads the network and checks that its outputs are what the manifest says: the plan, then poses and scores of the
    /// proposals, then the feature, those that there are.
    ///
    /// # Errors
    /// [`OnnxError`] names what does not fit.
    pub fn network(&self) -> Result<Network, OnnxError> {
        let path = self.path.with_file_name(&self.policy.file);
        let network = self.network_of(1)?;
        form::meant(&path, &network, self.policy.digest.as_ref())?;
        self.check_outputs(network.outputs()).map_err(|(output, problem)| OnnxError::Shape {
            path: path.display().to_string(),
            problem: format!("output {output:?} {problem}"),
        })?;
        Ok(network)
    }

    /// Returns the digest of manifest and network, by which a result says what made it.
    #[must_use]
    pub fn digest(&self, network: &Network) -> Digest {
        let mut writer = DigestWriter::new();
        writer.digest(&self.digest).digest(network.digest());
        writer.finish()
    }

    fn check_outputs(&self, shapes: &[Vec<usize>]) -> Result<(), (String, String)> {
        let plan = &shapes[0];
        let poses = |shape: &[usize], before: usize| match shape {
            [outer @ .., poses, 2 | 3] if *poses > 0 => outer.iter().product::<usize>() == before,
            _ => false,
        };
        if !poses(plan, 1) {
            let says = format!("has shape {plan:?}; a plan is [.., poses, 2 or 3] with sides of 1 before");
            return Err((self.plan.output.clone(), says));
        }
        if let Some(proposals) = &self.proposals {
            let (candidates, scores) = (&shapes[1], &shapes[2]);
            let number: usize = scores.iter().product();
            if number > MOST_PROPOSALS {
                return Err((
                    proposals.scores.clone(),
                    format!("has {number} numbers, {MOST_PROPOSALS} proposals are allowed"),
                ));
            }
            if number == 0 || !poses(candidates, number) {
                let says =
                    format!("has shape {candidates:?}, for {number} scores [.., {number}, poses, 2 or 3] is due");
                return Err((proposals.poses.clone(), says));
            }
        }
        Ok(())
    }
}

impl StateSection {
    fn check(&self) -> Result<(), (&'static str, String)> {
        if self.fields.is_empty() {
            return Err(("state.fields", "is empty".to_owned()));
        }
        if !self.scale.is_empty() && self.scale.len() != self.fields.len() {
            let lengths = format!("has {} numbers for {} fields", self.scale.len(), self.fields.len());
            return Err(("state.scale", lengths));
        }
        if self.scale.iter().all(|scale| scale.is_finite()) {
            return Ok(());
        }
        Err(("state.scale", format!("is {:?}, it must be finite", self.scale)))
    }
}

#[cfg(test)]
mod tests;
