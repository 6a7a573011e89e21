//! A layout as the model takes it, and the frame that geometry carries from one chunk to the next.
//!
//! Snow and rain belong to no layout and stay nowhere: where the prompt tells of them, what falls is drawn anew at each tick before the
//! frame that the decoder made, and frames are carried on without it.

use std::sync::Arc;

use ds_nn::Array;
use ds_nn::tiny_ae::AeShape;
use ds_raster::{Air, Carried, Fall, Geometry, Paints, RgbImage, calmed, sharpened};
use ds_space::{Digest, DigestWriter, Draws, Tick};

use crate::tokens;

/// Frames of a decoder that goes on from its own are shown so much sharper than it paints them.
pub(crate) const SHARPER: f32 = 0.12;
/// The brightness beside which drawn paints look as they are told, of 255.
const MEDIUM: f64 = 128.0;

/// A layout: its picture and, where it is known, its geometry.
#[derive(Debug, Clone)]
pub struct Layout {
    /// The picture.
    pub image: RgbImage,
    /// How far away what it shows is, and what of it moves.
    pub geometry: Option<Arc<Geometry>>,
}

impl Layout {
    /// Returns a frame of this layout as it is carried on: without specks, which would grow from chunk to chunk.
    #[must_use]
    pub fn calmed(&self, frame: &RgbImage) -> RgbImage {
        calmed(frame, &self.image.resized(frame.width_px(), frame.height_px()))
    }

    /// Returns a frame of this layout as it is shown at a tick: brought out a little if the decoder goes on from its own frames, and with
    /// what falls before it.
    pub(crate) fn shown(&self, frame: &RgbImage, carried: bool, fall: Option<Fall>, tick: Tick) -> RgbImage {
        let frame = if carried { &sharpened(frame, SHARPER) } else { frame };
        self.falling(frame, fall, tick)
    }

    /// Returns a frame of this layout with what falls before it at a tick, if anything does and the layout's lens is known.
    #[must_use]
    pub fn falling(&self, frame: &RgbImage, fall: Option<Fall>, tick: Tick) -> RgbImage {
        let (width_px, height_px) = (frame.width_px(), frame.height_px());
        let focal_px = self.geometry.as_ref().map(|seen| seen.lens.resized(width_px, height_px).fx_px);
        fall.zip(focal_px).map_or_else(|| frame.clone(), |(fall, focal_px)| fall.before(frame, tick, focal_px))
    }
}

impl From<RgbImage> for Layout {
    fn from(image: RgbImage) -> Self {
        Self { image, geometry: None }
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

/// The last frame of a chunk with its geometry; nothing where no geometry is known.
#[derive(Debug, Clone, Default)]
pub struct Carry {
    seen: Option<(Arc<RgbImage>, Arc<Geometry>)>,
    air: Air,
    paint: Paint,
}

/// What is told of the paint of vehicles that come into view.
#[derive(Debug, Clone, Default)]
pub enum Paint {
    /// Nothing.
    #[default]
    Untold,
    /// That of each.
    Told(Arc<Paints>),
    /// It is drawn by a key from colours as they are beside a frame of medium brightness.
    Drawn(Arc<[[u8; 3]]>, Digest),
}

impl Paint {
    /// Returns paint that is drawn from colours by a key; none is told if there are none.
    pub(crate) fn drawn(colours: &[[u8; 3]], key: Digest) -> Self {
        if colours.is_empty() { Self::Untold } else { Self::Drawn(colours.into(), key) }
    }

    /// Returns the paint of a vehicle in the light of a frame.
    fn of(&self, id: u32, frame: &RgbImage) -> Option<[u8; 3]> {
        match self {
            Self::Untold => None,
            Self::Told(paints) => paints.get(&id).copied(),
            Self::Drawn(colours, key) => {
                let draws = Draws::new(key, "paint", &[u64::from(id)]);
                let colour = colours.get(usize::try_from(draws.below(0, colours.len() as u64)).ok()?)?;
                Some(relit(*colour, brightness(frame)))
            }
        }
    }
}

/// Returns the mean brightness of a frame, in that beside which drawn paints look as they are told.
#[must_use]
pub fn brightness(frame: &RgbImage) -> f64 {
    let sum: u64 = frame.rgb().iter().map(|byte| u64::from(*byte)).sum();
    sum as f64 / frame.rgb().len() as f64 / MEDIUM
}

/// Returns a colour in light so many times as bright.
#[must_use]
pub fn relit(colour: [u8; 3], times: f64) -> [u8; 3] {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "float casts saturate")]
    let lit = |byte: u8| (f64::from(byte) * times).round() as u8;
    colour.map(lit)
}

impl Carry {
    /// Takes a frame along with the layout of its tick, seen through some air.
    #[must_use]
    pub fn of(frame: &RgbImage, layout: &Layout, air: Air) -> Self {
        let geometry = layout.geometry.as_ref();
        let seen = geometry.map(|geometry| (Arc::new(frame.clone()), Arc::clone(geometry)));
        Self { seen, air, paint: Paint::Untold }
    }

    /// Tells the paint of vehicles that come into view.
    #[must_use]
    pub fn painted(self, paint: Paint) -> Self {
        Self { paint, ..self }
    }

    /// Returns the frame as it would look from a layout, if both are known.
    fn to(&self, layout: &Layout) -> Option<Carried> {
        let ((frame, before), now) = self.seen.as_ref().zip(layout.geometry.as_ref())?;
        let mut carried = now.carry(before, frame, self.air);
        if !matches!(self.paint, Paint::Untold) {
            carried.paint(|id| self.paint.of(id, frame));
        }
        Some(carried)
    }

    /// Returns the frame.
    #[must_use]
    pub fn frame(&self) -> Option<&RgbImage> {
        self.seen.as_ref().map(|(frame, _)| &**frame)
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
        for (layout, seen) in layouts.iter().zip(stacked.values().chunks_exact(3 * pixels)) {
            let carried = self.to(layout);
            let known = |at: usize| carried.as_ref().filter(|carried| carried.kept[at] > 0.0);
            for (at, colour) in seen.chunks_exact(3).enumerate() {
                values.extend_from_slice(colour);
                match known(at) {
                    Some(carried) => {
                        values
                            .extend(carried.frame.rgb()[3 * at..3 * at + 3].iter().map(|byte| ds_raster::value(*byte)));
                        values.push(carried.kept[at]);
                    }
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
