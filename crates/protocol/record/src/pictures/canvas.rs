//! Placing images on images: copy, enlarge by whole factors, captions in a 3×5 pixel type.
//!
//! What does not fit is cut off. The type has capitals, digits and a few signs; other characters are blank.

use ds_raster::RgbImage;

/// Height of a caption, in pixels.
pub const CAPTION_PX: u32 = 16;
const TEXT: [u8; 3] = [214, 216, 220];
const DOT_PX: u32 = 2;

/// The type: five rows of three dots, one octal digit a row, top row first.
const GLYPHS: &[(char, u32)] = &[
    ('A', 0o25755),
    ('B', 0o65656),
    ('C', 0o34443),
    ('D', 0o65556),
    ('E', 0o74647),
    ('F', 0o74644),
    ('G', 0o34553),
    ('H', 0o55755),
    ('I', 0o72227),
    ('J', 0o11152),
    ('K', 0o55655),
    ('L', 0o44447),
    ('M', 0o57755),
    ('N', 0o65555),
    ('O', 0o25552),
    ('P', 0o65644),
    ('Q', 0o25573),
    ('R', 0o65655),
    ('S', 0o34216),
    ('T', 0o72222),
    ('U', 0o55557),
    ('V', 0o55552),
    ('W', 0o55775),
    ('X', 0o55255),
    ('Y', 0o55222),
    ('Z', 0o71247),
    ('0', 0o75557),
    ('1', 0o26227),
    ('2', 0o71747),
    ('3', 0o71717),
    ('4', 0o55711),
    ('5', 0o74717),
    ('6', 0o74757),
    ('7', 0o71111),
    ('8', 0o75757),
    ('9', 0o75717),
    ('.', 0o00002),
    ('-', 0o00700),
    ('_', 0o00007),
    ('=', 0o07070),
    ('/', 0o11244),
    (':', 0o02020),
    ('%', 0o51245),
];

/// Copies `image` to a place on `onto`.
pub fn place(onto: &mut RgbImage, image: &RgbImage, x_px: u32, y_px: u32) {
    let (width, height) = (onto.width_px(), onto.height_px());
    if x_px >= width || y_px >= height {
        return;
    }
    let columns = image.width_px().min(width - x_px) as usize;
    let rows = image.height_px().min(height - y_px) as usize;
    let (from_stride, to_stride) = (image.width_px() as usize * 3, width as usize * 3);
    for row in 0..rows {
        let from = &image.rgb()[row * from_stride..][..columns * 3];
        let start = (y_px as usize + row) * to_stride + x_px as usize * 3;
        onto.rgb_mut()[start..start + columns * 3].copy_from_slice(from);
    }
}

/// Returns the image with every pixel as a square of `factor` (at least 1) pixels.
#[must_use]
pub fn enlarged(image: &RgbImage, factor: u32) -> RgbImage {
    let factor = factor.max(1);
    let mut large = RgbImage::filled(image.width_px() * factor, image.height_px() * factor, [0; 3]);
    let (from_stride, to_stride) = (image.width_px() as usize * 3, large.width_px() as usize * 3);
    let Some(factor) = usize::try_from(factor).ok().filter(|factor| to_stride == from_stride * factor) else {
        return image.clone();
    };
    for (y, row) in large.rgb_mut().chunks_exact_mut(to_stride).enumerate() {
        let from = &image.rgb()[y / factor * from_stride..][..from_stride];
        for (block, pixel) in row.chunks_exact_mut(3 * factor).zip(from.chunks_exact(3)) {
            for to in block.chunks_exact_mut(3) {
                to.copy_from_slice(pixel);
            }
        }
    }
    large
}

/// Returns the image at half its size, each pixel the mean of four.
#[must_use]
pub fn halved(image: &RgbImage) -> RgbImage {
    let mut small = RgbImage::filled(image.width_px() / 2, image.height_px() / 2, [0; 3]);
    let stride = image.width_px() as usize * 3;
    let width = small.width_px() as usize * 3;
    for (y, row) in small.rgb_mut().chunks_exact_mut(width).enumerate() {
        let (upper, lower) = image.rgb()[2 * y * stride..].split_at(stride);
        for (x, value) in row.iter_mut().enumerate() {
            let at = x / 3 * 6 + x % 3;
            let sum = [upper[at], upper[at + 3], lower[at], lower[at + 3]].map(u32::from).iter().sum::<u32>();
            *value = (sum / 4) as u8;
        }
    }
    small
}

/// Writes a line at the top of an image, in capitals.
pub fn caption(image: &mut RgbImage, text: &str) {
    let mut x = 3 * DOT_PX;
    for character in text.chars().map(|c| c.to_ascii_uppercase()) {
        if let Some((_, rows)) = GLYPHS.iter().find(|(glyph, _)| *glyph == character) {
            glyph(image, *rows, x, (CAPTION_PX - 5 * DOT_PX) / 2);
        }
        x += 4 * DOT_PX;
    }
}

fn glyph(image: &mut RgbImage, rows: u32, x_px: u32, y_px: u32) {
    for dot in 0..15 {
        if rows >> (14 - dot) & 1 == 0 {
            continue;
        }
        let (left, top) = (x_px + dot % 3 * DOT_PX, y_px + dot / 3 * DOT_PX);
        for (x, y) in (0..DOT_PX * DOT_PX).map(|i| (left + i % DOT_PX, top + i / DOT_PX)) {
            if x < image.width_px() && y < image.height_px() {
                image.set_pixel(x, y, TEXT);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradient() -> RgbImage {
        RgbImage::new(4, 2, (0..24).map(|i| i * 8).collect()).expect("the size fits")
    }

    #[test]
    fn enlarging_and_halving_are_inverse() {
        let large = enlarged(&gradient(), 2);
        assert_eq!((large.width_px(), large.height_px()), (8, 4));
        assert_eq!(large.pixel(5, 3), gradient().pixel(2, 1));
        assert_eq!(halved(&large), gradient());
    }

    #[test]
    fn what_sticks_out_is_cut_off() {
        let mut onto = RgbImage::filled(5, 3, [1, 1, 1]);
        place(&mut onto, &gradient(), 3, 2);
        place(&mut onto, &gradient(), 9, 0);
        assert_eq!(onto.pixel(4, 2), gradient().pixel(1, 0));
        assert_eq!(onto.pixel(2, 2), [1, 1, 1]);
        caption(&mut onto, "a longer text than fits");
    }

    #[test]
    fn a_caption_draws_the_dots_of_its_glyphs() {
        let mut image = RgbImage::filled(40, CAPTION_PX, [0; 3]);
        caption(&mut image, "t1?");
        let lit = image.rgb().chunks_exact(3).filter(|pixel| pixel == &TEXT).count();
        let dots = (0o72222u32.count_ones() + 0o26227u32.count_ones()) * DOT_PX * DOT_PX;
        assert_eq!(lit, dots as usize);
    }
}
