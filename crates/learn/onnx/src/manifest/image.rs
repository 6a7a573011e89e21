//! The table `[image]`: what frames a network sees, and the array that they become.
//!
//! Pixels are (8-bit value · scale − mean) / std; frames stand oldest first.

use ds_nn::Array;
use ds_raster::RgbImage;
use ds_space::Framing;
use serde::Deserialize;

/// No frame has a longer side, in pixels.
const MOST_SIDE_PX: usize = 4096;
/// No network sees more frames.
const MOST_HISTORY: u32 = 64;

/// `[image]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageSection {
    /// The input's name.
    pub input: String,
    /// Width and height, in pixels.
    pub size_px: [usize; 2],
    /// Order of the axes.
    #[serde(default)]
    pub layout: Layout,
    /// Order of the colours.
    #[serde(default)]
    pub colour: Colour,
    /// What 8-bit values are multiplied with.
    #[serde(default = "unit")]
    pub scale: f32,
    /// Taken off after that, by colour in the order of the network.
    #[serde(default)]
    pub mean: [f32; 3],
    /// Divided by after that, by colour in the order of the network.
    #[serde(default = "ones")]
    pub std: [f32; 3],
    /// How many frames, the newest last.
    #[serde(default = "one")]
    pub history: u32,
    /// Which camera.
    #[serde(default)]
    pub camera: Camera,
    /// How a frame is brought to the size.
    #[serde(default)]
    pub resize: Resize,
}

/// The order of an image's axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
pub enum Layout {
    /// [1, frames · 3, height, width]
    #[default]
    #[serde(rename = "NCHW")]
    Nchw,
    /// [1, height, width, frames · 3]
    #[serde(rename = "NHWC")]
    Nhwc,
    /// [1, frames, 3, height, width]
    #[serde(rename = "NTCHW")]
    Ntchw,
    /// [1, 3, frames, height, width]
    #[serde(rename = "NCTHW")]
    Ncthw,
}

/// The order of an image's colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
pub enum Colour {
    /// Red first.
    #[default]
    #[serde(rename = "RGB")]
    Rgb,
    /// Blue first.
    #[serde(rename = "BGR")]
    Bgr,
}

/// The camera that a network looks through.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Camera {
    /// The one known camera of the built-in policies, into which the forward camera is brought.
    #[default]
    Known,
    /// A camera of the scenario by its id, as it is.
    Raw(String),
}

/// How a frame is brought to the size of the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Resize {
    /// Means over areas, width and height each for itself.
    #[default]
    Area,
    /// The largest part of the middle that has the network's proportions, then means over areas.
    Crop,
}

const fn unit() -> f32 {
    1.0
}

const fn ones() -> [f32; 3] {
    [1.0; 3]
}

const fn one() -> u32 {
    1
}

impl ImageSection {
    /// Returns the shape of the input.
    #[must_use]
    pub fn shape(&self) -> Vec<usize> {
        let ([width, height], frames) = (self.size_px, self.history as usize);
        match self.layout {
            Layout::Nchw => vec![1, 3 * frames, height, width],
            Layout::Nhwc => vec![1, height, width, 3 * frames],
            Layout::Ntchw => vec![1, frames, 3, height, width],
            Layout::Ncthw => vec![1, 3, frames, height, width],
        }
    }

    /// Returns which part of a frame of some width and height the network is shown.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "sides are at most 4096")]
    pub fn framing(&self, [across_px, down_px]: [u32; 2]) -> Framing {
        let to_px = self.size_px.map(|side| side as u32);
        if self.resize == Resize::Area {
            return Framing { left_px: 0, top_px: 0, width_px: across_px, height_px: down_px, to_px };
        }
        let scale = (f64::from(across_px) / f64::from(to_px[0])).min(f64::from(down_px) / f64::from(to_px[1]));
        let [width_px, height_px] = to_px.map(|side| ((f64::from(side) * scale).round() as u32).max(1));
        let [left_px, top_px] =
            [(across_px, width_px), (down_px, height_px)].map(|(all, part)| all.saturating_sub(part) / 2);
        Framing { left_px, top_px, width_px, height_px, to_px }
    }

