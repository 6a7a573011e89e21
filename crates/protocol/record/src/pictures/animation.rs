//! An endless animated GIF: one palette for the whole animation, unchanged pixels left out.
//!
//! The palette is chosen from a sample of the pictures, so pictures are drawn again for the second pass instead of being
//! kept. Long drives are shown in fewer pictures, at the same speed.

use ds_raster::RgbImage;
use ds_space::SimTime;
use gif::{DisposalMethod, Encoder, Frame, Repeat};

use crate::error::RecordError;
use crate::pictures::palette::Histogram;

/// The most pictures of an animation.
const MAX_PICTURES: usize = 200;
/// Pictures from which the palette is chosen.
const SAMPLES: usize = 8;
const NANOS_PER_HUNDREDTH: i64 = 10_000_000;
/// How long the last picture stays, in hundredths of a second.
const LAST_DELAY: u16 = 100;

/// Encodes `count` pictures, `dt` apart; `picture` draws one by its index. No pictures give one black dot.
pub(crate) fn encode(
    count: usize,
    dt: SimTime,
    picture: impl Fn(usize) -> Result<RgbImage, RecordError>,
) -> Result<Vec<u8>, RecordError> {
    let stride = count.div_ceil(MAX_PICTURES).max(1);
    let shown: Vec<usize> = (0..count).step_by(stride).collect();
    let mut histogram = Histogram::default();
    let mut size = (1, 1);
    for index in shown.iter().step_by(shown.len().div_ceil(SAMPLES).max(1)) {
        let image = picture(*index)?;
        size = (size.0.max(image.width_px()), size.1.max(image.height_px()));
        histogram.add(&image);
    }
    let palette = histogram.palette();
    let unchanged = u8::try_from(palette.len()).unwrap_or(u8::MAX);
    let mut colours = palette.rgb();
    colours.extend([0, 0, 0]);
    let side = |value: u32| u16::try_from(value).unwrap_or(u16::MAX);
    let mut encoder = Encoder::new(Vec::new(), side(size.0), side(size.1), &colours)?;
    encoder.set_repeat(Repeat::Infinite)?;
    let step = dt.0.saturating_mul(i64::try_from(stride).unwrap_or(1));
    let delay = u16::try_from((step / NANOS_PER_HUNDREDTH).max(2)).unwrap_or(u16::MAX);
    let mut before: Vec<u8> = Vec::new();
    for (place, index) in shown.iter().enumerate() {
        let image = picture(*index)?;
        let now = palette.indices(&image);
        let buffer: Vec<u8> = if before.len() == now.len() {
            now.iter().zip(&before).map(|(now, before)| if now == before { unchanged } else { *now }).collect()
        } else {
            now.clone()
        };
        encoder.write_frame(&Frame {
            delay: if place + 1 == shown.len() { LAST_DELAY } else { delay },
            dispose: DisposalMethod::Keep,
            transparent: Some(unchanged),
            width: side(image.width_px()),
            height: side(image.height_px()),
            buffer: buffer.into(),
            ..Frame::default()
        })?;
        before = now;
    }
    Ok(encoder.into_inner()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A red dot that moves over a grey ground, four pixels a picture.
    fn picture(index: usize) -> Result<RgbImage, RecordError> {
        let mut image = RgbImage::filled(40, 10, [90, 90, 90]);
        image.set_pixel((index as u32 * 4) % 40, 5, [250, 10, 10]);
        Ok(image)
    }

    #[test]
    fn a_reader_sees_every_picture_whole() {
        let bytes = encode(6, SimTime::from_secs(0.1), picture).expect("encodes");
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(bytes.as_slice()).expect("is a GIF");
        let mut screen = vec![[0u8; 4]; 400];
        let mut count = 0;
        while let Some(frame) = decoder.read_next_frame().expect("frames are sound") {
            assert_eq!(frame.delay, if count == 5 { LAST_DELAY } else { 10 });
            for (pixel, new) in screen.iter_mut().zip(frame.buffer.chunks_exact(4)) {
                if new[3] > 0 {
                    pixel.copy_from_slice(new);
                }
            }
            let red: Vec<usize> = (0..400).filter(|i| screen[*i][0] > 200 && screen[*i][1] < 60).collect();
            assert_eq!(red, [5 * 40 + count * 4]);
            count += 1;
        }
        assert_eq!(count, 6);
    }

    #[test]
    fn a_long_drive_is_thinned_and_an_empty_one_is_a_dot() {
        let bytes = encode(450, SimTime::from_secs(0.1), picture).expect("encodes");
        let mut decoder = gif::DecodeOptions::new().read_info(bytes.as_slice()).expect("is a GIF");
        let mut delays = Vec::new();
        while let Some(frame) = decoder.read_next_frame().expect("frames are sound") {
            delays.push(frame.delay);
        }
        assert_eq!((delays.len(), delays[0]), (150, 30));
        assert!(encode(0, SimTime::from_secs(0.1), picture).is_ok());
    }
}
