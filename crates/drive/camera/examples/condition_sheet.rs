//! Writes one picture of a hand-made street in every condition, 15 a row, one row a lighting:
//! `cargo run -p ds-camera --example condition_sheet -- FILE.png`.

#[path = "../../layout/tests/scenes/street.rs"]
mod street;

use ds_camera::{Appearance, Condition, ReferenceCamera, SceneCamera};
use ds_raster::{Encoding, RgbImage};

const COLUMNS: usize = 15;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("say the file to write")?;
    let (scene, world, camera) = (street::scene(), street::world(), street::camera(160, 96));
    let conditions: Vec<Condition> = Condition::all().collect();
    let rows = conditions.len().div_ceil(COLUMNS);
    let mut sheet = RgbImage::filled(160 * COLUMNS as u32, 96 * rows as u32, [0; 3]);
    for (i, condition) in conditions.iter().enumerate() {
        let appearance = Appearance::condition(*condition, 1);
        let picture =
            ReferenceCamera::new(&scene, appearance).render(&world, &camera, street::ego().world_from_rig(0.0))?;
        let (left, top) = ((i % COLUMNS) * 160, (i / COLUMNS) * 96);
        for (line, row) in picture.rgb().chunks_exact(480).enumerate() {
            let at = ((top + line) * 160 * COLUMNS + left) * 3;
            sheet.rgb_mut()[at..at + 480].copy_from_slice(row);
        }
    }
    std::fs::write(path, sheet.encode(Encoding::Png)?)?;
    Ok(())
}
