//! What a folder of results was asked for, `benchmark.json`: sets, policies, settings, shard. From it and the manifests
//! follow all cells; `resume` goes on with it, `merge` compares it, `report` names it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use ds_space::{Digest, DigestWriter};
use ds_world::AgentMode;
use serde::{Deserialize, Serialize};

use crate::cell::{Cell, Cells, Named, Settings, Shard};
use crate::choice;
use crate::endpoint::{Claim, Endpoint, LEARNED};
use crate::file::{self, FileError};
use crate::manifest::{Entry, Kind, Manifest, SUFFIX};

/// The format's name in files.
const FORMAT: &str = "dreamstream-benchmark";
/// The format's version.
const VERSION: u32 = 1;
/// The file's name in its folder.
pub const FILE: &str = "benchmark.json";
/// The folder with the manifests.
const SETS: &str = "sets";

/// Which recordings stay when their cell has ended.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Keep {
    /// All.
    All,
    /// Those of drives without success.
    Failures,
    /// Scene, world states, plans and scores of all.
    States,
    /// None.
    #[default]
    None,
}

/// What belongs to the machine, not to the benchmark.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// Folder of each set's manifest, from which its files are named.
    pub folders: Vec<PathBuf>,
    /// Configuration of the video model.
    pub model: PathBuf,
    /// Weights of the camera policy.
    pub policy_weights: PathBuf,
    /// Manifests of policies of one's own, by their names.
    #[serde(default)]
    pub manifests: BTreeMap<String, PathBuf>,
    /// Episodes at a time.
    pub workers: u32,
    /// Which recordings stay.
    pub keep: Keep,
    /// Where an external policy connects to.
    pub policy_listen: Option<String>,
}

/// What was asked for.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sheet {
    /// `dreamstream-benchmark`.
    pub format: String,
    /// The format's version.
    pub version: u32,
    /// Version of the program.
    pub program: String,
    /// Names and digests of the sets.
    pub sets: Vec<Named>,
    /// Who drives.
    pub policies: Vec<Named>,
    /// What makes the frames.
    pub observations: Vec<Named>,
    /// Which agents react.
    #[serde(with = "choice::all_agents")]
    pub agents: Vec<AgentMode>,
    /// Who ranks the proposals.
    pub scorers: Vec<String>,
    /// Seeds that results are reported on.
    pub seeds: Vec<u64>,
    /// Seeds that base sets are driven on besides, only to select scenarios by.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub selection: Vec<u64>,
    /// What all cells share.
    pub settings: Settings,
    /// What it is to show, declared before it is driven.
    #[serde(default)]
    pub endpoints: Vec<Endpoint>,
    /// Which part of the cells.
    pub shard: Shard,
    /// Whether parts of other benchmarks were merged in by force.
    pub mixed: bool,
    /// What belongs to the machine.
    pub place: Place,
}

/// Where a cell was met: index of the set and of the entry in it.
pub type At = (usize, usize);

/// Two scenarios of one name where names must agree.
#[derive(Debug, thiserror::Error)]
#[error(
    "scenario {scenario:?} has digest {first} and {second}: within a set, and among all but those of kind behavior, a name is one \
     scenario"
)]
pub struct Ambiguous {
    /// The scenario.
    scenario: String,
    /// One digest.
    first: String,
    /// The other.
    second: String,
}

/// The first part in which two benchmarks differ that must agree.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Differs {
    /// What it is.
    pub part: &'static str,
    /// What one has.
    pub first: String,
    /// What the other has.
    pub second: String,
}

impl Sheet {
    /// Returns an empty sheet of this program's format.
    #[must_use]
    pub fn new(program: &str) -> Self {
        Self {
            format: FORMAT.to_owned(),
            version: VERSION,
            program: program.to_owned(),
            sets: Vec::new(),
            policies: Vec::new(),
            observations: Vec::new(),
            agents: Vec::new(),
            scorers: Vec::new(),
            seeds: Vec::new(),
            selection: Vec::new(),
            settings: Settings::default(),
            endpoints: Vec::new(),
            shard: Shard::ALL,
            mixed: false,
            place: Place::default(),
        }
    }

