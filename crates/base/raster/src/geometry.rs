//! The geometry of a layout: how far away each pixel is, from where it is seen, and what moves by itself; and how a frame
//! looks when it is carried along with it from one tick to another.
//!
//! A pixel of the later view is taken back to the earlier one: its point of the world by its depth, with the box that it lies
//! in, if any, to where that box was, and through the camera. It has an origin where the earlier view saw that point: within
//! the picture, and at a depth that the four pixels around it have or hold between them. What is infinitely far has none,
//! nor has what lies beside it: the top of a tree would leave a streak in the sky. What comes nearer is told to be stale at some
//! distances, each so many times the next: carried further, what was a few pixels wide would fill the picture, and stay as blurred as
//! it was. What moves keeps its colours there, and what stands does in clear air: in snow and rain it is paler from afar. The ground, whose
//! edges would run out over one another, does not.

use std::sync::Arc;

use ds_space::pose::Camera;
use ds_space::{DVec2, DVec3, Intrinsics, Pose, PoseSe2, World};

use crate::image::RgbImage;
use crate::lens;

/// Depths are kept as inverse depth in steps of this size, in 1/m; 0 is infinitely far, the greatest 1 m and nearer.
pub const INVERSE_DEPTH_STEP: f64 = 1.0 / 65_535.0;

/// How far beyond its faces a point still belongs to a box, in metres.
const SKIN_M: f64 = 0.15;
/// Depths that differ by less than this share are those of one surface.
const SAME_DEPTH: f64 = 0.06;
/// What stands is drawn anew at distances that are so many times one another: in between, its pixels grow and get no detail.
const STANDING_TIMES: f64 = 4.0;
/// The same for what moves by itself: its paint is known, so that it may be drawn anew sooner.
const MOVING_TIMES: f64 = 2.0;
/// The same for the ground, which is stretched by the square of that.
const GROUND_TIMES: f64 = 1.22;
/// How much of a pixel may be kept that is to be drawn anew in its colours: more of it would leave more of its blur.
const STALE: f32 = 0.35;
/// Least length and width of a vehicle, in metres.
const VEHICLE_M: [f64; 2] = [2.5, 1.2];
/// As far as this is taken for infinitely far, in metres.
const FAR_M: f64 = 1e6;

/// A box that moves by itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mover {
    /// Which one, the same at each tick.
    pub id: u32,
    /// Its middle and heading in the world.
    pub pose: PoseSe2,
    /// Its bottom above the ground plane, in metres.
    pub bottom_m: f64,
    /// Length, width and height, in metres.
    pub size_m: [f64; 3],
}

impl Mover {
    /// Returns what a point of it is of a vehicle; none if it is not as large as one.
    fn part(&self, point: DVec3) -> Option<VehiclePart> {
        let [length_m, width_m, height_m] = self.size_m;
        let large = length_m >= VEHICLE_M[0] && width_m >= VEHICLE_M[1];
        large.then(|| VehiclePart { id: self.id, height: (point.z - self.bottom_m) / height_m })
    }
}

/// Where a pixel was, and how much of it may be kept.
type Origin = (DVec2, f32);

/// A box with its axes, which every pixel asks for, and where it was, if it was there.
struct Placed<'a> {
    now: &'a Mover,
    axes: [DVec2; 2],
    before: Option<(&'a Mover, [DVec2; 2])>,
}

impl<'a> Placed<'a> {
    fn all(now: &'a [Mover], before: &'a [Mover]) -> Vec<Self> {
        let axes = |mover: &Mover| [mover.pose.forward(), mover.pose.left()];
        let earlier = |id: u32| before.iter().find(|mover| mover.id == id);
        let place = |mover: &'a Mover| {
            let before = earlier(mover.id).map(|then| (then, axes(then)));
            Self { now: mover, axes: axes(mover), before }
        };
        now.iter().map(place).collect()
    }

    fn local(&self, point: DVec3) -> DVec2 {
        let offset = point.truncate() - self.now.pose.position;
        DVec2::from(self.axes.map(|axis| offset.dot(axis)))
    }

    fn holds(&self, point: DVec3) -> bool {
        let (local, [length, width, height]) = (self.local(point).abs(), self.now.size_m);
        local.x <= 0.5 * length + SKIN_M
            && local.y <= 0.5 * width + SKIN_M
            && (-SKIN_M..=height + SKIN_M).contains(&(point.z - self.now.bottom_m))
    }

    /// Returns where a point of it was; none if it was not there.
    fn earlier(&self, point: DVec3) -> Option<DVec3> {
        let (then, [forward, left]) = self.before?;
        let local = self.local(point);
        let flat = then.pose.position + forward * local.x + left * local.y;
        Some(flat.extend(point.z - self.now.bottom_m + then.bottom_m))
    }
}

