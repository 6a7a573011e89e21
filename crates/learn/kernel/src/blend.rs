//! The last step of a decoder that sees carried frames: of each pixel a share is carried, the rest painted. The share is a
//! logistic function of what the decoder tells, 0 where nothing is carried.

use super::image::Image;

/// Channels of a pixel of what guides: layout, carried frame, whether there is one.
const GUIDE: usize = 7;

/// What [`back`] needs of a mixture.
#[derive(Default)]
pub(crate) struct Mixed {
    painted: Vec<f32>,
    shares: Vec<f32>,
}

/// Mixes carried pixels into painted frames [frames, 2h, 2w, 3]; `told` has a channel for each of two by two pixels.
pub(crate) fn mix(frames: &mut [f32], told: &Image, guide: &[f32]) -> Mixed {
    let painted = frames.to_vec();
    let mut shares = vec![0.0; frames.len() / 3];
    let pixels = shares.iter_mut().zip(frames.chunks_exact_mut(3).zip(guide.chunks_exact(GUIDE)));
    for ((share, (pixel, guide)), at) in pixels.zip(places(told)) {
        *share = guide[6] / (1.0 + (-told.values()[at]).exp());
        pixel.iter_mut().zip(&guide[3..6]).for_each(|(pixel, carried)| *pixel += *share * (carried - *pixel));
    }
    Mixed { painted, shares }
}

/// Turns the gradient of mixed frames into that of the painted ones, and writes that of what was told.
pub(crate) fn back(mixed: &Mixed, d: &mut [f32], guide: &[f32], d_told: &mut Image) {
    let places: Vec<usize> = places(d_told).collect();
    let pixels = d.chunks_exact_mut(3).zip(mixed.painted.chunks_exact(3)).zip(guide.chunks_exact(GUIDE));
    for (((d, painted), guide), (share, at)) in pixels.zip(mixed.shares.iter().zip(places)) {
        let along: f32 = d.iter().zip(guide[3..6].iter().zip(painted)).map(|(d, (to, from))| d * (to - from)).sum();
        let slope = if guide[6] == 0.0 { 0.0 } else { 1.0 - share / guide[6] };
        d_told.values_mut()[at] = along * share * slope;
        d.iter_mut().for_each(|d| *d *= 1.0 - share);
    }
}

/// Lists where the value of each pixel of frames twice as large stands in an image of four channels, rows top to bottom.
fn places(image: &Image) -> impl Iterator<Item = usize> + use<> {
    let [frames, h, w, c] = image.size();
    let rows = (0..frames).flat_map(move |frame| (0..2 * h).map(move |y| (frame, y)));
    rows.flat_map(move |(frame, y)| {
        let line = (frame * (h + 2) + y / 2 + 1) * (w + 2);
        (0..2 * w).map(move |x| (line + x / 2 + 1) * c + y % 2 * 2 + x % 2)
    })
}