    /// Reads the sheet of a folder and its manifests.
    ///
    /// # Errors
    /// [`FileError`] if one cannot be read, is of another format, or a manifest is not the one that the sheet names.
    pub fn load(folder: &Path) -> Result<(Self, Vec<Manifest>), FileError> {
        let path = folder.join(FILE);
        let sheet: Self = file::read_json(&path)?;
        if sheet.format != FORMAT || sheet.version != VERSION {
            let value = format!("{} {}", sheet.format, sheet.version);
            let rule = "not a format that this program reads";
            return Err(FileError::Value { field: "format".to_owned(), value, rule, path });
        }
        if sheet.shard.index >= sheet.shard.count || sheet.place.folders.len() != sheet.sets.len() {
            let (field, value) = ("shard".to_owned(), sheet.shard.to_string());
            return Err(FileError::Value { field, value, rule: "not I/N with I < N, or folders are missing", path });
        }
        if let Some(seed) = sheet.overlap() {
            let (field, value) = ("selection".to_owned(), seed.to_string());
            return Err(FileError::Value { field, value, rule: "a seed that results are reported on", path });
        }
        let mut sets = Vec::new();
        for named in &sheet.sets {
            let path = folder.join(SETS).join(format!("{}{SUFFIX}", named.name));
            let set = Manifest::load(&path)?;
            if set.digest != named.digest {
                let rule = "not the digest in benchmark.json";
                return Err(FileError::Value { field: "digest".to_owned(), value: set.digest, rule, path });
            }
            sets.push(set);
        }
        Ok((sheet, sets))
    }

    /// Writes the sheet and its manifests; the sheet comes last.
    ///
    /// # Errors
    /// [`FileError`] if a file cannot be written.
    pub fn save(&self, sets: &[Manifest], folder: &Path) -> Result<(), FileError> {
        for set in sets {
            file::write_json(set, &folder.join(SETS).join(format!("{}{SUFFIX}", set.name)))?;
        }
        file::write_json(self, &folder.join(FILE))
    }

    /// Returns what must agree where results are merged, part by part.
    #[must_use]
    pub fn identity(&self) -> Vec<(&'static str, String)> {
        let named =
            |all: &[Named]| all.iter().map(|n| format!("{} {}", n.name, n.digest)).collect::<Vec<_>>().join(", ");
        vec![
            ("program", self.program.clone()),
            ("sets", named(&self.sets)),
            ("policies", named(&self.policies)),
            ("observations", named(&self.observations)),
            ("agents", self.modes().join(", ")),
            ("scorers", self.scorers.join(", ")),
            ("seeds", format!("{:?}", self.seeds)),
            ("selection seeds", format!("{:?}", self.selection)),
            ("settings", self.settings.told()),
            ("endpoints", format!("{:?}", self.endpoints)),
        ]
    }

    /// Returns what must agree with another sheet and does not; nothing where they are of one benchmark.
    #[must_use]
    pub fn differs(&self, other: &Self) -> Option<Differs> {
        let parts = self.identity().into_iter().zip(other.identity());
        let other = parts.into_iter().find(|((_, first), (_, second))| first != second);
        other.map(|((part, first), (_, second))| Differs { part, first, second })
    }

    /// Returns the names of the agents' modes.
    fn modes(&self) -> Vec<String> {
        self.agents.iter().map(|mode| mode.name().to_owned()).collect()
    }

