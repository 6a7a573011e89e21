//! Pictures of a hand-made street: against golden files, between the two back ends, and by law.
//!
//! Tolerances: golden, at most 0.5 % of the pixels differ; `cpu` against `wgpu`, at least 99 % of the pixels lie within
//! 8/255 in every channel. `UPDATE_GOLDEN=1 cargo test -p ds-layout` rewrites the golden files.

use std::path::{Path, PathBuf};

use ds_layout::{LayoutBackend, LayoutScene, Renderer, Shot, StaticMap, colour};
use ds_raster::{Encoding, RgbImage};
use ds_space::{AgentId, CameraModel, DVec2, DVec3, Intrinsics, PoseSe2};
use ds_world::{AgentClass, AgentState, Map, Size, Structure, StructureKind, WorldState};

fn cpu() -> Renderer {
    Renderer::new(LayoutBackend::Cpu).expect("the cpu back end needs nothing")
}

fn render(renderer: &mut Renderer, world: &WorldState, camera: &CameraModel) -> RgbImage {
    render_map(renderer, &crate::street::map(), world, camera)
}

/// Returns the street with a house on its left, a tree on its right and a wall across it, 70 m ahead.
fn built_up() -> Map {
    let stand = |kind, corners: &[(f64, f64)], (bottom_m, top_m)| {
        let outline = corners.iter().map(|corner| DVec2::from(*corner)).collect();
        Structure { kind, outline, bottom_m, top_m }
    };
    let crown: Vec<(f64, f64)> =
        (0..6).map(|i| (f64::from(i) * 1.047).sin_cos()).map(|(s, c)| (16.0 + c, s - 7.0)).collect();
    let structures = vec![
        stand(StructureKind::Building, &[(14.0, 6.0), (24.0, 6.0), (24.0, 14.0), (14.0, 14.0)], (0.0, 9.0)),
        stand(StructureKind::Vegetation, &crown, (2.0, 5.0)),
        stand(StructureKind::Wall, &[(70.0, -8.0), (71.0, -8.0), (71.0, 8.0), (70.0, 8.0)], (0.0, 3.0)),
    ];
    Map { structures, ..crate::street::map() }
}

fn render_map(renderer: &mut Renderer, map: &Map, world: &WorldState, camera: &CameraModel) -> RgbImage {
    let map = StaticMap::new(map);
    let scene = LayoutScene { map: &map, world };
    renderer.render(&scene, camera, crate::street::ego().world_from_rig(0.0)).expect("the picture's size is sound")
}

/// Returns the share of pixels that differ by more than `limit` in a channel.
fn share_apart(a: &RgbImage, b: &RgbImage, limit: u8) -> f64 {
    assert_eq!((a.width_px(), a.height_px()), (b.width_px(), b.height_px()));
    let apart = |(x, y): (&[u8], &[u8])| x.iter().zip(y).any(|(x, y)| x.abs_diff(*y) > limit);
    let count = a.rgb().chunks(3).zip(b.rgb().chunks(3)).filter(|pair| apart(*pair)).count();
    count as f64 / (a.rgb().len() / 3) as f64
}

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
}

fn check_golden(name: &str, image: &RgbImage) {
    let path = golden(name);
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        let bytes = image.encode(Encoding::Png).expect("a small picture encodes");
        std::fs::create_dir_all(path.parent().expect("the file has a folder")).expect("the folder can be made");
        std::fs::write(&path, bytes).expect("the golden file can be written");
        return;
    }
    let bytes = std::fs::read(&path).expect("the golden file is in the repository");
    let expected = RgbImage::decode(Encoding::Png, image.width_px(), image.height_px(), &bytes).expect("it is a PNG");
    let apart = share_apart(image, &expected, 0);
    assert!(apart <= 0.005, "{name}: {:.2} % of the pixels differ", 100.0 * apart);
}

fn fisheye() -> CameraModel {
    let camera = crate::street::camera(160, 96);
    CameraModel { intrinsics: Intrinsics { k1: -0.18, k2: 0.02, ..camera.intrinsics }, ..camera }
}

#[test]
fn the_street_looks_as_it_did() {
    check_golden("street_160.png", &render(&mut cpu(), &crate::street::world(), &crate::street::camera(160, 96)));
    check_golden("street_fisheye_160.png", &render(&mut cpu(), &crate::street::world(), &fisheye()));
}

