//! A bag or a text file → the mapping that its topics, or its columns and data, suggest, as text with reasons, and what could
//! not be decided.
//!
//! Of several candidates for a channel the first kind that moves is taken, of one kind the topic with most messages. What
//! no log holds, the mass, is a placeholder that says so.

mod candidates;
mod form;
mod names;
mod sheet;
mod units;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use ds_bags::{Clock, Format, Glance, Topic, Wanted};
use ds_diagnosis::CaseError;

use crate::channel::CHANNELS;
use crate::check;
use crate::error::LogError;
use crate::mapping::Mapping;
use candidates::Candidate;

/// Most candidates that are read.
const MOST: usize = 80;
/// Difference between a message's own stamp and its receipt from which they are two clocks, ns.
const OTHER_CLOCK_NANOS: i64 = 10_000_000_000;
/// What stands in for what no log holds.
const MASS: f64 = 1_500.0;
const WHEELBASE_M: f64 = 2.7;

/// A proposed mapping.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Suggestion {
    /// The mapping file.
    pub text: String,
    /// What could not be decided, one sentence each; they stand in the text too.
    pub undecided: Vec<String>,
}

/// Proposes a mapping for a bag or a text file.
///
/// # Errors
/// If the file is damaged, or neither a bag nor a table of numbers with names and stamps.
pub fn suggest(log: &Path) -> Result<Suggestion, LogError> {
    let Some(format) = Format::of(log)? else {
        return if log.is_dir() { Err(LogError::NoBag { path: log.to_path_buf() }) } else { sheet::suggest(log) };
    };
    let topics = ds_bags::topics(log, format)?;
    let mut offered: Vec<Candidate> = topics.iter().flat_map(candidates::of).filter(|c| c.messages > 0).collect();
    offered.sort_by_key(|c| (c.rank, std::cmp::Reverse(c.messages)));
    offered.truncate(MOST);
    let wanted = |c: &Candidate| Wanted { topic: c.topic.clone(), field: c.field.clone(), clock: Clock::Own };
    let found = ds_bags::glance(log, format, &offered.iter().map(wanted).collect::<Vec<_>>())?;
    let mut draft = Draft::default();
    draft.choose(&offered, &found);
    draft.stand_in();
    draft.compare_clocks(&topics, &offered, &found);
    draft.doubt(&topics);
    let format = match format {
        Format::Mcap => "mcap",
        Format::Rosbag1 => "rosbag1",
        Format::Rosbag2 => "rosbag2",
    };
    let heading = Heading {
        told_by: "topics".to_owned(),
        log: format!("format = {format:?}\n"),
        time: String::new(),
        secs: span_secs(&found),
    };
    let text = draft.text(log, &heading, None);
    let wheelbase = wheelbase(log, &text)?;
    let text = if wheelbase.is_some() { draft.text(log, &heading, wheelbase) } else { text };
    Ok(Suggestion { text, undecided: draft.undecided })
}

/// A mapping that comes into being.
#[derive(Default, Clone)]
struct Draft {
    undecided: Vec<String>,
    /// The entry of each channel, with why.
    lines: BTreeMap<&'static str, (String, String)>,
    /// The topic or column of each.
    chosen: BTreeMap<&'static str, String>,
    /// Channels of a text file whose unit its header does not say.
    open: Vec<&'static str>,
    foreign_clock: bool,
}

/// What stands above the channels of a mapping.
struct Heading {
    /// By what it was told.
    told_by: String,
    /// Further lines of `[log]`.
    log: String,
    /// The table `[time]`, if there is one.
    time: String,
    /// How long the log is, s.
    secs: f64,
}

/// Tells whether a field changes.
fn moves(found: &Glance) -> bool {
    found.range.is_some_and(|(low, high)| high - low > 1e-9)
}

fn span_secs(found: &[Glance]) -> f64 {
    let first = found.iter().filter_map(|glance| Some(glance.span_nanos?.0)).min();
    let last = found.iter().filter_map(|glance| Some(glance.span_nanos?.1)).max();
    first.zip(last).map_or(0.0, |(first, last)| last.saturating_sub(first) as f64 * 1e-9)
}

