//! The recipe of a set of clips: one TOML file that says which scenarios are seen, in which conditions, at which size.

use std::path::{Path, PathBuf};

use ds_camera::{CameraWorld, Condition, ReferenceWorld};
use ds_second_camera::SecondWorld;
use ds_space::Digest;
use ds_video::ModelConfig;
use serde::{Deserialize, Serialize};

use crate::error::ClipsError;
use crate::pattern::Pattern;

/// What a set is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// Training with layouts.
    Train,
    /// Training without layouts, apart from all other sets.
    Prior,
    /// Evaluation.
    Test,
}

/// Which pictures the frames are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// Generated scenarios seen by the reference camera (world A).
    Reference,
    /// Scenario files and logs seen by the reference camera.
    Imported,
    /// Scenarios seen in the second world (world B), for evaluation only; `second_world` or `abroad`, the name in digests.
    #[serde(rename = "abroad", alias = "second_world")]
    SecondWorld,
    /// Drives of the nuScenes folder layout: frames are photographs.
    Nuscenes,
    /// Drives of the OpenScene / NAVSIM folder layout: frames are photographs.
    Openscene,
}

impl Source {
    /// Says whether frames are photographs.
    #[must_use]
    pub fn is_photographed(self) -> bool {
        matches!(self, Self::Nuscenes | Self::Openscene)
    }

    /// Returns the world that frames are rendered in; photographs are not rendered, and the reference camera would show
    /// their drive.
    pub(crate) fn world(self) -> &'static dyn CameraWorld {
        match self {
            Self::SecondWorld => &SecondWorld,
            Self::Reference | Self::Imported | Self::Nuscenes | Self::Openscene => &ReferenceWorld,
        }
    }
}

/// A set of clips.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Schema version, 1.
    pub version: u32,
    /// The set's name.
    pub name: String,
    /// What it is for.
    pub split: Split,
    /// What the frames are.
    pub source: Source,
    /// The model preset whose size the pictures have, relative to this file.
    pub model: PathBuf,
    /// Where the clips go, relative to the current folder.
    pub folder: PathBuf,
    /// Keys all draws.
    pub seed: u64,
    /// Frames of a clip: 1 + k·stride_t.
    pub frames: usize,
    /// Clips of a shard file.
    pub shard_clips: usize,
    /// Whether class maps are kept.
    #[serde(default)]
    pub classes: bool,
    /// Whether the ego strays from its log; without, clips start with the log and stretch it where it is too short.
    #[serde(default)]
    pub stray: bool,
    /// Share of the clips whose layouts leave out what stands beside the road, as those of most logs do.
    #[serde(default)]
    pub bare: f64,
    /// Which scenarios.
    pub scenarios: ScenarioConfig,
    /// Which conditions.
    pub appearance: AppearanceConfig,
    /// Keeps only an edited first frame of clips of another recipe.
    #[serde(default)]
    pub edit: Option<EditConfig>,
    /// An external captioner: see `docs/data.md`.
    #[serde(default)]
    pub captioner: Option<HookConfig>,
    /// Where this file lies.
    #[serde(skip)]
    pub base: PathBuf,
}

/// The scenarios of a set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScenarioConfig {
    /// Generated scenarios: the seed of the first eight, one of each family; the next eight have the next seed.
    #[serde(default)]
    pub first_seed: u64,
    /// How many scenarios.
    #[serde(default)]
    pub count: u64,
    /// Who generates: the project's families without it, or `second_world`, roads of the second world; for tests only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub generator: Option<Generator>,
    /// Scenario files, logs, or folders of them; roots of data sets of photographed drives. Relative to this file.
    #[serde(default)]
    pub files: Vec<PathBuf>,
    /// Clips of each scenario; of photographed drives one after the other.
    pub clips_each: u64,
    /// Of photographed drives, the camera; the front one without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<String>,
    /// The folder of nuPlan's maps for drives of OpenScene, relative to this file; beside the drives without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub maps: Option<PathBuf>,
}

