//! Milliseconds (processor time) per layout picture, median of many, on a large map with sixty agents:
//! `cargo bench -p ds-layout --profile dev`.

#[path = "../tests/scenes/city.rs"]
mod city;
#[path = "../tests/scenes/street.rs"]
#[expect(dead_code, reason = "the benchmark needs the camera and the small scene alone")]
mod street;

use std::hint::black_box;
use std::time::Instant;

use ds_layout::{LayoutBackend, LayoutScene, Renderer, StaticMap};
use ds_space::PoseSe2;

/// Returns milliseconds spent on the processor by this thread, or of wall time where Linux does not say.
///
/// Processor time is what a shared machine can still measure; threads of a graphics driver are not in it.
fn now_ms(start: Instant) -> f64 {
    let spent = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanos = spent.as_deref().and_then(|text| text.split(' ').next()).and_then(|word| word.parse::<f64>().ok());
    nanos.map_or_else(|| start.elapsed().as_secs_f64() * 1e3, |nanos| nanos * 1e-6)
}

fn main() {
    let began = Instant::now();
    let mut report = String::new();
    for choice in [LayoutBackend::Cpu, LayoutBackend::Wgpu] {
        let mut renderer = match Renderer::new(choice) {
            Ok(renderer) => renderer,
            Err(error) => {
                report += &format!("{choice:?}: skipped: {error}\n");
                continue;
            }
        };
        for (name, map, world) in [("street", street::map(), street::world()), ("city", city::map(), city::world())] {
            let start = now_ms(began);
            let map = StaticMap::new(&map);
            let prepared_ms = now_ms(began) - start;
            let scene = LayoutScene { map: &map, world: &world };
            for (width, height) in [(160, 96), (832, 480)] {
                let camera = street::camera(width, height);
                let mut times: Vec<f64> = (0..101)
                    .map(|i| {
                        let rig = PoseSe2::new(0.1 * f64::from(i), -1.75, 0.0).world_from_rig(0.0);
                        let start = now_ms(began);
                        black_box(renderer.render(&scene, &camera, rig).expect("the size is sound"));
                        now_ms(began) - start
                    })
                    .collect();
                times.sort_by(f64::total_cmp);
                report += &format!(
                    "{}: {name} {width}×{height}: {:.2} ms median, {:.2} ms least (map prepared in {prepared_ms:.1} ms)\n",
                    renderer.describe(),
                    times[50],
                    times[0],
                );
            }
        }
    }
    std::io::Write::write_all(&mut std::io::stdout(), report.as_bytes()).expect("the report can be written");
}
