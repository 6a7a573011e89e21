//! From arguments to the sheet of a benchmark: names with the digests of what stands behind them, and how much it is.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use ds_benchmark::{Differs, Manifest, Named, Place, Settings, Shard, Sheet};
use ds_launch::own;
use ds_policy::builtin::{NAMES, is_builtin};
use ds_policy::{Learned, Own, Policy};
use ds_process::shipped;
use ds_space::{Digest, DigestWriter};
use ds_topic::ObservationSource;

use crate::cli::CellArgs;

/// Reads manifests, with the folder of each.
///
/// # Errors
/// If one is refused.
pub(crate) fn manifests(paths: &[PathBuf]) -> Result<(Vec<Manifest>, Vec<PathBuf>)> {
    let mut sets: Vec<Manifest> = Vec::new();
    let mut folders = Vec::new();
    for path in paths {
        let set = Manifest::load(path)?;
        if let Some(there) = sets.iter().find(|there| there.name == set.name) {
            bail!("set {:?} is named twice, with digests {} and {}", set.name, there.digest, set.digest);
        }
        sets.push(set);
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        folders.push(std::fs::canonicalize(folder).with_context(|| format!("path of {}", folder.display()))?);
    }
    Ok((sets, folders))
}

/// Returns the sheet that arguments ask for, over all shards, and its sets.
///
/// # Errors
/// If a manifest, of a set or of a policy, or a file of weights is refused.
pub(crate) fn sheet(args: &CellArgs) -> Result<(Sheet, Vec<Manifest>)> {
    let (sets, folders) = manifests(&args.manifests)?;
    let mut manifests = BTreeMap::new();
    let policy = |name: &String| -> Result<Named> {
        let Some(manifest) = Own::named(name) else { return policy(name, &args.networks.policy_weights) };
        let own = own::seeing(&manifest, args.history)?;
        let path = std::fs::canonicalize(&manifest).with_context(|| format!("path of {name}"))?;
        manifests.insert(own.name().to_owned(), path);
        Ok(Named { name: own.name().to_owned(), digest: own.digest().to_string() })
    };
    let policies: Vec<Named> = args.policies.iter().map(policy).collect::<Result<_>>()?;
    let observation = |source: &ObservationSource| observation(*source, &args.networks.model);
    let sheet = Sheet {
        sets: sets.iter().map(|set| Named { name: set.name.clone(), digest: set.digest.clone() }).collect(),
        policies,
        observations: args.observations.iter().map(observation).collect::<Result<_>>()?,
        agents: args.agents.clone(),
        scorers: args.scorers.iter().map(|scorer| scorer.name().to_owned()).collect(),
        seeds: args.seeds.clone(),
        selection: args.selection.clone(),
        settings: Settings {
            replan: args.replan,
            horizon: args.horizon,
            history: args.history,
            tracker: args.tracker,
            video_backend: args.networks.video_backend.name().to_owned(),
        },
        shard: Shard::ALL,
        place: Place {
            folders,
            model: args.networks.model.clone(),
            policy_weights: args.networks.policy_weights.clone(),
            manifests,
            ..Place::default()
        },
        ..Sheet::new(env!("CARGO_PKG_VERSION"))
    };
    if let Some((what, value)) = sheet.repeated() {
        bail!("{what} {value} is named twice");
    }
    if let Some(seed) = sheet.overlap() {
        bail!("seed {seed} is given to --seed and to --selection-seed: what selects may not be reported on");
    }
    for entry in sets.iter().flat_map(|set| &set.entries) {
        if entry.hand_over % sheet.settings.replan != 0 {
            bail!(
                "entry {:?} is handed over at tick {}, which is no multiple of --replan {}",
                entry.name,
                entry.hand_over,
                sheet.settings.replan
            );
        }
    }
    Ok((sheet, sets))
}

/// Returns the policies that connect from outside.
pub(crate) fn outside(sheet: &Sheet) -> impl Iterator<Item = &str> {
    let names = sheet.policies.iter().map(|policy| policy.name.as_str());
    names.filter(|name| !is_builtin(name) && !sheet.place.manifests.contains_key(*name))
}

