//! Milliseconds per layout picture, median of many, on a large map with sixty agents:
//! `cargo bench -p ds-layout --profile dev`.

#[path = "../tests/scenes/city.rs"]
mod city;
#[path = "../tests/scenes/street.rs"]
#[expect(dead_code, reason = "the benchmark needs the camera and the small scene alone")]
mod street;

use std::hint::black_box;
use std::time::Instant;

use ds_layout::{BackendChoice, LayoutScene, Renderer, StaticMap};
use ds_space::PoseSe2;

fn main() {
    let mut report = String::new();
    for choice in [BackendChoice::Cpu, BackendChoice::Wgpu] {
        let mut renderer = match Renderer::new(choice) {
            Ok(renderer) => renderer,
            Err(error) => {
                report += &format!("{choice:?}: skipped: {error}\n");
                continue;
            }
        };
        for (name, map, world) in
            [("street", street::map(), street::world()), ("city", city::map(), city::world())]
        {
            let start = Instant::now();
            let map = StaticMap::new(&map);
            let prepared_ms = start.elapsed().as_secs_f64() * 1e3;
            let scene = LayoutScene { map: &map, world: &world };
            for (width, height) in [(160, 96), (832, 480)] {
                let camera = street::camera(width, height);
                let mut times: Vec<f64> = (0..101)
                    .map(|i| {
                        let rig = PoseSe2::new(0.1 * f64::from(i), -1.75, 0.0).world_from_rig(0.0);
                        let start = Instant::now();
                        black_box(renderer.render(&scene, &camera, rig).expect("the size is sound"));
                        start.elapsed().as_secs_f64() * 1e3
                    })
                    .collect();
                times.sort_by(f64::total_cmp);
                report += &format!(
                    "{}: {name} {width}×{height}: {:.2} ms median, {:.2} ms least (map prepared in {prepared_ms:.1} ms)\n",
                    renderer.describe(), times[50], times[0],
                );
            }
        }
    }
    std::io::Write::write_all(&mut std::io::stdout(), report.as_bytes()).expect("the report can be written");
}
