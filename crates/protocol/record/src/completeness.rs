//! What a recording holds, what it should hold, and what is therefore missing.
//!
//! A complete recording ends with the record `dreamstream.complete`: status, reason, committed iterations, messages per
//! channel, digests. One without it is read up to its last commit and compared with what the scene's specification asks
//! for, topic by topic and tick by tick.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use ds_space::{CameraId, Digest};
use ds_topic::{EpisodeSpec, Topic};

use crate::channel::ChannelKey;
use crate::digests::Digests;

/// How an attempt ended, as its completeness record says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Completeness {
    /// `completed`, `failed` or `aborted`.
    pub status: String,
    /// Why; empty if there is nothing to say.
    pub reason: String,
    /// Committed iterations, the initial one included.
    pub iterations: u32,
    /// Messages per channel, by the channel's name.
    pub messages: BTreeMap<String, u64>,
    /// Digests of the streams.
    pub digests: Digests,
}

impl Completeness {
    pub(crate) fn to_metadata(&self) -> BTreeMap<String, String> {
        let mut entries = BTreeMap::from([
            ("status".to_owned(), self.status.clone()),
            ("reason".to_owned(), self.reason.clone()),
            ("iterations".to_owned(), self.iterations.to_string()),
            ("digest.world".to_owned(), self.digests.world.to_string()),
            ("digest.layout".to_owned(), self.digests.layout.to_string()),
            ("digest.frame".to_owned(), self.digests.frame.to_string()),
        ]);
        entries.extend(self.messages.iter().map(|(name, count)| (format!("messages.{name}"), count.to_string())));
        entries
    }

    /// Reads the record, or names the entry that is missing or odd.
    pub(crate) fn from_metadata(entries: &BTreeMap<String, String>) -> Result<Self, String> {
        let get = |key: &str| entries.get(key).ok_or_else(|| format!("no entry {key:?} in its completeness record"));
        let digest = |key: &str| {
            let text = get(key)?;
            Digest::from_hex(text).ok_or_else(|| format!("{key:?} is {text:?}, not a digest"))
        };
        let number = |key: &str, text: &str| {
            text.parse::<u64>().map_err(|error| format!("{key:?} is {text:?}, not a number: {error}"))
        };
        let mut messages = BTreeMap::new();
        for (key, text) in entries {
            if let Some(name) = key.strip_prefix("messages.") {
                messages.insert(name.to_owned(), number(key, text)?);
            }
        }
        Ok(Self {
            status: get("status")?.clone(),
            reason: get("reason")?.clone(),
            iterations: u32::try_from(number("iterations", get("iterations")?)?).unwrap_or(u32::MAX),
            messages,
            digests: Digests {
                world: digest("digest.world")?,
                layout: digest("digest.layout")?,
                frame: digest("digest.frame")?,
            },
        })
    }
}

/// The messages that one channel lacks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Missing {
    /// The channel.
    pub channel: ChannelKey,
    /// The channel's name.
    pub name: String,
    /// Messages that the specification asks for.
    pub expected: u32,
    /// The ranges of indices that are not there (ticks, iterations or chunks), both ends included.
    pub ranges: Vec<(u32, u32)>,
}

impl Missing {
    /// Returns how many messages are missing.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.ranges.iter().map(|(first, last)| last - first + 1).sum()
    }
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} of {} missing (", self.name, self.count(), self.expected)?;
        for (i, (first, last)) in self.ranges.iter().enumerate() {
            let comma = if i == 0 { "" } else { ", " };
            if first == last {
                write!(f, "{comma}{first}")?;
            } else {
                write!(f, "{comma}{first} to {last}")?;
            }
        }
        f.write_str(")")
    }
}

/// Returns the indices that each channel must hold in the end; `plans` are the iterations that end with a plan.
fn expected(spec: &EpisodeSpec, topic: Topic, plans: &BTreeSet<u32>) -> BTreeSet<u32> {
    match topic {
        Topic::Scene => BTreeSet::from([0]),
        Topic::Advance => (0..spec.iterations()).collect(),
        Topic::World | Topic::Ego | Topic::Layout | Topic::Frame => (0..=spec.last_tick.0).collect(),
        Topic::Cache => (0..spec.iterations()).flat_map(|iteration| spec.chunks_of(iteration)).collect(),
        Topic::Plan => plans.clone(),
        Topic::Score | Topic::Event | Topic::Diagnosis => BTreeSet::new(),
    }
}

/// Compares what is there with what the specification asks for.
pub(crate) fn missing(
    spec: &EpisodeSpec,
    cameras: &[CameraId],
    plans: &BTreeSet<u32>,
    present: &BTreeMap<ChannelKey, BTreeSet<u32>>,
) -> Vec<Missing> {
    let none = BTreeSet::new();
    let mut all = Vec::new();
    for channel in ChannelKey::all(cameras) {
        let asked = expected(spec, channel.topic, plans);
        let there = present.get(&channel).unwrap_or(&none);
        let ranges = ranges(asked.difference(there).copied());
        if !ranges.is_empty() {
            let expected = u32::try_from(asked.len()).unwrap_or(u32::MAX);
            all.push(Missing { channel, name: channel.name(cameras), expected, ranges });
        }
    }
    all
}

/// Joins rising indices to ranges.
fn ranges(indices: impl Iterator<Item = u32>) -> Vec<(u32, u32)> {
    let mut ranges: Vec<(u32, u32)> = Vec::new();
    for index in indices {
        match ranges.last_mut() {
            Some(last) if last.1 + 1 == index => last.1 = index,
            _ => ranges.push((index, index)),
        }
    }
    ranges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_join_to_ranges() {
        assert_eq!(ranges([1, 2, 3, 7, 9, 10].into_iter()), [(1, 3), (7, 7), (9, 10)]);
        assert_eq!(ranges([].into_iter()), []);
    }

    #[test]
    fn what_is_missing_reads_as_a_sentence() {
        let channel = ChannelKey { topic: Topic::Frame, camera: 0 };
        let missing = Missing { channel, name: "frame/front".to_owned(), expected: 81, ranges: vec![(4, 4), (46, 80)] };
        assert_eq!(missing.to_string(), "frame/front: 36 of 81 missing (4, 46 to 80)");
    }

    #[test]
    fn a_completeness_record_survives_its_metadata() {
        let digests = Digests { world: Digest::of(b"w"), layout: Digest::of(b"l"), frame: Digest::of(b"f") };
        let record = Completeness {
            status: "failed".to_owned(),
            reason: "policy_deadline".to_owned(),
            iterations: 7,
            messages: BTreeMap::from([("frame/front".to_owned(), 31)]),
            digests,
        };
        let mut entries = record.to_metadata();
        assert_eq!(Completeness::from_metadata(&entries), Ok(record));
        entries.insert("digest.world".to_owned(), "x".to_owned());
        let error = Completeness::from_metadata(&entries).expect_err("a bad digest is refused");
        assert!(error.contains("digest.world"), "{error}");
    }
}
