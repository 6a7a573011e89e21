//! What the video model starts a drive from: a prompt and the first frame of each camera.
//!
//! What a run does not give is made: the prompt by the template that clips for training have theirs from, on the
//! scenario's log; a first frame by the reference camera. A given picture, such as the log's own, has the camera's size or
//! is larger: its widest or highest middle part of the camera's aspect ratio is reduced to that size.

use std::collections::BTreeMap;

use ds_camera::{Appearance, ReferenceCamera, SceneCamera};
use ds_raster::{ImageError, RgbImage};
use ds_scenario::Facts;
use ds_space::{CameraModel, DigestWriter, Tick};
use ds_topic::ObservationSource;
use ds_wire::control as pb;
use ds_world::Scene;

/// The longest prompt, in bytes.
const MAX_PROMPT_BYTES: usize = 4_096;
/// The camera that a picture without a name is for, where there are several.
const FRONT: &str = "front";

/// A prompt or a first frame is refused.
#[derive(Debug, thiserror::Error)]
pub enum ConditioningError {
    /// No episode has a use for them.
    #[error("prompt and first frames are for the observation source \"dreamstream\", which the run does not name")]
    Unused,
    /// The prompt says nothing or too much.
    #[error(
        "prompt has {bytes} bytes and {words} words: at least 1 word and at most {MAX_PROMPT_BYTES} bytes are expected"
    )]
    Prompt {
        /// Its length.
        bytes: usize,
        /// Its words.
        words: usize,
    },
    /// The bytes are no picture.
    #[error("first frame of {} is no PNG or JPEG picture", named(.camera))]
    Picture {
        /// The camera; empty for the one in front.
        camera: String,
        /// Why.
        #[source]
        source: ImageError,
    },
    /// The first frame of a camera cannot be rendered.
    #[error("first frame of camera {camera:?} cannot be rendered")]
    Render {
        /// The camera.
        camera: String,
        /// Why.
        #[source]
        source: ImageError,
    },
    /// A camera has two pictures.
    #[error("first frame of {} is given twice, once is expected", named(.camera))]
    Twice {
        /// The camera; empty for the one in front.
        camera: String,
    },
    /// The scenario has no such camera.
    #[error("first frame of {}: one of {cameras:?} is expected, the cameras of scenario {scenario:?}", named(.camera))]
    Camera {
        /// The camera; empty for the one in front.
        camera: String,
        /// The cameras that there are.
        cameras: Vec<String>,
        /// The scenario.
        scenario: String,
    },
    /// The picture cannot become one of the camera.
    #[error(
        "first frame of camera {camera:?} has {}×{} px: at least {}×{} px are expected by {scenario:?}",
        .found.0, .found.1, .expected.0, .expected.1
    )]
    Size {
        /// The camera.
        camera: String,
        /// Width and height of the picture.
        found: (u32, u32),
        /// Width and height of the camera.
        expected: (u32, u32),
        /// The scenario.
        scenario: String,
    },
}

fn named(camera: &str) -> String {
    if camera.is_empty() { "the camera in front".to_owned() } else { format!("camera {camera:?}") }
}

/// What a run gives the video model to start from.
#[derive(Debug, Default)]
pub struct Conditioning {
    prompt: Option<String>,
    /// By the name of the camera, empty for the one in front.
    frames: BTreeMap<String, RgbImage>,
}

impl Conditioning {
    /// Reads prompt and pictures of a run over `sources`.
    ///
    /// # Errors
    /// [`ConditioningError`] for a prompt without words or too long, for bytes that are no picture, for a camera named
    /// twice, and for either where no source has a use for it.
    pub fn of(settings: &pb::RunSettings, sources: &[ObservationSource]) -> Result<Self, ConditioningError> {
        let given = settings.prompt.is_some() || !settings.first_frames.is_empty();
        if given && !sources.iter().any(|source| source.is_generated()) {
            return Err(ConditioningError::Unused);
        }
        if let Some(prompt) = &settings.prompt {
            let (bytes, words) = (prompt.len(), prompt.split_whitespace().count());
            if words == 0 || bytes > MAX_PROMPT_BYTES {
                return Err(ConditioningError::Prompt { bytes, words });
            }
        }
        let mut frames = BTreeMap::new();
        for frame in &settings.first_frames {
            let camera = frame.camera.clone();
            let picture = RgbImage::photo(&frame.image);
            let picture = picture.map_err(|source| ConditioningError::Picture { camera: camera.clone(), source })?;
            if frames.insert(camera.clone(), picture).is_some() {
                return Err(ConditioningError::Twice { camera });
            }
        }
        Ok(Self { prompt: settings.prompt.clone(), frames })
    }