#[test]
fn both_back_ends_agree() {
    let mut wgpu = match Renderer::new(LayoutBackend::Wgpu) {
        Ok(renderer) => renderer,
        Err(error) => {
            eprintln!("skipped: {error}");
            return;
        }
    };
    eprintln!("compared with {}", wgpu.describe());
    for camera in [crate::street::camera(160, 96), crate::street::camera(333, 200), fisheye()] {
        let (a, b) =
            (render(&mut cpu(), &crate::street::world(), &camera), render(&mut wgpu, &crate::street::world(), &camera));
        let apart = share_apart(&a, &b, 8);
        assert!(apart <= 0.01, "{}×{}: {:.2} % differ", a.width_px(), a.height_px(), 100.0 * apart);
        let built = |renderer: &mut Renderer| render_map(renderer, &built_up(), &crate::street::world(), &camera);
        let apart = share_apart(&built(&mut cpu()), &built(&mut wgpu), 8);
        assert!(apart <= 0.01, "built up: {:.2} % differ", 100.0 * apart);
    }
}

#[test]
fn structures_cover_what_is_behind_them_and_change_nothing_else() {
    let camera = crate::street::camera(160, 96);
    let truck = |x_m: f64| with_agents(vec![agent(AgentClass::Vehicle, x_m, -1.75)]);
    let seen = |map: &Map, x_m: f64| {
        let image = render_map(&mut cpu(), map, &truck(x_m), &camera);
        let pixels: Vec<[u8; 3]> = image.rgb().as_chunks::<3>().0.to_vec();
        pixels
    };
    let users = |pixels: &[[u8; 3]]| pixels.iter().filter(|rgb| colour::is_road_user(**rgb)).count();
    let (bare, built) = (seen(&crate::street::map(), 60.0), seen(&built_up(), 60.0));
    let covered = built.iter().filter(|rgb| colour::is_structure(**rgb)).count();
    assert!((1_000..8_000).contains(&covered), "{covered} pixels show structures");
    assert!(bare.iter().zip(&built).all(|(bare, built)| bare == built || colour::is_structure(*built)));
    assert_eq!(users(&built), users(&bare), "nothing stands before a vehicle at 60 m");
    let (bare, built) = (seen(&crate::street::map(), 80.0), seen(&built_up(), 80.0));
    assert!(users(&bare) > 0 && users(&built) == 0, "the wall at 70 m hides a vehicle at 80 m");
}

#[test]
fn a_batch_is_the_pictures_one_by_one() {
    for choice in [LayoutBackend::Cpu, LayoutBackend::Wgpu] {
        let mut renderer = match Renderer::new(choice) {
            Ok(renderer) => renderer,
            Err(error) => {
                eprintln!("skipped: {error}");
                continue;
            }
        };
        let (map, world) = (StaticMap::new(&crate::street::map()), crate::street::world());
        let cameras = [crate::street::camera(160, 96), crate::street::camera(64, 40), fisheye()];
        let world_from_rig = crate::street::ego().world_from_rig(0.0);
        let scene = LayoutScene { map: &map, world: &world };
        let shots: Vec<Shot> = cameras.iter().map(|camera| Shot { scene, camera, world_from_rig }).collect();
        let batch = renderer.render_batch(&shots).expect("the sizes are sound");
        for (image, camera) in batch.iter().zip(&cameras) {
            assert_eq!(image, &render(&mut renderer, &world, camera));
        }
    }
}

fn agent(class: AgentClass, x_m: f64, y_m: f64) -> AgentState {
    let size = Size { length_m: 4.0, width_m: 2.0, height_m: 1.8 };
    AgentState { id: AgentId(0), class, size, pose: PoseSe2::new(x_m, y_m, 0.0), z_m: 0.0, velocity_mps: DVec2::ZERO }
}

fn with_agents(agents: Vec<AgentState>) -> WorldState {
    WorldState { agents, ..crate::street::world() }
}

#[test]
fn what_is_behind_the_camera_is_not_drawn() {
    let camera = crate::street::camera(160, 96);
    let empty = render(&mut cpu(), &with_agents(vec![]), &camera);
    for (x_m, y_m) in [(-8.0, -1.75), (-3.0, 3.0), (-60.0, -1.75), (300.0, -1.75)] {
        let image = render(&mut cpu(), &with_agents(vec![agent(AgentClass::Vehicle, x_m, y_m)]), &camera);
        assert_eq!(image, empty, "an agent at ({x_m}, {y_m}) was drawn");
    }
}

