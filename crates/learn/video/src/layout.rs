//! A layout as the model takes it, and the frame that geometry carries from one chunk to the next.
//!
//! Snow and rain belong to no layout and stay nowhere: where the prompt tells of them, what falls is drawn anew at each tick, over the
//! carried frame and where none is known, as light as the lightest parts of the frame; what fell before the carried frame is left behind.

use std::sync::Arc;

use ds_nn::Array;
use ds_nn::tiny_ae::AeShape;
use ds_raster::{Fall, Geometry, RgbImage, Sight, specks};
use ds_space::{DigestWriter, Tick};

use crate::tokens;

/// How bright what falls is where no frame says how light it is, of 255.
const BRIGHT: u8 = 225;
/// The share of a frame's pixels that are darker than what falls before it.
const DARKER: f64 = 0.9;

/// A layout: its picture and, where it is known, its geometry.
#[derive(Debug, Clone)]
pub struct Layout {
    /// The picture.
    pub image: RgbImage,
    /// How far away what it shows is, and what of it moves.
    pub geometry: Option<Arc<Geometry>>,
    /// The share of each pixel of the frame that falling snow or rain covers, 255 for all of it.
    pub falls: Option<Arc<Vec<u8>>>,
}

impl Layout {
    /// Returns the layout with what falls at its tick, if anything does and its lens is known; frames have the given size.
    #[must_use]
    pub fn falling(&self, fall: Option<Fall>, tick: Tick, [width_px, height_px]: [u32; 2]) -> Self {
        let sight = self.geometry.as_ref().map(|seen| Sight::of(&seen.lens.resized(width_px, height_px)));
        let falls = fall.zip(sight).map(|(fall, sight)| Arc::new(fall.shares(tick, sight)));
        Self { falls, ..self.clone() }
    }
}

impl From<RgbImage> for Layout {
    fn from(image: RgbImage) -> Self {
        Self { image, geometry: None, falls: None }
    }
}

impl From<&RgbImage> for Layout {
    fn from(image: &RgbImage) -> Self {
        image.clone().into()
    }
}

impl From<&Self> for Layout {
    fn from(layout: &Self) -> Self {
        layout.clone()
    }
}

/// A frame that is carried on.
#[derive(Debug, Clone)]
struct Kept {
    frame: Arc<RgbImage>,
    geometry: Arc<Geometry>,
    /// What fell before it.
    falls: Option<Arc<Vec<u8>>>,
    /// How bright what falls is, of 255.
    bright: u8,
}

/// The last frame of a chunk with its geometry; nothing where no geometry is known.
#[derive(Debug, Clone, Default)]
pub struct Carry(Option<Kept>);

impl Carry {
    /// Takes a frame along with the layout of its tick.
    #[must_use]
    pub fn of(frame: &RgbImage, layout: &Layout) -> Self {
        Self(layout.geometry.as_ref().map(|geometry| Kept {
            frame: Arc::new(frame.clone()),
            geometry: Arc::clone(geometry),
            falls: layout.falls.clone(),
            bright: bright(frame),
        }))
    }

    /// Takes along the first frame of a drive, which somebody else made: where something falls, nobody knows where it fell before that.
    #[must_use]
    pub fn first(frame: &RgbImage, layout: &Layout) -> Self {
        let falls = layout.falls.as_ref().map(|_| Arc::new(specks(frame)));
        Self::of(frame, &Layout { falls, ..layout.clone() })
    }

    /// Returns the frame.
    #[must_use]
    pub fn frame(&self) -> Option<&RgbImage> {
        self.0.as_ref().map(|kept| &*kept.frame)
    }

    /// Makes what guides the decoder's frames of a chunk, [layouts, height, width, guide channels] of −1 to 1: each layout at the
    /// size of the frames, and beside it the frame as it would look from there, if the model is one that sees it.
    #[must_use]
    pub fn guide(&self, shape: &AeShape, width: u32, height: u32, layouts: &[&Layout]) -> Array {
        let images: Vec<RgbImage> = layouts.iter().map(|layout| layout.image.resized(width, height)).collect();
        let stacked = tokens::stacked(&images.iter().collect::<Vec<_>>());
        if !shape.carried {
            return stacked;
        }
        let pixels = width as usize * height as usize;
        let mut values = Vec::with_capacity(stacked.values().len() / 3 * 7);
        let bright = ds_raster::value(self.0.as_ref().map_or(BRIGHT, |kept| kept.bright));
        for (layout, seen) in layouts.iter().zip(stacked.values().chunks_exact(3 * pixels)) {
            let carried = self.0.as_ref().zip(layout.geometry.as_ref());
            let carried = carried.map(|(kept, now)| {
                now.carry(&kept.geometry, &kept.frame, kept.falls.as_ref().map(|falls| falls.as_slice()))
            });
            for (at, colour) in seen.chunks_exact(3).enumerate() {
                values.extend_from_slice(colour);
                let share = layout.falls.as_ref().map_or(0.0, |falls| f32::from(falls[at]) / 255.0);
                match carried.as_ref().filter(|carried| carried.known[at]) {
                    Some(carried) => {
                        let pixel = &carried.frame.rgb()[3 * at..3 * at + 3];
                        let covered = |value: f32| value + share * (bright - value);
                        values.extend(pixel.iter().map(|byte| covered(ds_raster::value(*byte))));
                        values.push(1.0);
                    }
                    None if share > 0.0 => values.extend([bright, bright, bright, share]),
                    None => values.extend([0.0; 4]),
                }
            }
        }
        Array::new(&[layouts.len(), height as usize, width as usize, 7], values)
    }

    /// Adds the frame to a digest; its geometry comes with the layouts.
    pub(crate) fn digest_into(&self, writer: &mut DigestWriter) {
        if let Some(frame) = self.frame() {
            frame.digest_into(writer);
        }
    }
}

/// Returns the brightness that [`DARKER`] of a frame's values stay below.
fn bright(frame: &RgbImage) -> u8 {
    let mut counts = [0u32; 256];
    frame.rgb().iter().for_each(|byte| counts[usize::from(*byte)] += 1);
    let below = DARKER * frame.rgb().len() as f64;
    let mut seen = 0.0;
    let at = counts.iter().position(|count| {
        seen += f64::from(*count);
        seen >= below
    });
    at.and_then(|at| u8::try_from(at).ok()).unwrap_or(u8::MAX)
}
