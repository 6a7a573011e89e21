//! Watching a rollout: an arm makes the frames of a drive, the networks look at the chosen ones.

use ds_perception::Label;
use ds_perception::overlap::Overlaps;
use ds_raster::RgbImage;
use ds_space::{Digest, DigestWriter};

use crate::arm::Arm;
use crate::drive::{Drive, Route};
use crate::error::EvaluationError;
use crate::eyes::Eyes;
use crate::record::{Glance, Record, Seam};
use ds_train::colour::{Colour, Steps, difference, psnr_db};

/// Which frames are looked at, and whether they are compared with the truth of the world's own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameSelection {
    /// Frames to look at, rising.
    pub looked: Vec<u32>,
    /// Whether labels, lights, PSNR and perceptual distance are wanted, or looks and colours alone.
    pub truth: bool,
}

impl FrameSelection {
    /// Returns the last frame that is needed.
    #[must_use]
    pub fn last(&self) -> u32 {
        self.looked.last().copied().unwrap_or(0)
    }
}

/// Frames that are looked at, and their width and height.
#[derive(Debug, Clone, Copy)]
pub struct Viewing<'a> {
    /// Which frames.
    pub plan: &'a FrameSelection,
    /// Their size.
    pub size_px: (u32, u32),
}

impl Viewing<'_> {
    /// Returns the digest of all that a record depends on.
    #[must_use]
    pub fn key(&self, arm: Option<&Arm>, world: &str, route: &Route, eyes: &Eyes) -> Digest {
        let Self { plan, size_px } = *self;
        let mut writer = DigestWriter::new();
        writer.text("appraisal record 3").text(world).digest(&eyes.digest()).digest(&route.scene.digest);
        writer.u32(route.start).f64s(&[route.pace, route.turned_deg]).text(&format!("{:?}", route.look));
        writer.u32(size_px.0).u32(size_px.1).text(&format!("{plan:?}"));
        match arm {
            Some(arm) => writer.text("arm").digest(&arm.digest()),
            None => writer.text("the world's own frames"),
        };
        writer.finish()
    }
}

/// Makes and looks at the frames of a drive; without an arm, at the world's own.
///
/// # Errors
/// If a layout cannot be rendered or the model gives values that are not finite.
pub fn watch(
    arm: Option<&Arm>,
    drive: &mut Drive,
    plan: &FrameSelection,
    eyes: &Eyes,
) -> Result<Record, EvaluationError> {
    let made = arm.map(|arm| arm.roll(drive, plan.last())).transpose()?;
    let mut glances = Vec::new();
    for frame in &plan.looked {
        let own = (made.is_none() || plan.truth).then(|| drive.frame(*frame)).transpose()?;
        let seen = made.as_ref().map(|made| &made[*frame as usize]).or(own.as_ref());
        let Some(seen) = seen else { continue };
        let compared = made.is_some().then_some(own.as_ref()).flatten();
        let mut glance = glance(*frame, seen, compared, eyes);
        if plan.truth {
            judge(&mut glance, drive, seen, compared, eyes)?;
        }
        glances.push(glance);
    }
    let per_chunk = arm.map_or(1, Arm::frames_per_chunk);
    let seam = made.as_ref().map_or_else(Seam::default, |made| seam(made, per_chunk));
    Ok(Record { drive: drive.name.clone(), glances, seam })
}

/// Looks at a frame, and at the world's own where they are compared.
fn glance(frame: u32, seen: &RgbImage, own: Option<&RgbImage>, eyes: &Eyes) -> Glance {
    let look = eyes.look.read(seen);
    Glance {
        frame,
        pixels: None,
        lights: Vec::new(),
        features: look.features,
        axes: look.axes,
        colour: Colour::of(seen),
        steps: Steps::of(seen),
        psnr_db: own.map(|own| psnr_db(own, seen)),
        distance: own.map(|own| eyes.look.distance(own, seen)),
        off_road: None,
    }
}

/// Adds how the pixels and lights of a frame agree with the truth.
fn judge(
    glance: &mut Glance,
    drive: &mut Drive,
    seen: &RgbImage,
    own: Option<&RgbImage>,
    eyes: &Eyes,
) -> Result<(), EvaluationError> {
    let truth = drive.labels(glance.frame)?;
    let beside: Vec<bool> = truth.iter().map(|label| *label == Label::Other).collect();
    glance.off_road = own.and_then(|own| eyes.look.distance_where(own, seen, &beside));
    let mut overlaps = Overlaps::default();
    overlaps.add(&truth, &eyes.segmenter.labels(seen));
    glance.pixels = Some(overlaps.0.map(|overlap| [overlap.both, overlap.either]));
    let lights = drive.lights(glance.frame, &truth);
    let values: Vec<f32> = seen.values().collect();
    let crop = |light| ds_perception::lights::crop(&values, seen.width_px() as usize, light);
    let read = eyes.lights.read(&lights.iter().map(crop).collect::<Vec<_>>());
    glance.lights = lights.iter().zip(read).map(|(light, read)| (light.distance_m, read == light.state)).collect();
    Ok(())
}

/// Sums differences between successive frames, apart for the borders of chunks; the given first frame is left out.
fn seam(frames: &[RgbImage], per_chunk: u32) -> Seam {
    let mut seam = Seam::default();
    for (index, pair) in (0u32..).zip(frames.windows(2)).skip(1) {
        let apart = difference(&pair[0], &pair[1]);
        if index.is_multiple_of(per_chunk) {
            seam.across += apart;
            seam.borders += 1;
        } else {
            seam.inside += apart;
            seam.steps += 1;
        }
    }
    seam
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seams_are_told_from_motion() {
        // Frames 1 to 4 are a chunk and 5 to 8 the next: grey rises by one a frame, and by six at the border.
        let frames: Vec<RgbImage> =
            [90u8, 10, 11, 12, 13, 19, 20, 21, 22].map(|grey| RgbImage::filled(4, 4, [grey; 3])).to_vec();
        let seam = seam(&frames, 4);
        assert_eq!((seam.borders, seam.steps), (1, 6));
        assert!((seam.ratio().expect("both are there") - 6.0).abs() < 1e-9, "{seam:?}");
        assert_eq!(Seam::default().ratio(), None);
    }
}