#[test]
fn the_nearer_box_hides_the_farther_one_whatever_their_order() {
    let (near, far) = (agent(AgentClass::Vehicle, 12.0, -1.75), agent(AgentClass::Cyclist, 20.0, -1.75));
    let camera = crate::street::camera(160, 96);
    let one = render(&mut cpu(), &with_agents(vec![near.clone(), far.clone()]), &camera);
    let other = render(&mut cpu(), &with_agents(vec![far, near]), &camera);
    assert_eq!(one, other);
    let rear = colour::face(colour::agent(AgentClass::Vehicle), colour::Face::Rear);
    assert_eq!(one.pixel(80, 52), rear);
}

#[test]
fn a_box_stands_where_the_camera_model_says() {
    for camera in [crate::street::camera(160, 96), fisheye()] {
        let car = agent(AgentClass::Barrier, 25.0, 2.0);
        let image = render(&mut cpu(), &with_agents(vec![car]), &camera);
        let world_from_camera = crate::street::ego().world_from_rig(0.0) * camera.rig_from_camera;
        let middle = world_from_camera.inverse() * DVec3::new(23.0, 2.0, 0.9);
        let pixel = camera.intrinsics.project(middle).expect("the box is ahead");
        let found = image.pixel(pixel.x as u32, pixel.y as u32);
        assert_eq!(found, colour::face(colour::agent(AgentClass::Barrier), colour::Face::Rear));
    }
}

#[test]
fn a_mirrored_scene_gives_the_mirrored_picture() {
    let flip = |p: &DVec2| DVec2::new(p.x, -3.5 - p.y);
    let (mut map, mut world) = (crate::street::map(), crate::street::world());
    let flip_all = |points: &mut Vec<DVec2>| points.iter_mut().for_each(|p| *p = flip(p));
    map.drivable.iter_mut().chain(&mut map.junctions).for_each(flip_all);
    map.crosswalks.iter_mut().for_each(|c| flip_all(&mut c.polygon));
    map.line_markings.iter_mut().for_each(|line| flip_all(&mut line.points));
    map.road_edges.iter_mut().for_each(|edge| flip_all(&mut edge.points));
    map.stop_lines.iter_mut().for_each(|line| line.points.iter_mut().for_each(|p| *p = flip(p)));
    for lane in &mut map.lanes {
        flip_all(&mut lane.polygon);
        flip_all(&mut lane.centre_line);
    }
    for light in &mut map.traffic_lights {
        light.position.y = -3.5 - light.position.y;
        light.facing_rad = -light.facing_rad;
    }
    for agent in &mut world.agents {
        agent.pose.position = flip(&agent.pose.position);
        agent.pose.heading_rad = -agent.pose.heading_rad;
    }
    let camera = crate::street::camera(160, 96);
    let mirrored_map = StaticMap::new(&map);
    let scene = LayoutScene { map: &mirrored_map, world: &world };
    let mirrored = cpu().render(&scene, &camera, crate::street::ego().world_from_rig(0.0)).expect("the size is sound");
    let straight = render(&mut cpu(), &crate::street::world(), &camera);
    let mut flipped = mirrored.clone();
    for y in 0..96 {
        for x in 0..160 {
            flipped.set_pixel(x, y, mirrored.pixel(159 - x, y));
        }
    }
    let apart = share_apart(&flipped, &straight, 0);
    assert!(apart < 0.005, "{:.2} % differ", 100.0 * apart);
}

#[test]
fn light_states_show_at_the_head_and_at_the_stop_line() {
    use ds_world::LightState::{Green, Red, Unknown, Yellow};
    for state in [Red, Yellow, Green, Unknown] {
        let world = WorldState { lights: vec![state], ..with_agents(vec![]) };
        let map = StaticMap::new(&crate::street::map());
        let scene = LayoutScene { map: &map, world: &world };
        let before_the_line = PoseSe2::new(17.0, -1.75, 0.0).world_from_rig(0.0);
        let image = cpu().render(&scene, &crate::street::camera(320, 192), before_the_line).expect("the size is sound");
        let shown = colour::light(state);
        let head = colour::face(shown, colour::Face::Front);
        for wanted in [shown, head] {
            assert!(image.rgb().chunks(3).any(|pixel| pixel == wanted), "{state:?} does not show");
        }
    }
}

#[test]
fn a_picture_that_is_too_large_is_refused() {
    let map = StaticMap::new(&crate::street::map());
    let (world, camera) = (crate::street::world(), crate::street::camera(1 << 20, 4));
    let refused =
        cpu().render(&LayoutScene { map: &map, world: &world }, &camera, crate::street::ego().world_from_rig(0.0));
    assert!(refused.is_err());
}