    /// Returns the given pictures at the sizes of a scenario's cameras, in camera order.
    ///
    /// # Errors
    /// [`ConditioningError`] for a camera that the scenario lacks or that is named twice, and for a size that does not
    /// fit.
    pub fn pictures(&self, scene: &Scene) -> Result<Vec<Option<RgbImage>>, ConditioningError> {
        let mut pictures = vec![None; scene.cameras.len()];
        for (name, picture) in &self.frames {
            let index = place(scene, name)?;
            let camera = &scene.cameras[index];
            if pictures[index].replace(fitted(scene, camera, picture)?).is_some() {
                return Err(ConditioningError::Twice { camera: camera.id.to_string() });
            }
        }
        Ok(pictures)
    }

    /// Returns the prompt of a drive up to the tick `last`.
    pub(crate) fn prompt(&self, scene: &Scene, last: Tick, appearance: &Appearance) -> String {
        self.prompt.clone().unwrap_or_else(|| {
            let (first, last) = (scene.logged_world(Tick(0)), scene.logged_world(last));
            ds_scenario::prompt(&Facts::of(scene, &first, &last, appearance.prompt()))
        })
    }

    /// Adds the pictures to a digest.
    pub(crate) fn digest_into(&self, writer: &mut DigestWriter) {
        for (camera, picture) in &self.frames {
            writer.text(camera);
            picture.digest_into(writer);
        }
    }
}

/// Returns o_0 of each camera: the picture that is given, else what the reference camera sees.
///
/// # Errors
/// If a frame cannot be rendered.
pub(crate) fn first_frames(
    scene: &Scene,
    given: Vec<Option<RgbImage>>,
    appearance: Appearance,
) -> Result<Vec<RgbImage>, ConditioningError> {
    let renderer = ReferenceCamera::new(scene, appearance);
    let world = scene.logged_world(Tick(0));
    let frame = |(given, camera): (Option<RgbImage>, &CameraModel)| match given {
        Some(given) => Ok(given),
        None => renderer
            .on_ego(&world, camera)
            .map_err(|source| ConditioningError::Render { camera: camera.id.to_string(), source }),
    };
    given.into_iter().zip(&scene.cameras).map(frame).collect()
}

fn place(scene: &Scene, name: &str) -> Result<usize, ConditioningError> {
    let wanted = if name.is_empty() { FRONT } else { name };
    let only = name.is_empty() && scene.cameras.len() == 1;
    scene.cameras.iter().position(|camera| only || camera.id.as_str() == wanted).ok_or_else(|| {
        ConditioningError::Camera {
            camera: name.to_owned(),
            cameras: scene.cameras.iter().map(|camera| camera.id.to_string()).collect(),
            scenario: scene.name.clone(),
        }
    })
}

fn fitted(scene: &Scene, camera: &CameraModel, picture: &RgbImage) -> Result<RgbImage, ConditioningError> {
    let (found, lens) = ((picture.width_px(), picture.height_px()), &camera.intrinsics);
    let expected = (lens.width_px, lens.height_px);
    if found.0 < expected.0 || found.1 < expected.1 {
        let (camera, scenario) = (camera.id.to_string(), scene.name.clone());
        return Err(ConditioningError::Size { camera, found, expected, scenario });
    }
    let part = middle(picture, expected.0, expected.1);
    Ok(if found == expected { part } else { part.reduced(expected.0, expected.1) })
}

/// Returns the largest middle part of a picture that has the aspect ratio of a size no larger than it.
fn middle(picture: &RgbImage, width_px: u32, height_px: u32) -> RgbImage {
    let found = (picture.width_px(), picture.height_px());
    let scaled = |length: u32, by: u32, over: u32| {
        let scaled = u64::from(length) * u64::from(by) / u64::from(over);
        u32::try_from(scaled).unwrap_or(u32::MAX)
    };
    let width = found.0.min(scaled(found.1, width_px, height_px));
    let height = found.1.min(scaled(found.0, height_px, width_px));
    let (left, top) = ((found.0 - width) / 2, (found.1 - height) / 2);
    picture.part([left, top], [width, height])
}

#[cfg(test)]
mod tests {
    use ds_raster::Encoding;
    use ds_scenario::Family;
    use ds_space::{CameraId, DVec3, Intrinsics};

    use super::*;

