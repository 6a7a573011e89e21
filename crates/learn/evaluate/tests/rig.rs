//! A rig of three cameras: what two of them generate of the same place agrees, on the shipped weights.
//!
//! The cameras stand in one point and are turned by 35°, so that views overlap by half and which pixel shows what of the
//! other view follows from the rays alone. Each starts from its own first frame; nothing but the layout ties them afterwards.

use std::path::Path;
use std::sync::Arc;

use ds_camera::{Appearance, ReferenceWorld};
use ds_evaluate::EvalConfig;
use ds_evaluate::arm::Arm;
use ds_evaluate::drive::{Drive, Route};
use ds_raster::RgbImage;
use ds_scenario::Family;
use ds_space::{CameraModel, DVec2};
use ds_world::Scene;

/// How far the cameras are turned to the left of the rig's front, in degrees.
const TURNED_DEG: [f64; 3] = [35.0, 0.0, -35.0];
/// Frames after the first, two seconds.
const FRAMES: u32 = 20;
/// Half the width of the square that colours are averaged over, in pixels.
const NEAR_PX: i64 = 2;

/// Loads the shipped student, whose layouts show structures or are bare.
fn student(name: &str) -> Arm {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/eval");
    let config = EvalConfig::load(&folder.join("structures.toml")).expect("the configuration is right");
    Arm::load(&config, name).expect("the shipped weights load")
}

fn drive(scene: &Arc<Scene>, turned_deg: f64) -> Drive {
    let route = Route { scene: Arc::clone(scene), start: 0, pace: 1.0, look: Appearance::DAY, turned_deg };
    Drive::new(&ReferenceWorld, &route, (160, 96)).expect("a drive")
}

/// Returns the mean colour around a pixel.
fn around(image: &RgbImage, at: DVec2) -> [f64; 3] {
    let mut sum = [0.0; 4];
    #[expect(clippy::cast_possible_truncation, reason = "within the picture")]
    let (x, y) = (at.x as i64, at.y as i64);
    for row in (y - NEAR_PX).max(0)..=(y + NEAR_PX).min(i64::from(image.height_px()) - 1) {
        for column in (x - NEAR_PX).max(0)..=(x + NEAR_PX).min(i64::from(image.width_px()) - 1) {
            let rgb = image.pixel(column as u32, row as u32).map(f64::from);
            sum = [sum[0] + rgb[0], sum[1] + rgb[1], sum[2] + rgb[2], sum[3] + 1.0];
        }
    }
    [0, 1, 2].map(|channel| sum[channel] / sum[3])
}

/// Returns the mean difference of colours (0 to 255) of what two cameras in one point both see.
fn apart(from: (&CameraModel, &RgbImage), to: (&CameraModel, &RgbImage)) -> f64 {
    let (lens, size) = (&from.0.intrinsics, DVec2::new(f64::from(to.1.width_px()), f64::from(to.1.height_px())));
    let other_from_here = to.0.rig_from_camera.rotation.inverse() * from.0.rig_from_camera.rotation;
    let (mut sum, mut count) = (0.0, 0.0);
    for y in 0..from.1.height_px() {
        for x in 0..from.1.width_px() {
            let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let ray = DVec2::new((at.x - lens.cx_px) / lens.fx_px, (at.y - lens.cy_px) / lens.fy_px).extend(1.0);
            let seen = to.0.intrinsics.project(other_from_here * ray);
            if let Some(seen) = seen.filter(|seen| seen.cmpge(DVec2::ZERO).all() && seen.cmplt(size).all()) {
                let (here, there) = (around(from.1, at), around(to.1, seen));
                sum += here.iter().zip(there).map(|(a, b)| (a - b).abs()).sum::<f64>() / 3.0;
                count += 1.0;
            }
        }
    }
    assert!(count > 3_000.0, "{count} pixels are seen by both");
    sum / count
}

/// Mean differences of overlapping views: of the reference camera, of what an arm generates, and of views of other drives.
fn differences(arm: &Arm) -> [f64; 3] {
    let (mut own, mut agree, mut strangers) = (0.0, 0.0, 0.0);
    let scenes = [Family::FreeCurve, Family::CutIn, Family::UnprotectedLeft];
    let scenes = scenes.map(|family| Arc::new(ds_scenario::generate(family, 20_000_013)));
    let rolled = scenes.each_ref().map(|scene| {
        TURNED_DEG.map(|turned_deg| {
            let mut drive = drive(scene, turned_deg);
            let made = arm.roll(&mut drive, FRAMES).expect("rolls out").pop().expect("frames");
            (drive.model.clone(), made, drive.frame(FRAMES).expect("renders"))
        })
    });
    for (i, rig) in rolled.iter().enumerate() {
        let other = &rolled[(i + 1) % rolled.len()];
        for side in [0, 2] {
            let (front, beside) = (&rig[1], &rig[side]);
            own += apart((&front.0, &front.2), (&beside.0, &beside.2)) / 6.0;
            agree += apart((&front.0, &front.1), (&beside.0, &beside.1)) / 6.0;
            strangers += apart((&front.0, &front.1), (&other[side].0, &other[side].1)) / 6.0;
        }
    }
    [own, agree, strangers]
}

#[test]
fn cameras_of_a_rig_agree_where_their_views_overlap() {
    let [own, agree, strangers] = differences(&student("student"));
    let [_, untold, _] = differences(&student("untold"));
    eprintln!(
        "of 255 apart: {agree:.1}; without structures {untold:.1}, reference {own:.1}, other drives {strangers:.1}"
    );
    assert!(own < 4.0, "the reference camera's own views are apart by {own}");
    assert!(
        agree < 12.0 && agree < 0.6 * strangers,
        "views are apart by {agree}, those of other drives by {strangers}"
    );
    assert!(agree < untold, "views are apart by {agree} with structures in the layout and by {untold} without");
}
