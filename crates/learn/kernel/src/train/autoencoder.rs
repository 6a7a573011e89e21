//! The tiny autoencoder forward, with what its backward pass needs kept, and backward.
//!
//! Clips lie one after the other in an image's frames; a block's memory of the frame before begins anew with each clip.

use ds_nn::array::Weights;
use ds_nn::tiny_ae::{AeShape, BLOCK_PX, EncoderStage, LAYOUT_CHANNELS};

use super::convolution::Layer;
use super::guide::{Guided, Guides};
use super::images::{add, filled, folded, shuffled, sized, unshuffled, where_positive};
use super::linear::Linear;
use crate::arch::Arch;
use crate::blend::{self, Mixed};
use crate::image::Image;
use crate::product::Finish;

struct Block {
    first: Layer,
    second: Layer,
}

impl Block {
    fn all(weights: &Weights, name: &str, count: usize, width: usize) -> Vec<Self> {
        let block = |index: usize| Self {
            first: Layer::new(weights, format!("{name}.block.{index}.conv.0"), &[width, width], 2),
            second: Layer::new(weights, format!("{name}.block.{index}.conv.2"), &[width], 1),
        };
        (0..count).map(block).collect()
    }
}

/// The images of a run of blocks: what each takes in, what lies inside it, and last what comes out.
#[derive(Default)]
struct Chain {
    images: Vec<Image>,
    inner: Vec<Image>,
}

impl Chain {
    fn last(&self) -> &Image {
        self.images.last().expect("a chain begins with its input")
    }
}

/// What the backward pass of a decoding needs.
#[derive(Default)]
pub(super) struct Decoded {
    latents: Vec<f32>,
    image: Image,
    stages: Vec<Chain>,
    guided: Guided,
    mixed: Option<(Mixed, Vec<f32>)>,
    /// Frames [images, 8h, 8w, 3].
    pub(super) frames: Vec<f32>,
}

/// What the backward pass of an encoding needs.
pub(super) struct Encoded {
    blocks: Vec<f32>,
    /// What each stage's linear layer takes in, and its blocks.
    stages: Vec<(Vec<f32>, Chain)>,
    /// Latents [steps, h, w, z].
    pub(super) latents: Vec<f32>,
}

impl Encoded {
    /// Returns what comes out of the last stage.
    fn encoded(&self) -> &Image {
        self.stages.last().expect("an encoder has a stage").1.last()
    }
}

