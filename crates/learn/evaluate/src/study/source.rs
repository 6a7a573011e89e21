//! Declared sources: an observation source, and what is done to its world and to its pictures before anybody looks.
//!
//! A plain name is the source of that name. Edits of the world change what is drawn (and the layout that a video model is
//! given), never what plans are scored against; alterations of pictures come last. All are pure functions of scenario,
//! frame and declaration.

use ds_raster::RgbImage;
use ds_space::{DQuat, DVec2, DVec3, DigestWriter, Draws, Pose};
use ds_topic::ObservationSource;
use ds_world::{AgentClass, Scene, WorldState};
use serde::Deserialize;

/// Vehicles within this distance are moved, in metres.
const NEAR_M: f64 = 40.0;

/// A source with alterations; those left out change nothing.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Altered {
    /// Its name in tables.
    pub(crate) name: String,
    /// The observation source that it is made of.
    pub(crate) from: String,
    /// Metres by which vehicles within 40 m stand aside, to the left or right of their own heading as is drawn for each.
    pub(crate) aside_m: f64,
    /// The share of agents that are gone, drawn for each.
    pub(crate) gone: f64,
    /// Whether painted lines are gone.
    pub(crate) no_lines: bool,
    /// How much older the frames are, in ticks.
    pub(crate) old_ticks: u32,
    /// Degrees by which the camera looks further down than it is thought to.
    pub(crate) pitch_deg: f64,
    /// Another look of the reference camera; the configuration's without it.
    pub(crate) look: Option<String>,
    /// Which other draw of the reference camera's textures covers ground and walls; 0 for the scenario's own.
    pub(crate) texture: u64,
    /// Which other draw of the reference camera's paints vehicles, people and houses wear; 0 for the look's own.
    pub(crate) paint: u64,
    /// Deviation of a Gaussian blur, in pixels.
    pub(crate) blur_px: f64,
    /// Deviation of noise of each pixel and colour, in levels.
    pub(crate) noise: f64,
    /// Quality of a quantisation in the manner of JPEG, 1 to 100: 8×8 cosine blocks, no chroma subsampling; 0 for none.
    pub(crate) jpeg: u8,
    /// Whether colour is gone.
    pub(crate) grey: bool,
    /// Exponent of the levels, 0 to 1; 0 for none.
    pub(crate) gamma: f64,
}

impl Altered {
    /// Says whether the reference camera itself draws otherwise.
    fn of_camera(&self) -> bool {
        self.look.is_some() || self.texture > 0 || self.paint > 0
    }
}

/// A checked source: in configurations the name of an observation source, or a table.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "toml::Value")]
pub struct Source {
    /// What makes its frames.
    pub(crate) from: ObservationSource,
    pub(crate) altered: Altered,
}

impl TryFrom<toml::Value> for Source {
    type Error = String;

    fn try_from(value: toml::Value) -> Result<Self, String> {
        match value {
            toml::Value::String(name) => Self::of(Altered { from: name.clone(), name, ..Altered::default() }),
            value => Self::of(Altered::deserialize(value).map_err(|error| error.to_string())?),
        }
    }
}

impl Source {
    /// The real set itself.
    pub(crate) fn reference() -> Self {
        Self::plain(ObservationSource::Reference)
    }

    /// An observation source as it is.
    pub(crate) fn plain(from: ObservationSource) -> Self {
        let name = from.name().to_owned();
        Self { from, altered: Altered { from: name.clone(), name, ..Altered::default() } }
    }

