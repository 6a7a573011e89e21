//! Edits follow: what is changed in the layout changes in the frame there, and next to nothing elsewhere. On the
//! shipped weights, with the same first frame, prompt and noise.
//!
//! *There* are the pixels whose layout changed in the frame's chunk, and those up to [`NEAR_PX`] beside them, for what
//! stands in a place also casts its shadow there.

use std::path::Path;
use std::sync::Arc;

use ds_camera::{Appearance, ReferenceWorld};
use ds_evaluate::EvalConfig;
use ds_evaluate::arm::Arm;
use ds_evaluate::drive::{Drive, Route};
use ds_raster::RgbImage;
use ds_scenario::Family;
use ds_space::DVec2;
use ds_video::Layout;
use ds_world::{Scene, WorldState};

/// Frames after the first: three chunks.
const FRAMES: u32 = 12;
const NEAR_PX: usize = 5;

fn student() -> Arm {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/eval");
    let config = EvalConfig::load(&folder.join("shipped.toml")).expect("the configuration is right");
    Arm::load(&config, "student").expect("the shipped weights load")
}

fn route(family: Family, seed: u64, start: u32) -> Route {
    let scene = Arc::new(ds_scenario::generate(family, seed));
    Route { scene, start, pace: 1.0, look: Appearance::DAY, turned_deg: 0.0 }
}

/// Drives that count for a mean.
const DRIVES: usize = 3;
/// Seeds that are tried for them.
const SEEDS: std::ops::Range<u64> = 20_000_001..20_000_013;

/// The mean over drives of the changes there and elsewhere.
#[derive(Default)]
struct Mean(Vec<(f64, f64)>);

impl Mean {
    fn full(&self) -> bool {
        self.0.len() == DRIVES
    }

    /// Takes one drive more, as long as there are too few.
    fn add(&mut self, name: &str, change: impl FnOnce() -> Option<(f64, f64)>) {
        if !self.full() {
            let change = change();
            eprintln!("{name}, there and elsewhere: {change:.2?}");
            self.0.extend(change);
        }
    }

    fn check(&self, what: &str, least: f64, ratio: f64) {
        assert!(self.full(), "{what}: in view in {} drives alone", self.0.len());
        let mean = |part: fn(&(f64, f64)) -> f64| self.0.iter().map(part).sum::<f64>() / DRIVES as f64;
        check(what, mean(|change| change.0), mean(|change| change.1), least, ratio);
    }
}

/// Returns the mean change of colours (0 to 255) where the layout changed, and elsewhere, over the last chunk; nothing if
/// the edit is out of view.
fn change([before, after]: [&[Layout]; 2], frames: [&[RgbImage]; 2]) -> Option<(f64, f64)> {
    let (width, height) = (frames[0][0].width_px() as usize, frames[0][0].height_px() as usize);
    let differs = |images: [&RgbImage; 2], at: usize| {
        let pixel = |image: &RgbImage| [0, 1, 2].map(|colour| image.rgb()[3 * at + colour]);
        pixel(images[0]) != pixel(images[1])
    };
    let (mut there, mut elsewhere) = ((0.0, 0.0), (0.0, 0.0));
    let chunk = FRAMES as usize - 3..=FRAMES as usize;
    let changed: Vec<bool> = (0..width * height)
        .map(|at| chunk.clone().any(|frame| differs([&before[frame].image, &after[frame].image], at)))
        .collect();
    for at in 0..width * height {
        let (x, y) = (at % width, at / width);
        let (left, top) = (x.saturating_sub(NEAR_PX), y.saturating_sub(NEAR_PX));
        let (right, bottom) = ((x + NEAR_PX + 1).min(width), (y + NEAR_PX + 1).min(height));
        let near = (top..bottom).any(|row| changed[row * width + left..row * width + right].contains(&true));
        let place = if near { &mut there } else { &mut elsewhere };
        for frame in chunk.clone() {
            for colour in 0..3 {
                let value = |images: &[RgbImage]| f64::from(images[frame].rgb()[3 * at + colour]);
                place.0 += (value(frames[0]) - value(frames[1])).abs();
                place.1 += 1.0;
            }
        }
    }
    (there.1 > 0.0).then(|| (there.0 / there.1, elsewhere.0 / f64::max(elsewhere.1, 1.0)))
}

