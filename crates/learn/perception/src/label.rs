//! What a pixel shows, as the segmenter names it, and the truth of it from a camera's class map and the map.
//!
//! Crosswalks are areas: bars and the road between them, wherever nothing stands on it. Everything else is the
//! camera's own class.

use ds_camera::PixelClass;
use ds_layout::{LayoutBackend, LayoutError, LayoutScene, Renderer, StaticMap, colour};
use ds_space::{CameraModel, Pose, Rig, World};
use ds_world::{Map, WorldState};

/// What a pixel shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Label {
    /// Drivable surface.
    Road = 0,
    /// Lane lines and stop lines.
    Lane = 1,
    /// Pedestrian crossings, bars and gaps.
    Crosswalk = 2,
    /// Cars, trucks, buses.
    Vehicle = 3,
    /// Pedestrians, and cyclists with their bicycles.
    Pedestrian = 4,
    /// Everything else below the sky.
    Other = 5,
    /// The sky.
    Sky = 6,
}

impl Label {
    /// Number of labels.
    pub const COUNT: usize = 7;

    /// All labels, in the order of the segmenter's scores.
    pub const ALL: [Self; Self::COUNT] =
        [Self::Road, Self::Lane, Self::Crosswalk, Self::Vehicle, Self::Pedestrian, Self::Other, Self::Sky];
}

/// Finds the crosswalks of a map in pictures.
pub struct Crosswalks {
    map: Option<StaticMap>,
    renderer: Renderer,
}

impl Crosswalks {
    /// Prepares a map.
    ///
    /// # Errors
    /// If the software rasteriser cannot be had.
    pub fn new(map: &Map) -> Result<Self, LayoutError> {
        let bare = Map { crosswalks: map.crosswalks.clone(), ..Map::default() };
        let map = (!bare.crosswalks.is_empty()).then(|| StaticMap::new(&bare));
        Ok(Self { map, renderer: Renderer::new(LayoutBackend::Cpu)? })
    }

    /// Returns the truth of a picture whose class map is given.
    ///
    /// # Errors
    /// If the picture's size is refused.
    pub fn label(
        &mut self,
        classes: &[PixelClass],
        world: &WorldState,
        model: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Result<Vec<Label>, LayoutError> {
        let plain = |class: &PixelClass| match class {
            PixelClass::Road => Label::Road,
            PixelClass::Paint => Label::Lane,
            PixelClass::Vehicle => Label::Vehicle,
            PixelClass::Person => Label::Pedestrian,
            PixelClass::Other => Label::Other,
            PixelClass::Sky => Label::Sky,
        };
        let mut labels: Vec<Label> = classes.iter().map(plain).collect();
        let Some(map) = &self.map else { return Ok(labels) };
        let empty = WorldState { agents: Vec::new(), lights: Vec::new(), ..world.clone() };
        let picture = self.renderer.render(&LayoutScene { map, world: &empty }, model, world_from_rig)?;
        for (label, pixel) in labels.iter_mut().zip(picture.rgb().chunks_exact(3)) {
            if pixel == colour::CROSSWALK && matches!(label, Label::Road | Label::Lane) {
                *label = Label::Crosswalk;
            }
        }
        Ok(labels)
    }
}
