//! `data`: renders, lists and shows clips for training and evaluation.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, ensure};
use ds_clips::{ClipSet, Progress, Recipe, Source};
use ds_process::service::InterruptedError;
use ds_process::terminal::{answer, bar, stop_flag};
use ds_raster::Encoding;
use indicatif::ProgressBar;

use crate::cli::{DataCommand, DataListArgs, DataPaintsArgs, DataRenderArgs, DataSheetArgs};

struct Bar {
    bar: ProgressBar,
    stop: Arc<AtomicBool>,
}

impl Progress for Bar {
    fn made(&self, clips: u64, of: u64) {
        self.bar.set_length(of);
        self.bar.set_position(self.bar.position().max(clips));
    }

    fn noted(&self, line: &str) {
        self.bar.suspend(|| answer(&format!("warning: {line}")));
    }

    fn stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Runs a command on clips.
///
/// # Errors
/// If a recipe or set is refused or files cannot be written.
pub(crate) fn run(command: &DataCommand) -> Result<()> {
    match command {
        DataCommand::Render(args) => render(args),
        DataCommand::Sheet(args) => sheet(args),
        DataCommand::List(args) => list(args),
        DataCommand::Paints(args) => paints(args),
    }
}

fn render(args: &DataRenderArgs) -> Result<()> {
    let mut recipe = Recipe::load(&args.config).with_context(|| format!("recipe {}", args.config.display()))?;
    if let Some(world) = &args.world {
        let asked = if world == "b" { Source::SecondWorld } else { Source::Reference };
        if asked != recipe.source {
            ensure!(args.out.is_some(), "--world {world} differs from the recipe's: say with --out where the clips go");
            recipe = recipe.in_world(asked)?;
        }
    }
    let folder = args.out.clone().unwrap_or_else(|| recipe.folder.clone());
    let progress = Bar { bar: bar(0, "clips"), stop: stop_flag()? };
    let rendered = ds_clips::render(&recipe, &folder, &progress)?;
    progress.bar.finish_and_clear();
    let place = rendered.folder.display();
    if rendered.clips < rendered.of {
        let (made, of) = (rendered.clips, rendered.of);
        return Err(InterruptedError(format!("{made} of {of} clips in {place}: the same command goes on")).into());
    }
    answer(&format!("{} clips in {place}, {} of them made now", rendered.clips, rendered.made));
    save_sheet(&ClipSet::open(&folder)?, 24, folder.join("sheet.png"))
}

fn sheet(args: &DataSheetArgs) -> Result<()> {
    let set = ClipSet::open(&args.set).with_context(|| format!("set of clips {}", args.set.display()))?;
    let path = args.out.clone().unwrap_or_else(|| args.set.join("sheet.png"));
    save_sheet(&set, usize::from(args.clips), path)
}

fn save_sheet(set: &ClipSet, clips: usize, path: PathBuf) -> Result<()> {
    let bytes = ds_clips::contact_sheet(set, clips)?.encode(Encoding::Png)?;
    std::fs::write(&path, bytes).with_context(|| format!("contact sheet {}", path.display()))?;
    answer(&format!("contact sheet {}", path.display()));
    Ok(())
}

fn list(args: &DataListArgs) -> Result<()> {
    let set = ClipSet::open(&args.set).with_context(|| format!("set of clips {}", args.set.display()))?;
    for clip in &set.index().clips {
        answer(&format!(
            "{:5} {} network {} {} {} frames, {} ticks: {}",
            clip.index, clip.scenario, clip.network, clip.appearance, clip.frames, clip.ticks, clip.prompt
        ));
    }
    Ok(())
}

fn paints(args: &DataPaintsArgs) -> Result<()> {
    let set = ClipSet::open(&args.set).with_context(|| format!("set of clips {}", args.set.display()))?;
    let bar = bar(set.len() as u64, "clips");
    let mut all = Vec::new();
    for at in 0..set.len() {
        let clip = set.whole(at)?;
        let seen = clip.frames.iter().zip(clip.geometry.iter().map(|geometry| &**geometry));
        let Some(brightness) = clip.frames.first().map(ds_video::brightness) else { continue };
        all.extend(ds_raster::paints(seen).into_values().map(|paint| ds_video::relit(paint, 1.0 / brightness)));
        bar.inc(1);
    }
    bar.finish_and_clear();
    all.sort_by_key(|paint| paint.map(u32::from).iter().sum::<u32>());
    ensure!(!all.is_empty(), "no clip of {} shows a vehicle with its geometry", args.set.display());
    let count = usize::from(args.count).min(all.len());
    let shown = (0..count).map(|at| all[(2 * at + 1) * all.len() / (2 * count)]);
    answer(&format!("# the paint of {} vehicles", all.len()));
    answer(&format!("paints = {:?}", shown.collect::<Vec<_>>()));
    Ok(())
}