/// Returns the layouts of a drive with every state of the world edited but that of the first frame, which shows it as it was: what a
/// layout says of a frame that shows something else would be carried along.
fn layouts(drive: &mut Drive, edit: impl Fn(&mut WorldState)) -> Vec<Layout> {
    let layout = |frame| {
        let mut world = drive.world(frame);
        if frame > 0 {
            edit(&mut world);
        }
        drive.layout_of(&world).expect("renders")
    };
    (0..=FRAMES).map(layout).collect()
}

/// Holds a mean to its bounds: at least so many of 255 there, and so many times what changes elsewhere.
fn check(what: &str, there: f64, elsewhere: f64, least: f64, ratio: f64) {
    eprintln!("{what}: {there:.2} there, {elsewhere:.2} elsewhere, ratio {:.1}", there / elsewhere);
    assert!(there >= least, "{what}: the frame changes by {there:.2} where the layout does, {least} expected");
    assert!(there >= ratio * elsewhere, "{what}: {there:.2} there and {elsewhere:.2} elsewhere");
}

#[test]
fn removing_or_moving_a_vehicle_changes_the_frame_there() {
    let arm = student();
    let (mut removed, mut moved) = (Mean::default(), Mean::default());
    for seed in SEEDS {
        if removed.full() && moved.full() {
            break;
        }
        let mut drive =
            Drive::new(&ReferenceWorld, &route(Family::LeadBraking, seed, 20), arm.size_px()).expect("a drive");
        let ego = drive.world(0).ego.pose;
        let ahead = |agent: &ds_world::AgentState| {
            let local = ego.to_local(agent.pose.position);
            (local.x > 4.0 && local.y.abs() < 6.0).then_some(local.x)
        };
        let near = drive.world(0).agents.into_iter().filter_map(|agent| Some((ahead(&agent)?, agent.id)));
        let (_, nearest) = near.min_by(|a, b| a.0.total_cmp(&b.0)).expect("this family has a vehicle ahead");
        let before = layouts(&mut drive, |_| ());
        let without = layouts(&mut drive, |world| world.agents.retain(|agent| agent.id != nearest));
        let aside = layouts(&mut drive, |world| {
            for agent in world.agents.iter_mut().filter(|agent| agent.id == nearest) {
                agent.pose.position = agent.pose.to_outer(DVec2::new(0.0, 3.5));
            }
        });
        let rolled = |layouts: &[Layout]| arm.roll_with(&drive, layouts).expect("rolls out");
        let frames = rolled(&before);
        for (mean, after) in [(&mut removed, &without), (&mut moved, &aside)] {
            mean.add(&format!("lead-braking {seed}"), || change([&before, after], [&frames, &rolled(after)]));
        }
    }
    removed.check("vehicle removed", 5.0, 3.0);
    moved.check("vehicle moved", 5.0, 2.0);
}

#[test]
fn removing_or_moving_lane_lines_changes_the_frame_there() {
    let arm = student();
    let (mut removed, mut moved) = (Mean::default(), Mean::default());
    for seed in SEEDS {
        if removed.full() && moved.full() {
            break;
        }
        let route = route(Family::FreeCurve, seed, 20);
        let edited = |edit: &dyn Fn(&mut Scene)| {
            let mut scene = Scene::clone(&route.scene);
            edit(&mut scene);
            let route = Route { scene: Arc::new(scene), ..route.clone() };
            layouts(&mut Drive::new(&ReferenceWorld, &route, arm.size_px()).expect("a drive"), |_| ())
        };
        let drive = Drive::new(&ReferenceWorld, &route, arm.size_px()).expect("a drive");
        let before = edited(&|_| ());
        let without = edited(&|scene| scene.map.line_markings.clear());
        let aside = edited(&|scene| {
            let left = scene.ego_log[20].pose.left();
            scene.map.line_markings.iter_mut().flat_map(|line| &mut line.points).for_each(|point| *point += 1.0 * left);
        });
        let rolled = |layouts: &[Layout]| arm.roll_with(&drive, layouts).expect("rolls out");
        let frames = rolled(&before);
        for (mean, after) in [(&mut removed, &without), (&mut moved, &aside)] {
            mean.add(&format!("free-curve {seed}"), || change([&before, after], [&frames, &rolled(after)]));
        }
    }
    removed.check("lane lines removed", 5.0, 2.0);
    moved.check("lane lines moved", 5.0, 2.0);
}
