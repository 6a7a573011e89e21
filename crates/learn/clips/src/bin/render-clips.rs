//! Renders a recipe of clips without the rest of the project: `render-clips RECIPE [DIR]`, with a line now and then.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ds_clips::{ClipSet, ClipsError, Progress, Recipe};
use ds_raster::Encoding;

struct Lines;

impl Progress for Lines {
    fn made(&self, clips: u64, of: u64) {
        if clips.is_multiple_of(48) || clips == of {
            eprintln!("{clips} of {of} clips");
        }
    }

    fn noted(&self, line: &str) {
        eprintln!("warning: {line}");
    }
}

fn run(path: &Path, folder: Option<PathBuf>) -> Result<(), ClipsError> {
    let recipe = Recipe::load(path)?;
    let folder = folder.unwrap_or_else(|| recipe.folder.clone());
    ds_clips::render(&recipe, &folder, &Lines)?;
    let sheet = ds_clips::contact_sheet(&ClipSet::open(&folder)?, 24)?;
    let broken = |reason: String| ClipsError::Broken { path: folder.join("sheet.png"), reason };
    let bytes = sheet.encode(Encoding::Png).map_err(|error| broken(error.to_string()))?;
    std::fs::write(folder.join("sheet.png"), bytes).map_err(|error| broken(error.to_string()))
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (recipe, folder) = match arguments.as_slice() {
        [recipe] => (recipe, None),
        [recipe, folder] => (recipe, Some(PathBuf::from(folder))),
        _ => {
            eprintln!("usage: render-clips RECIPE [DIR]");
            return ExitCode::from(64);
        }
    };
    match run(Path::new(recipe), folder) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            let mut source = std::error::Error::source(&error);
            while let Some(error) = source {
                eprintln!("  {error}");
                source = error.source();
            }
            ExitCode::FAILURE
        }
    }
}
