//! Pictures of a drive: what the policy saw next to the layout and a top-down view, as animation and contact sheet.
//!
//! Small images are enlarged by whole factors, pixel by pixel, so that nothing is invented; large ones are reduced. One
//! camera is a column: frame above layout, both of one size; the top-down view stands beside the columns. No wall clock: the caption is simulation time.

pub mod animation;
pub mod canvas;
pub mod palette;
pub mod top_view;

use std::fs;
use std::path::Path;

use ds_raster::{Encoding, RgbImage};
use ds_space::{CameraId, DVec2, PoseSe2};
use ds_topic::Plan;
use ds_world::{Scene, WorldState};

use crate::error::RecordError;
use canvas::{CAPTION_PX, caption, place};
use top_view::TopView;

/// Columns are made at least this wide, in pixels, by whole enlargement.
const COLUMN_PX: u32 = 300;
/// No side of an image is longer, in pixels.
const PANEL_PX: u32 = 480;
/// The narrowest top-down view, in pixels.
const TOP_VIEW_PX: u32 = 320;
/// The most cameras that are shown.
const MAX_CAMERAS: usize = 3;
const SHEET_TICKS: usize = 8;
const BACKGROUND: [u8; 3] = [22, 23, 26];

/// What one picture is made of.
#[derive(Debug, Clone)]
pub struct Moment {
    /// The state of the world.
    pub state: WorldState,
    /// The condition image of each camera; may be empty.
    pub layouts: Vec<RgbImage>,
    /// The frame of each camera; may be empty.
    pub frames: Vec<RgbImage>,
    /// The newest plan, and the rig in the world when it was made.
    pub plan: Option<(PoseSe2, Plan)>,
}

/// Makes the moment of an index; moments are made when needed and not kept.
pub type MomentSource<'a> = dyn Fn(usize) -> Result<Moment, RecordError> + 'a;

/// A drive, ready to be drawn.
pub struct Reel<'a> {
    /// The scenario.
    pub scene: &'a Scene,
    /// The rig's position in the world at each moment, in metres.
    pub path: Vec<DVec2>,
    /// Makes the moments, of which there are as many as positions.
    pub moment: Box<MomentSource<'a>>,
}

impl Reel<'_> {
    /// Writes the drive as an endless animated GIF at the speed of simulation time.
    ///
    /// # Errors
    /// If a moment cannot be made or the file not be written.
    pub fn animate(&self, path: &Path) -> Result<(), RecordError> {
        let top_view = TopView::new(self.scene);
        let compose = |index: usize| self.compose(&top_view, index);
        let bytes = animation::encode(self.path.len(), self.scene.dt, compose)?;
        write(path, &bytes)
    }

    /// Writes eight moments, evenly spread over the drive, as one PNG.
    ///
    /// # Errors
    /// If a moment cannot be made or the file not be written.
    pub fn contact_sheet(&self, path: &Path) -> Result<(), RecordError> {
        let top_view = TopView::new(self.scene);
        let last = self.path.len().saturating_sub(1);
        let mut indices: Vec<usize> = (0..SHEET_TICKS).map(|i| i * last / (SHEET_TICKS - 1)).collect();
        indices.dedup();
        let pictures =
            indices.into_iter().map(|index| self.compose(&top_view, index)).collect::<Result<Vec<_>, _>>()?;
        write(path, &sheet(&pictures).encode(Encoding::Png)?)
    }

    /// Draws one moment.
    fn compose(&self, top_view: &TopView, index: usize) -> Result<RgbImage, RecordError> {
        let moment = (self.moment)(index)?;
        let names: Vec<&CameraId> = self.scene.cameras.iter().map(|camera| &camera.id).collect();
        let mut columns = Vec::new();
        for camera in 0..moment.frames.len().max(moment.layouts.len()).min(MAX_CAMERAS) {
            let name = names.get(camera).map_or("", |name| name.as_str());
            let images = [("frame", moment.frames.get(camera)), ("layout", moment.layouts.get(camera))];
            columns.push(column(name, &images));
        }
        let height = columns.iter().map(RgbImage::height_px).max().unwrap_or(TOP_VIEW_PX + CAPTION_PX);
        let width = columns.iter().map(RgbImage::width_px).max().unwrap_or(0).max(TOP_VIEW_PX);
        let past = &self.path[..=index.min(self.path.len().saturating_sub(1))];
        let map = top_view.draw(&moment, past, width, height.saturating_sub(CAPTION_PX).max(1))?;
        columns.push(with_caption(&top_caption(&moment), &map));
        Ok(beside(&columns))
    }
}