/// Returns the box that a point of the world belongs to.
fn holder<'p, 'a>(movers: &'p [Placed<'a>], point: DVec3) -> Option<&'p Placed<'a>> {
    let stands = point.z > SKIN_M && point.z < 0.5 * FAR_M;
    movers.iter().find(|mover| stands && mover.holds(point))
}

/// What a layout shows, as geometry.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    /// The lens, of the layout's size.
    pub lens: Intrinsics,
    /// From where it is seen.
    pub world_from_camera: Pose<World, Camera>,
    /// Inverse depth along the optical axis of each pixel, rows top to bottom, in steps of [`INVERSE_DEPTH_STEP`].
    pub inverse_depths: Arc<[u16]>,
    /// What moves by itself.
    pub movers: Vec<Mover>,
}

/// Returns inverse depths as they travel and are kept: two bytes each, the low one first. Their loops stand here, for this crate's are optimised in every build.
#[must_use]
pub fn bytes_of_depths(depths: &[u16]) -> Vec<u8> {
    depths.iter().map(|depth| depth.to_le_bytes()).collect::<Vec<_>>().into_flattened()
}

/// Returns the inverse depths that some bytes tell; none if their number is odd.
#[must_use]
pub fn depths_of_bytes(bytes: &[u8]) -> Option<Arc<[u16]>> {
    let (pairs, rest) = bytes.as_chunks::<2>();
    rest.is_empty().then(|| pairs.iter().map(|pair| u16::from_le_bytes(*pair)).collect())
}

/// What lies between the camera and what it sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Air {
    /// Nothing.
    #[default]
    Clear,
    /// Snow or rain: the farther away, the paler.
    Hazy,
}

/// A frame carried to another view.
#[derive(Debug, Clone, PartialEq)]
pub struct Carried {
    /// The frame as it would look; black where nothing is known.
    pub frame: RgbImage,
    /// Of each pixel, how much of it may be kept: 1 where it is known, a third where it is known and has come much nearer, 0 elsewhere.
    pub kept: Vec<f32>,
    /// What of a vehicle each pixel shows.
    pub vehicles: Vec<Option<VehiclePart>>,
}

/// A point of a vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehiclePart {
    /// Which vehicle.
    pub id: u32,
    /// How high up: 0 at its bottom, 1 at its top.
    pub height: f64,
}

impl Geometry {
    /// Carries a frame of an earlier tick, seen with the geometry `before`, to this view. The picture has the size of the frame, which
    /// is the layouts' view at another resolution.
    #[must_use]
    pub fn carry(&self, before: &Self, frame: &RgbImage, air: Air) -> Carried {
        let (origins, vehicles) = self.origins(before, (frame.width_px(), frame.height_px()), air);
        let mut carried = RgbImage::filled(frame.width_px(), frame.height_px(), [0; 3]);
        for (pixel, origin) in carried.rgb_mut().chunks_exact_mut(3).zip(&origins) {
            if let Some((origin, _)) = origin {
                pixel.copy_from_slice(&between(frame, *origin));
            }
        }
        let kept = origins.iter().map(|origin| origin.map_or(0.0, |(_, kept)| kept)).collect();
        Carried { frame: carried, kept, vehicles }
    }