/// Refuses policies that a fleet would only refuse once it is under way.
pub(crate) fn check(sheet: &Sheet) -> Result<()> {
    let outside: Vec<&str> = outside(sheet).collect();
    match (outside.as_slice(), &sheet.place.policy_listen) {
        ([], None) | ([_], Some(_)) => Ok(()),
        ([], Some(listen)) => bail!("--policy-listen {listen} is for an external policy, and all are built in"),
        ([name, ..], None) => {
            let names: Vec<&str> = NAMES.iter().map(|(name, _)| *name).collect();
            bail!(
                "there is no policy {name:?}: built in are {}; an external one needs --policy-listen",
                names.join(", ")
            )
        }
        (names, Some(_)) => bail!("one external policy at a time, not {}", names.join(", ")),
    }
}

/// Refuses to go on with a benchmark whose program, weights or model are no longer those that it began with.
///
/// # Errors
/// What differs, with what it was and is; if a file is not to be had.
pub(crate) fn unchanged(sheet: &Sheet) -> Result<()> {
    let place = &sheet.place;
    let of_policy = |there: &Named| match place.manifests.get(&there.name) {
        Some(manifest) => Ok(Named { digest: own::read(manifest)?.digest().to_string(), ..there.clone() }),
        None => policy(&there.name, &place.policy_weights),
    };
    let of_source = |there: &Named| {
        let source = ObservationSource::from_name(&there.name);
        observation(source.with_context(|| format!("observation {:?}", there.name))?, &place.model)
    };
    let now = Sheet {
        program: env!("CARGO_PKG_VERSION").to_owned(),
        policies: sheet.policies.iter().map(of_policy).collect::<Result<_>>()?,
        observations: sheet.observations.iter().map(of_source).collect::<Result<_>>()?,
        ..sheet.clone()
    };
    if let Some(Differs { part, first, second }) = sheet.differs(&now) {
        bail!("{part} differ: the benchmark began with {first}, there is now {second}");
    }
    Ok(())
}

/// Returns a policy that no manifest names, with the digest of its weights.
fn policy(name: &str, weights: &Path) -> Result<Named> {
    let of_weights = |learned: Learned| -> Result<String> {
        let weights = learned.weights_file(weights);
        learned.trained(&weights)?;
        of_files(&[weights])
    };
    let digest = Learned::of(name).map(of_weights).transpose()?.unwrap_or_default();
    Ok(Named { name: name.to_owned(), digest })
}

/// Returns what makes frames, with the digest of the video model where one makes them.
fn observation(source: ObservationSource, model: &Path) -> Result<Named> {
    let mut files = vec![model.to_owned()];
    files.extend(Some(model.with_extension("safetensors")).filter(|weights| weights.exists()));
    if source == ObservationSource::DreamstreamNoGuidance {
        files.push(model.with_file_name("arms").join("no_guidance.safetensors"));
    }
    let digest = if source.is_generated() { of_files(&files)? } else { String::new() };
    Ok(Named { name: source.name().to_owned(), digest })
}

fn of_files(files: &[impl AsRef<Path>]) -> Result<String> {
    let mut writer = DigestWriter::new();
    for file in files {
        let file = file.as_ref();
        let bytes = std::fs::read(file).with_context(|| format!("read {}", shipped::describe(file)))?;
        writer.digest(&Digest::of(&bytes));
    }
    Ok(writer.finish().to_string())
}

/// Returns the shard that a text names; `auto` reads the variables of a job array.
///
/// # Errors
/// If it names none.
#[expect(clippy::disallowed_methods, reason = "the scheduler of a job array speaks by these variables alone")]
pub(crate) fn shard(text: &str) -> Result<Shard> {
    match text {
        "auto" => Shard::of_array(|name| std::env::var(name).ok()).context("--shard auto"),
        text => text.parse().context("--shard"),
    }
}