/// A generator of scenarios beside the project's own families.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Generator {
    /// Roads of the second world; named as its pictures are.
    #[serde(rename = "abroad", alias = "second_world")]
    SecondWorld,
}

/// The conditions of a set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AppearanceConfig {
    /// Patterns of wanted conditions, such as `lighting=day,surface=dry` or `any`.
    pub conditions: Vec<String>,
    /// Patterns of conditions that are left out of them.
    #[serde(default)]
    pub held_out: Vec<String>,
    /// Whether snow and rain are seen falling where a condition has them. A decoder never sees them where they are drawn before its
    /// frames (`control.falls`).
    // What is true by default is not written, so that recipes of before keep their digests.
    #[serde(default = "yes", skip_serializing_if = "Clone::clone")]
    pub falls: bool,
}

fn yes() -> bool {
    true
}

/// Edited first frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EditConfig {
    /// The recipe whose clips are edited, relative to this file.
    pub of: PathBuf,
    /// How many of its clips, evenly spread.
    pub clips: u64,
    /// An external editor in place of the reference camera: see `docs/data.md`.
    #[serde(default)]
    pub editor: Option<HookConfig>,
}

/// An external program.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HookConfig {
    /// Program and arguments.
    pub command: Vec<String>,
}

impl Recipe {
    /// Reads and checks a recipe.
    ///
    /// # Errors
    /// If the file cannot be read, a key is unknown or a value is out of bounds.
    pub fn load(path: &Path) -> Result<Self, ClipsError> {
        let text = std::fs::read_to_string(path).map_err(ClipsError::io("clip recipe", path))?;
        let syntax = |source| ClipsError::Syntax { path: path.to_path_buf(), source: Box::new(source) };
        let mut recipe: Self = toml::from_str(&text).map_err(syntax)?;
        recipe.base = path.parent().unwrap_or(Path::new(".")).to_path_buf();
        recipe.check()?;
        Ok(recipe)
    }

    /// Returns the recipe with frames of another source.
    ///
    /// # Errors
    /// If that source does not go with the rest: the second world is for tests only.
    pub fn in_world(&self, source: Source) -> Result<Self, ClipsError> {
        let recipe = Self { source, ..self.clone() };
        recipe.check()?;
        Ok(recipe)
    }

    /// Returns the size of pictures in pixels, width and height, from the model preset.
    ///
    /// # Errors
    /// If the preset cannot be read or is refused.
    pub fn size(&self) -> Result<(u32, u32), ClipsError> {
        let path = self.base.join(&self.model);
        let text = std::fs::read_to_string(&path).map_err(ClipsError::io("model preset", &path))?;
        let model = ModelConfig::parse(&text)?;
        Ok((model.video.width_px, model.video.height_px))
    }

    /// Returns the conditions that clips are drawn from.
    ///
    /// # Errors
    /// If a pattern is refused or none is left.
    pub fn conditions(&self) -> Result<Vec<Condition>, ClipsError> {
        let parse = |field, patterns: &[String]| -> Result<Vec<Pattern>, ClipsError> {
            let refuse = |rule| ClipsError::Recipe { field, rule };
            patterns.iter().map(|text| text.parse().map_err(refuse)).collect()
        };
        let wanted = parse("appearance.conditions", &self.appearance.conditions)?;
        let held_out = parse("appearance.held_out", &self.appearance.held_out)?;
        let any = |patterns: &[Pattern], condition| patterns.iter().any(|pattern| pattern.holds(condition));
        let all: Vec<Condition> =
            Condition::all().filter(|condition| any(&wanted, *condition) && !any(&held_out, *condition)).collect();
        if all.is_empty() {
            return Err(ClipsError::Recipe { field: "appearance.conditions", rule: "no condition is left".to_owned() });
        }
        Ok(all)
    }

