//! Effects on frames: what an operator on one picture at a time may know, and the chain that applies several of them.
//!
//! Geometry effects are composed into one warp, so that a frame is resampled once; edits follow in the order of the
//! library. At neutral values a chain returns its input bit for bit. Draws are a function of seed, effect and frame.

use std::collections::VecDeque;

use ds_space::draw::Draws;

use crate::picture::Picture;
use crate::{Insertion, Parameter};

/// A pinhole camera, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole {
    /// Focal length across.
    pub fx: f64,
    /// Focal length down.
    pub fy: f64,
    /// Column of the axis.
    pub cx: f64,
    /// Row of the axis.
    pub cy: f64,
}

/// A box of the layout in a frame, px, with its object's class.
#[derive(Debug, Clone, PartialEq)]
pub struct LayoutBox {
    /// Left, top, right, bottom.
    pub edges: [f64; 4],
    /// Class: car, pedestrian, cyclist.
    pub class: String,
}

/// What an effect may know of the frame it acts on.
#[derive(Debug, Clone)]
pub struct FrameContext<'a> {
    /// Number of the frame.
    pub frame: u64,
    /// Simulator time, s.
    pub time_secs: f64,
    /// Frames since the video model was last anchored.
    pub frames_since_anchor: f64,
    /// Forward speed, m/s, where known.
    pub speed_mps: Option<f64>,
    /// Yaw rate, left positive, rad/s, where known.
    pub yaw_rate_radps: Option<f64>,
    /// Illumination of the scene relative to the start.
    pub light: f64,
    /// Depth along the axis, m, one value per pixel of the picture, where known.
    pub depth_m: Option<&'a [f32]>,
    /// Layout boxes of this frame.
    pub boxes: &'a [LayoutBox],
    /// Camera of the picture.
    pub camera: Pinhole,
    /// Columns and rows of the picture.
    pub size: [usize; 2],
    /// Rows of the whole sensor, read out over the height of the picture.
    pub sensor_rows: f64,
    /// Key of every draw.
    pub seed: u64,
}

impl FrameContext<'_> {
    /// Returns the draws of an effect for this frame, or for all frames alike.
    #[must_use]
    pub fn draws(&self, effect: &str, fixed: bool) -> Draws {
        let frame = if fixed { 0 } else { self.frame.wrapping_mul(0x9E37_79B9_7F4A_7C15) };
        Draws::from_seed(self.seed ^ frame, effect)
    }

    /// Returns the depth at a place of the picture, m.
    #[must_use]
    pub fn depth_at(&self, at: [f64; 2]) -> Option<f64> {
        let depth = self.depth_m?;
        let x = at[0].round().clamp(0.0, (self.size[0] - 1) as f64) as usize;
        let y = at[1].round().clamp(0.0, (self.size[1] - 1) as f64) as usize;
        Some(f64::from(depth[y * self.size[0] + x]))
    }

    /// Returns how fast the scene moves over the picture because of the ego's motion, px/s.
    #[must_use]
    pub fn flow(&self, at: [f64; 2]) -> Option<[f64; 2]> {
        let (speed, turn) = (self.speed_mps?, self.yaw_rate_radps.unwrap_or(0.0));
        let c = self.camera;
        let (x, y) = ((at[0] - c.cx) / c.fx, (at[1] - c.cy) / c.fy);
        let closing = self.depth_at(at).map_or(0.0, |d| speed / d);
        Some([c.fx * (x * closing + turn * (1.0 + x * x)), c.fy * (y * closing + turn * x * y)])
    }
}

/// What an effect must be told to show at all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Needs {
    /// The picture alone.
    Picture,
    /// Three channels.
    Colour,
    /// A change of the scene's illumination.
    Light,
    /// Speed or yaw rate.
    Motion,
    /// Depth.
    Depth,
    /// Boxes of the layout.
    Boxes,
    /// Frames in a fixed step, or at least in an order.
    Sequence,
}

/// What an effect keeps from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct Memory {
    /// Level that an exposure control has reached.
    pub level: Option<f64>,
    /// Time of the frame before, s.
    pub time_secs: f64,
}

