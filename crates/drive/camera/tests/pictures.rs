//! Laws of the cameras' pictures and class maps, on a hand-made street.

#[path = "../../layout/tests/scenes/street.rs"]
mod street;

use std::sync::Arc;

use ds_camera::{
    Appearance, LabelledCamera, PixelClass, PlainCamera, ReferenceCamera, ReprojectedCamera, Sampling, SceneCamera,
};
use ds_space::{AgentId, CameraModel, DVec2, DVec3, Intrinsics, PoseSe2};
use ds_world::{AgentClass, AgentState, EgoState, Scene, Size, Track, TrackPoint, WorldState};

fn reference() -> ReferenceCamera {
    ReferenceCamera::new(&street::scene(), Appearance::DAY)
}

fn classes(world: &WorldState, camera: &CameraModel) -> Vec<PixelClass> {
    reference().classes(world, camera, street::ego().world_from_rig(0.0)).expect("the size is sound")
}

fn agent(class: AgentClass, [length_m, width_m, height_m]: [f64; 3], x_m: f64, y_m: f64) -> AgentState {
    let size = Size { length_m, width_m, height_m };
    AgentState { id: AgentId(0), class, size, pose: PoseSe2::new(x_m, y_m, 0.3), z_m: 0.0, velocity_mps: DVec2::ZERO }
}

fn with_agents(agents: Vec<AgentState>) -> WorldState {
    WorldState { agents, ..street::world() }
}

#[test]
fn equal_input_gives_equal_bits() {
    for sampling in [Sampling::Smooth, Sampling::Single] {
        for appearance in [Appearance::DAY, Appearance::from_seed(4)] {
            let picture = || {
                let camera = ReferenceCamera::new(&street::scene(), appearance).with_sampling(sampling);
                camera
                    .render(&street::world(), &street::camera(160, 96), street::ego().world_from_rig(0.0))
                    .expect("the size is sound")
            };
            assert_eq!(picture(), picture());
        }
    }
}

#[test]
fn appearances_and_scenes_look_different_and_shapes_stay() {
    let rig = street::ego().world_from_rig(0.0);
    let (world, camera) = (street::world(), street::camera(160, 96));
    let night = ReferenceCamera::new(&street::scene(), Appearance { night: 1.0, ..Appearance::DAY });
    let mean = |camera: &ReferenceCamera| {
        let image = camera.render(&world, &street::camera(160, 96), rig).expect("the size is sound");
        image.rgb().iter().map(|c| f64::from(*c)).sum::<f64>() / image.rgb().len() as f64
    };
    assert!(mean(&night) < 0.6 * mean(&reference()));
    assert_eq!(night.classes(&world, &camera, rig).expect("the size is sound"), classes(&world, &camera));
    let other = Scene { digest: ds_space::Digest::of(b"another street"), ..street::scene() };
    let elsewhere =
        ReferenceCamera::new(&other, Appearance::DAY).render(&world, &camera, rig).expect("the size is sound");
    assert_ne!(elsewhere, reference().render(&world, &camera, rig).expect("the size is sound"));
}

#[test]
fn nothing_behind_the_camera_is_seen() {
    let camera = street::camera(160, 96);
    let empty = classes(&with_agents(vec![]), &camera);
    for (x_m, y_m) in [(-8.0, -1.75), (-3.5, 3.0), (-60.0, -1.75)] {
        let world = with_agents(vec![agent(AgentClass::Vehicle, [4.5, 1.8, 1.5], x_m, y_m)]);
        assert_eq!(classes(&world, &camera), empty, "an agent at ({x_m}, {y_m}) was seen");
    }
}

