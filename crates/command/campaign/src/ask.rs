//! From arguments to the sheet of a benchmark: names with the digests of what stands behind them, and how much it is.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use ds_benchmark::{Manifest, Named, Place, Settings, Shard, Sheet};
use ds_launch::own;
use ds_policy::{Learned, Own, Policy};
use ds_process::shipped;
use ds_process::terminal::answer;
use ds_space::{Digest, DigestWriter};
use ds_topic::ObservationSource;

use crate::Ended;
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
        if let Some(manifest) = Own::named(name) {
            let own = own::seeing(&manifest, args.history)?;
            let path = std::fs::canonicalize(&manifest).with_context(|| format!("path of {name}"))?;
            manifests.insert(own.name().to_owned(), path);
            return Ok(Named { name: own.name().to_owned(), digest: own.digest().to_string() });
        }
        let of_weights = |learned: Learned| -> Result<String> {
            let weights = learned.weights_file(&args.networks.policy_weights);
            learned.trained(&weights)?;
            of_files(&[&weights])
        };
        let digest = Learned::of(name).map(of_weights).transpose()?.unwrap_or_default();
        Ok(Named { name: name.clone(), digest })
    };
    let model =
        [args.networks.model.as_path(), &args.networks.model.with_extension("safetensors")].map(Path::to_path_buf);
    let unguided = model[0].with_file_name("arms").join("no_guidance.safetensors");
    let observation = |source: &ObservationSource| -> Result<Named> {
        let mut existing: Vec<&PathBuf> = model.iter().filter(|file| file.exists()).collect();
        let shown = source.is_generated();
        if *source == ObservationSource::DreamstreamNoGuidance {
            existing.push(&unguided);
        }
        Ok(Named { name: source.name().to_owned(), digest: if shown { of_files(&existing)? } else { String::new() } })
    };
    let policies = args.policies.iter().map(policy).collect::<Result<_>>()?;
    let sheet = Sheet {
        sets: sets.iter().map(|set| Named { name: set.name.clone(), digest: set.digest.clone() }).collect(),
        policies,
        observations: args.observations.iter().map(observation).collect::<Result<_>>()?,
        agents: args.agents.iter().map(|mode| mode.name().to_owned()).collect(),
        scorers: args.scorers.iter().map(|scorer| scorer.name().to_owned()).collect(),
        seeds: args.seeds.clone(),
        selection: args.selection.clone(),
        settings: Settings {
            replan: args.replan,
            horizon: args.horizon,
            history: args.history,
            tracker: args.tracker.name().to_owned(),
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

/// Runs `plan`.
///
/// # Errors
/// If a manifest is refused.
pub(crate) fn plan(what: &CellArgs, rate: f64, machines: u32) -> Result<Ended> {
    let (sheet, sets) = sheet(what)?;
    let cells = sheet.cells(&sets)?;
    let frames: u64 = cells.values().map(|(cell, _)| u64::from(cell.last)).sum();
    let largest = cells.len().div_ceil(machines as usize);
    sets.iter().for_each(crate::describe);
    let hours = frames as f64 / rate.max(1e-9) / 3600.0;
    answer(&format!(
        "{} cells ({} arms, {} seeds), {frames} frames; {hours:.2} h at {rate} frames/s on one machine, {:.2} h on {machines}, \
         {largest} cells in the largest shard",
        cells.len(),
        sheet.arms().len(),
        sheet.seeds.len(),
        hours / f64::from(machines),
    ));
    Ok(Ended::Complete)
}