    /// Returns the digest over what must agree.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let mut writer = DigestWriter::new();
        for (part, value) in self.identity() {
            writer.text(part).text(&value);
        }
        writer.finish()
    }

    /// Returns all cells, of every shard, each once.
    ///
    /// # Errors
    /// [`Ambiguous`] if a set holds different scenarios of one name, or two sets do that are of another kind than behavior:
    /// variants of one base that differ in what their adversaries do bear one name.
    pub fn cells(&self, sets: &[Manifest]) -> Result<Cells<At>, Ambiguous> {
        let mut cells = Cells::new();
        let mut digests: BTreeMap<(Option<usize>, &str), &str> = BTreeMap::new();
        for (s, set) in sets.iter().enumerate() {
            let own = (set.kind == Kind::Behavior).then_some(s);
            for (e, entry) in set.entries.iter().enumerate() {
                let first = *digests.entry((own, &entry.scenario)).or_insert(&entry.scenario_digest);
                if first != entry.scenario_digest {
                    let (scenario, first) = (entry.scenario.clone(), first.to_owned());
                    return Err(Ambiguous { scenario, first, second: entry.scenario_digest.clone() });
                }
                for arm in self.arms() {
                    for seed in self.seeds.iter().chain(self.selecting(set)) {
                        let cell = self.cell(&arm, entry, *seed);
                        cells.entry(cell.key()).or_insert((cell, (s, e)));
                    }
                }
            }
        }
        Ok(cells)
    }

    /// Returns what is named twice, which would be rows and cells that say the same: what it is, and its value.
    #[must_use]
    pub fn repeated(&self) -> Option<(&'static str, String)> {
        let names = |all: &[Named]| all.iter().map(|named| named.name.clone()).collect::<Vec<_>>();
        let seeds = |all: &[u64]| all.iter().map(u64::to_string).collect::<Vec<_>>();
        let parts = [
            ("policy", names(&self.policies)),
            ("observation", names(&self.observations)),
            ("agents", self.modes()),
            ("scorer", self.scorers.clone()),
            ("seed", seeds(&self.seeds)),
            ("selection seed", seeds(&self.selection)),
        ];
        let mut all = parts.into_iter().flat_map(|(what, values)| values.into_iter().map(move |value| (what, value)));
        let mut seen = BTreeSet::new();
        all.find(|one| !seen.insert(one.clone()))
    }

    /// Returns what a claim is about and is not driven, in words; nothing where all of it is driven.
    #[must_use]
    pub fn undriven(&self, claim: &Claim, sets: &[Manifest]) -> Option<String> {
        let (policies, kinds, named, oracle) = match claim {
            Claim::Policies { first, second } => (vec![first, second], vec![Kind::Base], vec![], false),
            Claim::Axes { policy, .. } => (vec![policy], vec![Kind::Base, Kind::Weather], vec![], false),
            Claim::Contacts { policy, first, second } => (vec![policy], vec![], vec![first, second], false),
            Claim::Coverage { policy } => (vec![policy], vec![Kind::Base, Kind::Behavior], vec![], true),
        };
        let policy = policies.into_iter().find(|name| self.policies.iter().all(|policy| policy.name != **name));
        let set = named.into_iter().find(|name| sets.iter().all(|set| set.name != **name));
        let kind = kinds.into_iter().find(|kind| sets.iter().all(|set| set.kind != *kind));
        let scorer = self.scorers.iter().all(|scorer| (scorer != LEARNED) != oracle);
        let ranks = if oracle { "oracle" } else { LEARNED };
        policy
            .map(|name| format!("policy {name:?}"))
            .or_else(|| set.map(|name| format!("set {name:?}")))
            .or_else(|| kind.map(|kind| format!("set of kind {kind:?}").to_lowercase()))
            .or_else(|| scorer.then(|| format!("scorer {ranks:?}")))
    }

    /// Returns a seed that both selects and is reported on, which would let luck select itself.
    #[must_use]
    pub fn overlap(&self) -> Option<u64> {
        self.selection.iter().copied().find(|seed| self.seeds.contains(seed))
    }

    /// Returns the seeds that a set is driven on only to select by.
    fn selecting(&self, set: &Manifest) -> &[u64] {
        if set.kind == Kind::Base { &self.selection } else { &[] }
    }

    /// Returns every combination of policy, observation, agents and scorer.
    #[must_use]
    pub fn arms(&self) -> Vec<Arm> {
        let mut arms = Vec::new();
        for policy in &self.policies {
            for observation in &self.observations {
                for agents in self.agents.iter().copied() {
                    for scorer in &self.scorers {
                        let (policy, observation) = (policy.clone(), observation.clone());
                        arms.push(Arm { policy, observation, agents, scorer: scorer.clone() });
                    }
                }
            }
        }
        arms
    }

    /// Returns the cell of an arm, an entry and a seed.
    #[must_use]
    pub fn cell(&self, arm: &Arm, entry: &Entry, seed: u64) -> Cell {
        Cell {
            scenario: entry.scenario.clone(),
            scenario_digest: entry.scenario_digest.clone(),
            policy: arm.policy.clone(),
            observation: arm.observation.clone(),
            appearance: entry.appearance.clone(),
            agents: arm.agents,
            scorer: arm.scorer.clone(),
            seed,
            hand_over: entry.hand_over,
            last: entry.last,
            settings: self.settings.clone(),
        }
    }
}

