//! Side by side: the world's own frames, the layouts and each arm's frames, as stills in one picture and as an animated GIF.
//!
//! The film has one fixed palette of 6×7×6 levels with an ordered dither, so that frames can be written one after the other.

use std::collections::BTreeMap;

use ds_raster::RgbImage;
use gif::{Encoder, Frame, Repeat};

use crate::arm::Arm;
use crate::config::ArmKind;
use crate::drive::Drive;
use crate::error::EvaluationError;

const LEVELS: [u32; 3] = [6, 7, 6];
const BAYER: [[u32; 4]; 4] = [[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]];
/// Hundredths of a second per frame.
const DELAY: u16 = 10;

/// Frames of which stills are made.
pub(crate) const STILLS: [u32; 3] = [10, 40, 80];

/// Frames of the world, its layouts and of arms.
pub(crate) struct Film {
    strips: Vec<Vec<RgbImage>>,
    last: u32,
}

/// Rolls arms out over a drive; an arm whose clip is shorter stands still at its end.
pub(crate) fn side_by_side(
    drive: &mut Drive,
    names: &[String],
    arms: &BTreeMap<String, Arm>,
    last: u32,
) -> Result<Film, EvaluationError> {
    let mut strips = Vec::new();
    strips.push((0..=last).map(|frame| drive.frame(frame)).collect::<Result<Vec<_>, _>>()?);
    strips.push((0..=last).map(|frame| Ok(drive.layout(frame)?.image)).collect::<Result<Vec<_>, EvaluationError>>()?);
    for name in names {
        let arm = &arms[name];
        strips.push(arm.roll(drive, whole(arm.kind, last, arm.frames_per_chunk()))?);
    }
    Ok(Film { strips, last })
}

impl Film {
    /// Returns the animation.
    pub(crate) fn animation(&self) -> Result<Vec<u8>, EvaluationError> {
        encode(&self.strips, self.last)
    }

    /// Returns a row of pictures for each still that the film is long enough for.
    pub(crate) fn stills(&self) -> Vec<Vec<RgbImage>> {
        let row = |at: &u32| {
            self.strips.iter().map(|strip| strip[(*at as usize).min(strip.len() - 1)].clone()).collect::<Vec<_>>()
        };
        STILLS.iter().filter(|at| **at <= self.last).map(row).collect()
    }
}

fn encode(strips: &[Vec<RgbImage>], last: u32) -> Result<Vec<u8>, EvaluationError> {
    let (width, height) =
        strips.first().and_then(|strip| strip.first()).map_or((1, 1), |image| (image.width_px(), image.height_px()));
    let side = |value: u32| u16::try_from(value).unwrap_or(u16::MAX);
    let wide = side(width * strips.len() as u32);
    let mut encoder = Encoder::new(Vec::new(), wide, side(height), &palette())?;
    encoder.set_repeat(Repeat::Infinite)?;
    for index in 0..=last as usize {
        let mut buffer = Vec::with_capacity(usize::from(wide) * height as usize);
        for y in 0..height {
            for strip in strips {
                let image = &strip[index.min(strip.len() - 1)];
                buffer.extend((0..width).map(|x| nearest(image.pixel(x, y), x, y)));
            }
        }
        encoder.write_frame(&Frame {
            delay: DELAY,
            width: wide,
            height: side(height),
            buffer: buffer.into(),
            ..Frame::default()
        })?;
    }
    Ok(encoder.into_inner()?)
}

fn palette() -> Vec<u8> {
    let [red, green, blue] = LEVELS;
    #[expect(clippy::cast_possible_truncation, reason = "at most 255")]
    let value = |level: u32, levels: u32| (level * 255 / (levels - 1)) as u8;
    let colours = (0..red).flat_map(|r| (0..green).flat_map(move |g| (0..blue).map(move |b| (r, g, b))));
    colours.flat_map(|(r, g, b)| [value(r, red), value(g, green), value(b, blue)]).collect()
}

/// Returns the index of a colour near a pixel's, dithered by its place.
fn nearest(pixel: [u8; 3], x: u32, y: u32) -> u8 {
    let threshold = BAYER[(y % 4) as usize][(x % 4) as usize];
    let level = |colour: usize| {
        let (scaled, levels) = (u32::from(pixel[colour]) * (LEVELS[colour] - 1) * 16, LEVELS[colour]);
        ((scaled + threshold * 255) / (255 * 16)).min(levels - 1)
    };
    #[expect(clippy::cast_possible_truncation, reason = "there are 252 colours")]
    let index = ((level(0) * LEVELS[1] + level(1)) * LEVELS[2] + level(2)) as u8;
    index
}

/// Returns the frames after the first that an arm can make at most: whole chunks for a teacher.
fn whole(kind: ArmKind, frames: u32, per_chunk: u32) -> u32 {
    if kind.samples_windows() { frames - frames % per_chunk } else { frames }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_stay_near_and_exact_ones_stay() {
        let palette = palette();
        assert_eq!(palette.len(), 252 * 3);
        for pixel in [[0, 0, 0], [255, 255, 255], [51, 85, 204], [255, 0, 0]] {
            for (x, y) in [(0, 0), (3, 2), (1, 1)] {
                let at = usize::from(nearest(pixel, x, y)) * 3;
                let apart = (0..3).map(|colour| palette[at + colour].abs_diff(pixel[colour])).max();
                assert!(apart <= Some(1), "{pixel:?}: {:?}", &palette[at..at + 3]);
            }
        }
        let greys: Vec<u32> =
            (0..16).map(|k| u32::from(palette[usize::from(nearest([100; 3], k % 4, k / 4)) * 3])).collect();
        let mean = greys.iter().sum::<u32>() / 16;
        assert!(mean.abs_diff(100) <= 4, "a dithered grey keeps its mean: {greys:?}");
    }

    #[test]
    fn strips_stand_side_by_side() {
        let strip = |grey: u8, count: usize| vec![RgbImage::filled(8, 4, [grey; 3]); count];
        let bytes = encode(&[strip(0, 3), strip(255, 2)], 2).expect("encodes");
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(bytes.as_slice()).expect("is a GIF");
        assert_eq!((decoder.width(), decoder.height()), (16, 4));
        let mut frames = 0;
        while let Some(frame) = decoder.read_next_frame().expect("reads") {
            assert_eq!((frame.buffer[0], frame.buffer[8 * 4]), (0, 255));
            frames += 1;
        }
        assert_eq!(frames, 3);
    }
}