    /// Checks a declaration.
    pub(crate) fn of(altered: Altered) -> Result<Self, String> {
        let from = ObservationSource::from_name(&altered.from).ok_or_else(|| {
            let known = ObservationSource::ALL.map(ObservationSource::name).join(", ");
            format!("{:?} is made from {:?}; there are {known}", altered.name, altered.from)
        })?;
        let name = &altered.name;
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        if name.is_empty() || name.len() > 60 || !name.chars().all(plain) {
            return Err(format!("{name:?} is no name of letters, digits, '-', '_' and '.'"));
        }
        let bounds = [
            ("aside_m", altered.aside_m, 20.0),
            ("gone", altered.gone, 1.0),
            ("old_ticks", f64::from(altered.old_ticks), 100.0),
            ("pitch_deg", altered.pitch_deg.abs(), 20.0),
            ("blur_px", altered.blur_px, 50.0),
            ("noise", altered.noise, 128.0),
            ("jpeg", f64::from(altered.jpeg), 100.0),
            ("gamma", altered.gamma, 5.0),
        ];
        match bounds.into_iter().find(|(_, value, most)| !(0.0..=*most).contains(value)) {
            Some((field, value, most)) => Err(format!("{name:?} has {field} {value}, it must be 0 to {most}")),
            None if altered.of_camera() && from != ObservationSource::Reference => {
                Err(format!("{name:?} has a look, a texture or a paint, which only the reference camera takes"))
            }
            None => Ok(Self { from, altered }),
        }
    }

    /// Returns the name in tables.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.altered.name
    }

    /// Says whether this is the real set.
    pub(crate) fn is_real(&self) -> bool {
        let Self { altered: Altered { name, from, .. }, .. } = self;
        let plain = Altered { name: name.clone(), from: from.clone(), ..Altered::default() };
        self.from == ObservationSource::Reference && self.altered == plain
    }

    /// Writes all that the frames depend on besides scenario, size and model; the name is none of it.
    pub(crate) fn digest_into(&self, writer: &mut DigestWriter) {
        let nameless = Altered { name: String::new(), ..self.altered.clone() };
        writer.text(&format!("{nameless:?}"));
    }

    /// Returns the scene that is drawn.
    pub(crate) fn scene(&self, scene: &Scene) -> Scene {
        let mut drawn = scene.clone();
        if self.altered.no_lines {
            drawn.map.line_markings.clear();
        }
        if self.altered.texture > 0 {
            drawn.digest = Draws::key(&scene.digest, "another texture", self.altered.texture);
        }
        drawn
    }

    /// Returns the world that is drawn.
    pub(crate) fn world(&self, scene: &Scene, mut world: WorldState) -> WorldState {
        let draws = Draws::new(&scene.digest, "edited world", &[]);
        let ego = world.ego.pose.position;
        world.agents.retain(|agent| draws.uniform(2 * u64::from(agent.id.0)) >= self.altered.gone);
        for agent in &mut world.agents {
            let near = agent.pose.position.distance(ego) <= NEAR_M && agent.class == AgentClass::Vehicle;
            if self.altered.aside_m > 0.0 && near {
                let side = if draws.uniform(2 * u64::from(agent.id.0) + 1) < 0.5 { -1.0 } else { 1.0 };
                agent.pose.position = agent.pose.to_outer(DVec2::new(0.0, side * self.altered.aside_m));
            }
        }
        world
    }

    /// Returns the camera as it hangs, which nobody is told.
    pub(crate) fn camera(&self, model: &ds_space::CameraModel) -> ds_space::CameraModel {
        let down = DQuat::from_rotation_x(-self.altered.pitch_deg.to_radians());
        let rig_from_camera = model.rig_from_camera * Pose::new(down, DVec3::ZERO);
        ds_space::CameraModel { rig_from_camera, ..model.clone() }
    }

    /// Returns a picture as it arrives.
    pub(crate) fn picture(&self, scene: &Scene, frame: u32, image: RgbImage) -> RgbImage {
        let altered = &self.altered;
        let (width, height) = (image.width_px() as usize, image.height_px() as usize);
        let mut levels: Vec<f64> = image.rgb().iter().map(|level| f64::from(*level)).collect();
        if altered.grey {
            for pixel in levels.chunks_exact_mut(3) {
                let grey = 0.299 * pixel[0] + 0.587 * pixel[1] + 0.114 * pixel[2];
                pixel.fill(grey);
            }
        }
        if altered.gamma > 0.0 {
            levels.iter_mut().for_each(|level| *level = 255.0 * (*level / 255.0).powf(altered.gamma));
        }
        if altered.blur_px > 0.0 {
            levels = blurred(&levels, width, height, altered.blur_px);
        }
        if altered.noise > 0.0 {
            let draws = Draws::new(&scene.digest, "picture noise", &[u64::from(frame)]);
            (0..).zip(&mut levels).for_each(|(at, level)| *level += altered.noise * draws.normal(at));
        }
        if altered.jpeg > 0 {
            quantised(&mut levels, width, height, altered.jpeg);
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
        let rgb = levels.iter().map(|level| level.round().clamp(0.0, 255.0) as u8).collect();
        RgbImage::new(image.width_px(), image.height_px(), rgb).expect("the size is that of the picture")
    }
}

