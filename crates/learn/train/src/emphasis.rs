//! Where a loss counts more: the pixels whose layout shows vehicles, pedestrians, cyclists, a lit traffic light or paint on the road.
//!
//! They cover a few per cent of a frame, a light a few pixels, yet they are what a policy must see. Every other pixel counts 1, but
//! where a layout tells nothing but ground or sky, or that something stands there, and the frame is one of many that it allows: no
//! layout tells the colour of a house.

use ds_layout::colour;
use ds_raster::RgbImage;

use crate::config::TrainConfig;

/// How much pixels count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Emphasis {
    /// Those of a vehicle, a pedestrian, a cyclist or what blocks the way.
    pub(crate) road_users: f32,
    /// Those of a red, yellow or green light and its stop line.
    pub(crate) lights: f32,
    /// Those of paint on the road: lines and crossings.
    pub(crate) markings: f32,
    /// Those of bare ground and of what stands before the sky.
    pub(crate) untold: f32,
    /// Those of houses, trees and whatever else the layout stands beside the road.
    pub(crate) structures: f32,
}

impl Emphasis {
    /// Returns what a recipe asks of all stages.
    pub(crate) fn of(config: &TrainConfig) -> Self {
        Self { road_users: config.road_users, lights: config.lights, markings: 1.0, untold: 1.0, structures: 1.0 }
    }

    /// Says whether a layout's colour is that of a road user or of what blocks the way.
    pub(crate) fn is_in_the_way(rgb: colour::Rgb) -> bool {
        colour::is_road_user(rgb) || colour::is_obstacle(rgb)
    }

    /// Returns the weight of every pixel of some layouts, [images, height, width].
    pub(crate) fn of_pixels(self, layouts: &[&RgbImage]) -> Vec<f32> {
        let weight = |rgb: &[u8]| match [rgb[0], rgb[1], rgb[2]] {
            colour::GROUND | colour::SKY => self.untold,
            rgb if Self::is_in_the_way(rgb) => self.road_users,
            rgb if colour::is_lit(rgb) => self.lights,
            rgb if colour::is_marking(rgb) => self.markings,
            rgb if colour::is_structure(rgb) => self.structures,
            _ => 1.0,
        };
        layouts.iter().flat_map(|layout| layout.rgb().chunks_exact(3).map(weight)).collect()
    }

    /// Returns the weight of every latent pixel [h, w] of one latent step: the mean over its 8×8 pixels of all frames.
    pub(crate) fn of_latents(self, layouts: &[&RgbImage]) -> Vec<f32> {
        let (width, height) = (layouts[0].width_px() as usize, layouts[0].height_px() as usize);
        let (h, w) = (height / 8, width / 8);
        let mut sums = vec![0.0; h * w];
        for (at, weight) in self.of_pixels(layouts).into_iter().enumerate() {
            let (y, x) = (at / width % height, at % width);
            if y < 8 * h && x < 8 * w {
                sums[y / 8 * w + x / 8] += weight;
            }
        }
        sums.iter_mut().for_each(|sum| *sum /= (64 * layouts.len()) as f32);
        sums
    }
}

#[cfg(test)]
mod tests {
    use ds_world::{AgentClass, LightState};

    use super::*;

    #[test]
    fn road_users_and_lights_weigh_more_where_they_are() {
        let vehicle = colour::face(colour::agent(AgentClass::Vehicle), colour::Face::Rear);
        let mut rgb = colour::LANE.repeat(16 * 8);
        for x in 8..12 {
            rgb[3 * x..3 * x + 3].copy_from_slice(&vehicle);
        }
        rgb[..3].copy_from_slice(&colour::light(LightState::Red));
        rgb[3..6].copy_from_slice(&colour::light(LightState::Unknown));
        let emphasis = Emphasis { road_users: 5.0, lights: 9.0, markings: 1.0, untold: 1.0, structures: 1.0 };
        let (layout, empty) =
            (RgbImage::new(16, 8, rgb).expect("the size fits"), RgbImage::filled(16, 8, colour::LANE));
        let pixels = emphasis.of_pixels(&[&layout]);
        assert_eq!(pixels.iter().filter(|weight| **weight > 1.0).count(), 5);
        assert_eq!(pixels[..2], [9.0, 1.0]);
        assert_eq!(pixels[8..13], [5.0, 5.0, 5.0, 5.0, 1.0]);
        // 1 of 128 pixels of the left block weighs 8 more, 4 of the right one weigh 4 more.
        assert_eq!(emphasis.of_latents(&[&layout, &empty]), [1.0625, 1.125]);
    }
}