impl Draft {
    /// Takes the best candidate that moves for every channel.
    fn choose(&mut self, offered: &[Candidate], found: &[Glance]) {
        for known in CHANNELS {
            let all: Vec<(&Candidate, bool)> = offered
                .iter()
                .zip(found)
                .filter(|(c, _)| c.channel == known.name)
                .map(|(c, s)| (c, moves(s)))
                .collect();
            let Some(place) = all.iter().position(|(_, moves)| *moves) else {
                if let Some((c, _)) = all.first() {
                    // an unused field of a message, most often
                    self.undecided
                        .push(format!("{}: {} of {} never changes and is not taken", known.name, c.field, c.topic));
                }
                continue;
            };
            let candidate = all[place].0;
            let mut why = if candidate.guessed { "by its name alone".to_owned() } else { String::new() };
            let passed: Vec<String> = all
                .iter()
                .filter(|(c, moves)| *moves && *c != candidate)
                .map(|(c, _)| format!("{} {}", c.topic, c.field))
                .collect();
            if !passed.is_empty() {
                let _infallible = write!(why, "{}also {}", if why.is_empty() { "" } else { "; " }, passed.join(", "));
            }
            self.take(known.name, candidate, why);
        }
        // a heading of its own for a place of its own
        if let (Some(x), Some(y)) = (self.chosen.get("x"), self.chosen.get("y"))
            && x != y
        {
            self.undecided.push(format!("x is of {x} and y of {y}: map both of one topic"));
        }
    }

    fn take(&mut self, channel: &'static str, candidate: &Candidate, why: String) {
        let more = if candidate.more.is_empty() { String::new() } else { format!(", {}", candidate.more) };
        let entry = format!("topic = {:?}, field = {:?}{more}", candidate.topic, candidate.field);
        self.lines.insert(channel, (entry, why));
        self.chosen.insert(channel, candidate.topic.clone());
    }

    /// Adds to the entry of a channel that is there, and to why it is so.
    fn add(&mut self, channel: &str, entry: &str, why: &str) {
        let Some((entries, reasons)) = self.lines.get_mut(channel) else { return };
        for (all, separator, more) in [(entries, ", ", entry), (reasons, "; ", why)] {
            if !more.is_empty() {
                *all = if all.is_empty() { more.to_owned() } else { format!("{all}{separator}{more}") };
            }
        }
    }

    /// Finds what stands in for a command that is not in the log.
    fn stand_in(&mut self) {
        if !self.chosen.contains_key("cmd_steer") {
            match self.chosen.remove("steer_meas").zip(self.lines.remove("steer_meas")) {
                Some((measured, (entry, _))) => {
                    self.undecided.push(format!(
                        "cmd_steer: no steering command; the measured angle of {measured} stands in, so that the steering actuator cannot be judged"
                    ));
                    self.lines.insert("cmd_steer", (entry, "measured, not asked for".to_owned()));
                    self.chosen.insert("cmd_steer", measured);
                    self.open.iter_mut().filter(|name| **name == "steer_meas").for_each(|name| *name = "cmd_steer");
                }
                None => self.undecided.push("cmd_steer: no steering angle found; add it by hand".to_owned()),
            }
        }
        if !self.chosen.contains_key("cmd_accel") {
            let from = ["v", "v_wheel", "ax"].into_iter().find(|name| self.chosen.contains_key(name));
            match from {
                Some(from) => {
                    self.undecided.push(format!(
                        "cmd_accel: no drive command; the one that the nominal vehicle needs for {from} stands in, so that only the lateral side is diagnosed"
                    ));
                    self.lines.insert("cmd_accel", (format!("derived_from = {from:?}"), String::new()));
                }
                None => self
                    .undecided
                    .push("cmd_accel: neither a drive command nor a speed found; add one by hand".to_owned()),
            }
        }
    }

