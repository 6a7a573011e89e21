//! Frames with a border of zeros, channels last: [frames, h + 2, w + 2, channels].

use rayon::prelude::*;

use super::Buffer;
use super::product::Source;

/// Frames of one size. The border stays zero: only the inside is ever written.
#[derive(Default)]
pub(crate) struct Image {
    pub(crate) frames: usize,
    pub(crate) h: usize,
    pub(crate) w: usize,
    pub(crate) c: usize,
    data: Buffer,
}

impl Image {
    /// Takes on a size; what was inside is forgotten.
    pub(crate) fn reset(&mut self, [frames, h, w, c]: [usize; 4]) {
        if (self.h, self.w, self.c) != (h, w, c) {
            self.data = Buffer::default();
        }
        (self.frames, self.h, self.w, self.c) = (frames, h, w, c);
        self.data.resize(frames * self.frame_len());
    }

    /// Returns frames, rows, columns and channels.
    pub(crate) fn size(&self) -> [usize; 4] {
        [self.frames, self.h, self.w, self.c]
    }

    fn frame_len(&self) -> usize {
        (self.h + 2) * (self.w + 2) * self.c
    }

    /// Returns one frame, border included.
    pub(crate) fn frame(&self, frame: usize) -> &[f32] {
        &self.data[frame * self.frame_len()..(frame + 1) * self.frame_len()]
    }

    /// Returns all values, border included.
    pub(crate) fn values(&self) -> &[f32] {
        &self.data
    }

    /// Returns all values for writing; the border has to stay zero.
    pub(crate) fn values_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// Returns the rows inside the border, frame by frame.
    pub(crate) fn inside(&self) -> impl Iterator<Item = &[f32]> {
        let (line, c, w) = ((self.w + 2) * self.c, self.c, self.w);
        let frames = self.data.chunks_exact(self.frame_len().max(1));
        frames.flat_map(move |frame| frame.chunks_exact(line).skip(1).take(self.h).map(move |row| &row[c..c + w * c]))
    }

    /// Returns the values inside the border, [frames, h, w, c].
    pub(crate) fn dense(&self) -> Buffer {
        let mut dense = Buffer::zeros(self.frames * self.h * self.w * self.c);
        dense.chunks_exact_mut(self.w * self.c).zip(self.inside()).for_each(|(to, row)| to.copy_from_slice(row));
        dense
    }

    /// Returns the pixels of a row inside the border as the rows of a product.
    pub(crate) fn row(&self, frame: usize, y: usize) -> Source<'_> {
        let offset = ((y + 1) * (self.w + 2) + 1) * self.c;
        Source { data: self.frame(frame), offset, stride: self.c, depth: self.c }
    }

    /// Hands out every row inside the border for writing, in parallel: frame, row, and the row with its border.
    pub(crate) fn each_row(&mut self, each: impl Fn(usize, usize, &mut [f32]) + Sync) {
        let (h, line) = (self.h, (self.w + 2) * self.c);
        self.data.par_chunks_mut(line).enumerate().with_min_len(2).for_each(|(index, row)| {
            let (frame, y) = (index / (h + 2), index % (h + 2));
            if (1..=h).contains(&y) {
                each(frame, y - 1, row);
            }
        });
    }

    /// Copies values [frames, h, w, c] inside the border.
    pub(crate) fn fill(&mut self, values: &[f32]) {
        let (h, line, c) = (self.h, self.w * self.c, self.c);
        self.each_row(|frame, y, row| {
            let at = (frame * h + y) * line;
            row[c..c + line].copy_from_slice(&values[at..at + line]);
        });
    }
}
