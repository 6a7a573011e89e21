//! The paint of vehicles, which no layout tells: where one comes into view, a carried frame shows the colour it shall have.

use std::collections::BTreeMap;

use crate::geometry::{Carried, Geometry, VehiclePart};
use crate::image::RgbImage;

/// How much of a pixel may be kept that shows a vehicle's paint and nothing else of it.
const PAINTED: f32 = 0.2;
/// Between which shares of its height a vehicle shows its paint: above the wheels, below the windows.
const BODY: std::ops::Range<f64> = 0.2..0.55;
/// So many such pixels tell it.
const TELLING_PX: u32 = 6;

/// Colours of vehicles by their ids.
pub type Paints = BTreeMap<u32, [u8; 3]>;

/// Sums of the colours of a vehicle's pixels, and their number.
type Sums = BTreeMap<u32, ([u32; 3], u32)>;

/// Returns the mean colour of the body of each vehicle in the frame that shows most of it.
#[must_use]
pub fn paints<'a>(seen: impl IntoIterator<Item = (&'a RgbImage, &'a Geometry)>) -> Paints {
    let mut most = Sums::new();
    for (frame, geometry) in seen {
        let vehicles = geometry.vehicles((frame.width_px(), frame.height_px()));
        for (id, sums) in sums(frame, &vehicles, |_| true) {
            let best = most.entry(id).or_default();
            if sums.1 > best.1 {
                *best = sums;
            }
        }
    }
    means(&most).collect()
}

impl Carried {
    /// Shows the paint of vehicles where nothing is known of them: the mean of what is known of one; of one of which too little is
    /// known to tell, what `told` says by its id, in the place of that little.
    pub fn paint(&mut self, told: impl Fn(u32) -> Option<[u8; 3]>) {
        let known = sums(&self.frame, &self.vehicles, |at| self.kept[at] > 0.0);
        let known: Paints = means(&known).collect();
        let mut asked = BTreeMap::new();
        let painted = self.vehicles.iter().enumerate().filter_map(|(at, part)| {
            let part = part.as_ref()?;
            let colour = match known.get(&part.id) {
                Some(_) if self.kept[at] > 0.0 => return None,
                Some(known) => *known,
                None => (*asked.entry(part.id).or_insert_with_key(|id| told(*id)))?,
            };
            Some((at, BODY.contains(&part.height).then_some(colour)))
        });
        for (at, colour) in painted.collect::<Vec<_>>() {
            self.frame.rgb_mut()[3 * at..3 * at + 3].copy_from_slice(&colour.unwrap_or_default());
            self.kept[at] = if colour.is_some() { PAINTED } else { 0.0 };
        }
    }
}

fn sums(frame: &RgbImage, vehicles: &[Option<VehiclePart>], counts: impl Fn(usize) -> bool) -> Sums {
    let mut all = Sums::new();
    for (at, (colour, part)) in frame.rgb().as_chunks::<3>().0.iter().zip(vehicles).enumerate() {
        let Some(part) = part.filter(|part| counts(at) && BODY.contains(&part.height)) else { continue };
        let (sums, count) = all.entry(part.id).or_default();
        sums.iter_mut().zip(colour).for_each(|(sum, byte)| *sum += u32::from(*byte));
        *count += 1;
    }
    all
}

fn means(sums: &Sums) -> impl Iterator<Item = (u32, [u8; 3])> {
    let telling = sums.iter().filter(|(_, (_, count))| *count >= TELLING_PX);
    telling.map(|(id, (sums, count))| (*id, sums.map(|sum| u8::try_from(sum / count).unwrap_or(u8::MAX))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::tests::{SIZE_PX, mover, seen};
    use crate::{Air, Mover};

    #[test]
    fn a_vehicle_that_comes_into_view_has_the_paint_that_is_told() {
        let frame = RgbImage::filled(SIZE_PX.0, SIZE_PX.1, [10, 20, 30]);
        let stranger = seen(0.0, Some(Mover { id: 8, ..mover(10.0, 0.0) }));
        let carried = |told: fn(u32) -> Option<[u8; 3]>| {
            let mut carried = stranger.carry(&seen(0.0, None), &frame, Air::Clear);
            carried.paint(told);
            carried
        };
        let red = carried(|id| (id == 8).then_some([200, 0, 0]));
        let painted = |carried: &Carried| carried.kept.iter().filter(|kept| (**kept - PAINTED).abs() < 1e-6).count();
        let shown = red.frame.rgb().as_chunks::<3>().0.iter().filter(|colour| **colour == [200, 0, 0]).count();
        assert!(shown > 50 && shown == painted(&red), "{shown} pixels are red, {} painted", painted(&red));
        assert_eq!(painted(&carried(|_| None)), 0, "of this vehicle nothing is told");
    }

    #[test]
    fn what_is_known_of_a_vehicle_is_its_paint() {
        // before, half of it was beyond the edge
        let (before, now) = (seen(0.0, Some(mover(10.0, 4.6))), seen(0.0, Some(mover(10.0, 2.0))));
        let mut frame = RgbImage::filled(SIZE_PX.0, SIZE_PX.1, [10, 20, 30]);
        let vehicles = before.vehicles(SIZE_PX);
        for (pixel, part) in frame.rgb_mut().as_chunks_mut::<3>().0.iter_mut().zip(vehicles) {
            *pixel = if part.is_some() { [0, 90, 0] } else { *pixel };
        }
        assert_eq!(paints([(&frame, &before)]), Paints::from([(7, [0, 90, 0])]));
        let mut carried = now.carry(&before, &frame, Air::Clear);
        let unknown: Vec<usize> =
            (0..carried.kept.len()).filter(|at| carried.vehicles[*at].is_some() && carried.kept[*at] == 0.0).collect();
        carried.paint(|_| Some([200, 0, 0]));
        let colours: Vec<&[u8]> = unknown.iter().map(|at| &carried.frame.rgb()[3 * at..3 * at + 3]).collect();
        assert!(!colours.is_empty() && colours.iter().all(|colour| colour[0] < 20), "not green: {colours:?}");
    }
}
