//! Whether generated frames show a condition: the look network names it on them at least 0.7 times as often as on the
//! reference camera's frames of the same states. Else a row about it supports no claim, and is tested by nobody.

use std::collections::BTreeSet;

use ds_topic::ObservationSource;

use crate::cell::Named;
use crate::manifest::{Entry, Kind};
use crate::results::Results;
use crate::sheet::Arm;
use crate::source::CONDITIONS;
use crate::table::{Table, Value};

/// What share of the hit rate on reference frames is enough.
const ENOUGH: f64 = 0.7;
/// Why a row supports no claim.
const NOT_SHOWN: &str = "condition not shown";
/// Why a row of a source that no look changes supports no claim.
const NO_LOOK: &str = "condition not shown: this source has no look";
/// Why nothing is known of a row.
const NOT_MEASURED: &str = "condition not measured";

/// How often a condition is named.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Hits {
    /// Frames that were looked at.
    of: usize,
    /// On generated frames.
    frames: usize,
    /// On reference frames.
    reference: usize,
}

impl Hits {
    /// Counts on the frames of a source, over all policies: whether a condition is shown is the generator's doing.
    fn count(results: &Results, source: &Named, condition: &str) -> Self {
        let sets = results.sets.iter().filter(|set| set.kind == Kind::Weather);
        let entries: Vec<&Entry> =
            sets.flat_map(|set| &set.entries).filter(|entry| entry.appearance == condition).collect();
        let mut hits = Self::default();
        for arm in results.sheet.arms().iter().filter(|arm| arm.observation == *source) {
            let drives = entries.iter().flat_map(|entry| results.of(arm, entry));
            for shown in drives.filter_map(|drive| drive.shown) {
                hits.of += 1;
                hits.frames += usize::from(shown.frame);
                hits.reference += usize::from(shown.reference);
            }
        }
        hits
    }

    /// Returns the hit rate on generated frames of that on reference frames.
    fn share(self) -> Option<f64> {
        (self.reference > 0).then(|| self.frames as f64 / self.reference as f64)
    }

    fn fault(self) -> Option<&'static str> {
        match self.share() {
            _ if self.of == 0 => Some(NOT_MEASURED),
            Some(share) if share >= ENOUGH => None,
            _ => Some(NOT_SHOWN),
        }
    }
}

/// Says whether a video model makes the frames of a source; of the others all that have a look show what they are told.
fn generated(source: &Named) -> bool {
    !source.digest.is_empty()
}

/// Says whether no condition changes the frames of a source.
fn lookless(source: &Named) -> bool {
    ObservationSource::from_name(&source.name).is_some_and(|source| !source.has_look())
}

/// Returns why the drives of an arm under the conditions of some entries support no claim; nothing where they do.
pub(super) fn fault(results: &Results, arm: &Arm, entries: &[&Entry]) -> Option<&'static str> {
    let conditions: BTreeSet<&str> = entries.iter().map(|entry| entry.appearance.as_str()).collect();
    let known = |name: &&str| CONDITIONS.iter().any(|(_, names)| names.contains(name));
    conditions.into_iter().filter(known).find_map(|condition| unshown(results, &arm.observation, condition))
}

/// Returns why a source does not show a condition; nothing where it does.
fn unshown(results: &Results, source: &Named, condition: &str) -> Option<&'static str> {
    if lookless(source) {
        return Some(NO_LOOK);
    }
    generated(source).then(|| Hits::count(results, source, condition).fault()).flatten()
}

/// Returns what a reader has to know of sets whose conditions are not all shown, or not known to be.
pub(super) fn warnings(results: &Results) -> Vec<String> {
    let mut warnings = Vec::new();
    for set in results.sets.iter().filter(|set| set.kind == Kind::Weather) {
        let driven: BTreeSet<&str> = set.entries.iter().map(|entry| entry.appearance.as_str()).collect();
        for source in &results.sheet.observations {
            let hidden = |condition: &&str| unshown(results, source, condition).is_some();
            let all = CONDITIONS.iter().flat_map(|(_, all)| all.iter().copied());
            let hidden: Vec<&str> = all.filter(|condition| driven.contains(condition)).filter(hidden).collect();
            if !hidden.is_empty() {
                let (set, source, hidden) = (&set.name, &source.name, hidden.join(", "));
                warnings.push(format!(
                    "Frames of {source} do not show, or were not looked at for, conditions of set {set}: {hidden}. Rows over all of the \
                     set rank nobody by them, and its pairs are not tested."
                ));
            }
        }
    }
    warnings
}

/// Returns which conditions generated frames show.
pub(super) fn shown(results: &Results) -> Table {
    let mut rows = Vec::new();
    for source in results.sheet.observations.iter().filter(|source| generated(source)) {
        for (axis, condition) in CONDITIONS.iter().flat_map(|(axis, all)| all.iter().map(move |one| (*axis, *one))) {
            let hits = Hits::count(results, source, condition);
            if hits.of > 0 {
                let rate = |count: usize| Value::Score(Some(count as f64 / hits.of as f64));
                let mut row = [source.name.as_str(), axis, condition].map(Value::text).to_vec();
                row.extend([hits.of, hits.frames, hits.reference].map(Value::count));
                row.extend([rate(hits.frames), rate(hits.reference), Value::Score(hits.share())]);
                row.push(Value::text(hits.fault().unwrap_or("shown")));
                rows.push(row);
            }
        }
    }
    let mut columns = vec!["source", "axis", "condition", "frames", "named", "named on reference"];
    columns.extend(["generated %", "reference %", "share %", "gate"]);
    let note = format!(
        "On how many frames 80 of a drive the look network names the condition, as generated and as the reference camera \
         renders the same state. A condition counts as shown where the first is at least {ENOUGH} of the second; else rows \
         about it support no claim."
    );
    Table { id: "shown", title: "Conditions shown", note, columns, rows }
}