    /// Returns what of a vehicle each pixel of a picture of this view shows.
    pub(crate) fn vehicles(&self, size: (u32, u32)) -> Vec<Option<VehiclePart>> {
        let movers = Placed::all(&self.movers, &[]);
        let part = |(_, point): (f64, DVec3)| holder(&movers, point)?.now.part(point);
        self.points(size).map(|seen| seen.and_then(part)).collect()
    }

    /// Returns for each pixel of a picture of this view how far away its point of the world is, in metres, and where; none of what is
    /// infinitely far.
    fn points(&self, size: (u32, u32)) -> impl Iterator<Item = Option<(f64, DVec3)>> {
        let directions = lens::directions(&self.lens.resized(size.0, size.1));
        let point = |(depth_m, direction): (f64, DVec2)| {
            (depth_m < FAR_M).then(|| (depth_m, self.world_from_camera * (direction.extend(1.0) * depth_m)))
        };
        self.depths_m(size).into_iter().zip(directions).map(point)
    }

    /// Returns for each pixel of a picture of this view where it was in a picture of the view `before`, both of the same size, and how
    /// much of it may be kept; and what of a vehicle it shows.
    fn origins(&self, before: &Self, size: (u32, u32), air: Air) -> (Vec<Option<Origin>>, Vec<Option<VehiclePart>>) {
        let (width_px, height_px) = size;
        let depths_before_m = before.depths_m(size);
        let lens = before.lens.resized(width_px, height_px);
        let camera_from_world = before.world_from_camera.inverse();
        let movers = Placed::all(&self.movers, &before.movers);
        let origin = |depth_m: f64, point: DVec3, holder: Option<&Placed<'_>>| {
            let then = holder.map_or(Some(point), |mover| mover.earlier(point))?;
            let seen = camera_from_world * then;
            let at = lens.project(seen)?;
            let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < f64::from(width_px) && at.y < f64::from(height_px);
            let around = inside.then(|| around(at, size).map(|pixel| depths_before_m[pixel]))?;
            let known = around.iter().all(|m| *m < FAR_M);
            let (nearest, farthest) = around.iter().fold((FAR_M, 0.0), |(low, high), m| (m.min(low), m.max(high)));
            let surface = nearest / (1.0 + SAME_DEPTH)..=farthest * (1.0 + SAME_DEPTH);
            let stands = point.z > SKIN_M;
            let times = match holder {
                Some(_) => MOVING_TIMES,
                None if stands => STANDING_TIMES,
                None => GROUND_TIMES,
            };
            let stale = nearer(times, depth_m, seen.z);
            let coloured = holder.is_some() || (stands && air == Air::Clear);
            let kept = if stale && coloured { STALE } else { f32::from(u8::from(!stale)) };
            (known && surface.contains(&seen.z) && kept > 0.0).then_some((at, kept))
        };
        let pixel = |seen: Option<(f64, DVec3)>| {
            let Some((depth_m, point)) = seen else { return (None, None) };
            let holder = holder(&movers, point);
            (origin(depth_m, point, holder), holder.and_then(|mover| mover.now.part(point)))
        };
        self.points(size).map(pixel).unzip()
    }

    /// Returns the depths of the pixels of a picture of this view at another size, in metres, rows top to bottom.
    fn depths_m(&self, (width_px, height_px): (u32, u32)) -> Vec<f64> {
        let (w, h) = (self.lens.width_px as usize, self.lens.height_px as usize);
        let middles = |of: u32, side: usize| -> Vec<usize> {
            (0..of as usize).map(|at| (2 * at + 1) * side / (2 * of as usize)).collect()
        };
        let (rows, columns) = (middles(height_px, h), middles(width_px, w));
        let steps = rows.iter().flat_map(|y| columns.iter().map(move |x| self.inverse_depths[y * w + x]));
        steps.map(|step| if step > 0 { (f64::from(step) * INVERSE_DEPTH_STEP).recip() } else { FAR_M }).collect()
    }
}

/// Says whether a distance of 1 m or one of its multiples by powers of `times` lies between where something is and, farther away, where it was.
fn nearer(times: f64, is_m: f64, was_m: f64) -> bool {
    let mut border_m = 1.0;
    while border_m <= is_m {
        border_m *= times;
    }
    border_m <= was_m
}