    /// Takes the time of receipt for all where the stamps of some topics are of another clock.
    fn compare_clocks(&mut self, topics: &[Topic], offered: &[Candidate], found: &[Glance]) {
        for (candidate, glance) in offered.iter().zip(found) {
            let used = self.chosen.values().any(|topic| *topic == candidate.topic);
            let received = topics.iter().find(|t| t.name == candidate.topic).and_then(|t| t.received_nanos);
            let (Some((first, _)), Some(own), true) = (received, glance.first_nanos, used) else { continue };
            if !self.foreign_clock && own.saturating_sub(first).saturating_abs() > OTHER_CLOCK_NANOS {
                self.foreign_clock = true;
                self.undecided.push(format!(
                    "stamps: those of {} are {:.0} s from their receipt (simulated time, or never set); the time of receipt is taken for all",
                    candidate.topic,
                    own.saturating_sub(first) as f64 * 1e-9
                ));
            }
        }
    }

    /// Says what was seen and not used.
    fn doubt(&mut self, topics: &[Topic]) {
        for topic in topics {
            if let Err(why) = &topic.leaves {
                self.undecided.push(format!("{} ({}) cannot be read: {why}", topic.name, topic.kind));
            } else if candidates::is_pedal(topic) {
                self.undecided.push(format!(
                    "{} ({}): what a pedal does would have to be fitted; it is not read",
                    topic.name, topic.kind
                ));
            }
        }
        self.doubt_mass();
    }

    /// Says what stands in for what no log holds.
    fn doubt_mass(&mut self) {
        self.undecided.push(format!("mass: no log holds it; {MASS} kg stands in"));
    }

    /// Writes the mapping; `wheelbase` with how well it fits.
    fn text(&self, log: &Path, heading: &Heading, wheelbase: Option<(f64, f64)>) -> String {
        let file = log.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let name = log.file_stem().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let Heading { told_by, log, time, secs } = heading;
        let mut text = format!("# Proposed for {file:?} by its {told_by}.\n");
        for sentence in &self.undecided {
            let _infallible = writeln!(text, "# Not decided: {sentence}.");
        }
        let _infallible = write!(text, "\n[log]\nname = {name:?}\n{log}");
        if *secs > 60.0 {
            let _infallible = writeln!(
                text,
                "piece_secs = {:.1} # cut into drives; every fourth is held out",
                (secs / 8.0).clamp(20.0, 60.0)
            );
        }
        let _infallible = write!(text, "{time}\n[[drive]]\nfile = {file:?}\n\n[channels]\n");
        let receipt = if self.foreign_clock { ", stamp = \"log\"" } else { "" };
        for known in CHANNELS {
            let Some((entry, why)) = self.lines.get(known.name) else { continue };
            let receipt = if entry.starts_with("topic") { receipt } else { "" };
            let why = if why.is_empty() { String::new() } else { format!(" # {why}") };
            let _infallible = writeln!(text, "{} = {{ {entry}{receipt} }}{why}", known.name);
        }
        let (base, how) = match wheelbase {
            Some((base, fit)) => {
                (base, format!("of yaw rate, speed and steering angle (r = {fit:.2}); set the true one"))
            }
            None => (WHEELBASE_M, "a usual car's: set the true one".to_owned()),
        };
        let _infallible = write!(
            text,
            "\n[nominal]\nmodel = \"linear\" # kinematic: wheels that do not slip\nmass = {MASS:.1} # a usual car's: set the true one\nwheelbase = {base:.3} # {how}\n"
        );
        text
    }
}

/// Returns the wheelbase that the longest drive of a proposed mapping has, with its correlation.
fn wheelbase(log: &Path, text: &str) -> Result<Option<(f64, f64)>, LogError> {
    let Ok(mapping) = Mapping::parse(text) else { return Ok(None) };
    let Some(drive) = mapping.drive.first() else { return Ok(None) };
    let folder = log.parent().unwrap_or(Path::new("."));
    let records = match mapping.open(folder, drive).and_then(|log| mapping.records(&log)) {
        Ok(records) => records,
        Err(LogError::Apart { .. } | LogError::Case(CaseError::TooShort { .. })) => return Ok(None),
        Err(error) => return Err(error),
    };
    let longest = records.iter().max_by_key(|record| record.samples());
    let based = longest.and_then(|record| check::wheelbase_m(record, "cmd_steer"));
    Ok(based.filter(|(base, fit)| *fit > 0.9 && (0.1..8.0).contains(base)))
}
