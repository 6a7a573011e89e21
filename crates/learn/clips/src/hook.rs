//! External programs beside the renderer: a captioner, and an editor of first frames.
//!
//! Both get the first frame as a PNG file and the facts as a JSON file, named by their last arguments. A captioner
//! prints the prompt; an editor writes a PNG of the same size to the third path. Anything else fails the clip.

use std::path::Path;
use std::process::{Command, Stdio};

use ds_raster::{Encoding, RgbImage};
use ds_scenario::Facts;
use serde::Serialize;

use crate::error::ClipsError;
use crate::recipe::HookConfig;

const MOST_PROMPT_BYTES: usize = 4_096;

/// What an external program is told, besides the picture.
#[derive(Debug, Serialize)]
pub(crate) struct Brief<'a> {
    /// The scenario's name.
    pub(crate) scenario: &'a str,
    /// The wanted look, on its axes.
    pub(crate) lighting: &'a str,
    /// The weather.
    pub(crate) weather: &'a str,
    /// The road surface.
    pub(crate) surface: &'a str,
    /// The prompt of the template.
    pub(crate) prompt: &'a str,
    /// The facts it was written from.
    pub(crate) facts: &'a Facts,
}

/// Lets a captioner describe a first frame.
pub(crate) fn caption(hook: &HookConfig, first: &RgbImage, brief: &Brief) -> Result<String, ClipsError> {
    let folder = handed_over(hook, first, brief)?;
    let output = run(hook, &[&folder.path().join("first.png"), &folder.path().join("facts.json")])?;
    let text = String::from_utf8(output).map_err(|_| failed(hook, "it printed something else than UTF-8"))?;
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if text.is_empty() || text.len() > MOST_PROMPT_BYTES {
        let reason = format!("it printed {} bytes of prompt, 1 to {MOST_PROMPT_BYTES} are accepted", text.len());
        return Err(failed(hook, &reason));
    }
    Ok(text)
}

/// Lets an editor change a first frame.
pub(crate) fn edit(hook: &HookConfig, first: &RgbImage, brief: &Brief) -> Result<RgbImage, ClipsError> {
    let folder = handed_over(hook, first, brief)?;
    let edited = folder.path().join("edited.png");
    run(hook, &[&folder.path().join("first.png"), &folder.path().join("facts.json"), &edited])?;
    let bytes = std::fs::read(&edited).map_err(|error| failed(hook, &format!("it wrote no picture: {error}")))?;
    RgbImage::decode(Encoding::Png, first.width_px(), first.height_px(), &bytes).map_err(|error| {
        let cause = std::error::Error::source(&error).map(|source| format!(" ({source})")).unwrap_or_default();
        failed(hook, &format!("its picture is refused: {error}{cause}"))
    })
}

fn handed_over(hook: &HookConfig, first: &RgbImage, brief: &Brief) -> Result<tempfile::TempDir, ClipsError> {
    let fail = |error: &dyn std::fmt::Display| failed(hook, &format!("its input cannot be written: {error}"));
    let folder = tempfile::tempdir().map_err(|error| fail(&error))?;
    let picture = first.encode(Encoding::Png).map_err(|error| fail(&error))?;
    std::fs::write(folder.path().join("first.png"), picture).map_err(|error| fail(&error))?;
    let facts = serde_json::to_vec_pretty(brief).map_err(|error| fail(&error))?;
    std::fs::write(folder.path().join("facts.json"), facts).map_err(|error| fail(&error))?;
    Ok(folder)
}

fn run(hook: &HookConfig, paths: &[&Path]) -> Result<Vec<u8>, ClipsError> {
    let mut command = Command::new(&hook.command[0]);
    command.args(&hook.command[1..]).args(paths).stdin(Stdio::null());
    let output = command.output().map_err(|error| failed(hook, &format!("it cannot be started: {error}")))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let last = said.trim().lines().last().unwrap_or("nothing on stderr").to_owned();
        return Err(failed(hook, &format!("{}: {last}", output.status)));
    }
    Ok(output.stdout)
}

fn failed(hook: &HookConfig, reason: &str) -> ClipsError {
    ClipsError::Hook { program: hook.command.join(" "), reason: reason.to_owned() }
}
