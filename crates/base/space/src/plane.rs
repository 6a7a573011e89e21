//! Plane geometry, once for all crates: polygons, boxes, polylines, paths, grids over bounding boxes.
//!
//! Metres, any fixed frame. Touching is closed (a shared boundary counts), being inside an [`IndexedPolygon`] is strict
//! (a point on a boundary is outside), both as in the reference implementations of the scores.

mod areas;
mod bounds;
mod corridor;
mod grid;
mod indexed_polygon;
mod line;
pub mod oriented_box;
pub mod path;
pub mod polygon;
mod polyline;

pub use areas::Areas;
pub use bounds::Bounds;
pub use corridor::corridor;
pub use grid::Grid;
pub use indexed_polygon::IndexedPolygon;
pub use line::{Line, Nearest};
pub use oriented_box::OrientedBox;
pub use path::Path;
pub use polyline::{Polyline, Projection};
