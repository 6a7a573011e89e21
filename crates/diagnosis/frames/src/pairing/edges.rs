//! Displacement and age of streams of other texture: both are replaced by the strength of their edges, relative to the
//! surroundings, and go through the alignment of aligned streams.

use ds_effect::picture::Picture;
use ds_effect::{FrameEffect, find_frame};

use crate::align::{self, Ages, Field};
use crate::case::FrameCase;
use crate::geometry::{Chosen, Loose, fit};
use crate::pairing::looks::{ALL, MOVED};
use crate::scene::Scene;
use crate::transport::{self, Late};

/// Effects whose values are estimated together, in the order of the statistics.
const TOGETHER: [&str; 7] =
    ["mount_pitch", "mount_yaw", "mount_roll", "focal_error", "radial_distortion", "mount_position", "rolling_shutter"];

/// What edges tell.
pub struct Moved {
    /// Estimates in the order of the statistics from [`MOVED`] on, in units of a share of the slab.
    pub values: Vec<f64>,
    /// Age of the content.
    pub late: Late,
}

/// Returns effects and parameter of each displacement statistic.
#[must_use]
pub fn axes() -> Vec<(&'static FrameEffect, usize)> {
    let effects = TOGETHER.iter().filter_map(|id| find_frame(id));
    effects.flat_map(|e| (0..e.parameters.len()).map(move |k| (e, k))).take(ALL - 1 - MOVED).collect()
}

/// Returns the unit of a displacement statistic: a hundredth of its slab.
#[must_use]
pub fn unit(axis: (&'static FrameEffect, usize)) -> f64 {
    let slab = axis.0.parameters[axis.1].slab;
    0.01 * (slab.1 - slab.0)
}

/// Measures displacement and age on edges.
#[must_use]
pub fn measured(case: &FrameCase) -> Moved {
    let mut drawn = case.clone();
    drawn.held.clear();
    for frame in &mut drawn.fit {
        (frame.sim, frame.real) = (edges(&frame.sim), edges(&frame.real));
    }
    let scene = Scene::new(&drawn);
    let ages: Ages = align::ages(&scene);
    let late = transport::judge(&scene, &ages);
    let mut field: Field = align::field(&scene, &late.ages, ages.start);
    field.points.iter_mut().take(late.blind).for_each(Vec::clear);
    let free: Chosen = TOGETHER
        .iter()
        .filter_map(|id| find_frame(id))
        .filter(|e| scene.can_show(e))
        .map(|e| (e, e.neutral()))
        .collect();
    let loose = Loose { constant_px: 0.3, frame_px: 0.3 };
    let found = fit(&drawn, &scene.frames, &field.points, &free, loose);
    let values = axes()
        .into_iter()
        .map(|axis| {
            let own = found.effects.iter().find(|(e, _)| e.id == axis.0.id).map(|(_, v)| v[axis.1]);
            own.map_or(0.0, |v| v / unit(axis))
        })
        .collect();
    Moved { values, late }
}

/// Replaces a picture by the strength of its edges over that of their surroundings, 0 to 250.
fn edges(picture: &Picture) -> Picture {
    let grey = picture.grey().boxed(1);
    let (w, h) = (grey.width, grey.height);
    let mut strength = Picture::filled(w, h, 1, 0.0);
    for y in 1..h - 1 {
        for x in 1..w - 1 {
            let k = y * w + x;
            let (gx, gy) = (grey.data[k + 1] - grey.data[k - 1], grey.data[k + w] - grey.data[k - w]);
            strength.data[k] = gx.hypot(gy);
        }
    }
    let around = strength.boxed(12);
    let soft = strength.boxed(1);
    let data = soft.data.iter().zip(&around.data).map(|(s, a)| 250.0 * s / (s + 2.0 * a + 6.0)).collect();
    Picture { data, ..strength }
}