    fn rig(names: &[&str]) -> Scene {
        let camera = |name: &&str| {
            let id = CameraId::new(name).expect("a plain word");
            CameraModel::mounted(id, Intrinsics::centred(8, 4, 1.2), DVec3::Z, 0.0, 0.0)
        };
        Scene { cameras: names.iter().map(camera).collect(), ..ds_scenario::generate(Family::FreeCurve, 0) }
    }

    fn settings(prompt: Option<&str>, frames: &[(&str, (u32, u32))]) -> pb::RunSettings {
        let frame = |(camera, (width, height)): &(&str, (u32, u32))| pb::FirstFrame {
            camera: (*camera).to_owned(),
            image: RgbImage::filled(*width, *height, [9, 8, 7]).encode(Encoding::Png).expect("encodes").into(),
        };
        pb::RunSettings {
            prompt: prompt.map(str::to_owned),
            first_frames: frames.iter().map(frame).collect(),
            ..pb::RunSettings::default()
        }
    }

    #[test]
    fn pictures_find_their_cameras_at_their_size() {
        let check = |rig_of: &[&str], given: &[(&str, (u32, u32))], expected: &[bool]| {
            let given = Conditioning::of(&settings(None, given), &ObservationSource::ALL).expect("sound");
            let pictures = given.pictures(&rig(rig_of)).expect("they fit");
            assert_eq!(pictures.iter().map(Option::is_some).collect::<Vec<_>>(), expected);
            assert!(pictures.iter().flatten().all(|picture| *picture == RgbImage::filled(8, 4, [9, 8, 7])));
        };
        check(&["roof"], &[("", (8, 4))], &[true]);
        check(&["left", "front"], &[("", (80, 40))], &[false, true]);
        check(&["left", "front"], &[("left", (17, 9)), ("front", (16, 1200))], &[true, true]);
        check(&["left", "front"], &[("left", (12, 6)), ("front", (8, 4))], &[true, true]);
        check(&["left", "front"], &[], &[false, false]);
    }

    #[test]
    fn a_photograph_of_another_shape_loses_its_borders() {
        let mut wide = RgbImage::filled(24, 8, [200, 0, 0]);
        for (y, x) in (0..8).flat_map(|y| (4..20).map(move |x| (y, x))) {
            wide.set_pixel(x, y, [0, 90, 0]);
        }
        assert_eq!(middle(&wide, 8, 4), RgbImage::filled(16, 8, [0, 90, 0]));
        assert_eq!(middle(&wide, 24, 8), wide);
        let mut high = RgbImage::filled(4, 9, [200, 0, 0]);
        for x in 0..4 {
            high.set_pixel(x, 4, [0, 90, 0]);
        }
        assert_eq!(middle(&high, 4, 1), RgbImage::filled(4, 1, [0, 90, 0]));
    }

    #[test]
    fn what_cannot_be_used_is_named() {
        let refused = |cameras: &[&str], settings: &pb::RunSettings, says: &str| {
            let given = Conditioning::of(settings, &ObservationSource::ALL);
            let error = given.and_then(|given| given.pictures(&rig(cameras))).expect_err(says);
            assert!(error.to_string().contains(says), "{error} does not say {says:?}");
        };
        let front: &[&str] = &["front"];
        refused(front, &settings(Some(" \n"), &[]), "0 words: at least 1 word");
        refused(front, &settings(Some(&"a ".repeat(2_049)), &[]), "4098 bytes");
        refused(front, &settings(None, &[("", (9, 3))]), "9×3 px: at least 8×4 px");
        refused(front, &settings(None, &[("", (4, 2))]), "4×2 px: at least 8×4 px");
        refused(front, &settings(None, &[("rear", (8, 4))]), "camera \"rear\": one of [\"front\"] is expected");
        refused(
            &["left", "right"],
            &settings(None, &[("", (8, 4))]),
            "the camera in front: one of [\"left\", \"right\"]",
        );
        refused(front, &settings(None, &[("", (8, 4)), ("front", (8, 4))]), "given twice");
        refused(front, &settings(None, &[("front", (8, 4)), ("front", (8, 4))]), "given twice");
        let mut text = settings(None, &[("", (8, 4))]);
        text.first_frames[0].image = b"a road".as_slice().into();
        refused(front, &text, "no PNG or JPEG");
        let error = Conditioning::of(&settings(Some("rain"), &[]), &[ObservationSource::Layout]).expect_err("unused");
        assert!(error.to_string().contains("dreamstream"), "{error}");
    }
}