/// The autoencoder's layers with their weights packed.
pub(super) struct Network<'a> {
    shape: &'a AeShape,
    arch: Arch,
    encoder: Vec<(Linear<'a>, Vec<Block>)>,
    encoder_head: Layer,
    encoder_skip: Linear<'a>,
    stem: Layer,
    stages: Vec<(Vec<Block>, Option<Linear<'a>>)>,
    guides: Guides<'a>,
    head: Layer,
    blend: Option<Layer>,
    skip: Option<Linear<'a>>,
}

/// Images [steps, h, w] of a batch of clips.
pub(super) type Size = [usize; 3];

impl<'a> Network<'a> {
    pub(super) fn new(shape: &'a AeShape, weights: &'a Weights) -> Self {
        let widths = shape.decoder_widths;
        let stage = |stage: usize| {
            let name = format!("decoder.stage.{stage}");
            let blocks = Block::all(weights, &name, shape.decoder_blocks[stage], widths[stage]);
            (blocks, (stage < 2).then(|| Linear::new(weights, format!("{name}.grow"))))
        };
        let fold = |stage: &EncoderStage| {
            let layer = Linear::new(weights, format!("{}.fold", stage.name));
            (layer, Block::all(weights, &stage.name, stage.blocks, stage.width))
        };
        let last = shape.encoder_widths.len() - 1;
        Self {
            arch: Arch::new(),
            encoder: shape.encoder().iter().map(fold).collect(),
            encoder_head: Layer::new(weights, "encoder.head", &shape.encoder_widths[last..], 1),
            encoder_skip: Linear::new(weights, "encoder.skip"),
            stem: Layer::new(weights, "decoder.stem", &[shape.z], 1),
            stages: (0..3).map(stage).collect(),
            guides: Guides::new(shape, weights),
            head: Layer::new(weights, "decoder.head", &[widths[2]], 1),
            blend: shape.carried.then(|| Layer::new(weights, "decoder.guide.blend", &[widths[2]], 1)),
            skip: shape.decoder_skip.then(|| Linear::new(weights, "decoder.skip")),
            shape,
        }
    }

    /// Encodes space-to-depth frames [steps, h, w, inputs].
    pub(super) fn encode(&self, blocks: &[f32], [steps, h, w]: Size, clips: usize) -> Encoded {
        let mut run = Encoded { blocks: blocks.to_vec(), stages: Vec::new(), latents: Vec::new() };
        for (index, (layer, blocks)) in self.encoder.iter().enumerate() {
            let input = match run.stages.last() {
                Some((_, below)) => folded(below.last()).dense().to_vec(),
                None => self.shape.cut(&run.blocks, w),
            };
            let scale = self.encoder.len() - 1 - index;
            let size = [steps, h << scale, w << scale, layer.outputs()];
            let mut hidden = vec![0.0; size.iter().product()];
            layer.forward(&input, &mut hidden);
            hidden.iter_mut().for_each(|x| *x = x.max(0.0));
            run.stages.push((input, self.blocks(blocks, filled(size, &hidden), clips)));
        }
        let mut head = sized([steps, h, w, self.shape.z]);
        let x = run.encoded();
        self.encoder_head.forward(self.arch, |frame| [x.frame(frame), &[]], &mut head, |_, _| Finish::Plain);
        let mut latents = vec![0.0; steps * h * w * self.shape.z];
        self.encoder_skip.forward(blocks, &mut latents);
        head.inside().zip(latents.chunks_exact_mut(w * self.shape.z)).for_each(|(head, latents)| add(latents, head));
        Encoded { latents, ..run }
    }

    /// Adds the gradients of the encoder's weights, given that of the latents.
    pub(super) fn encode_back(&self, run: &Encoded, size: Size, clips: usize, d: &[f32], gradient: &mut Weights) {
        let [steps, h, w] = size;
        self.encoder_skip.learn(self.arch, d, &run.blocks, gradient);
        let d_head = filled([steps, h, w, self.shape.z], d);
        let x = run.encoded();
        self.encoder_head.learn(self.arch, &d_head, |frame| [x.frame(frame), &[]], gradient);
        let mut dx = sized(x.size());
        self.encoder_head.back(self.arch, 0, |frame| d_head.frame(frame), &mut dx, false);
        for (index, ((layer, blocks), (input, chain))) in self.encoder.iter().zip(&run.stages).enumerate().rev() {
            self.blocks_back(blocks, chain, &mut dx, clips, gradient);
            where_positive(&mut dx, &chain.images[0]);
            let d = dx.dense();
            layer.learn(self.arch, &d, input, gradient);
            if index > 0 {
                let mut below = vec![0.0; input.len()];
                layer.back(&d, &mut below, false);
                dx = shuffled(&below, &dx, 1);
            }
        }
    }

    /// Decodes latents [steps, h, w, z], with what guides each pixel of the frames if the decoder is guided.
    pub(super) fn decode(&self, latents: &[f32], guide: Option<&[f32]>, size: Size, clips: usize) -> Decoded {
        let [steps, h, w] = size;
        let mut run = Decoded { latents: latents.to_vec(), ..Decoded::default() };
        run.image = filled([steps, h, w, self.shape.z], latents);
        let mut x = sized([steps, h, w, self.stem.outputs()]);
        let image = &run.image;
        self.stem.forward(self.arch, |frame| [image.frame(frame), &[]], &mut x, |_, _| Finish::Relu);
        for (stage, (blocks, grow)) in self.stages.iter().enumerate() {
            let chain = self.blocks(blocks, x, clips);
            x = Image::default();
            if let Some(grow) = grow {
                let out = chain.last();
                let mut grown = vec![0.0; out.frames * out.h * out.w * grow.outputs()];
                grow.forward(&out.dense(), &mut grown);
                grown.iter_mut().for_each(|x| *x = x.max(0.0));
                x = shuffled(&grown, out, self.shape.growth()[stage]);
            }
            run.stages.push(chain);
        }
        run.guided = self.guides.forward(self.arch, run.stages[2].last(), guide);
        let input = run.guided.last(run.stages[2].last());
        let mut head = sized([input.frames, input.h, input.w, LAYOUT_CHANNELS]);
        self.head.forward(self.arch, |frame| [input.frame(frame), &[]], &mut head, |_, _| Finish::Plain);
        run.frames = shuffled(&head.dense(), &head, 1).dense().to_vec();
        if let Some(layer) = &self.skip {
            let mut skip = vec![0.0; steps * h * w * self.shape.inputs()];
            layer.forward(latents, &mut skip);
            unfold(&mut run.frames, &mut skip, size, true);
        }
        if let Some((layer, guide)) = self.blend.as_ref().zip(guide) {
            let input = run.guided.last(run.stages[2].last());
            let mut told = sized([input.frames, input.h, input.w, layer.outputs()]);
            layer.forward(self.arch, |frame| [input.frame(frame), &[]], &mut told, |_, _| Finish::Plain);
            run.mixed = Some((blend::mix(&mut run.frames, &told, guide), guide.to_vec()));
        }
        run
    }

    /// Adds the gradients of the decoder's weights, given that of the frames, and returns that of the latents.
    pub(super) fn decode_back(
        &self,
        run: &Decoded,
        size: Size,
        clips: usize,
        d: &mut [f32],
        gradient: &mut Weights,
    ) -> Vec<f32> {
        let [steps, h, w] = size;
        let last = run.guided.last(run.stages[2].last());
        let d_told = self.blend.as_ref().zip(run.mixed.as_ref()).map(|(layer, (mixed, guide))| {
            let mut d_told = sized([last.frames, last.h, last.w, layer.outputs()]);
            blend::back(mixed, d, guide, &mut d_told);
            (layer, d_told)
        });
        let mut d_latents = vec![0.0; run.latents.len()];
        if let Some(layer) = &self.skip {
            let mut d_skip = vec![0.0; steps * h * w * self.shape.inputs()];
            unfold(d, &mut d_skip, size, false);
            layer.learn(self.arch, &d_skip, &run.latents, gradient);
            layer.back(&d_skip, &mut d_latents, false);
        }
        let d_head = filled([last.frames, last.h, last.w, LAYOUT_CHANNELS], &unshuffled(d, last, 1));
        self.head.learn(self.arch, &d_head, |frame| [last.frame(frame), &[]], gradient);
        let mut dx = sized(last.size());
        self.head.back(self.arch, 0, |frame| d_head.frame(frame), &mut dx, false);
        if let Some((layer, d_told)) = &d_told {
            layer.learn(self.arch, d_told, |frame| [last.frame(frame), &[]], gradient);
            layer.back(self.arch, 0, |frame| d_told.frame(frame), &mut dx, true);
        }
        self.guides.back(self.arch, &run.guided, run.stages[2].last(), &mut dx, gradient);
        for (stage, (blocks, grow)) in self.stages.iter().enumerate().rev() {
            let chain = &run.stages[stage];
            if let Some(grow) = grow {
                where_positive(&mut dx, &run.stages[stage + 1].images[0]);
                let out = chain.last();
                let dy = unshuffled(&dx.dense(), out, self.shape.growth()[stage]);
                grow.learn(self.arch, &dy, &out.dense(), gradient);
                let mut dense = vec![0.0; out.frames * out.h * out.w * out.c];
                grow.back(&dy, &mut dense, false);
                dx = filled(out.size(), &dense);
            }
            self.blocks_back(blocks, chain, &mut dx, clips, gradient);
        }
        where_positive(&mut dx, &run.stages[0].images[0]);
        let image = &run.image;
        self.stem.learn(self.arch, &dx, |frame| [image.frame(frame), &[]], gradient);
        let mut d_image = sized(image.size());
        self.stem.back(self.arch, 0, |frame| dx.frame(frame), &mut d_image, false);
        add(&mut d_latents, &d_image.dense());
        d_latents
    }

    fn blocks(&self, blocks: &[Block], x: Image, clips: usize) -> Chain {
        let (per_clip, nothing) = (x.frames / clips, vec![0.0; x.frame(0).len()]);
        let mut chain = Chain { images: vec![x], inner: Vec::new() };
        for block in blocks {
            let x = chain.last();
            let (mut inner, mut out) = (sized(x.size()), sized(x.size()));
            let before = |frame: usize| if frame.is_multiple_of(per_clip) { &nothing[..] } else { x.frame(frame - 1) };
            let pair = |frame: usize| [x.frame(frame), before(frame)];
            block.first.forward(self.arch, pair, &mut inner, |_, _| Finish::Relu);
            let middle = &inner;
            let other = |frame: usize, y: usize| Finish::ReluOfSum(x.row(frame, y));
            block.second.forward(self.arch, |frame| [middle.frame(frame), &[]], &mut out, other);
            chain.inner.push(inner);
            chain.images.push(out);
        }
        chain
    }

    /// Takes the gradient of a run of blocks from its output to its input.
    fn blocks_back(&self, blocks: &[Block], chain: &Chain, dx: &mut Image, clips: usize, gradient: &mut Weights) {
        let (per_clip, nothing) = (dx.frames / clips, vec![0.0; dx.frame(0).len()]);
        for (index, block) in blocks.iter().enumerate().rev() {
            let (x, inner) = (&chain.images[index], &chain.inner[index]);
            where_positive(dx, &chain.images[index + 1]);
            block.second.learn(self.arch, dx, |frame| [inner.frame(frame), &[]], gradient);
            let mut d_inner = sized(inner.size());
            let dy: &Image = dx;
            block.second.back(self.arch, 0, |frame| dy.frame(frame), &mut d_inner, false);
            where_positive(&mut d_inner, inner);
            let before = |frame: usize| if frame.is_multiple_of(per_clip) { &nothing[..] } else { x.frame(frame - 1) };
            block.first.learn(self.arch, &d_inner, |frame| [x.frame(frame), before(frame)], gradient);
            let d_inner = &d_inner;
            block.first.back(self.arch, 0, |frame| d_inner.frame(frame), dx, true);
            let later = |frame: usize| {
                if (frame + 1).is_multiple_of(per_clip) { &nothing[..] } else { d_inner.frame(frame + 1) }
            };
            block.first.back(self.arch, 1, later, dx, true);
        }
    }
}

/// Adds blocks (frame, row, column, colour) of latent pixels to frames, or copies frames into blocks.
fn unfold(frames: &mut [f32], blocks: &mut [f32], [steps, h, w]: Size, add_blocks: bool) {
    const RUN: usize = BLOCK_PX * 3;
    let stride = blocks.len() / (steps * h * w * BLOCK_PX * RUN);
    for (index, line) in frames.chunks_exact_mut(w * RUN).enumerate() {
        let (frame, y) = (index / (h * BLOCK_PX), index % (h * BLOCK_PX));
        let first = (frame / stride * h + y / BLOCK_PX) * w * stride * BLOCK_PX * RUN;
        let part = (frame % stride * BLOCK_PX + y % BLOCK_PX) * RUN;
        let pixels = blocks[first..].chunks_exact_mut(stride * BLOCK_PX * RUN);
        for (line, block) in line.chunks_exact_mut(RUN).zip(pixels) {
            let block = &mut block[part..part + RUN];
            if add_blocks { add(line, block) } else { block.copy_from_slice(line) }
        }
    }
}
