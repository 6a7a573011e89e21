//! Frames of the reference camera carried along with the geometry of their layouts.

use std::sync::Arc;

use ds_camera::{Appearance, ReferenceWorld};
use ds_evaluate::drive::{Drive, Route};
use ds_raster::{Air, RgbImage};
use ds_scenario::Family;

/// Frames from the one that is carried to the one that it is compared with.
const AHEAD: u32 = 2;

/// Returns the mean difference of colours, 0 to 255, over some pixels.
fn difference(a: &RgbImage, b: &RgbImage, of: &[bool]) -> f64 {
    let pixels = a.rgb().chunks_exact(3).zip(b.rgb().chunks_exact(3)).zip(of).filter(|(_, wanted)| **wanted);
    let (sum, count) = pixels.fold((0.0, 0.0), |(sum, count), ((a, b), _)| {
        let off: u32 = a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(*b))).sum();
        (sum + f64::from(off) / 3.0, count + 1.0)
    });
    sum / f64::max(count, 1.0)
}

/// Road, buildings and vehicles that move are where the later frame has them; what was hidden or out of sight is not known, nor are sky, lines
/// and people, nor what has come much nearer.
#[test]
fn a_carried_frame_is_nearly_the_later_one() {
    for (family, seed) in [(Family::LeadBraking, 3), (Family::CutIn, 5), (Family::Roundabout, 2)] {
        let scene = Arc::new(ds_scenario::generate(family, seed));
        let route = Route { scene, start: 20, pace: 1.0, look: Appearance::DAY, turned_deg: 0.0 };
        let mut drive = Drive::new(&ReferenceWorld, &route, (160, 96)).expect("has a camera");
        let (before, now) = (drive.layout(0).expect("renders"), drive.layout(AHEAD).expect("renders"));
        let [then, later] = [0, AHEAD].map(|frame| drive.frame(frame).expect("renders"));
        let (before, now) = (before.geometry.expect("is known"), now.geometry.expect("is known"));
        let carried = now.carry(&before, &then, Air::Clear);
        let seen: Vec<bool> = carried.kept.iter().map(|kept| *kept > 0.0).collect();
        let known = seen.iter().filter(|seen| **seen).count() as f64 / seen.len() as f64;
        let (left, still) = (difference(&carried.frame, &later, &seen), difference(&then, &later, &seen));
        assert!(known > 0.15, "{family:?}: {known} known");
        assert!(left < 0.6 * still, "{family:?}: {left} and {still} off");
    }
}
