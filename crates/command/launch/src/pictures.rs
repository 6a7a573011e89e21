//! The pictures of drives: an animation and a contact sheet of each, drawn as it ends, beside those that go on.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use ds_process::runs::EpisodeResults;
use ds_process::terminal::bar;
use ds_record::Recording;
use ds_wire::control as pb;
use tokio::sync::Semaphore;
use tokio::task::JoinSet;

use crate::fleet_plan::workers;

/// Draws drives as they end, as many at a time as cores serve.
pub(crate) struct Painter {
    folder: PathBuf,
    /// Episodes whose pictures were begun.
    begun: BTreeSet<String>,
    drawn: JoinSet<Result<()>>,
    places: Arc<Semaphore>,
}

impl Painter {
    /// Makes a painter of a run in a folder; pictures go to `pictures` in it.
    #[must_use]
    pub(crate) fn new(out: &Path) -> Self {
        let places = Arc::new(Semaphore::new(workers(None, usize::MAX) as usize));
        Self { folder: out.join("pictures"), begun: BTreeSet::new(), drawn: JoinSet::new(), places }
    }

    /// Begins to draw what ended since the last look.
    pub(crate) fn look(&mut self, told: &EpisodeResults) {
        let recorded = |episode: &pb::EpisodeResult| pb::has_ended(episode.status) && !episode.recording.is_empty();
        for (id, episode) in told.iter().filter(|(_, episode)| recorded(episode)) {
            if self.begun.insert(id.clone()) {
                let (recording, folder) = (PathBuf::from(&episode.recording), self.folder.clone());
                let places = Arc::clone(&self.places);
                self.drawn.spawn(async move {
                    let _place = places.acquire_owned().await.context("a place to draw")?;
                    tokio::task::spawn_blocking(move || draw(&recording, &folder)).await.context("drawing")?
                });
            }
        }
    }

    /// Waits until all is drawn.
    ///
    /// # Errors
    /// If a recording cannot be drawn or the folder not be written.
    pub(crate) async fn finish(mut self) -> Result<()> {
        let bar = bar(self.drawn.len() as u64, "pictures");
        while let Some(drawn) = self.drawn.join_next().await {
            drawn.context("drawing")??;
            bar.inc(1);
        }
        bar.finish_and_clear();
        Ok(())
    }
}

/// Writes `NAME.gif` and `NAME.png` of `NAME.mcap` to a folder.
fn draw(recording: &Path, folder: &Path) -> Result<()> {
    let name = recording.file_name().and_then(|name| name.to_str()).unwrap_or("drive");
    let stem = name.trim_end_matches(".mcap");
    let opened = Recording::open(recording).with_context(|| format!("draw {}", recording.display()))?;
    std::fs::create_dir_all(folder).with_context(|| format!("create {}", folder.display()))?;
    let reel = opened.reel()?;
    reel.animate(&folder.join(format!("{stem}.gif")))?;
    reel.contact_sheet(&folder.join(format!("{stem}.png")))?;
    Ok(())
}