    /// Returns a frame of any size in that of the network.
    #[must_use]
    pub fn sized(&self, frame: &RgbImage) -> RgbImage {
        let Framing { left_px, top_px, width_px, height_px, to_px } =
            self.framing([frame.width_px(), frame.height_px()]);
        if [width_px, height_px] == [frame.width_px(), frame.height_px()] {
            return frame.resized(to_px[0], to_px[1]);
        }
        frame.part([left_px, top_px], [width_px, height_px]).resized(to_px[0], to_px[1])
    }

    /// Returns the input that `history` frames of the network's size become.
    ///
    /// # Panics
    /// If there are fewer or more, or one has another size.
    #[must_use]
    pub fn array(&self, frames: &[RgbImage]) -> Array {
        let colours: [usize; 3] = if self.colour == Colour::Rgb { [0, 1, 2] } else { [2, 1, 0] };
        let value = |frame: &RgbImage, pixel: usize, place: usize| {
            let byte = f32::from(frame.rgb()[3 * pixel + colours[place]]);
            (byte * self.scale - self.mean[place]) / self.std[place]
        };
        let [width, height] = self.size_px;
        let pixels = width * height;
        let mut values = Vec::with_capacity(3 * frames.len() * pixels);
        let mut plane = |frame, place| values.extend((0..pixels).map(|pixel| value(frame, pixel, place)));
        match self.layout {
            Layout::Nchw | Layout::Ntchw => {
                frames.iter().for_each(|frame| (0..3).for_each(|place| plane(frame, place)))
            }
            Layout::Ncthw => (0..3).for_each(|place| frames.iter().for_each(|frame| plane(frame, place))),
            Layout::Nhwc => {
                for pixel in 0..pixels {
                    values.extend(frames.iter().flat_map(|frame| [0, 1, 2].map(|place| value(frame, pixel, place))));
                }
            }
        }
        Array::new(&self.shape(), values)
    }

    pub(crate) fn check(&self) -> Result<(), (&'static str, String)> {
        let sound = self.size_px.iter().all(|side| (1..=MOST_SIDE_PX).contains(side));
        if !sound {
            return Err(("image.size_px", format!("is {:?}, sides are 1 to {MOST_SIDE_PX}", self.size_px)));
        }
        if !(1..=MOST_HISTORY).contains(&self.history) {
            return Err(("image.history", format!("is {}, it must be 1 to {MOST_HISTORY}", self.history)));
        }
        let numbers = [self.scale].into_iter().chain(self.mean).chain(self.std);
        if !numbers.clone().all(f32::is_finite) || self.std.contains(&0.0) {
            let numbers: Vec<f32> = numbers.collect();
            return Err(("image.std", format!("is refused: {numbers:?} must be finite, a divisor not 0")));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_stand_in_the_order_and_unit_of_the_manifest() {
        let image = |layout, colour, history| ImageSection {
            input: "image".to_owned(),
            size_px: [2, 1],
            layout,
            colour,
            scale: 0.1,
            mean: [1.0, 0.0, 0.0],
            std: [1.0, 1.0, 2.0],
            history,
            camera: Camera::Known,
            resize: Resize::Area,
        };
        let old = RgbImage::new(2, 1, vec![10, 20, 40, 50, 60, 80]).expect("an image");
        let new = RgbImage::filled(2, 1, [0; 3]);
        let values = |image: &ImageSection, frames: &[RgbImage]| image.array(frames).into_values();
        let first = std::slice::from_ref(&old);
        assert_eq!(values(&image(Layout::Nchw, Colour::Rgb, 1), first), [0.0, 4.0, 2.0, 6.0, 2.0, 4.0]);
        assert_eq!(values(&image(Layout::Nhwc, Colour::Rgb, 1), first), [0.0, 2.0, 2.0, 4.0, 6.0, 4.0]);
        assert_eq!(values(&image(Layout::Nchw, Colour::Bgr, 1), first), [3.0, 7.0, 2.0, 6.0, 0.5, 2.5]);
        let two = values(&image(Layout::Ntchw, Colour::Rgb, 2), &[old.clone(), new.clone()]);
        assert_eq!(two[..6], [0.0, 4.0, 2.0, 6.0, 2.0, 4.0]);
        assert_eq!(two[6..], [-1.0, -1.0, 0.0, 0.0, 0.0, 0.0]);
        let two = values(&image(Layout::Ncthw, Colour::Rgb, 2), &[old, new]);
        assert_eq!(two, [0.0, 4.0, -1.0, -1.0, 2.0, 6.0, 0.0, 0.0, 2.0, 4.0, 0.0, 0.0]);
    }
}
