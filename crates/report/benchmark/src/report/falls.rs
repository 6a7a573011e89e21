//! The worst falls: drives against an adversary, each beside the drive of its base on the same seed, and how their animations are
//! made again where no recording was kept.

use std::path::{Path, PathBuf};

use ds_run_report::write::points;

use super::rows::{Anchor, driving_score, how, named};
use crate::judge::PROFILES;
use crate::manifest::{Entry, Kind, Manifest, SUFFIX};
use crate::plot::{Pair, Plot};
use crate::results::{Drive, Results};
use crate::sheet::{Arm, Sheet};
use crate::table::{Table, Value};

/// Falls that are told of each arm and set.
const WORST: usize = 3;
/// The profile that they are told in.
const PROFILE: &str = PROFILES[0];
/// Digits of a key that name what is made of its cell.
const DIGITS: usize = 16;

/// A drive against an adversary beside that of its base.
#[derive(Debug)]
pub struct Fall<'a> {
    /// Who drove how.
    pub arm: Arm,
    /// The set of the variant.
    pub set: &'a Manifest,
    /// The base and the variant.
    pub sides: [Side<'a>; 2],
    /// The seed of both.
    pub seed: u64,
}

/// One drive of a fall.
#[derive(Debug)]
pub struct Side<'a> {
    /// What was driven.
    pub entry: &'a Entry,
    /// The key of its cell.
    pub key: String,
    /// How it went.
    pub drive: &'a Drive,
    /// Its driving score.
    pub score: f64,
}

impl Fall<'_> {
    /// Returns how much less the variant scores than its base.
    #[must_use]
    pub fn depth(&self) -> f64 {
        self.sides[0].score - self.sides[1].score
    }
}

impl Side<'_> {
    /// Returns the name of what is made of this drive.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.key[..DIGITS.min(self.key.len())]
    }
}

/// Returns the worst falls of every arm on every set with adversaries, at most one of each variant, the deepest first.
#[must_use]
pub fn worst(results: &Results) -> Vec<Fall<'_>> {
    let mut all = Vec::new();
    // What reviewers accept is part of a set that is there as a whole.
    let driven = |set: &&Manifest| results.sheet.sets.iter().any(|named| named.name == set.name);
    for set in results.sets.iter().filter(|set| set.kind == Kind::Behavior).filter(driven) {
        for arm in results.sheet.arms() {
            let mut falls: Vec<Fall> =
                set.entries.iter().filter_map(|entry| deepest(results, &arm, set, entry)).collect();
            falls.sort_by(|a, b| b.depth().total_cmp(&a.depth()));
            all.extend(falls.into_iter().take(WORST));
        }
    }
    all
}

/// Returns the seed on which a variant falls furthest below its base; nothing where it falls on none.
fn deepest<'a>(results: &'a Results, arm: &Arm, set: &'a Manifest, entry: &'a Entry) -> Option<Fall<'a>> {
    let base = results.base_of(entry)?;
    let side = |entry: &'a Entry, seed: u64| -> Option<Side<'a>> {
        let (key, drive) = results.drive(arm, entry, seed)?;
        Some(Side { entry, key, score: driving_score(PROFILE)(drive)?, drive })
    };
    let of_seed = |seed: &u64| {
        let sides = [side(base, *seed)?, side(entry, *seed)?];
        Some(Fall { arm: arm.clone(), set, sides, seed: *seed })
    };
    let falls = results.sheet.seeds.iter().filter_map(of_seed).filter(|fall| fall.depth() > 0.0);
    falls.reduce(|first, other| if other.depth() > first.depth() { other } else { first })
}

/// Returns the worst falls as a table.
pub(super) fn falls(results: &Results, anchor: Anchor) -> Table {
    let row = |fall: Fall| {
        let [base, variant] = &fall.sides;
        let mut row = named(anchor, fall.set, &fall.arm);
        row.extend([&variant.entry.category, &variant.entry.name, &base.entry.name].map(Value::text));
        row.push(Value::Count(fall.seed));
        row.extend([base.score, variant.score, fall.depth()].map(|score| Value::Score(Some(score))));
        let shown = fall.sides.iter().all(|side| results.animations.contains_key(&side.key));
        row.push(Value::text(if shown { "below" } else { "no recording" }));
        row
    };
    let mut columns = vec!["policy", "set", "how", "class", "variant", "base", "seed"];
    columns.extend(["DS base", "DS", "fall", "animations"]);
    let note = format!(
        "Of each policy the {WORST} variants whose drives fall furthest below that of their own base on the same seed, in profile \
         {PROFILE}. They were picked for their fall: an illustration, no estimate."
    );
    Table {
        id: "falls",
        title: "Worst paired falls",
        note,
        columns,
        rows: worst(results).into_iter().map(row).collect(),
    }
}