/// How an effect acts.
#[derive(Clone, Copy)]
pub enum Act {
    /// Shows an older frame: returns its age in frames.
    Age(fn(&[f64], &FrameContext<'_>) -> usize),
    /// Moves pixels: returns where in the source the result looks at a place, px.
    Warp(fn(&[f64], &FrameContext<'_>, [f64; 2]) -> [f64; 2]),
    /// Edits values in place.
    Edit(fn(&[f64], &FrameContext<'_>, &mut Memory, &mut Picture)),
}

/// One effect on frames.
pub struct FrameEffect {
    /// Name in labels and reports.
    pub id: &'static str,
    /// Point of the loop at which it acts.
    pub insertion: Insertion,
    /// Its parameters; the first is the one that is reported as its value.
    pub parameters: &'static [Parameter],
    /// What it must be told to show.
    pub needs: &'static [Needs],
    /// How it acts; takes one value per parameter, in reported units.
    pub act: Act,
}

impl FrameEffect {
    /// Returns the values at which the effect is absent.
    #[must_use]
    pub fn neutral(&self) -> Vec<f64> {
        self.parameters.iter().map(|p| p.reported(p.neutral, 1.0)).collect()
    }

    /// Tells whether the effect is absent at these values. A further parameter that is neutral at 0 (a second gain, a
    /// second offset) is an effect of its own; any other only shapes the first.
    #[must_use]
    pub fn absent(&self, values: &[f64]) -> bool {
        let neutral = self.neutral();
        (0..values.len()).all(|k| (k > 0 && neutral[k] != 0.0) || values[k].to_bits() == neutral[k].to_bits())
    }
}

/// Effects with their values and what they remember, applied to one frame after the other.
pub struct FrameChain {
    effects: Vec<(&'static FrameEffect, Vec<f64>, Memory)>,
    past: VecDeque<Picture>,
    reach: usize,
}

impl FrameChain {
    /// Chains effects; they act in the order of the library, whatever the order given.
    #[must_use]
    pub fn new(effects: &[(&'static FrameEffect, Vec<f64>)]) -> Self {
        let mut effects: Vec<_> =
            effects.iter().filter(|(e, v)| !e.absent(v)).map(|(e, v)| (*e, v.clone(), Memory::default())).collect();
        let place = |id: &str| crate::frame_library().iter().position(|e| e.id == id);
        effects.sort_by_key(|(e, ..)| place(e.id));
        let reach = if effects.iter().any(|(e, ..)| matches!(e.act, Act::Age(_))) { 8 } else { 0 };
        Self { effects, past: VecDeque::new(), reach }
    }

    /// Returns what becomes of the next frame.
    pub fn next(&mut self, source: &Picture, context: &FrameContext<'_>) -> Picture {
        let mut age = 0;
        for (effect, values, _) in &self.effects {
            if let Act::Age(act) = effect.act {
                age += act(values, context);
            }
        }
        if self.reach > 0 {
            self.past.push_front(source.clone());
            self.past.truncate(self.reach + 1);
        }
        let shown = self.past.get(age.min(self.past.len().saturating_sub(1))).unwrap_or(source).clone();
        self.edited(self.warped(shown, context), context)
    }

    /// Returns where in the source the result looks at a place: every warp of the chain, one after the other.
    #[must_use]
    pub fn source_of(&self, context: &FrameContext<'_>, at: [f64; 2]) -> [f64; 2] {
        self.effects.iter().rev().fold(at, |at, (effect, values, _)| match effect.act {
            Act::Warp(act) => act(values, context, at),
            _ => at,
        })
    }

    /// Tells whether the chain moves pixels.
    #[must_use]
    pub fn warps(&self) -> bool {
        self.effects.iter().any(|(e, ..)| matches!(e.act, Act::Warp(_)))
    }

    fn warped(&self, picture: Picture, context: &FrameContext<'_>) -> Picture {
        if !self.warps() {
            return picture;
        }
        picture.warped(|x, y| self.source_of(context, [x as f64, y as f64]).map(|v| v as f32))
    }

    /// Lets a frame go by that nobody looks at: what effects remember goes on.
    pub fn pass(&mut self, context: &FrameContext<'_>) {
        // wider than any kernel, and small
        let _ = self.edited(Picture::filled(16, 16, 1, 128.0), context);
    }

    /// Returns a picture that is already in place after all edits.
    pub fn edited(&mut self, mut picture: Picture, context: &FrameContext<'_>) -> Picture {
        for (effect, values, memory) in &mut self.effects {
            if let Act::Edit(act) = effect.act {
                act(values, context, memory, &mut picture);
                memory.time_secs = context.time_secs;
            }
        }
        picture
    }
}
