//! Rectangles of a picture: filled from their surroundings, copied, pasted, restyled. Edges in px; what lies outside of
//! the picture is left out.

use crate::picture::Picture;

/// Returns the whole pixels of a box within the picture: left, top, right, bottom (the last two exclusive).
fn inside(picture: &Picture, edges: [f64; 4]) -> [usize; 4] {
    let limit = |v: f64, most: usize| v.round().clamp(0.0, most as f64) as usize;
    [
        limit(edges[0], picture.width),
        limit(edges[1], picture.height),
        limit(edges[2], picture.width),
        limit(edges[3], picture.height),
    ]
}

/// Fills a box row by row with the passage from the pixel on its left to the one on its right.
pub(crate) fn fill(picture: &mut Picture, edges: [f64; 4]) {
    let [x0, y0, x1, y1] = inside(picture, edges);
    for y in y0..y1 {
        for k in 0..picture.channels {
            let beyond = picture.at(x1 as isize, y as isize, k);
            let left = if x0 > 0 { picture.at(x0 as isize - 1, y as isize, k) } else { beyond };
            let right = if x1 < picture.width { beyond } else { left };
            for x in x0..x1 {
                let share = (x - x0 + 1) as f32 / (x1 - x0 + 1) as f32;
                picture.data[(y * picture.width + x) * picture.channels + k] = left + share * (right - left);
            }
        }
    }
}

/// Shows a rectangle of another picture of the same size at a new place.
pub(crate) fn paste(picture: &mut Picture, from: &Picture, at: [f64; 2], to: [f64; 2], size: [f64; 2]) {
    let shift = [(at[0] - to[0]).round() as isize, (at[1] - to[1]).round() as isize];
    let [x0, y0, x1, y1] = inside(picture, [to[0], to[1], to[0] + size[0], to[1] + size[1]]);
    for y in y0..y1 {
        for x in x0..x1 {
            for k in 0..picture.channels {
                let value = from.at(x as isize + shift[0], y as isize + shift[1], k);
                picture.data[(y * picture.width + x) * picture.channels + k] = value;
            }
        }
    }
}

/// Shows a rectangle of the picture a second time.
pub(crate) fn copy(picture: &mut Picture, from: [f64; 2], to: [f64; 2], size: [f64; 2]) {
    let source = picture.clone();
    paste(picture, &source, from, to, size);
}

/// Scales the values in a box.
pub(crate) fn restyle(picture: &mut Picture, edges: [f64; 4], gain: f32) {
    let [x0, y0, x1, y1] = inside(picture, edges);
    let (width, channels) = (picture.width, picture.channels);
    for y in y0..y1 {
        let row = &mut picture.data[(y * width + x0) * channels..(y * width + x1.max(x0)) * channels];
        row.iter_mut().for_each(|v| *v = (*v * gain).min(255.0));
    }
}