    /// Returns the recipe whose clips are edited, if this is one of edits.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn edited(&self) -> Result<Option<Self>, ClipsError> {
        self.edit.as_ref().map(|edit| Self::load(&self.base.join(&edit.of))).transpose()
    }

    /// Returns the digest of everything that the clips depend on; the folder does not count.
    ///
    /// # Errors
    /// If a file that the recipe names cannot be read.
    pub fn digest(&self) -> Result<Digest, ClipsError> {
        let placeless = Self { folder: PathBuf::new(), base: PathBuf::new(), ..self.clone() };
        let text = serde_json::to_string(&placeless)
            .map_err(|error| ClipsError::Recipe { field: "version", rule: error.to_string() })?;
        let (width, height) = self.size()?;
        let mut writer = ds_space::DigestWriter::new();
        writer.text(MAKER).text(&text).u32(width).u32(height);
        if let Some(edited) = self.edited()? {
            writer.digest(&edited.digest()?);
        }
        Ok(writer.finish())
    }

    fn check(&self) -> Result<(), ClipsError> {
        let refuse = |field, rule: String| Err(ClipsError::Recipe { field, rule });
        if self.version != 1 {
            return refuse("version", format!("must be 1, not {}", self.version));
        }
        if !(1..=4_096).contains(&self.frames) {
            return refuse("frames", format!("must be 1 to 4096, not {}", self.frames));
        }
        if !(1..=4_096).contains(&self.shard_clips) {
            return refuse("shard_clips", format!("must be 1 to 4096, not {}", self.shard_clips));
        }
        if !(0.0..=1.0).contains(&self.bare) {
            return refuse("bare", format!("must be 0 to 1, not {}", self.bare));
        }
        let scenarios = &self.scenarios;
        if self.source == Source::SecondWorld && self.split != Split::Test {
            return refuse("source", "\"second_world\" is for split \"test\" only".to_owned());
        }
        let generated = scenarios.files.is_empty();
        if self.edit.is_none() && generated && !(1..=100_000).contains(&scenarios.count) {
            return refuse("scenarios.count", format!("must be 1 to 100000, not {}", scenarios.count));
        }
        let wrong = match self.source {
            Source::Imported | Source::Nuscenes | Source::Openscene => generated,
            Source::Reference => !generated,
            Source::SecondWorld => false,
        };
        if wrong {
            return refuse(
                "scenarios.files",
                "are given with \"imported\", \"nuscenes\", \"openscene\" and where wanted \"second_world\", and only there"
                    .to_owned(),
            );
        }
        if self.source.is_photographed() && (self.classes || self.stray || self.edit.is_some()) {
            return refuse("source", "photographs have no classes, no stray ego and no edits".to_owned());
        }
        if scenarios.generator.is_some() && (self.split != Split::Test || !generated) {
            return refuse("scenarios.generator", "\"second_world\" is for split \"test\", without files".to_owned());
        }
        if scenarios.camera.is_some() && !self.source.is_photographed() {
            return refuse("scenarios.camera", "is for photographs only".to_owned());
        }
        if scenarios.maps.is_some() && self.source != Source::Openscene {
            return refuse("scenarios.maps", "is for source \"openscene\" only".to_owned());
        }
        if !(1..=10_000).contains(&scenarios.clips_each) {
            return refuse("scenarios.clips_each", format!("must be 1 to 10000, not {}", scenarios.clips_each));
        }
        if let Some(edit) = &self.edit
            && !(1..=1_000_000).contains(&edit.clips)
        {
            return refuse("edit.clips", format!("must be 1 to 1000000, not {}", edit.clips));
        }
        let hooks = [self.captioner.as_ref(), self.edit.as_ref().and_then(|edit| edit.editor.as_ref())];
        if hooks.iter().flatten().any(|hook| hook.command.is_empty()) {
            return refuse("command", "names no program".to_owned());
        }
        self.conditions().map(|_| ())
    }
}

/// Changes whenever the same recipe gives other clips.
const MAKER: &str = "clips 2";
