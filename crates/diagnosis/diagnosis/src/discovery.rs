//! A law outside the library as written to `diagnosis.json`: where in the loop something acts, and what it is.

use ds_effect::Law;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

use crate::null;

/// What a search for a law came to.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Discovery {
    /// Points of the loop at which something may act, likeliest first; what is left to 1 is [`Self::p_none`].
    pub insertion: Vec<Place>,
    /// What acts there; absent where no law was found that holds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub law: Option<FoundLaw>,
    /// How far the law shrinks the gap; absent where there is none, or no gap beyond the floor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub share_explained: Option<LawShare>,
    /// Log score that the law gains on drives kept from the fit, where nothing is fitted; only where how far it shrinks the gap
    /// cannot be measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kept_gain: Option<f64>,
    /// Share of the samples of the drives on which that was measured at which a signal of the law lies beyond the range on which it was
    /// found; absent where there is no law or it names no range.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub extrapolated_share: Option<f64>,
    /// Log evidence of the best law at the likeliest point over the ordinary mismatch alone.
    #[serde(deserialize_with = "null::number")]
    pub evidence_gain: f64,
    /// Its predictive log score on drives left out of the fit, summed; absent where no law was worth a fit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heldout_gain: Option<f64>,
    /// Probability that nothing acts at any point.
    #[serde(deserialize_with = "null::number")]
    pub p_none: f64,
    /// Why no law is offered, or what could not be had of the one that is, in one sentence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// Share of samples beyond the range of a law from which it is warned of.
pub const EXTRAPOLATED: f64 = 0.1;

/// A point of the loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// `steering`, `drive`, `lateral.front`, `lateral.rear`, `lateral.body`, `sensor.CHANNEL` or `follower`.
    pub id: String,
    /// Probability that something acts there.
    #[serde(deserialize_with = "null::number")]
    pub probability: f64,
}

/// A law.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FoundLaw {
    /// The whole of it, as `run --law` takes it; ranges in brackets are those on which it was found.
    pub text: String,
    /// What it is the sum of.
    pub terms: Vec<FoundTerm>,
    /// How it is written.
    pub kind: LawKind,
    /// Where it acts, more exactly than the point of the loop: `steering.linkage` lies behind the position sensor.
    pub port: String,
    /// Unit of what is added there.
    pub unit: String,
    /// Laws of other ports that these data cannot tell from it.
    pub equivalent: Vec<String>,
    /// Whether every term is kept, with one sign, in at least four of five refits without one drive.
    pub stable: bool,
}

/// One summand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FoundTerm {
    /// A product of declared primitives.
    pub expression: String,
    /// What it is multiplied by.
    #[serde(deserialize_with = "null::number")]
    pub coefficient: f64,
    /// 90 % interval of the coefficient.
    #[serde(deserialize_with = "null::pair")]
    pub interval90: [f64; 2],
}

/// How a law is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LawKind {
    /// As a sum of products.
    Expression,
    /// As a curve over one signal, by its values at even steps.
    Table,
}

/// How far a law shrinks the gap.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LawShare {
    /// The metric, as in `how_far`.
    pub metric: String,
    /// Share of the gap beyond the floor that the law explains, after the ordinary mismatch.
    #[serde(deserialize_with = "null::number")]
    pub value: f64,
    /// 90 % interval of the share.
    #[serde(default, deserialize_with = "null::known_pair", skip_serializing_if = "Option::is_none")]
    pub interval90: Option<[f64; 2]>,
    /// `heldout` or `fit`.
    pub on: String,
}

/// Reads texts of laws; one that is none is refused.
pub(crate) fn laws<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<String>, D::Error> {
    let texts = Vec::<String>::deserialize(from)?;
    texts.iter().try_for_each(|text| Law::parse(text).map(|_| ()).map_err(D::Error::custom))?;
    Ok(texts)
}