/// Returns the rectangle around the projected corners of an agent's box: left, right, top, bottom.
fn box_in_picture(agent: &AgentState, camera: &CameraModel) -> [f64; 4] {
    let camera_from_world = (street::ego().world_from_rig(0.0) * camera.rig_from_camera).inverse();
    let mut bounds = [f64::MAX, f64::MIN, f64::MAX, f64::MIN];
    for corner in agent.corners() {
        for z_m in [agent.z_m, agent.z_m + agent.size.height_m] {
            let pixel = camera.intrinsics.project(camera_from_world * corner.extend(z_m)).expect("the box is ahead");
            bounds = [bounds[0].min(pixel.x), bounds[1].max(pixel.x), bounds[2].min(pixel.y), bounds[3].max(pixel.y)];
        }
    }
    bounds
}

/// Checks that an agent fills its projected box and does not leave it.
fn check_in_box(class: AgentClass, seen_as: PixelClass, size: [f64; 3], least_share: f64) {
    let plain = street::camera(640, 384);
    let distorted = CameraModel { intrinsics: Intrinsics { k1: -0.12, ..plain.intrinsics }, ..plain.clone() };
    for camera in [plain, distorted] {
        let agent = agent(class, size, 14.0, -3.0);
        let seen = classes(&with_agents(vec![agent.clone()]), &camera);
        let [left, right, top, bottom] = box_in_picture(&agent, &camera);
        let pixels = seen.iter().enumerate().filter(|(_, class)| **class == seen_as);
        let places: Vec<(f64, f64)> = pixels.map(|(i, _)| ((i % 640) as f64 + 0.5, (i / 640) as f64 + 0.5)).collect();
        for (x, y) in &places {
            let inside = *x > left - 5.0 && *x < right + 5.0 && *y > top - 5.0 && *y < bottom + 5.0;
            assert!(inside, "{class:?} at ({x}, {y}) leaves {:?}", [left, right, top, bottom]);
        }
        let share = places.len() as f64 / ((right - left) * (bottom - top));
        assert!(share > least_share, "{class:?} fills {share:.2} of its box");
    }
}

#[test]
fn agents_fill_their_boxes() {
    check_in_box(AgentClass::Vehicle, PixelClass::Vehicle, [4.5, 1.8, 1.5], 0.6);
    check_in_box(AgentClass::Vehicle, PixelClass::Vehicle, [4.8, 2.0, 1.9], 0.6);
    check_in_box(AgentClass::Vehicle, PixelClass::Vehicle, [9.0, 2.5, 3.4], 0.6);
    check_in_box(AgentClass::Pedestrian, PixelClass::Person, [0.7, 0.7, 1.75], 0.25);
    check_in_box(AgentClass::Cyclist, PixelClass::Person, [1.8, 0.6, 1.75], 0.2);
}

#[test]
fn sky_is_above_and_road_ahead() {
    let seen = classes(&with_agents(vec![]), &street::camera(160, 96));
    assert!(seen[..160 * 10].iter().all(|class| matches!(class, PixelClass::Sky | PixelClass::Other)));
    assert!(!seen[160 * 50..].contains(&PixelClass::Sky));
    assert_eq!(seen[160 * 90 + 90], PixelClass::Road);
    assert!(seen.contains(&PixelClass::Paint));
}

#[test]
fn the_lit_lamp_shows_the_state() {
    use ds_world::LightState::{Green, Red, Unknown};
    let camera = street::camera(640, 384);
    let rig = street::ego().world_from_rig(0.0);
    let picture = |state| {
        reference()
            .render(&WorldState { lights: vec![state], ..with_agents(vec![]) }, &camera, rig)
            .expect("the size is sound")
    };
    let (red, green, unknown) = (picture(Red), picture(Green), picture(Unknown));
    let camera_from_world = (rig * camera.rig_from_camera).inverse();
    let lamp = |up_m: f64| {
        let head = street::map().traffic_lights[0].position + DVec3::new(-0.15, 0.0, up_m);
        let pixel = camera.intrinsics.project(camera_from_world * head).expect("the head is ahead");
        (pixel.x as u32, pixel.y as u32)
    };
    let at = |image: &ds_raster::RgbImage, (x, y)| image.pixel(x, y).map(i32::from);
    let (r, g) = (at(&red, lamp(0.46)), at(&green, lamp(-0.46)));
    assert!(r[0] > r[1] + 80, "the red lamp shows {r:?}");
    assert!(g[1] > g[0] + 80, "the green lamp shows {g:?}");
    assert!(at(&unknown, lamp(0.46))[0] < 120);
}

