//! The one geometry kernel of all scores: oriented boxes, polygons with holes, polylines, a grid over bounding boxes.
//!
//! Planar, metres, any fixed frame. Touching is closed (a shared boundary counts), being inside is strict (a point on
//! a boundary is outside), both as in the reference implementations. Nothing here knows what is scored.

mod bounds;
mod corridor;
mod grid;
mod line;
mod oriented_box;
mod polygon;

pub use bounds::Bounds;
pub use corridor::corridor;
pub use line::{Line, Nearest};
pub use oriented_box::OrientedBox;
pub use polygon::IndexedPolygon;

pub(crate) use grid::Grid;