/// Returns where the four pixels around a place in a picture stand in its rows.
fn around(at: DVec2, (width_px, height_px): (u32, u32)) -> [usize; 4] {
    let (x, y) = ((at.x - 0.5).max(0.0), (at.y - 0.5).max(0.0));
    let (left, top) = (x as u32, y as u32);
    let (right, bottom) = ((left + 1).min(width_px - 1), (top + 1).min(height_px - 1));
    [(left, top), (right, top), (left, bottom), (right, bottom)].map(|(x, y)| (y * width_px + x) as usize)
}

/// Returns the colour of a frame between pixels, by the cubic through the four in each row and column (Catmull and Rom), which keeps
/// what is carried again and again sharper than the line between two.
fn between(frame: &RgbImage, at: DVec2) -> [u8; 3] {
    let side = |at: f64, side_px: u32| {
        let (first, share) = ((at - 0.5).floor(), (at - 0.5).rem_euclid(1.0));
        let pixel = |tap: i32| (first as i32 + tap - 1).clamp(0, side_px as i32 - 1) as u32;
        ([0, 1, 2, 3].map(pixel), cubic(share))
    };
    let (columns, across) = side(at.x, frame.width_px());
    let (rows, down) = side(at.y, frame.height_px());
    let mut sums = [0.0; 3];
    for (y, down) in rows.into_iter().zip(down) {
        for (x, across) in columns.into_iter().zip(across) {
            let colour = frame.pixel(x, y);
            sums = std::array::from_fn(|channel| sums[channel] + across * down * f64::from(colour[channel]));
        }
    }
    sums.map(|sum: f64| sum.round().clamp(0.0, 255.0) as u8)
}