#[test]
fn the_plain_camera_agrees_with_the_class_map_on_the_sky() {
    let camera = street::camera(160, 96);
    let rig = street::ego().world_from_rig(0.0);
    let image = PlainCamera::new(&street::scene()).render(&street::world(), &camera, rig).expect("the size is sound");
    let seen = classes(&street::world(), &camera);
    let sky = image.pixel(0, 0);
    for (i, class) in seen.iter().enumerate().filter(|(_, class)| **class == PixelClass::Sky) {
        assert_eq!(image.rgb()[3 * i..3 * i + 3], sky, "pixel {i} is {class:?}");
    }
}

fn in_condition(name: &str) -> ReferenceCamera {
    ReferenceCamera::new(&street::scene(), Appearance::named(name).expect("a condition"))
}

fn at_tick(camera: &ReferenceCamera, tick: u32) -> ds_raster::RgbImage {
    let world = WorldState { tick: ds_space::Tick(tick), ..street::world() };
    camera.render(&world, &street::camera(160, 96), street::ego().world_from_rig(0.0)).expect("the size is sound")
}

/// Mean absolute difference of bytes.
fn difference(a: &ds_raster::RgbImage, b: &ds_raster::RgbImage) -> f64 {
    let pairs = a.rgb().iter().zip(b.rgb());
    pairs.map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs()).sum::<f64>() / a.rgb().len() as f64
}

#[test]
fn every_condition_shows_and_keeps_the_shapes() {
    let (world, camera) = (street::world(), street::camera(160, 96));
    let rig = street::ego().world_from_rig(0.0);
    let conditions: Vec<ds_camera::Condition> = ds_camera::Condition::all().collect();
    // One palette and one sun for all: what differs is the condition.
    let look = |condition| Appearance { palette_seed: 1, sun_azimuth_rad: 0.9, ..Appearance::condition(condition, 1) };
    let pictures: Vec<_> = conditions.iter().map(|c| ReferenceCamera::new(&street::scene(), look(*c))).collect();
    let classes = pictures[0].classes(&world, &camera, rig).expect("the size is sound");
    let frames: Vec<_> = pictures.iter().map(|camera| at_tick(camera, 3)).collect();
    for (i, a) in conditions.iter().enumerate() {
        assert_eq!(
            pictures[i].classes(&world, &camera, rig).expect("the size is sound"),
            classes,
            "{a} changes the classes"
        );
        for (j, b) in conditions.iter().enumerate().skip(i + 1) {
            let apart = difference(&frames[i], &frames[j]);
            assert!(apart > 1.0, "{a} and {b} differ by {apart:.2} only");
        }
    }
}

#[test]
fn snow_and_rain_fall_anew_at_each_tick_and_the_same_each_time() {
    for (name, least) in [("snow", 1.0), ("rain", 0.5), ("snow-night", 0.2)] {
        let camera = in_condition(name);
        let (first, again, next) = (at_tick(&camera, 5), at_tick(&in_condition(name), 5), at_tick(&camera, 6));
        assert_eq!(first, again, "{name}");
        assert!(difference(&first, &next) > least, "{name}: {}", difference(&first, &next));
    }
    let dry = in_condition("overcast");
    assert_eq!(at_tick(&dry, 5), at_tick(&dry, 6), "nothing falls");
}