/// Who drives, seeing what, among whom, ranked by whom: a row of a table.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Arm {
    /// Who drives.
    pub policy: Named,
    /// What makes the frames.
    pub observation: Named,
    /// Which agents react.
    pub agents: AgentMode,
    /// Who ranks the proposals.
    pub scorer: String,
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::manifest::Recipe;
    use crate::manifest::tests::{entry, set};

    fn named(name: &str) -> Named {
        Named { name: name.to_owned(), digest: String::new() }
    }

    pub(crate) fn sheet(sets: &[Manifest]) -> Sheet {
        Sheet {
            sets: sets.iter().map(|set| Named { name: set.name.clone(), digest: set.digest.clone() }).collect(),
            policies: vec![named("lattice"), named("camera")],
            observations: vec![named("layout")],
            agents: vec![AgentMode::IdmAll],
            scorers: vec!["learned".to_owned()],
            seeds: vec![1, 2],
            place: Place { folders: vec![PathBuf::from("."); sets.len()], ..Place::default() },
            ..Sheet::new("0")
        }
    }

    #[test]
    fn cells_are_all_combinations_each_once() {
        let sets = [set(&["a", "b", "c"])];
        let sheet = sheet(&sets);
        assert_eq!(sheet.cells(&sets).expect("sound").len(), 3 * 2 * 2);
        let selecting = Sheet { selection: vec![0], ..sheet.clone() };
        assert_eq!(selecting.cells(&sets).expect("sound").len(), 3 * 2 * 3);
        assert_eq!(Sheet { selection: vec![0, 2], ..sheet.clone() }.overlap(), Some(2));
        assert_eq!(sheet.repeated(), None);
        let twice = Sheet { seeds: vec![1, 2, 1], ..sheet.clone() };
        assert_eq!(twice.repeated(), Some(("seed", "1".to_owned())));
        let doubled = [sets[0].clone(), set(&["a"])];
        assert_eq!(sheet.cells(&doubled).expect("sound").len(), 3 * 2 * 2);
        let mut other = entry("a", "MIT");
        other.scenario_digest = Digest::of(b"other").to_string();
        let of = |kind| Manifest::new("other", kind, Recipe::default(), vec![other.clone()]);
        let error = sheet.cells(&[sets[0].clone(), of(Kind::Base)]).expect_err("ambiguous").to_string();
        assert!(error.contains("\"a\""), "{error}");
        let two = [
            set(&["b"]),
            of(Kind::Behavior),
            Manifest::new("replay", Kind::Behavior, Recipe::default(), vec![entry("a", "MIT")]),
        ];
        assert_eq!(sheet.cells(&two).expect("two modes").len(), 3 * 2 * 2);
    }

    #[test]
    fn a_sheet_comes_back_with_its_sets() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let sets = vec![set(&["a", "b"])];
        let sheet = sheet(&sets);
        sheet.save(&sets, folder.path()).expect("written");
        assert_eq!(Sheet::load(folder.path()).expect("sound"), (sheet.clone(), sets));
        file::write_json(&set(&["a"]), &folder.path().join("sets/some.set.json")).expect("written");
        let error = Sheet::load(folder.path()).expect_err("another set").to_string();
        assert!(error.contains("some.set.json") && error.contains("benchmark.json"), "{error}");
        let moved = Sheet { shard: Shard { index: 1, count: 2 }, ..sheet.clone() };
        assert_eq!(moved.digest(), sheet.digest());
        assert_ne!(Sheet { program: "1".to_owned(), ..sheet.clone() }.digest(), sheet.digest());
    }

    /// Printed by the program in which agents and tracker were texts.
    #[test]
    fn names_of_choices_keep_the_digest_as_it_was() {
        const DIGEST: &str = "913bcc416c9e10f5d5a0631773da22fabe3dd529bf47d12d8760a7e51fe584b6";
        let settings = r#"{"replan":5,"horizon":80,"history":1,"tracker":"pure-pursuit","video_backend":"cpu"}"#;
        let settings: Settings = serde_json::from_str(settings).expect("settings");
        let sheet = Sheet { agents: vec![AgentMode::IdmAll, AgentMode::LogReplay], settings, ..Sheet::new("0") };
        assert_eq!(sheet.digest().to_string(), DIGEST);
        let text = serde_json::to_string(&sheet).expect("JSON");
        assert!(text.contains(r#""agents":["idm-all","log-replay"]"#), "{text}");
        let error = serde_json::from_str::<Sheet>(&text.replace("log-replay", "log")).expect_err("no mode").to_string();
        assert!(error.contains("no agent mode \"log\""), "{error}");
    }

    #[test]
    fn what_an_endpoint_is_about_and_nobody_drives_is_named() {
        let sets = [set(&["a"])];
        let sheet = sheet(&sets);
        let undriven = |claim: Claim| sheet.undriven(&claim, &sets);
        let [lattice, camera, other] = ["lattice", "camera", "other"].map(str::to_owned);
        let policies = |second: &String| Claim::Policies { first: lattice.clone(), second: second.clone() };
        assert_eq!(undriven(policies(&camera)), None);
        assert_eq!(undriven(policies(&other)).as_deref(), Some("policy \"other\""));
        assert_eq!(undriven(Claim::Coverage { policy: camera.clone() }).as_deref(), Some("set of kind behavior"));
        let contacts = Claim::Contacts { policy: camera, first: sets[0].name.clone(), second: other };
        assert_eq!(undriven(contacts).as_deref(), Some("set \"other\""));
    }
}
