//! Features show what was done to a picture.

use ds_effect::picture::Picture;
use ds_fidelity::features::{FEATURES, features};

#[test]
fn features_see_brightness_and_blur() {
    let data = (0..96 * 64).map(|k| if (k % 96 / 3 + k / 96 / 3) % 2 == 0 { 60.0 } else { 180.0 }).collect();
    let sharp = Picture { width: 96, height: 64, channels: 1, data };
    let blurred = sharp.boxed(1);
    let (a, b) = (features(&[sharp]), features(&[blurred]));
    assert_eq!(a.shape(), (24, FEATURES));
    assert!((a[(8, 0)] - b[(8, 0)]).abs() < 4.0, "a blur keeps brightness");
    assert!(a[(8, 2)] > b[(8, 2)] + 1.0, "a blur takes gradients");
}