/// Returns the falls whose both animations are there, the base on the left.
pub(super) fn pairs(results: &Results) -> Vec<Plot> {
    let pair = |fall: Fall| {
        let picture = |side: &Side, what: &str| {
            let path = results.animations.get(&side.key)?.clone();
            Some((path, format!("{what} {}: DS {}", side.entry.name, points(Some(side.score)))))
        };
        let [base, variant] = &fall.sides;
        let pictures = [picture(base, "base")?, picture(variant, "variant")?];
        let (policy, how, depth) = (&fall.arm.policy.name, how(&fall.arm), points(Some(fall.depth())));
        let title = format!("{policy} · {how} · {} · seed {}: {depth} points less", variant.entry.name, fall.seed);
        Some(Plot::Pair(Pair { title, pictures }))
    };
    worst(results).into_iter().filter_map(pair).collect()
}

/// Returns the commands that make the animations which are not there; a table without rows where none is missing.
pub(super) fn again(results: &Results) -> Table {
    let (mut rows, mut folders) = (Vec::new(), Vec::new());
    for fall in worst(results) {
        for side in fall.sides.iter().filter(|side| !results.animations.contains_key(&side.key)) {
            let out = results.folder.join("falls").join(side.name());
            if folders.contains(&out) {
                continue;
            }
            let Some(command) = command(&results.sheet, &results.sets, &fall.arm, side.entry, fall.seed, &out) else {
                continue;
            };
            rows.push([&fall.arm.policy.name, &side.entry.name, &command].map(Value::text).to_vec());
            folders.push(out);
        }
    }
    if !folders.is_empty() {
        let folders: Vec<String> = folders.iter().map(|folder| quoted(folder)).collect();
        let command =
            format!("dreamstream benchmark report {} --recordings {}", quoted(&results.folder), folders.join(" "));
        rows.push(["", "this page, with animations", &command].map(Value::text).to_vec());
    }
    let note = "Of these drives no recording was kept. Each is driven again, to the bit, as a shard of one cell, where the manifests lie \
                that the benchmark began with; the last command puts the animations beside the page."
        .to_owned();
    Table { id: "again", title: "Falls to be driven again", note, columns: vec!["policy", "scenario", "command"], rows }
}

/// Returns the command that drives one cell again and keeps its world states; nothing where no driven set has the entry.
fn command(sheet: &Sheet, sets: &[Manifest], arm: &Arm, entry: &Entry, seed: u64, out: &Path) -> Option<String> {
    let place =
        sets.iter().position(|set| set.entries.contains(entry)).filter(|place| *place < sheet.place.folders.len())?;
    let (set, folder) = (&sets[place], &sheet.place.folders[place]);
    let alone = Sheet {
        policies: vec![arm.policy.clone()],
        observations: vec![arm.observation.clone()],
        agents: vec![arm.agents],
        scorers: vec![arm.scorer.clone()],
        seeds: vec![seed],
        selection: Vec::new(),
        ..sheet.clone()
    };
    let cells = alone.cells(std::slice::from_ref(set)).ok()?;
    let key = alone.cell(arm, entry, seed).key();
    let index = cells.keys().position(|other| *other == key)?;
    let manifest = folder.join(format!("{}{SUFFIX}", set.name));
    let policy =
        sheet.place.manifests.get(&arm.policy.name).map_or_else(|| PathBuf::from(&arm.policy.name), Clone::clone);
    let (settings, at) = (&sheet.settings, &sheet.place);
    let mut words = vec![format!("dreamstream benchmark run {} --policy {}", quoted(&manifest), quoted(&policy))];
    words.push(format!("--observation {} --agents {}", arm.observation.name, arm.agents.name()));
    words.push(format!("--scorer {} --seed {seed} --replan {}", arm.scorer, settings.replan));
    words.push(format!("--horizon {} --history {}", settings.horizon, settings.history));
    words.push(format!("--tracker {} --video-backend {}", settings.tracker.name(), settings.video_backend));
    for (option, path, counts) in [
        ("--model", &at.model, !arm.observation.digest.is_empty()),
        (
            "--policy-weights",
            &at.policy_weights,
            !arm.policy.digest.is_empty() && !at.manifests.contains_key(&arm.policy.name),
        ),
    ] {
        words.extend(counts.then(|| format!("{option} {}", quoted(path))));
    }
    words.extend(at.policy_listen.as_ref().map(|listen| format!("--policy-listen {listen}")));
    words.push(format!("--shard {index}/{} --keep states --out {}", cells.len(), quoted(out)));
    Some(words.join(" "))
}

/// Returns a path as a shell takes it.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+=:@%".contains(c);
    if !text.is_empty() && text.chars().all(plain) { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}
