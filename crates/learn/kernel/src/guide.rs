//! The guides of a decoder: convolutions behind its last stage that also see each frame's layout, or the sketch made of it.

use ds_nn::array::Array;
use ds_nn::tiny_ae::{AeShape, CARRIED_CHANNELS, LAYOUT_CHANNELS, SketchLevel};

use super::arch::Arch;
use super::convolution::Convolution;
use super::growth::Growth;
use super::image::Image;
use super::network::Named;
use super::product::Finish;

struct Level {
    convolution: Convolution,
    grow: Option<Growth>,
}

/// The guides with packed weights.
pub(crate) struct Guides {
    sketch: Vec<Level>,
    convolutions: Vec<Convolution>,
    carried: bool,
}

/// Images of one frame's layout: folded to 1/2, 1/4 and 1/8 resolution; what is drawn at 1/8, 1/4 and 1/2; what grows from the
/// first two; and what is last drawn beside a carried frame.
#[derive(Default)]
pub(crate) struct Seen {
    layouts: [Image; 3],
    drawn: [Image; 3],
    grown: [Image; 2],
    both: Image,
}

impl Guides {
    /// Packs the guides of a decoder.
    pub(crate) fn new(shape: &AeShape, named: &Named<'_>) -> Self {
        let (levels, width) = (shape.sketch(), shape.decoder_widths[2]);
        let level = |(index, level): (usize, &SketchLevel)| {
            let name = format!("decoder.guide.sketch.{index}");
            let inputs = [level.grown, level.layout];
            Level {
                convolution: named.convolution(&name, if index == 0 { &inputs[1..] } else { &inputs }),
                grow: levels
                    .get(index + 1)
                    .map(|next| Growth::new(named, &format!("{name}.grow"), level.width, next.width)),
            }
        };
        let guide = |index: usize| named.convolution(&format!("decoder.guide.{index}"), &[width, shape.seen()]);
        Self {
            sketch: levels.iter().enumerate().map(level).collect(),
            convolutions: (0..shape.guides).map(guide).collect(),
            carried: shape.carried,
        }
    }

    /// Guides the image `x` of frames by what guides them ([`AeShape::guide_channels`]), zeros without any; `out` is room of its size.
    pub(crate) fn apply(&self, arch: Arch, guide: Option<&Array>, [x, out]: [&mut Image; 2], seen: &mut Seen) {
        if self.convolutions.is_empty() {
            return;
        }
        seen.layouts[0].reset([x.frames, x.h, x.w, LAYOUT_CHANNELS]);
        unshuffle(guide, [0, 3], &mut seen.layouts[0], 0);
        self.draw(arch, seen);
        let Seen { layouts, drawn, both, .. } = seen;
        let mut seen: &Image = if self.sketch.is_empty() { &layouts[0] } else { &drawn[2] };
        if self.carried {
            both.reset([x.frames, x.h, x.w, seen.c + CARRIED_CHANNELS]);
            beside(seen, both);
            unshuffle(guide, [3, 4], both, seen.c);
            seen = both;
        }
        for convolution in &self.convolutions {
            out.reset(x.size());
            let input: &Image = x;
            let both = |frame: usize| [input.frame(frame), seen.frame(frame)];
            convolution.apply(arch, both, out, |frame, y| Finish::SumWithRelu(input.row(frame, y)));
            std::mem::swap(x, out);
        }
    }

    /// Draws the sketch, if there is one.
    fn draw(&self, arch: Arch, Seen { layouts, drawn, grown, .. }: &mut Seen) {
        if self.sketch.is_empty() {
            return;
        }
        for index in 1..3 {
            let [above, below] = layouts.get_disjoint_mut([index - 1, index]).expect("three foldings");
            fold(above, below);
        }
        for (index, level) in self.sketch.iter().enumerate() {
            let (layout, drawn) = (&layouts[2 - index], &mut drawn[index]);
            drawn.reset([layout.frames, layout.h, layout.w, level.convolution.outputs()]);
            if index == 0 {
                level.convolution.apply(arch, |frame| [layout.frame(frame), &[]], drawn, |_, _| Finish::Relu);
            } else {
                let grown = &grown[index - 1];
                let both = |frame: usize| [grown.frame(frame), layout.frame(frame)];
                level.convolution.apply(arch, both, drawn, |_, _| Finish::Relu);
            }
            if let Some(grow) = &level.grow {
                grow.apply(arch, 1, drawn, &mut grown[index]);
            }
        }
    }
}

/// Folds some channels, first and count, of a guide [frames, 2h, 2w, c] into those of an image from `at` on; a guide that has none
/// of them gives zeros.
fn unshuffle(guide: Option<&Array>, [first, count]: [usize; 2], image: &mut Image, at: usize) {
    let (h, w, all) = (image.h, image.w, image.c);
    let guide = guide.map(|guide| (guide.values(), guide.shape()[3])).filter(|(_, c)| *c >= first + count);
    image.each_row(|frame, y, row| {
        let row = row[all..all * (w + 1)].chunks_exact_mut(all).map(|pixel| &mut pixel[at..at + 4 * count]);
        let Some((values, c)) = guide else { return row.for_each(|pixel| pixel.fill(0.0)) };
        let lines = [0, 1].map(|dy| &values[(frame * 2 * h + 2 * y + dy) * 2 * w * c..][..2 * w * c]);
        for (x, pixel) in row.enumerate() {
            for (index, part) in pixel.chunks_exact_mut(count).enumerate() {
                part.copy_from_slice(&lines[index / 2][(2 * x + index % 2) * c + first..][..count]);
            }
        }
    });
}

/// Copies an image into the first channels of a wider one.
fn beside(from: &Image, to: &mut Image) {
    let (w, c, all) = (to.w, from.c, to.c);
    to.each_row(|frame, y, row| {
        let line = from.row(frame, y);
        let pixels = line.data[line.offset..][..w * c].chunks_exact(c);
        row[all..].chunks_exact_mut(all).zip(pixels).for_each(|(to, pixel)| to[..c].copy_from_slice(pixel));
    });
}

/// Folds two by two pixels of an image into one, values ordered (row, column, channel).
fn fold(from: &Image, to: &mut Image) {
    let c = from.c;
    to.reset([from.frames, from.h / 2, from.w / 2, 4 * c]);
    let w = to.w;
    to.each_row(|frame, y, row| {
        let row = &mut row[4 * c..4 * c * (w + 1)];
        for dy in 0..2 {
            let line = from.row(frame, 2 * y + dy);
            let line = &line.data[line.offset..][..2 * w * c];
            for (pixel, pair) in row.chunks_exact_mut(4 * c).zip(line.chunks_exact(2 * c)) {
                pixel[dy * 2 * c..(dy + 1) * 2 * c].copy_from_slice(pair);
            }
        }
    });
}