#[test]
fn fog_hides_what_is_far_and_leaves_what_is_near() {
    // A dark car at 8 m and one at 60 m, each against its surroundings.
    let contrast = |name: &str, x_m: f64| {
        let car = agent(AgentClass::Vehicle, [4.5, 1.8, 1.5], x_m, -1.75);
        let camera = street::camera(160, 96);
        let rig = street::ego().world_from_rig(0.0);
        let with = in_condition(name).render(&with_agents(vec![car.clone()]), &camera, rig).expect("the size is sound");
        let without = in_condition(name).render(&with_agents(vec![]), &camera, rig).expect("the size is sound");
        let seen = classes(&with_agents(vec![car]), &camera);
        let pixels: Vec<usize> = (0..seen.len()).filter(|i| seen[*i] == PixelClass::Vehicle).collect();
        let change = |i: &usize| {
            (0..3).map(|c| f64::from(with.rgb()[3 * i + c].abs_diff(without.rgb()[3 * i + c]))).sum::<f64>()
        };
        pixels.iter().map(change).sum::<f64>() / pixels.len() as f64
    };
    let left = |x_m: f64| contrast("fog", x_m) / contrast("overcast", x_m);
    let (near, far) = (left(8.0), left(60.0));
    assert!(near > 0.45 && far < 0.4 && far < 0.6 * near, "near {near:.2}, far {far:.2}");
}

#[test]
fn snow_whitens_sand_yellows_and_puddles_mirror() {
    let mean = |name: &str| {
        let appearance = Appearance { palette_seed: 1, ..Appearance::named(name).expect("a condition") };
        let camera = ReferenceCamera::new(&street::scene(), appearance);
        let picture = camera
            .render(&with_agents(vec![]), &street::camera(160, 96), street::ego().world_from_rig(0.0))
            .expect("the size is sound");
        let seen = classes(&with_agents(vec![]), &street::camera(160, 96));
        let road: Vec<usize> = (0..seen.len()).filter(|i| seen[*i] == PixelClass::Road).collect();
        let channel =
            |c: usize| road.iter().map(|i| f64::from(picture.rgb()[3 * i + c])).sum::<f64>() / road.len() as f64;
        let brightness: Vec<f64> = road
            .iter()
            .map(|i| picture.rgb()[3 * i..3 * i + 3].iter().map(|c| f64::from(*c)).sum::<f64>() / 3.0)
            .collect();
        let average = brightness.iter().sum::<f64>() / brightness.len() as f64;
        let spread = (brightness.iter().map(|b| (b - average).powi(2)).sum::<f64>() / brightness.len() as f64).sqrt();
        ([channel(0), channel(1), channel(2)], average, spread)
    };
    let (dry, snow) = (mean("overcast"), mean("overcast-snow_covered"));
    let (sand, puddles) = (mean("overcast-sand"), mean("overcast-puddles"));
    assert!(snow.1 > dry.1 + 20.0, "snow {:.0}, dry {:.0}", snow.1, dry.1);
    assert!(sand.0[0] > sand.0[2] + 30.0 && dry.0[0] < dry.0[2] + 15.0, "sand {:?}, dry {:?}", sand.0, dry.0);
    assert!(puddles.2 > 1.5 * dry.2, "puddles {:.1}, dry {:.1}", puddles.2, dry.2);
}

#[test]
fn a_camera_too_large_to_render_is_refused_by_its_size() {
    let (world, rig) = (street::world(), street::ego().world_from_rig(0.0));
    let wide = street::camera(ds_raster::image::MAX_SIDE_PX + 2, 2);
    let plain = PlainCamera::new(&street::scene()).render(&world, &wide, rig).expect_err("too wide");
    assert_eq!(plain.to_string(), "image of 8194×2 px: each side must be 1 to 8192");
    assert!(reference().render(&world, &wide, rig).is_err(), "four samples a pixel do not make it fit");
    assert!(reference().classes(&world, &wide, rig).is_err());
}

/// Mean difference of two pictures, 0 to 255.
fn apart(a: &ds_raster::RgbImage, b: &ds_raster::RgbImage) -> f64 {
    let sum: f64 = a.rgb().iter().zip(b.rgb()).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
    sum / a.rgb().len() as f64
}

