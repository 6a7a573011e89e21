//! The pictures of a drive: an animation and a contact sheet.

use std::path::Path;

use anyhow::{Context, Result};
use ds_record::Recording;

/// Writes `NAME.gif` and `NAME.png` to a folder.
///
/// # Errors
/// If the recording cannot be drawn or the folder not be written.
pub(crate) fn draw(recording: &Recording, name: &str, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("create {}", folder.display()))?;
    let stem = Path::new(name).file_name().and_then(|name| name.to_str()).unwrap_or("drive");
    let stem = stem.trim_end_matches(".mcap");
    let reel = recording.reel()?;
    reel.animate(&folder.join(format!("{stem}.gif")))?;
    reel.contact_sheet(&folder.join(format!("{stem}.png")))?;
    Ok(())
}
