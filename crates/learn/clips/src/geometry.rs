//! The geometry of a tick as bytes of a shard, little-endian: x, y and heading of the ego (f64), the count of movers (u32), of each
//! its id (u32) and x, y, heading, bottom, length, width and height (f64), then the inverse depths (u16). The camera is the clip's.

use std::sync::Arc;

use ds_raster::{Geometry, Mover};
use ds_space::{CameraModel, DVec2, PoseSe2};

/// The ego's pose and the geometry that its camera sees.
pub(crate) fn packed(ego_in_world: &PoseSe2, geometry: &Geometry) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(64 * (1 + geometry.movers.len()) + 2 * geometry.inverse_depths.len());
    let mut put = |values: &[f64]| values.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
    put(&pose(ego_in_world));
    bytes.extend((geometry.movers.len() as u32).to_le_bytes());
    for mover in &geometry.movers {
        bytes.extend(mover.id.to_le_bytes());
        let values = pose(&mover.pose).into_iter().chain([mover.bottom_m]).chain(mover.size_m);
        values.for_each(|value| bytes.extend(value.to_le_bytes()));
    }
    geometry.inverse_depths.iter().for_each(|depth| bytes.extend(depth.to_le_bytes()));
    bytes
}

fn pose(pose: &PoseSe2) -> [f64; 3] {
    [pose.position.x, pose.position.y, pose.heading_rad]
}

/// Undoes [`packed`]; none if there are too few or too many bytes or a number is not finite.
pub(crate) fn unpacked(bytes: &[u8], camera: &CameraModel) -> Option<Arc<Geometry>> {
    let mut left = bytes;
    let ego = numbers::<3>(&mut left)?;
    let count = word(&mut left)?;
    let movers = (0..count).map(|_| {
        let id = word(&mut left)?;
        let [x, y, heading_rad, bottom_m, length, width, height] = numbers(&mut left)?;
        let pose = PoseSe2 { position: DVec2::new(x, y), heading_rad };
        Some(Mover { id, pose, bottom_m, size_m: [length, width, height] })
    });
    let movers = movers.collect::<Option<Vec<Mover>>>()?;
    let lens = camera.intrinsics;
    let whole = left.len() == 2 * lens.width_px as usize * lens.height_px as usize;
    let depths = left.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
    let ego = PoseSe2::new(ego[0], ego[1], ego[2]);
    whole.then(|| {
        let world_from_camera = ego.world_from_rig(0.0) * camera.rig_from_camera;
        Arc::new(Geometry { lens, world_from_camera, inverse_depths: depths.collect(), movers })
    })
}

fn word(left: &mut &[u8]) -> Option<u32> {
    let (head, tail) = left.split_first_chunk()?;
    *left = tail;
    Some(u32::from_le_bytes(*head))
}

fn numbers<const N: usize>(left: &mut &[u8]) -> Option<[f64; N]> {
    let mut values = [0.0; N];
    for value in &mut values {
        let (head, tail) = left.split_first_chunk()?;
        *left = tail;
        *value = f64::from_le_bytes(*head);
    }
    values.iter().all(|value| value.is_finite()).then_some(values)
}
