//! Where a loss counts more: the pixels whose layout shows vehicles, pedestrians or cyclists.
//!
//! Road users cover a few per cent of a frame, yet they are what a policy must see. Every other pixel counts 1, but
//! where a layout tells nothing but ground or sky and the frame is one of many that it allows: houses and trees stand in both.

use ds_layout::colour;
use ds_raster::RgbImage;

/// Returns the weight of every pixel of some layouts, [images, height, width]; bare ground and what stands before the sky weigh `untold`.
pub(crate) fn of_pixels(layouts: &[&RgbImage], road_users: f32, untold: f32) -> Vec<f32> {
    let weight = |rgb: &[u8]| match [rgb[0], rgb[1], rgb[2]] {
        colour::GROUND | colour::SKY => untold,
        rgb if colour::is_road_user(rgb) => road_users,
        _ => 1.0,
    };
    layouts.iter().flat_map(|layout| layout.rgb().chunks_exact(3).map(weight)).collect()
}

/// Returns the weight of every latent pixel [h, w] of one latent step: the mean over its 8×8 pixels of all frames.
pub(crate) fn of_latents(layouts: &[&RgbImage], road_users: f32) -> Vec<f32> {
    let (width, height) = (layouts[0].width_px() as usize, layouts[0].height_px() as usize);
    let (h, w) = (height / 8, width / 8);
    let mut sums = vec![0.0; h * w];
    for (at, weight) in of_pixels(layouts, road_users, 1.0).into_iter().enumerate() {
        let (y, x) = (at / width % height, at % width);
        if y < 8 * h && x < 8 * w {
            sums[y / 8 * w + x / 8] += weight;
        }
    }
    sums.iter_mut().for_each(|sum| *sum /= (64 * layouts.len()) as f32);
    sums
}

#[cfg(test)]
mod tests {
    use ds_world::AgentClass;

    use super::*;

    #[test]
    fn road_users_weigh_more_where_they_are() {
        let vehicle = colour::face(colour::agent(AgentClass::Vehicle), colour::Face::Rear);
        let mut rgb = colour::LANE.repeat(16 * 8);
        for x in 8..12 {
            rgb[3 * x..3 * x + 3].copy_from_slice(&vehicle);
        }
        let (layout, empty) =
            (RgbImage::new(16, 8, rgb).expect("the size fits"), RgbImage::filled(16, 8, colour::LANE));
        let pixels = of_pixels(&[&layout], 5.0, 1.0);
        assert_eq!(pixels.iter().filter(|weight| **weight > 1.0).count(), 4);
        assert_eq!(pixels[8..13], [5.0, 5.0, 5.0, 5.0, 1.0]);
        // 4 of 128 pixels of the right block weigh 4 more.
        assert_eq!(of_latents(&[&layout, &empty], 5.0), [1.0, 1.125]);
    }
}
