//! Writes pictures of a hand-made street by every camera of this crate: `cargo run -p ds-camera --example street_pictures -- DIR`.

#[path = "../../layout/tests/scenes/street.rs"]
mod street;

use std::path::PathBuf;

use ds_camera::{Appearance, PlainCamera, ReferenceCamera, SceneCamera};
use ds_raster::{Encoding, RgbImage};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("say the folder to write into")?);
    std::fs::create_dir_all(&folder)?;
    let save = |name: String, image: RgbImage| {
        std::fs::write(folder.join(name), image.encode(Encoding::Png)?).map_err(Box::<dyn std::error::Error>::from)
    };
    let (scene, world) = (street::scene(), street::world());
    let rig = street::ego().world_from_rig(0.0);
    let low = Appearance { sun_elevation_rad: 0.35, sun_azimuth_rad: 2.4, palette_seed: 3, ..Appearance::DAY };
    let wet = Appearance { wetness: 0.9, cloud: 0.95, haze: 0.3, palette_seed: 5, ..Appearance::DAY };
    let night = Appearance { night: 1.0, palette_seed: 7, ..Appearance::DAY };
    for (name, appearance) in [("day", Appearance::DAY), ("low", low), ("wet", wet), ("night", night)] {
        let camera = ReferenceCamera::new(&scene, appearance);
        for (width, height) in [(160, 96), (640, 384)] {
            save(format!("{name}_{width}.png"), camera.render(&world, &street::camera(width, height), rig)?)?;
        }
    }
    save("plain_640.png".to_owned(), PlainCamera::new(&scene).render(&world, &street::camera(640, 384), rig)?)?;
    Ok(())
}
