//! The guides of a decoder and the sketch that they see, forward and backward; layouts take no gradient.

use ds_nn::array::Weights;
use ds_nn::tiny_ae::{AeShape, LAYOUT_CHANNELS, SketchLevel};

use super::convolution::Layer;
use super::images::{add, beside, filled, folded, leading, shuffled, sized, unshuffled, where_positive};
use super::linear::Linear;
use crate::arch::Arch;
use crate::image::Image;
use crate::product::Finish;

/// What the backward pass needs: layouts and sketch at 1/8, 1/4 and 1/2 resolution, what grew into the last two, the sketch beside a
/// carried frame, and what each guide added and gave.
#[derive(Default)]
pub(super) struct Guided {
    layouts: Vec<Image>,
    drawn: Vec<Image>,
    grown: Vec<Image>,
    both: Option<Image>,
    added: Vec<Image>,
    sums: Vec<Image>,
}

impl Guided {
    /// Returns what comes out of the last guide, given what went into the first.
    pub(super) fn last<'a>(&'a self, x: &'a Image) -> &'a Image {
        self.sums.last().unwrap_or(x)
    }

    /// Returns what the guides see.
    fn seen(&self) -> &Image {
        self.both.as_ref().unwrap_or_else(|| self.drawn())
    }

    /// Returns the sketch, or the layouts where there is none.
    fn drawn(&self) -> &Image {
        self.drawn.last().unwrap_or(&self.layouts[0])
    }

    /// Returns what a level of the sketch takes in of a frame.
    fn below<'a>(&'a self, level: usize) -> impl Fn(usize) -> [&'a [f32]; 2] + Sync {
        move |frame| {
            let layout = self.layouts[level].frame(frame);
            if level == 0 { [layout, &[]] } else { [self.grown[level - 1].frame(frame), layout] }
        }
    }
}

/// The guides with their weights packed.
pub(super) struct Guides<'a> {
    sketch: Vec<(Layer, Option<Linear<'a>>)>,
    layers: Vec<Layer>,
    /// Channels of a pixel of what guides.
    channels: usize,
}

impl<'a> Guides<'a> {
    pub(super) fn new(shape: &AeShape, weights: &'a Weights) -> Self {
        let levels = shape.sketch();
        let level = |(index, level): (usize, &SketchLevel)| {
            let name = format!("decoder.guide.sketch.{index}");
            let grow = (index + 1 < levels.len()).then(|| Linear::new(weights, format!("{name}.grow")));
            let inputs = [level.grown, level.layout];
            let layer = if index == 0 { (&inputs[1..], 0) } else { (&inputs[..], 1) };
            (Layer::new(weights, name, layer.0, layer.1), grow)
        };
        let inputs = [shape.decoder_widths[2], shape.seen()];
        let learned = if levels.is_empty() { 1 } else { 2 };
        let guide = |index: usize| Layer::new(weights, format!("decoder.guide.{index}"), &inputs, learned);
        Self {
            sketch: levels.iter().enumerate().map(level).collect(),
            layers: (0..shape.guides).map(guide).collect(),
            channels: shape.guide_channels(),
        }
    }

    /// Guides an image by pixels of twice its size ([`AeShape::guide_channels`]); nothing happens without either.
    pub(super) fn forward(&self, arch: Arch, x: &Image, guide: Option<&[f32]>) -> Guided {
        let mut run = Guided::default();
        let Some(guide) = guide.filter(|_| !self.layers.is_empty()) else { return run };
        let part = |channels: std::ops::Range<usize>| -> Vec<f32> {
            guide.chunks_exact(self.channels).flat_map(|pixel| &pixel[channels.clone()]).copied().collect()
        };
        run.layouts.push(filled([x.frames, x.h, x.w, LAYOUT_CHANNELS], &unshuffled(&part(0..3), x, 1)));
        if !self.sketch.is_empty() {
            for _ in 1..self.sketch.len() {
                run.layouts.insert(0, folded(&run.layouts[0]));
            }
            self.draw(arch, &mut run);
        }
        if self.channels > 3 {
            run.both = Some(beside(run.drawn(), &unshuffled(&part(3..self.channels), x, 1)));
        }
        for layer in &self.layers {
            let x = run.last(x);
            let (mut added, mut sum, seen) = (sized(x.size()), sized(x.size()), run.seen());
            layer.forward(arch, |frame| [x.frame(frame), seen.frame(frame)], &mut added, |_, _| Finish::Relu);
            sum.values_mut().copy_from_slice(x.values());
            add(sum.values_mut(), added.values());
            run.sums.push(sum);
            run.added.push(added);
        }
        run
    }

    fn draw(&self, arch: Arch, run: &mut Guided) {
        for (level, (layer, grow)) in self.sketch.iter().enumerate() {
            let [frames, h, w, _] = run.layouts[level].size();
            let mut drawn = sized([frames, h, w, layer.outputs()]);
            layer.forward(arch, run.below(level), &mut drawn, |_, _| Finish::Relu);
            if let Some(grow) = grow {
                let mut values = vec![0.0; frames * h * w * grow.outputs()];
                grow.forward(&drawn.dense(), &mut values);
                values.iter_mut().for_each(|x| *x = x.max(0.0));
                run.grown.push(shuffled(&values, &drawn, 1));
            }
            run.drawn.push(drawn);
        }
    }

    /// Takes the gradient of what comes out to what went in, `x`, and adds those of the weights.
    pub(super) fn back(&self, arch: Arch, run: &Guided, x: &Image, dx: &mut Image, gradient: &mut Weights) {
        if run.sums.is_empty() {
            return;
        }
        let (seen, mut d_seen) = (run.seen(), sized(run.seen().size()));
        for (index, layer) in self.layers.iter().enumerate().rev() {
            let x = if index == 0 { x } else { &run.sums[index - 1] };
            let mut dy = sized(dx.size());
            dy.values_mut().copy_from_slice(dx.values());
            where_positive(&mut dy, &run.added[index]);
            layer.learn(arch, &dy, |frame| [x.frame(frame), seen.frame(frame)], gradient);
            layer.back(arch, 0, |frame| dy.frame(frame), dx, true);
            if !self.sketch.is_empty() {
                layer.back(arch, 1, |frame| dy.frame(frame), &mut d_seen, true);
            }
        }
        if run.both.is_some() {
            d_seen = leading(&d_seen, run.drawn().c);
        }
        for (level, (layer, _)) in self.sketch.iter().enumerate().rev() {
            where_positive(&mut d_seen, &run.drawn[level]);
            layer.learn(arch, &d_seen, run.below(level), gradient);
            let Some(above) = level.checked_sub(1) else { break };
            let mut d_grown = sized(run.grown[above].size());
            layer.back(arch, 0, |frame| d_seen.frame(frame), &mut d_grown, false);
            where_positive(&mut d_grown, &run.grown[above]);
            let drawn = &run.drawn[above];
            let below = drawn.dense();
            let mut dense = vec![0.0; below.len()];
            if let (_, Some(grow)) = &self.sketch[above] {
                let dy = unshuffled(&d_grown.dense(), drawn, 1);
                grow.learn(arch, &dy, &below, gradient);
                grow.back(&dy, &mut dense, false);
            }
            d_seen = filled(drawn.size(), &dense);
        }
    }
}