/// Blurs with a Gaussian, rows then columns; edges are held.
fn blurred(levels: &[f64], width: usize, height: usize, deviation_px: f64) -> Vec<f64> {
    #[expect(clippy::cast_possible_truncation, reason = "a few pixels")]
    let reach = (3.0 * deviation_px).ceil() as isize;
    let weight = |at: isize| (-0.5 * (at as f64 / deviation_px).powi(2)).exp();
    let sum: f64 = (-reach..=reach).map(weight).sum();
    let weights: Vec<f64> = (-reach..=reach).map(|at| weight(at) / sum).collect();
    let pass = |from: &[f64], along_x: bool| {
        let mut to = vec![0.0; from.len()];
        for y in 0..height {
            for x in 0..width {
                for (by, weight) in (-reach..=reach).zip(&weights) {
                    let held = |at: usize, side: usize| (at as isize + by).clamp(0, side as isize - 1) as usize;
                    let (x0, y0) = if along_x { (held(x, width), y) } else { (x, held(y, height)) };
                    for colour in 0..3 {
                        to[3 * (y * width + x) + colour] += weight * from[3 * (y0 * width + x0) + colour];
                    }
                }
            }
        }
        to
    };
    pass(&pass(levels, true), false)
}

/// Rounds the cosine coefficients of 8×8 blocks to steps that grow with their frequency and fall with the quality.
fn quantised(levels: &mut [f64], width: usize, height: usize, quality: u8) {
    const SIDE: usize = 8;
    let quality = f64::from(quality);
    let scale = if quality < 50.0 { 50.0 / quality } else { 2.0 - quality / 50.0 };
    let basis = |k: usize, n: usize| {
        let norm = if k == 0 { (1.0 / SIDE as f64).sqrt() } else { (2.0 / SIDE as f64).sqrt() };
        norm * (std::f64::consts::PI * (n as f64 + 0.5) * k as f64 / SIDE as f64).cos()
    };
    let table: Vec<f64> = (0..SIDE * SIDE).map(|at| basis(at / SIDE, at % SIDE)).collect();
    let place = |x: usize, y: usize, colour: usize| 3 * (y.min(height - 1) * width + x.min(width - 1)) + colour;
    for (top, left) in (0..height).step_by(SIDE).flat_map(|y| (0..width).step_by(SIDE).map(move |x| (y, x))) {
        for colour in 0..3 {
            let block: Vec<f64> =
                (0..SIDE * SIDE).map(|at| levels[place(left + at % SIDE, top + at / SIDE, colour)] - 128.0).collect();
            let mut rounded = vec![0.0; SIDE * SIDE];
            for (v, u) in (0..SIDE).flat_map(|v| (0..SIDE).map(move |u| (v, u))) {
                let sum: f64 = (0..SIDE * SIDE)
                    .map(|at| block[at] * table[v * SIDE + at / SIDE] * table[u * SIDE + at % SIDE])
                    .sum();
                let step = (scale * (16.0 + 6.0 * (u + v) as f64)).max(1.0);
                rounded[v * SIDE + u] = (sum / step).round() * step;
            }
            for (y, x) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (y, x))) {
                if left + x < width && top + y < height {
                    let sum: f64 = (0..SIDE * SIDE)
                        .map(|at| rounded[at] * table[at / SIDE * SIDE + y] * table[at % SIDE * SIDE + x])
                        .sum();
                    levels[place(left + x, top + y, colour)] = sum + 128.0;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_scenario::Family;
    use ds_space::Tick;

    fn altered(change: impl FnOnce(&mut Altered)) -> Source {
        let mut altered = Source::reference().altered;
        change(&mut altered);
        Source::of(altered).expect("sound")
    }

    #[test]
    fn pictures_change_as_declared() {
        let scene = ds_scenario::generate(Family::LeadBraking, 1);
        let mut image = RgbImage::filled(24, 16, [100, 120, 140]);
        image.set_pixel(12, 8, [255, 0, 0]);
        let seen = |source: &Source, frame| source.picture(&scene, frame, image.clone());
        assert_eq!(seen(&altered(|_| ()), 3), image);
        let blur = seen(&altered(|a| a.blur_px = 1.0), 3);
        assert!(blur.pixel(12, 8)[0] < 200 && blur.pixel(11, 8)[0] > 100 && blur.pixel(0, 0) == [100, 120, 140]);
        let grey = seen(&altered(|a| a.grey = true), 3).pixel(0, 0);
        assert!(grey[0] == grey[1] && grey[1] == grey[2]);
        assert_eq!(seen(&altered(|a| a.gamma = 2.0), 3).pixel(0, 0), [39, 56, 77]);
        let noisy = altered(|a| a.noise = 10.0);
        assert_eq!(seen(&noisy, 3), seen(&noisy, 3));
        assert_ne!(seen(&noisy, 3), seen(&noisy, 4));
        let (fine, coarse) = (seen(&altered(|a| a.jpeg = 100), 3), seen(&altered(|a| a.jpeg = 5), 3));
        let apart = |other: &RgbImage| -> u32 {
            other.rgb().iter().zip(image.rgb()).map(|(a, b)| u32::from(a.abs_diff(*b))).sum()
        };
        assert!(apart(&fine) < 500 && apart(&coarse) > 2 * apart(&fine), "{} {}", apart(&fine), apart(&coarse));
    }

    #[test]
    fn worlds_change_as_declared() {
        let scene = ds_scenario::generate(Family::LeadBraking, 1);
        let world = scene.logged_world(Tick(0));
        let aside = altered(|a| a.aside_m = 2.0).world(&scene, world.clone());
        let moved = aside.agents.iter().zip(&world.agents).map(|(a, b)| a.pose.position.distance(b.pose.position));
        assert!(moved.clone().any(|m| (m - 2.0).abs() < 1e-9) && moved.clone().all(|m| m < 2.0 + 1e-9));
        assert!(altered(|a| a.gone = 1.0).world(&scene, world.clone()).agents.is_empty());
        assert_eq!(altered(|_| ()).world(&scene, world.clone()), world);
        let bare = altered(|a| a.no_lines = true).scene(&scene);
        assert!(bare.map.line_markings.is_empty() && !scene.map.line_markings.is_empty());
        assert_eq!(bare.digest, scene.digest, "textures stay");
        let covered = |texture| altered(|a| a.texture = texture).scene(&scene).digest;
        assert!(covered(0) == scene.digest && covered(1) != scene.digest && covered(1) != covered(2));
        let camera = &scene.cameras[0];
        let lower = altered(|a| a.pitch_deg = 2.0).camera(camera);
        let ahead = |camera: &ds_space::CameraModel| camera.rig_from_camera.rotation * DVec3::Z;
        assert!(ahead(&lower).z < ahead(camera).z - 0.02, "it looks further down");
    }

    #[test]
    fn wrong_declarations_are_named() {
        for (text, words) in [
            ("[\"photo\"]", "photo"),
            ("[{ name = \"a\", from = \"layout\", look = \"snow\" }]", "look"),
            ("[{ name = \"a\", from = \"sim-rgb\", texture = 1 }]", "texture"),
            ("[{ name = \"a\", from = \"layout\", blur_px = -1.0 }]", "blur_px"),
            ("[{ name = \"a\", from = \"layout\", smear = 1.0 }]", "smear"),
            ("[{ name = \"a b\", from = \"layout\" }]", "a b"),
        ] {
            let table: toml::Table = toml::from_str(&format!("all = {text}")).expect("readable");
            let value = table["all"].as_array().expect("a list")[0].clone();
            let error = Source::try_from(value).expect_err(words);
            assert!(error.contains(words), "{error}");
        }
    }
}
