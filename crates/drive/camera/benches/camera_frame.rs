//! Milliseconds (processor time) per picture of the reference and plain cameras, median of many, on a large map with sixty agents:
//! `cargo bench -p ds-camera --profile dev`.

#[path = "../../layout/tests/scenes/city.rs"]
mod city;
#[path = "../../layout/tests/scenes/street.rs"]
mod street;

use std::hint::black_box;
use std::time::Instant;

use ds_camera::{Appearance, LabelledCamera, PlainCamera, ReferenceCamera, Sampling, SceneCamera};
use ds_space::PoseSe2;
use ds_world::Scene;

/// Returns milliseconds spent on the processor by this thread, or of wall time where Linux does not say.
///
/// Processor time is what a shared machine can still measure; threads of a graphics driver are not in it.
fn now_ms(start: Instant) -> f64 {
    let spent = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanos = spent.as_deref().and_then(|text| text.split(' ').next()).and_then(|word| word.parse::<f64>().ok());
    nanos.map_or_else(|| start.elapsed().as_secs_f64() * 1e3, |nanos| nanos * 1e-6)
}

fn median_ms(mut render: impl FnMut(f64)) -> (f64, f64) {
    let began = Instant::now();
    let mut times: Vec<f64> = (0..101)
        .map(|i| {
            let start = now_ms(began);
            render(0.1 * f64::from(i));
            now_ms(began) - start
        })
        .collect();
    times.sort_by(f64::total_cmp);
    (times[50], times[0])
}

fn main() {
    let began = Instant::now();
    let mut report = String::new();
    let camera = street::camera(160, 96);
    let rig = |x_m: f64| PoseSe2::new(x_m, street::ego().position.y, 0.0).world_from_rig(0.0);
    let street_scene = street::scene();
    let city_scene = Scene { map: city::map(), ..street::scene() };
    for (name, scene, world) in [("street", street_scene, street::world()), ("city", city_scene, city::world())] {
        let start = now_ms(began);
        let smooth = ReferenceCamera::new(&scene, Appearance::DAY);
        let prepared_ms = now_ms(began) - start;
        let single = smooth.clone().with_sampling(Sampling::Single);
        let plain = PlainCamera::new(&scene);
        let mut line = |what: &str, (median, least): (f64, f64)| {
            report += &format!("{name} 160×96 {what}: {median:.2} ms median, {least:.2} ms least\n");
        };
        line("reference, smooth", median_ms(|x| drop(black_box(smooth.render(&world, &camera, rig(x))))));
        line("reference, single", median_ms(|x| drop(black_box(single.render(&world, &camera, rig(x))))));
        line("plain", median_ms(|x| drop(black_box(plain.render(&world, &camera, rig(x))))));
        line("classes", median_ms(|x| drop(black_box(smooth.classes(&world, &camera, rig(x))))));
        report += &format!("{name}: prepared in {prepared_ms:.1} ms\n");
    }
    std::io::Write::write_all(&mut std::io::stdout(), report.as_bytes()).expect("the report can be written");
}
