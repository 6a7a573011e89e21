//! The experiment as written to `next.json`: what to drive, what it tells apart, what it leaves of the envelope, and the runs
//! that were driven.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::envelope::{Envelope, Margin};

/// Version of this schema.
pub(crate) const SCHEMA: u32 = 1;

/// Said of a manoeuvre that a search made of one of the library.
pub(crate) const CHANGED: &str = ", changed";
/// Said of one that is driven more gently, so that it holds the envelope.
pub(crate) const GENTLER: &str = ", gentler";

/// The next experiment of a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Next {
    /// Version of the schema.
    pub schema_version: u32,
    /// The case.
    pub case: String,
    /// Seed of the search and of the draws.
    pub seed: u64,
    /// What the diagnosis leaves, likeliest first.
    pub hypotheses: Vec<Hypothesis>,
    /// Probability that nothing of these is at work, which no manoeuvre here is designed for.
    pub p_unknown: f64,
    /// What is unknown of the hypotheses, nat.
    pub entropy_nats: f64,
    /// The manoeuvre; absent where nothing is worth a run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub planned: Option<Planned>,
    /// Runs that were driven.
    #[serde(default)]
    pub runs: Vec<Run>,
    /// Runs whose log was refused, and which count for nothing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub refused: Vec<Refused>,
    /// Why nothing more is driven or proposed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended: Option<String>,
}

/// An explanation that a diagnosis leaves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hypothesis {
    /// Its effects; none for the ordinary mismatch alone.
    pub effects: Vec<String>,
    /// Probability among the hypotheses.
    pub probability: f64,
}

/// A manoeuvre that was designed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Planned {
    /// What the search began from: a manoeuvre of the library, or that a search changed it.
    pub from: String,
    /// Its numbers.
    pub design: BTreeMap<String, f64>,
    /// Its length, s.
    pub secs: f64,
    /// Lower bound of what its log tells of the hypotheses, nat.
    pub nats: f64,
    /// Hypotheses that it tells apart, most so first.
    pub separates: Vec<Pair>,
    /// What it leaves of the envelope.
    pub envelope: Checked,
    /// Manoeuvres that were considered, best first.
    pub considered: Vec<Considered>,
    /// Simulated drives of the search.
    pub rollouts: usize,
    /// What each hypothesis predicts.
    pub predicted: Vec<Curves>,
}

impl Planned {
    /// Returns the manoeuvre of the library that the search began from.
    #[must_use]
    pub fn begun(&self) -> &str {
        self.from.trim_end_matches(GENTLER).trim_end_matches(CHANGED)
    }
}

/// Two hypotheses and how far a log would tell them apart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Pair {
    /// Effects of the one.
    pub one: Vec<String>,
    /// Effects of the other.
    pub other: Vec<String>,
    /// Bhattacharyya distance of what they predict, nat.
    pub nats: f64,
}

/// An envelope and what draws of hypothesis and ordinary mismatch leave of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Checked {
    /// The limits.
    pub limits: Envelope,
    /// Draws; none of them left it.
    pub draws: usize,
    /// Distance from each limit over all draws.
    pub margins: Vec<Margin>,
}

/// A manoeuvre of the search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Considered {
    /// Where it comes from.
    pub from: String,
    /// Lower bound of what its log tells, nat.
    pub nats: f64,
    /// Whether it stays within the envelope in all draws, where that was drawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holds: Option<bool>,
}

/// What the hypotheses predict of one channel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Curves {
    /// The channel.
    pub channel: String,
    /// Time since the start, s.
    pub t: Vec<f64>,
    /// One for each hypothesis.
    pub each: Vec<Curve>,
    /// Standard deviation of the sensor's noise, in the channel's unit.
    pub noise: f64,
}

/// What one hypothesis predicts of a channel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Curve {
    /// Its effects.
    pub effects: Vec<String>,
    /// Values, in SI units.
    pub values: Vec<f64>,
}

/// A run that was driven for nothing: the manoeuvre that it came from is not begun from again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Refused {
    /// Its number, from 1, among all runs.
    pub run: usize,
    /// What the manoeuvre came from.
    pub from: String,
    /// Its numbers.
    pub design: BTreeMap<String, f64>,
    /// Why its log was refused.
    pub why: String,
}

/// A run that was driven.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Its number, from 1.
    pub run: usize,
    /// File of its log in the grown case.
    pub file: String,
    /// What the manoeuvre came from.
    pub from: String,
    /// Its numbers.
    pub design: BTreeMap<String, f64>,
    /// Lower bound of what its log was to tell, nat.
    pub nats: f64,
    /// What the car really left of the envelope.
    pub margins: Vec<Margin>,
    /// Whether it left it.
    pub left_envelope: bool,
    /// What the diagnosis with its log finds likeliest.
    pub effects: Vec<String>,
    /// Probability of that among the hypotheses.
    pub probability: f64,
    /// Probability that nothing of the library explains the logs.
    pub p_unknown: f64,
}
