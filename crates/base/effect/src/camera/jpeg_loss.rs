//! `jpeg_loss`: an encoder before the transport rounds the 8 x 8 cosine coefficients (ITU-T T.81, annex K table, the
//! usual quality scale). All channels with the table of brightness. The neutral value leaves the frame untouched.

use std::f32::consts::PI;

use crate::frame::{Act, FrameEffect, Needs};
use crate::picture::Picture;
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "jpeg_loss",
    insertion: Insertion::Transport,
    parameters: &[Parameter::linear("quality", "1", (10.0, 100.0)).absent_at(100.0)],
    needs: &[Needs::Picture],
    act: Act::Edit(|values, _, _, picture| encode(picture, values[0])),
};

const TABLE: [u16; 64] = [
    16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56, 14, 17, 22, 29, 51,
    87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92, 49, 64, 78, 87, 103, 121, 120, 101,
    72, 92, 95, 98, 112, 100, 103, 99,
];

type Block = [[f32; 8]; 8];

fn encode(picture: &mut Picture, quality: f64) {
    let quality = quality.clamp(1.0, 100.0);
    let scale = if quality < 50.0 { 5000.0 / quality } else { 200.0 - 2.0 * quality };
    let steps = TABLE.map(|t| ((f64::from(t) * scale + 50.0) / 100.0).floor().clamp(1.0, 255.0) as f32);
    let cosines: Block = std::array::from_fn(|f| {
        let norm = if f == 0 { 0.125f32.sqrt() } else { 0.5 };
        std::array::from_fn(|x| norm * ((2 * x + 1) as f32 * f as f32 * PI / 16.0).cos())
    });
    let turned = transposed(&cosines);
    let source = picture.clone();
    for channel in 0..picture.channels {
        for top in (0..picture.height).step_by(8) {
            for left in (0..picture.width).step_by(8) {
                let pixel = |y: usize, x: usize| source.at((left + x) as isize, (top + y) as isize, channel) - 128.0;
                let block: Block = std::array::from_fn(|y| std::array::from_fn(|x| pixel(y, x)));
                let mut spectrum = product(&product(&cosines, &block), &turned);
                for (s, step) in spectrum.iter_mut().flatten().zip(&steps) {
                    *s = (*s / step).round() * step;
                }
                let block = product(&product(&turned, &spectrum), &cosines);
                for (y, row) in block.iter().enumerate().take(picture.height - top) {
                    for (x, value) in row.iter().enumerate().take(picture.width - left) {
                        let at = ((top + y) * picture.width + left + x) * picture.channels + channel;
                        picture.data[at] = (value + 128.0).round().clamp(0.0, 255.0);
                    }
                }
            }
        }
    }
}

fn transposed(a: &Block) -> Block {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

fn product(a: &Block, b: &Block) -> Block {
    std::array::from_fn(|i| {
        let mut row = [0.0; 8];
        for k in 0..8 {
            for (sum, b) in row.iter_mut().zip(b[k]) {
                *sum += a[i][k] * b;
            }
        }
        row
    })
}
