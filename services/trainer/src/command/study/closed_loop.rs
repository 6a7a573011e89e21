//! `study closed-loop`: drives of a benchmark's cells on every source, then how far they lie from those on the reference.

use std::num::NonZero;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use ds_benchmark::record;
use ds_campaign::cli::{CellArgs, Kept, RunArgs};
use ds_evaluate::study::closed_loop::{self, ClosedLoop, Drive, REFERENCE};
use ds_evaluate::study::write_drives;
use ds_launch::Networks;
use ds_policy::Own;
use ds_process::terminal::answer;
use ds_topic::{ObservationSource, ProposalScorer};
use ds_world::{AgentMode, TrackerKind};
use serde::Deserialize;

use super::{config_of, shown, take, wrong};
use crate::cli::StudyArgs;

/// Only every so many-th scenario is driven for a look.
const QUICK: NonZero<usize> = NonZero::new(8).expect("not zero");

/// What is driven and asked. Paths are relative to the configuration file, `out` to the current folder.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Config {
    version: u32,
    out: PathBuf,
    /// Manifests of scenario sets (NAME.set.json).
    sets: Vec<PathBuf>,
    /// Only every so many-th scenario of each set is driven; all without it.
    #[serde(default = "each")]
    every: NonZero<usize>,
    policies: Vec<String>,
    /// Observation sources; the reference is driven too.
    sources: Vec<String>,
    /// Pairs of sources: is the first nearer to the reference than the second?
    #[serde(default)]
    nearer: Vec<[String; 2]>,
    seeds: Vec<u64>,
    draws: u64,
    model: PathBuf,
    policy_weights: PathBuf,
}

fn each() -> NonZero<usize> {
    NonZero::<usize>::MIN
}

impl Config {
    /// Returns what breaks a rule.
    fn wrong(&self) -> Option<String> {
        let rules = [
            (self.version == 1, "version must be 1"),
            ((1..=100_000).contains(&self.draws), "draws must be 1 to 100000"),
            (!self.sets.is_empty(), "sets must name one"),
            (!self.policies.is_empty(), "policies must name one"),
            (!self.seeds.is_empty(), "seeds must name one"),
            (self.sources.iter().any(|source| source != REFERENCE), "sources must name one besides the reference"),
        ];
        let absent = self.nearer.iter().flatten().find(|name| !self.sources.contains(name));
        let same = self.nearer.iter().find(|[source, than]| source == than);
        let rule = rules.iter().find(|(held, _)| !held).map(|(_, rule)| (*rule).to_owned());
        rule.or_else(|| absent.map(|name| format!("nearer asks about {name:?}, which is not among sources")))
            .or_else(|| same.map(|[name, _]| format!("nearer asks whether {name:?} is nearer than itself")))
    }
}

/// Reads what is driven and asked, with the sources of the drives: the reference first.
fn asked(args: &StudyArgs, path: &Path) -> Result<(Config, Vec<ObservationSource>)> {
    ensure!(args.recorded.is_none(), "--recorded is of studies over frames");
    ensure!(args.given.fid.is_none() && args.given.fvd.is_none(), "--fid and --fvd are of studies over frames");
    ensure!(args.scenarios.is_none(), "--scenarios is of studies over frames: sets say what is driven");
    let config: Config = toml::from_str(&std::fs::read_to_string(path)?)?;
    if let Some(rule) = config.wrong() {
        bail!(rule);
    }
    let mut observations = vec![ObservationSource::Reference];
    for name in &config.sources {
        let source = ObservationSource::from_name(name).with_context(|| format!("there is no source {name:?}"))?;
        observations.extend((!observations.contains(&source)).then_some(source));
    }
    Ok((config, observations))
}

/// Returns a policy's name; of one that is named by its manifest where that lies.
fn policy_of(base: &Path, policy: &str) -> String {
    Own::named(policy).map_or_else(|| policy.to_owned(), |manifest| base.join(manifest).display().to_string())
}

/// Drives and compares.
///
/// # Errors
/// If the configuration is refused or drives fail.
pub(super) fn run(args: &StudyArgs) -> Result<()> {
    let path = config_of(args, "closed-loop");
    let (config, observations) = asked(args, &path).map_err(|error| wrong(&path, error))?;
    let mut out = args.out.clone().unwrap_or(config.out);
    if args.quick {
        out = out.join("quick");
    }
    let _held = take(&out, "closed-loop")?;
    let base = path.parent().unwrap_or(Path::new("."));
    let drives = RunArgs {
        what: CellArgs {
            manifests: config.sets.iter().map(|set| base.join(set)).collect(),
            policies: config.policies.iter().map(|policy| policy_of(base, policy)).collect(),
            observations,
            agents: vec![AgentMode::IdmAll],
            scorers: vec![ProposalScorer::Learned],
            seeds: config.seeds,
            selection: Vec::new(),
            replan: 5,
            horizon: 80,
            history: 1,
            tracker: TrackerKind::Lqr,
            networks: Networks {
                model: base.join(&config.model),
                policy_weights: base.join(&config.policy_weights),
                ..Networks::default()
            },
        },
        endpoints: None,
        shard: "0/1".to_owned(),
        workers: None,
        keep: Kept::None,
        policy_listen: None,
        done: Vec::new(),
        metrics: None,
        out: out.join("drives"),
    };
    let every = if args.quick { QUICK.max(config.every) } else { config.every };
    let complete = ds_campaign::drives(&drives, every.get())?;
    ensure!(complete, "not all drives have ended: the same command goes on");
    let (mut all, mut unscored) = (Vec::new(), 0);
    record::read(&drives.out, |_, record| match record.episode.driving_score.filter(|_| record.ended()) {
        Some(score) => all.push(Drive {
            policy: record.cell.policy.name.clone(),
            source: record.cell.observation.name.clone(),
            unit: format!("{} {}", record.cell.scenario, record.cell.seed),
            driving_score: 100.0 * score,
        }),
        None => unscored += usize::from(record.ended()),
    })?;
    let mut found = closed_loop::compare(&all, &config.nearer, config.draws);
    found.quick = args.quick;
    found.left_out += unscored;
    let part = if every == each() { String::new() } else { format!(", one scenario of {every}") };
    let named = |set: &PathBuf| format!("{}{part}", set.file_name().unwrap_or_default().to_string_lossy());
    found.sets = config.sets.iter().map(named).collect();
    write_drives(&out, &found)?;
    tell(&found);
    for name in ["closed-loop.json", "index.html"] {
        answer(&out.join(name).display().to_string());
    }
    Ok(())
}

/// Says what was found in the terminal.
fn tell(found: &ClosedLoop) {
    for (policy, gaps) in &found.gaps {
        for (source, gap) in gaps {
            answer(&format!(
                "{policy} on {source}: {} drives, |DS - DS on {REFERENCE}| {}, difference {}",
                gap.drives,
                shown(gap.distance),
                shown(gap.difference)
            ));
        }
    }
    for nearer in &found.nearer {
        answer(&format!(
            "{}: {} less {}: {}, p {:.4}, Holm {:.4}",
            nearer.policy,
            nearer.source,
            nearer.than,
            shown(nearer.apart),
            nearer.p,
            nearer.p_holm
        ));
    }
}