fn top_caption(moment: &Moment) -> String {
    let (secs, speed_mps) = (moment.state.time.secs(), moment.state.ego.speed_mps());
    let contact = if moment.state.contacts.is_empty() { "" } else { "  contact" };
    format!("t {secs:.1} s  {speed_mps:.1} m/s{contact}")
}

/// Stacks the images of a camera, each under its caption.
fn column(camera: &str, images: &[(&str, Option<&RgbImage>)]) -> RgbImage {
    let shown = || images.iter().filter_map(|(name, image)| image.map(|image| (name, image)));
    let size = shown().next().map_or([1, 1], |(_, image)| panel(image));
    let parts: Vec<RgbImage> =
        shown().map(|(name, image)| with_caption(&format!("{name} {camera}"), &at(image, size))).collect();
    let width = parts.iter().map(RgbImage::width_px).max().unwrap_or(1);
    let mut whole = RgbImage::filled(width, parts.iter().map(RgbImage::height_px).sum(), BACKGROUND);
    let mut y = 0;
    for part in &parts {
        place(&mut whole, part, 0, y);
        y += part.height_px();
    }
    whole
}

/// Returns the size at which an image is shown.
fn panel(image: &RgbImage) -> [u32; 2] {
    let (width, height) = (image.width_px(), image.height_px());
    let longest = width.max(height);
    if longest > PANEL_PX {
        return [width, height].map(|side| (u64::from(side) * u64::from(PANEL_PX) / u64::from(longest)).max(1) as u32);
    }
    let factor = COLUMN_PX.div_ceil(width).min(PANEL_PX / longest).max(1);
    [factor * width, factor * height]
}

/// Returns an image at a size: pixels as squares where that is a whole multiple, else means.
fn at(image: &RgbImage, [width, height]: [u32; 2]) -> RgbImage {
    let factor = width / image.width_px();
    let whole = [image.width_px(), image.height_px()].map(|side| factor * side) == [width, height];
    if whole { canvas::enlarged(image, factor) } else { image.resized(width, height) }
}

fn with_caption(text: &str, image: &RgbImage) -> RgbImage {
    let mut whole = RgbImage::filled(image.width_px(), image.height_px() + CAPTION_PX, BACKGROUND);
    caption(&mut whole, text);
    place(&mut whole, image, 0, CAPTION_PX);
    whole
}

fn beside(columns: &[RgbImage]) -> RgbImage {
    let height = columns.iter().map(RgbImage::height_px).max().unwrap_or(1);
    let mut whole = RgbImage::filled(columns.iter().map(RgbImage::width_px).sum(), height, BACKGROUND);
    let mut x = 0;
    for column in columns {
        place(&mut whole, column, x, 0);
        x += column.width_px();
    }
    whole
}

/// Puts pictures of one size in two columns.
fn sheet(pictures: &[RgbImage]) -> RgbImage {
    let Some(first) = pictures.first() else { return RgbImage::filled(1, 1, BACKGROUND) };
    let (width, height) = (first.width_px(), first.height_px());
    let rows = u32::try_from(pictures.len().div_ceil(2)).unwrap_or(1);
    let mut whole = RgbImage::filled(2 * width + 8, rows * (height + 8), BACKGROUND);
    for (index, picture) in (0u32..).zip(pictures) {
        place(&mut whole, picture, (index % 2) * (width + 8), (index / 2) * (height + 8));
    }
    whole
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), RecordError> {
    fs::write(path, bytes).map_err(|source| RecordError::File { action: "write", path: path.to_path_buf(), source })
}
