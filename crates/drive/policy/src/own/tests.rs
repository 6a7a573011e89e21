//! Inputs and outputs of a wrapped network, without one.

use ds_onnx::manifest::{Colour, Layout, Resize};

use super::*;

fn plan(first_s: f64, axes: Axes, angle: Angle, origin_ahead_m: f64, beyond: Beyond) -> PlanSection {
    PlanSection { output: "plan".to_owned(), first_s, spacing_s: 0.5, axes, angle, origin_ahead_m, beyond }
}

fn near(one: &PoseSe2, x_m: f64, y_m: f64, heading_rad: f64) {
    let apart = one.position.distance(DVec2::new(x_m, y_m)) + (one.heading_rad - heading_rad).abs();
    assert!(apart < 1e-6, "{one:?} is not ({x_m}, {y_m}, {heading_rad})");
}

#[test]
fn axes_units_and_origin_are_undone() {
    let one = |axes, angle, ahead_m, numbers: &[f32]| {
        poses_of(&plan(0.5, axes, angle, ahead_m, Beyond::Hold), numbers, numbers.len())[0]
    };
    near(&one(Axes::ForwardLeft, Angle::Radians, 0.0, &[4.0, 1.0, 0.5]), 4.0, 1.0, 0.5);
    near(&one(Axes::ForwardRight, Angle::Radians, 0.0, &[4.0, -1.0, -0.5]), 4.0, 1.0, 0.5);
    near(&one(Axes::LeftForward, Angle::Radians, 0.0, &[1.0, 4.0, 0.5]), 4.0, 1.0, 0.5);
    near(&one(Axes::RightForward, Angle::Degrees, 0.0, &[-1.0, 4.0, -90.0]), 4.0, 1.0, 90f64.to_radians());
    // Turned by a quarter, the axle lies beside the centre's old place instead of behind its new one.
    near(
        &one(Axes::ForwardLeft, Angle::Radians, 1.4, &[0.0, 1.4, std::f32::consts::FRAC_PI_2]),
        1.4,
        0.0,
        std::f64::consts::FRAC_PI_2,
    );
    // Without headings a pose points along its step, and a car that stands keeps its own.
    near(&one(Axes::ForwardLeft, Angle::Radians, 0.0, &[3.0, 3.0]), 3.0, 3.0, std::f64::consts::FRAC_PI_4);
    near(&one(Axes::ForwardLeft, Angle::Radians, 0.0, &[0.0, 0.001]), 0.0, 0.001, 0.0);
}

#[test]
fn a_plan_that_ends_early_goes_on_as_the_manifest_says() {
    let straight = [PoseSe2::new(5.0, 0.0, 0.0), PoseSe2::new(10.0, 0.0, 0.0)];
    let until = |first_s, beyond, horizon_s| {
        let plan = plan(first_s, Axes::ForwardLeft, Angle::Radians, 0.0, beyond);
        points(&plan, &straight, SimTime::from_secs(horizon_s))
    };
    assert_eq!(until(0.5, Beyond::Hold, 8.0).len(), 2);
    let on = until(0.5, Beyond::Curvature, 2.2);
    assert_eq!(on.iter().map(|point| point.after.0 / 100_000_000).collect::<Vec<_>>(), [5, 10, 15, 20, 25]);
    near(&on[4].pose, 25.0, 0.0, 0.0);
    assert_eq!(until(0.5, Beyond::Curvature, 1.0).len(), 2, "what reaches far enough is left as it is");
    let later = until(0.0, Beyond::Hold, 8.0);
    assert_eq!((later.len(), later[0].after), (1, SimTime::from_secs(0.5)), "a pose at now says nothing");
}

#[test]
fn the_newest_frames_are_seen_and_the_middle_is_cut_out() {
    let camera = crate::camera::eye::known_camera();
    let frames: Vec<RgbImage> = (1..=3).map(|grey| RgbImage::filled(4, 2, [grey; 3])).collect();
    let image = |history, resize, raw: &str| ImageSection {
        input: "image".to_owned(),
        size_px: [1, 1],
        layout: Layout::Nchw,
        colour: Colour::Rgb,
        scale: 1.0,
        mean: [0.0; 3],
        std: [1.0; 3],
        history,
        camera: Camera::Raw(raw.to_owned()),
        resize,
    };
    let seen = |image: &ImageSection, frames: &[RgbImage]| {
        let shown = super::frames(image, &mut Eye::default(), &[(&camera, frames)])?;
        Ok::<_, PolicyError>(shown.iter().map(|frame| frame.pixel(0, 0)[0]).collect::<Vec<_>>())
    };
    assert_eq!(seen(&image(2, Resize::Area, "front"), &frames).expect("seen"), [2, 3]);
    assert_eq!(seen(&image(3, Resize::Area, "front"), &frames[..1]).expect("seen"), [1, 1, 1]);
    let sides = RgbImage::new(4, 1, [[0; 3], [90; 3], [90; 3], [0; 3]].concat()).expect("an image");
    let wide = std::slice::from_ref(&sides);
    assert_eq!(seen(&ImageSection { size_px: [2, 1], ..image(1, Resize::Crop, "front") }, wide).expect("seen"), [90]);
    assert_eq!(seen(&ImageSection { size_px: [1, 1], ..image(1, Resize::Area, "front") }, wide).expect("seen"), [45]);
    let error = seen(&image(1, Resize::Area, "rear"), &frames).expect_err("no such camera").to_string();
    assert!(error.contains("\"rear\"") && error.contains("front"), "{error}");
}
