//! Pixels of a frame that show the same: those that the layout beside it paints in one colour.

use crate::image::RgbImage;

/// A layout, by which pixels of a frame of its size are compared with those around them.
pub(crate) struct Alike<'a> {
    told: &'a [[u8; 3]],
    pub(crate) width: usize,
    pub(crate) height: usize,
}

impl<'a> Alike<'a> {
    /// Takes the layout of a frame.
    ///
    /// # Panics
    ///
    /// Panics if the two differ in size.
    pub(crate) fn new(frame: &RgbImage, layout: &'a RgbImage) -> Self {
        let size = |image: &RgbImage| (image.width_px() as usize, image.height_px() as usize);
        let (width, height) = size(frame);
        assert_eq!(size(layout), (width, height), "frame and layout differ in size");
        Self { told: layout.rgb().as_chunks::<3>().0, width, height }
    }

    /// Returns the places of the pixels up to so many to each side of one, itself among them, that show the same, by rows.
    pub(crate) fn around(&self, at: usize, reach: usize) -> impl Iterator<Item = usize> + '_ {
        let (x, y) = (at % self.width, at / self.width);
        let columns = x.saturating_sub(reach)..(x + reach + 1).min(self.width);
        let rows = y.saturating_sub(reach)..(y + reach + 1).min(self.height);
        let places = rows.flat_map(move |row| columns.clone().map(move |column| row * self.width + column));
        places.filter(move |near| self.told[*near] == self.told[at])
    }
}
