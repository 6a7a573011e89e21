//! `scenario list|show|generate` and `import`.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use ds_campaign::adverse;
use ds_import::{Choice, Format};
use ds_launch::scenarios::files;
use ds_process::maker::chain;
use ds_process::terminal::{answer, complain};
use indicatif::ProgressBar;

use crate::cli::{ImportArgs, ScenarioCommand};

/// Runs a command of `scenario`.
///
/// # Errors
/// If a file is refused or nothing is found.
pub(crate) fn run(command: &ScenarioCommand) -> Result<()> {
    match command {
        ScenarioCommand::Adverse(args) => adverse::run(args, &files(&args.paths)?, &files(&args.fit)?),
        ScenarioCommand::List { paths } => list(paths),
        ScenarioCommand::Show { path } => {
            let (scene, warnings) = ds_scenario::load(path)?;
            answer(&ds_scenario::describe(&scene));
            warnings.iter().for_each(|warning| answer(&format!("warning: {warning}")));
            Ok(())
        }
        ScenarioCommand::Generate { family, seed, count, out } => {
            let family = match family.as_str() {
                "all" => None,
                name => Some(name.parse::<ds_scenario::Family>()?),
            };
            let written = ds_scenario::generate_set(family, *seed, *count, out)?;
            answer(&format!("{} scenarios written to {}", written.len(), out.display()));
            Ok(())
        }
    }
}

fn list(paths: &[PathBuf]) -> Result<()> {
    answer(&format!(
        "{:<34} {:>7} {:>7} {:>6} {:<12} {}",
        "scenario", "seconds", "agents", "lanes", "licence", "family"
    ));
    for path in files(paths)? {
        let (scene, _) = ds_scenario::load(&path)?;
        let secs = f64::from(scene.last_tick().0) * scene.dt.secs();
        let (agents, lanes) = (scene.tracks.len(), scene.map.lanes.len());
        answer(&format!(
            "{:<34} {secs:>7.1} {agents:>7} {lanes:>6} {:<12} {}",
            scene.name, scene.origin.licence, scene.family
        ));
    }
    Ok(())
}

/// Runs `import`: every readable log becomes a scenario file, every bad one a named error.
///
/// # Errors
/// If any log was refused; the others are still written.
pub(crate) fn import(args: &ImportArgs) -> Result<()> {
    ensure!(args.maps.is_none() || args.format == Format::OpenScene, "--maps is for openscene only");
    ensure!(args.ego.is_none() || args.format == Format::CommonRoad, "--ego is for commonroad only");
    let mut refused = 0;
    for path in &args.paths {
        refused += import_one(args, path).with_context(|| format!("import of {}", path.display()))?;
    }
    ensure!(refused == 0, "{refused} of the logs were refused");
    Ok(())
}

fn import_one(args: &ImportArgs, path: &Path) -> Result<usize> {
    let spinner = ProgressBar::new_spinner();
    let mut refused = 0;
    let choice = Choice { maps: args.maps.as_deref(), ego: args.ego.as_deref() };
    ds_import::import_path(args.format, path, choice, &args.out, &mut |imported| {
        spinner.tick();
        match &imported.outcome {
            Ok((written, warnings)) => {
                answer(&format!("{} → {}", imported.log.display(), written.display()));
                warnings.iter().for_each(|warning| answer(&format!("  warning: {warning}")));
            }
            Err(error) => {
                refused += 1;
                complain(&anyhow::anyhow!("{}: {}", imported.log.display(), chain(error)));
            }
        }
    })?;
    spinner.finish_and_clear();
    Ok(refused)
}