#[test]
fn a_picture_of_the_log_is_warped_to_where_the_ego_is() {
    let mut scene = street::scene();
    let (agents, ticks) = (street::world().agents, scene.ego_log.len());
    let track = |agent: &AgentState| {
        let AgentState { class, size, pose, z_m, velocity_mps, .. } = *agent;
        let points = vec![Some(TrackPoint { pose, z_m, velocity_mps }); ticks];
        Track { name: format!("{}", agent.id.0), class, size, points }
    };
    scene.tracks = agents.iter().map(track).collect();
    let scene = Arc::new(scene);
    let reference = ReferenceCamera::new(&scene, Appearance::DAY);
    let (camera, rig) = (street::camera(160, 96), |pose: &PoseSe2| pose.world_from_rig(0.0));
    let warp = ReprojectedCamera::new(Arc::clone(&scene), Appearance::DAY);
    let logged = scene.logged_world(ds_space::Tick(0));
    let here = reference.render(&logged, &camera, rig(&logged.ego.pose)).expect("the size is sound");
    // From the log's own place the picture is nearly the camera's own.
    let same = warp.render(&logged, &camera, rig(&logged.ego.pose)).expect("the size is sound");
    assert_eq!(same, warp.render(&logged, &camera, rig(&logged.ego.pose)).expect("the size is sound"));
    assert!(apart(&same, &here) < 4.0, "{}", apart(&same, &here));
    // Beside it, the warped picture is nearer to what a camera there sees than to what the log saw.
    let moved = logged.ego.pose.compose(&PoseSe2::new(0.0, 1.0, 0.09));
    let there = reference.render(&logged, &camera, rig(&moved)).expect("the size is sound");
    let warped = warp.render(&logged, &camera, rig(&moved)).expect("the size is sound");
    assert!(apart(&warped, &there) < 0.5 * apart(&here, &there), "{} {}", apart(&warped, &there), apart(&here, &there));
    // Who moved meanwhile is shown where he is now, and who is gone is not shown.
    let (mut gone, mut aside) = (logged.clone(), logged.clone());
    gone.agents.clear();
    for agent in &mut aside.agents {
        agent.pose.position += DVec2::new(0.5, 1.5);
    }
    let [there, warped, empty] = [
        reference.render(&aside, &camera, rig(&logged.ego.pose)),
        warp.render(&aside, &camera, rig(&logged.ego.pose)),
        warp.render(&gone, &camera, rig(&logged.ego.pose)),
    ]
    .map(|picture| picture.expect("the size is sound"));
    assert!(apart(&empty, &same) > 0.5, "{}", apart(&empty, &same));
    assert!(apart(&warped, &there) < apart(&same, &there), "{} {}", apart(&warped, &there), apart(&same, &there));
}

#[test]
fn an_ego_that_falls_behind_its_log_is_still_shown_the_road() {
    let mut scene = street::scene();
    let start = scene.ego_log[0];
    let along = |tick: u32| PoseSe2::new(f64::from(tick), 0.0, 0.0);
    scene.ego_log = (0..60).map(|tick| EgoState { pose: start.pose.compose(&along(tick)), ..start }).collect();
    let scene = Arc::new(scene);
    let (camera, late) = (street::camera(160, 96), ds_space::Tick(50));
    let world = WorldState { ego: scene.ego_log[20], ..scene.logged_world(late) };
    let rig = world.ego.pose.world_from_rig(0.0);
    let warp = ReprojectedCamera::new(Arc::clone(&scene), Appearance::DAY);
    let warped = warp.render(&world, &camera, rig).expect("the size is sound");
    let there = ReferenceCamera::new(&scene, Appearance::DAY).render(&world, &camera, rig).expect("the size is sound");
    assert!(apart(&warped, &there) < 6.0, "{}", apart(&warped, &there));
}