/// Returns the shares of four neighbours in the value at a share of the way from the second to the third.
fn cubic(t: f64) -> [f64; 4] {
    let [t2, t3] = [t * t, t * t * t];
    [0.5 * (2.0 * t2 - t3 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (4.0 * t2 - 3.0 * t3 + t), 0.5 * (t3 - t2)]
}

#[cfg(test)]
pub(crate) mod tests {
    use ds_space::DQuat;

    use super::*;
    use crate::{DepthRaster, View};

    pub(crate) const SIZE_PX: (u32, u32) = (64, 32);
    const WALL_M: f64 = 20.0;

    /// A camera 1.5 m high that looks along x from a place on it, at a wall and a box before it.
    pub(crate) fn seen(x_m: f64, mover: Option<Mover>) -> Geometry {
        let lens = Intrinsics::centred(SIZE_PX.0, SIZE_PX.1, 1.0);
        let ahead = DQuat::from_mat3(&ds_space::DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X));
        let world_from_camera = Pose::new(ahead, DVec3::new(x_m, 0.0, 1.5));
        let view = View::new(&lens, world_from_camera);
        let mut raster = DepthRaster::new(SIZE_PX.0, SIZE_PX.1, ()).expect("the size fits");
        let mut wall = |x: f64, [left, right]: [f64; 2], top: f64| {
            let corner = |y: f64, z: f64| DVec3::new(x, y, z);
            for corners in [
                [corner(left, 0.0), corner(right, 0.0), corner(right, top)],
                [corner(left, 0.0), corner(right, top), corner(left, top)],
            ] {
                view.fill(&mut raster, &corners, ());
            }
        };
        wall(WALL_M, [30.0, -30.0], 30.0);
        if let Some(mover) = mover {
            let middle = mover.pose.position;
            wall(middle.x - 0.5 * mover.size_m[0], [middle.y + 1.0, middle.y - 1.0], mover.size_m[2]);
        }
        let ground = |at: usize| (-view.ray(0.5, (at / SIZE_PX.0 as usize) as f64 + 0.5).z / 1.5).max(0.0);
        let depths = raster.inverse_depths().iter().enumerate();
        let steps = depths.map(|(at, depth)| (f64::from(*depth).max(ground(at)) / INVERSE_DEPTH_STEP) as u16);
        Geometry { lens, world_from_camera, inverse_depths: steps.collect(), movers: mover.into_iter().collect() }
    }

    pub(crate) fn mover(x_m: f64, y_m: f64) -> Mover {
        Mover { id: 7, pose: PoseSe2::new(x_m, y_m, 0.0), bottom_m: 0.0, size_m: [4.0, 2.0, 1.5] }
    }

    /// A frame whose colours tell column and row.
    fn frame() -> RgbImage {
        let mut image = RgbImage::filled(SIZE_PX.0, SIZE_PX.1, [0; 3]);
        for (x, y) in (0..SIZE_PX.0).flat_map(|x| (0..SIZE_PX.1).map(move |y| (x, y))) {
            image.set_pixel(x, y, [4 * x as u8, 8 * y as u8, 128]);
        }
        image
    }

    #[test]
    fn where_nothing_moves_a_frame_stays_as_it_is() {
        let geometry = seen(0.0, Some(mover(10.0, 0.0)));
        let carried = geometry.carry(&geometry, &frame(), Air::Clear);
        assert!(carried.kept.iter().all(|kept| *kept == 1.0));
        assert_eq!(carried.frame, frame());
    }

    #[test]
    fn what_comes_nearer_grows_around_where_it_goes() {
        let (before, now) = (seen(0.0, None), seen(4.0, None));
        let carried = now.carry(&before, &frame(), Air::Clear);
        // The wall was 20 m away and is 16 m: four fifths as far from the middle as now.
        let [was, is] = [28u32, 27].map(|x| frame().pixel(x, 8)[0]);
        let found = carried.frame.pixel(27, 8)[0];
        assert!(found > is && found <= was + 4, "{found} is not {was}");
        let wall = &carried.kept[..(16 * SIZE_PX.0) as usize];
        assert!(wall.iter().filter(|kept| **kept > 0.0).count() > 900);
    }

    #[test]
    fn what_has_come_much_nearer_is_drawn_anew() {
        let kept_in = |air, x_m: f64| seen(x_m, None).carry(&seen(0.0, None), &frame(), air).kept;
        let kept = |x_m| kept_in(Air::Clear, x_m);
        let at = |column: usize, row: usize| row * SIZE_PX.0 as usize + column;
        // The wall comes from 20 m: 16 m lies between that and 15.5, not between that and 16.5. The ground in row 24 is 5.5 m away.
        assert_eq!([3.5, 4.5].map(|x_m| kept(x_m)[at(32, 8)]), [1.0, STALE]);
        assert_eq!([3.5, 0.2].map(|x_m| kept(x_m)[at(32, 24)]), [0.0, 1.0]);
        assert_eq!([3.5, 4.5].map(|x_m| kept_in(Air::Hazy, x_m)[at(32, 8)]), [1.0, 0.0], "paler from afar");
        // a box of which the distance of 4 m lies between then and now keeps its paint in any air
        let boxed = |x_m: f64| seen(x_m, Some(mover(10.0, 0.0)));
        let kept = boxed(4.5).carry(&boxed(3.5), &frame(), Air::Hazy).kept;
        assert_eq!(kept[at(32, 20)], STALE);
    }

    #[test]
    fn a_box_takes_its_colours_along_and_uncovers_what_nobody_saw() {
        let (before, now) = (seen(0.0, Some(mover(10.0, 0.0))), seen(0.0, Some(mover(10.0, 2.0))));
        let carried = now.carry(&before, &frame(), Air::Clear);
        let row = 20;
        let column = |y_m: f64| (32.0 - now.lens.fx_px * y_m / 8.0) as u32;
        let [moved, left] = [column(2.0), column(0.0)];
        assert!(carried.frame.pixel(moved, row)[0].abs_diff(frame().pixel(column(0.0), row)[0]) <= 6);
        assert!(carried.kept[(row * SIZE_PX.0 + left) as usize] == 0.0, "the ground behind the box was hidden");
        let stranger = seen(0.0, Some(Mover { id: 8, ..mover(10.0, 2.0) }));
        let carried = stranger.carry(&before, &frame(), Air::Clear);
        assert!(carried.kept[(row * SIZE_PX.0 + moved) as usize] == 0.0, "this box was not there");
    }
}
